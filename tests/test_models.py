"""BSDFs, phase functions and lights by themselves; arithmetic of pictures; the examples of docs/python.md."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from statistics_tools import generator

import lajolla


def directions(count: int, name: str) -> np.ndarray:
    found = generator(name).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def test_a_diffuse_bsdf_is_lamberts() -> None:
    bsdf = lajolla.Bsdf({"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": [0.1, 0.4, 0.9]}})
    wi = directions(200, "lambert")
    cosine = np.maximum(wi[:, 2], 0)
    assert np.allclose(bsdf.eval((0, 0, 2), wi), cosine[:, None] * [0.1, 0.4, 0.9] / np.pi, atol=1e-6)
    assert np.allclose(bsdf.pdf((0, 0.6, 0.8), wi), cosine / np.pi, atol=1e-6)
    samples = bsdf.sample((0, 0, 1), 50, seed=2)
    assert samples.valid.all()
    assert np.allclose(samples.weight, [0.1, 0.4, 0.9], atol=1e-5)
    assert np.array_equal(samples.wi, bsdf.sample((0, 0, 1), 50, seed=2).wi)
    assert not np.array_equal(samples.wi, bsdf.sample((0, 0, 1), 50, seed=3).wi)


@pytest.mark.parametrize("name", ["roughconductor", "principled", "hair", "roughdielectric"])
def test_weights_are_value_over_density(name: str) -> None:
    bsdf = lajolla.Bsdf({"type": name})
    samples = bsdf.sample((0.6, 0, 0.8), 500, seed=1)
    kept = samples.valid & ~samples.delta
    wi = samples.wi[kept]
    values, density = bsdf.eval((0.6, 0, 0.8), wi), bsdf.pdf((0.6, 0, 0.8), wi)
    assert kept.sum() > 300
    assert np.allclose(density, samples.pdf[kept], rtol=2e-3)
    assert np.allclose(values / density[:, None], samples.weight[kept], rtol=5e-3, atol=1e-5)


def test_phase_functions_are_their_densities() -> None:
    phase = lajolla.Phase({"type": "hg", "g": 0.6})
    wi, density = phase.sample((0, 0, 1), 2000, seed=4)
    assert np.allclose(phase.eval((0, 0, 1), wi), density, rtol=1e-4)
    deflection = -wi[:, 2]  # the cosine to the direction of light that is not deflected
    expected = (1 - 0.36) / (1 + 0.36 - 1.2 * deflection) ** 1.5 / (4 * np.pi)
    assert np.allclose(density, expected, rtol=1e-3)
    assert abs(deflection.mean() - 0.6) < 5 * deflection.std() / np.sqrt(2000)


def test_lights_are_seen_from_points() -> None:
    shape = {"type": "sphere", "center": [0, 3, 0], "emitter": {"type": "area", "radiance": [1, 2, 3]}}
    light = lajolla.Light(shape)
    samples = light.sample((0, 0, 0), 100, seed=1)
    assert samples.visible.all() and not samples.delta.any()
    assert np.allclose(samples.radiance, [1, 2, 3])
    solid_angle = 2 * np.pi * (1 - np.sqrt(1 - 1 / 9))
    assert np.allclose(samples.pdf, 1 / solid_angle, rtol=1e-4)
    assert np.allclose(light.pdf((0, 0, 0), samples.wi), 1 / solid_angle, rtol=1e-4)
    assert np.allclose(light.eval((0, 0, 0), [[0, 1, 0], [0, -1, 0]]), [[1, 2, 3], [0, 0, 0]])
    lamp = lajolla.Light({"type": "point", "position": [0, 2, 0], "intensity": 8})
    assert np.allclose(lamp.sample((0, 0, 0), 3).radiance, 2)
    assert lamp.sample((0, 0, 0), 3).delta.all()


@pytest.mark.parametrize(
    ("model", "description", "message"),
    [
        (lajolla.Bsdf, {"type": "mask", "bsdf": {"type": "diffuse"}}, "no blend, mask"),
        (
            lajolla.Bsdf,
            {"type": "diffuse", "reflectance": {"type": "checkerboard"}},
            "textures must be const",
        ),
        (lajolla.Bsdf, {"type": "diffues"}, "diffues"),
        (lajolla.Phase, {"type": "hg", "g": "forward"}, "expects a number"),
        (lajolla.Light, {"type": "sphere"}, "is an emitter"),
    ],
)
def test_what_is_no_model_is_refused(model: Any, description: dict[str, Any], message: str) -> None:  # noqa: ANN401
    with pytest.raises(lajolla.SceneError, match=message):
        model(description)


def test_wrong_directions_are_refused() -> None:
    bsdf = lajolla.Bsdf({"type": "diffuse"})
    with pytest.raises(ValueError, match=r"shape \(N, 3\)"):
        bsdf.eval((0, 1), (0, 0, 1))
    with pytest.raises(ValueError, match="no length"):
        bsdf.eval((0, 0, 0), (0, 0, 1))
    with pytest.raises(lajolla.OptionError, match="whole number"):
        bsdf.sample((0, 0, 1), 0.5)


def test_samples_that_are_not_valid_have_the_value_zero() -> None:
    bsdf = lajolla.Bsdf({"type": "roughconductor", "alpha": 0.9, "multiscatter": False})
    wo = (0.95, 0, 0.1)
    samples = bsdf.sample(wo, 1000)
    assert not samples.valid.all()
    values, density = bsdf.eval(wo, samples.wi), bsdf.pdf(wo, samples.wi)
    assert not values[~samples.valid].any()
    assert not density[~samples.valid].any()
    kept = samples.valid
    assert np.allclose(values[kept], samples.weight[kept] * samples.pdf[kept, None], rtol=1e-3)
    assert lajolla.Phase({"type": "hg"}).eval((0, 0, 1), (0, 0, 0)).tolist() == [0]
    assert samples == samples


def test_models_warn_as_scenes_do() -> None:
    for model, description, message in (
        (lajolla.Bsdf, {"type": "roughconductor", "alpha": -1}, "below 0"),
        (lajolla.Bsdf, {"type": "diffuse", "reflectance": 3}, "above 1"),
        (lajolla.Phase, {"type": "hg", "g": 1.8}, "above 0.999"),
    ):
        with pytest.warns(lajolla.SceneWarning, match=message) as caught:
            made = model(description)
        assert len(caught) == 1
        assert description["type"] in repr(made)
    with pytest.raises(lajolla.SceneError, match='expected a bsdf, got the phase "hg"'):
        lajolla.Bsdf({"type": "hg"})


# Pictures


def test_pictures_are_added_and_scaled() -> None:
    a = lajolla.Image(np.full((2, 3, 3), 0.25), {"A": np.ones((2, 3))})
    b = lajolla.Image(np.full((2, 3, 3), 0.5))
    for result, expected in (
        (a + b, 0.75),
        (2 * a, 0.5),
        (a - 1, -0.75),
        (np.ones((2, 3, 1)) - a, 0.75),
        (1 / b, 2.0),
        (b**2, 0.25),
        (abs(-a), 0.25),
        (a * np.array([1.0, 1.0, 1.0]), 0.25),
        (np.float32(2) * a, 0.5),
    ):
        assert isinstance(result, lajolla.Image)
        assert np.allclose(result.array, expected)
        assert result.channels == {}
    assert float(np.mean(a)) == 0.25
    with pytest.raises(ValueError, match="broadcast"):
        a + np.ones((5, 5))


def test_pictures_for_screens() -> None:
    image = lajolla.Image(np.full((2, 2, 3), 0.5, np.float32))
    assert image.to_srgb().tolist() == np.full((2, 2, 3), 188).tolist()
    assert image.to_srgb(exposure=1)[0, 0, 0] == 255
    png = lajolla.Image.open(io.BytesIO(image._repr_png_()))
    assert np.allclose(png.array, 0.5, atol=0.01)


def test_plots() -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    depth = np.linspace(0, 1, 6).reshape(2, 3)
    channels = {f"normal.{letter}": depth for letter in "xyz"} | {
        "depth.Z": depth,
        "uv.U": depth,
        "uv.V": depth,
    }
    image = lajolla.Image(np.ones((2, 3, 3)), channels)
    for layer in ("rgb", "depth", "normal", "uv"):
        axes = image.plot(layer)
        shown = axes.images[0].get_array()
        assert shown.shape[:2] == (2, 3)
        assert len(axes.figure.axes) == (2 if layer == "depth" else 1)
        pyplot.close(axes.figure)
    with pytest.raises(lajolla.ImageError, match="did you mean 'depth'"):
        image.plot("dept")


# The documentation


def test_twelve_tasks_take_five_lines(
    repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "scenes").symlink_to(repository / "scenes")
    monkeypatch.chdir(tmp_path)
    text = (repository / "docs" / "python.md").read_text()
    examples = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert [int(n) for n in re.findall(r"^(\d+)\. ", text, re.MULTILINE)] == list(range(1, 13))
    names: dict[str, Any] = {}
    for example in examples:
        lines = [line for line in example.splitlines() if line and line != "import asyncio"]
        assert len(lines) <= 5, example
        exec(compile(example, "python.md", "exec"), names)
    assert names["hits"].hit.mean() > 0.5
    assert 0.4 < names["best"] < 0.6
    assert names["ball"].sum() > 50
    expected = 2 * np.pi / 9  # radiance times the projected solid angle of the sphere
    assert np.allclose(names["irradiance"], expected, rtol=0.05)
