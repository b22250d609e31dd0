"""What Python callers may pass by mistake is answered, or refused with a clear message."""

from __future__ import annotations

import copy
import pickle
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scene_tools import make_scene
from statistics_tools import generator
from test_params import ROOM, loaded

import lajolla
from lajolla import _core

DOWN = ((1, 3, 1.5), (0, -1, 0))
HUGE = 1e300


# Rays


@pytest.mark.parametrize("far", [np.nan, None, [1.0, np.nan], [None], "far", np.ones((2, 2)), 1j])
@pytest.mark.parametrize("ask", [lajolla.Scene.intersect, lajolla.Scene.occluded])
def test_ends_of_rays_are_numbers(ask: Callable[..., object], far: Any) -> None:  # noqa: ANN401
    with pytest.raises(ValueError, match="max_distance"):
        ask(loaded(ROOM), *DOWN, far)


@pytest.mark.parametrize("part", range(2))
def test_rays_are_numbers(part: int) -> None:
    ray: list[Any] = list(DOWN)
    for wrong in ((0, "up", 0), (None, 0, 1), (1j, 0, 0)):
        ray[part] = wrong
        with pytest.raises(ValueError, match=f"{('origins', 'directions')[part]} must be numbers"):
            loaded(ROOM).intersect(*ray)


def scene_of(kind: str) -> _core.Scene:
    """Something along the negative y axis, in each of the structures that rays are tested with."""
    if kind == "room":
        return loaded(ROOM).core
    ball, balls = {"type": "sphere", "center": [0, -4, 0]}, []
    if kind == "spheres":  # too many to be tested in lanes
        balls = [{**ball, "center": [0, -4 - i, 0]} for i in range(20)]
    elif kind == "curves":
        points = np.float32([[-9, -4, 0, 1], [0, -4, 0, 1], [3, -4, 0, 1], [9, -4, 0, 1]])
        balls = [{"type": "curves", "curves": _core.Curves(points, np.uint32([0]))}, ball]
    groups = {
        "shapes": [ball],
        "groups": [{"shapes": [0]}],
        "instances": [{"group": 0, "to_world": np.eye(4)}],
    }
    return make_scene(**groups) if kind == "instances" else make_scene(shapes=balls)


@pytest.mark.parametrize("kind", ["room", "spheres", "curves", "instances"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, -1.0, -np.float32(1e-40)])
def test_the_core_answers_for_any_end(kind: str, bad: float) -> None:
    """Also in packets with other rays."""
    scene, down = scene_of(kind), np.float32([DOWN[1]])
    origins = np.tile(np.float64(DOWN[0] if kind == "room" else (0, 0, 0)), (40, 1))
    ends = np.full(40, np.inf, np.float32)
    ends[::3] = bad
    expected = np.ones(40, bool)
    expected[::3] = bad == np.inf
    assert np.array_equal(_core.intersect(scene, origins, down, ends)["shape"] >= 0, expected)
    assert np.array_equal(_core.occluded(scene, origins, down, ends), expected)


def test_both_queries_agree_on_every_ray() -> None:
    rng = generator("odd rays")
    odd = np.array([0, -0.0, 1, -1, 1e-45, 1e-20, 1e17, 1e18, 1e19, 1e30, HUGE, np.inf, -np.inf, np.nan])
    origins = np.where(rng.random((4000, 3)) < 0.2, rng.choice(odd, (4000, 3)), rng.uniform(-3, 3, (4000, 3)))
    directions = np.where(rng.random((4000, 3)) < 0.2, rng.choice(odd, (4000, 3)), rng.normal(size=(4000, 3)))
    ends = np.where(rng.random(4000) < 0.5, rng.choice(odd[:-1], 4000), rng.uniform(-5, 5, 4000))
    scene = loaded(ROOM)
    hit = scene.intersect(origins, directions, ends).hit
    assert np.array_equal(hit, scene.occluded(origins, directions, ends))
    refused = (ends < 0) | ~(np.abs(np.hstack([origins, directions])) <= 1e18).all(axis=1)
    assert 0.05 < hit.mean() < 0.5
    assert not hit[refused].any()


def test_rays_far_from_the_origin() -> None:
    """The scene is where float32 resolves half a metre; rays and hits are exact to micrometres."""
    place = np.array([1e7, -3e6, 5e6])
    ball = {"type": "sphere", "center": place.tolist(), "radius": 0.5}
    scene = loaded({**{key: ROOM[key] for key in ("type", "integrator", "camera")}, "ball": ball})
    rng = generator("far rays")
    inward = rng.normal(size=(200, 3))
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    origins = place - 2 * inward
    hits = scene.intersect(origins, inward)
    assert hits.hit.all()
    assert np.allclose(hits.distance, 1.5, atol=1e-5)
    assert hits.position.dtype == np.float64
    assert np.abs(hits.position - (place - 0.5 * inward)).max() < 1e-5
    assert np.allclose(hits.normal, -inward, atol=1e-5)
    assert not scene.occluded(origins, inward, 1.4999).any()
    assert scene.occluded(origins, inward, 1.5001).all()


def test_lights_far_from_the_origin() -> None:
    place = np.array([1e7, -3e6, 5e6])
    emitter = {"type": "area", "radiance": 2.0}
    light = lajolla.Light({"type": "sphere", "center": place.tolist(), "radius": 0.5, "emitter": emitter})
    samples = light.sample(place - [0, 2.25, 0], 100)
    solid_angle = 2 * np.pi * (1 - np.sqrt(1 - (0.5 / 2.25) ** 2))
    assert np.allclose(samples.pdf, 1 / solid_angle, rtol=1e-4)


# Models by themselves


@pytest.mark.parametrize("back", [{"type": "diffuse", "reflectance": [0.7, 0.2, 0.1]}, {"type": "conductor"}])
def test_backs_of_two_sided_bsdfs(back: dict[str, Any]) -> None:
    front = {"type": "roughconductor", "alpha_u": 0.1, "alpha_v": 0.4}
    both = lajolla.Bsdf({"type": "twosided", "first": front, "second": back})
    rng = generator("two-sided")
    wo, wi = rng.normal(size=(2, 300, 3))
    above, turn = wo[:, 2] > 0, np.array([1, -1, -1])
    for name in ("eval", "pdf"):
        alone = [getattr(lajolla.Bsdf(bsdf), name) for bsdf in (front, back)]
        found = getattr(both, name)(wo, wi)
        assert np.array_equal(found[above], alone[0](wo[above], wi[above]))
        assert np.array_equal(found[~above], alone[1](wo[~above] * turn, wi[~above] * turn))
    samples = both.sample(wo, 300, seed=5)
    expected = lajolla.Bsdf(back).sample(wo * turn, 300, seed=5)
    assert np.array_equal(samples.wi[~above], expected.wi[~above] * turn)
    assert np.array_equal(samples.weight[~above], expected.weight[~above])
    assert (samples.wi[samples.valid, 2] * wo[samples.valid, 2] > 0).all()
    below = both.sample((0, 0.6, -0.8), 20, seed=1)
    assert below.valid.all() and (below.wi[:, 2] < 0).all()


def test_a_two_sided_bsdf_is_alike_on_both_sides() -> None:
    bsdf = lajolla.Bsdf({"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": 0.5}})
    assert np.allclose(bsdf.eval((0, 0, -1), [(0, 0, -1), (0, 0, 1)])[:, 0], [0.5 / np.pi, 0])
    one = lajolla.Bsdf({"type": "diffuse"})
    assert not one.eval((0, 0, -1), (0, 0, -1)).any()


def test_backs_that_are_trees_are_refused() -> None:
    mask = {"type": "mask", "opacity": 0.5, "bsdf": {"type": "diffuse"}}
    with pytest.raises(lajolla.SceneError, match="no blend, mask"):
        lajolla.Bsdf({"type": "twosided", "first": {"type": "diffuse"}, "second": mask})


MODELS = (
    lajolla.Bsdf({"type": "twosided", "a": {"type": "plastic"}}),
    lajolla.Phase({"type": "hg", "g": 0.4}),
)
NONE = np.zeros((0, 3))


@pytest.mark.parametrize("model", MODELS)
def test_no_directions_have_no_values(model: Any) -> None:  # noqa: ANN401
    for pair in ((NONE, (0, 0, 1)), ((0, 0, 1), NONE), (NONE, NONE)):
        assert len(model.eval(*pair)) == len(model.pdf(*pair)) == 0
    model.sample(NONE, 0)
    with pytest.raises(ValueError, match="wo and wi have 0 and 2 rows"):
        model.eval(NONE, np.ones((2, 3)))
    with pytest.raises(ValueError, match="wo has 2 rows, not 1 or as many as samples, 3"):
        model.sample(np.ones((2, 3)), 3)


@pytest.mark.parametrize("model", MODELS)
def test_directions_of_any_length(model: Any) -> None:  # noqa: ANN401
    wi = (0.36, 0.48, 0.8)
    for length in (1e-300, 1e-30, 1e30, HUGE):
        assert np.allclose(model.eval((0, 0, length), np.multiply(wi, length)), model.eval((0, 0, 1), wi))
    for wrong in (np.nan, np.inf):
        with pytest.raises(ValueError, match="a direction is not finite"):
            model.eval((0, 0, wrong), wi)


@pytest.mark.parametrize("seed", [None, "x", 0.5, -1])
def test_seeds_of_samples(seed: Any) -> None:  # noqa: ANN401
    with pytest.raises(lajolla.OptionError, match="seed must be"):
        MODELS[0].sample((0, 0, 1), 2, seed=seed)


@pytest.mark.parametrize("x", [np.nan, np.inf, 1e30])
def test_points_are_finite(x: float) -> None:
    light = lajolla.Light({"type": "point"})
    for ask in (light.eval, light.pdf):
        with pytest.raises(ValueError, match="a point is three numbers"):
            ask((x, 0, 0), (0, 0, 1))
    with pytest.raises(ValueError, match="a point is three numbers"):
        light.sample((x, 0, 0), 1)
    assert np.isfinite(light.sample((1e18, 1e18, 1e18), 3).wi).all()


@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda model: pickle.loads(pickle.dumps(model))]
)
def test_models_are_pickled(copied: Callable[[Any], Any]) -> None:
    wo, wi = generator("pickled models").normal(size=(2, 50, 3))
    grid = {"type": "gridvolume", "grid": np.ones((2, 2, 2), np.float32)}
    for model in (
        *MODELS,
        lajolla.Phase(
            {"type": "blendphase", "weight": grid, "a": {"type": "isotropic"}, "b": {"type": "hg"}}
        ),
    ):
        assert np.array_equal(copied(model).eval(wo, wi), model.eval(wo, wi))
    sky = lajolla.Light({"type": "envmap", "data": np.random.default_rng(1).random((4, 8, 3))})
    assert np.array_equal(copied(sky).eval((0, 0, 0), wi), sky.eval((0, 0, 0), wi))


@pytest.mark.parametrize("model", [lajolla.Bsdf, lajolla.Phase, lajolla.Light])
def test_models_are_described_by_dicts(model: Any) -> None:  # noqa: ANN401
    for wrong in (3, None, "diffuse", []):
        with pytest.raises(TypeError, match="description must be a dict, not"):
            model(wrong)


# Transforms


def test_angles_are_finite_and_axes_of_any_length() -> None:
    for angle in (np.nan, np.inf, -np.inf):
        with pytest.raises(ValueError, match="angle of a rotation must be finite"):
            lajolla.rotate((0, 1, 0), angle)
    wanted = lajolla.rotate((3, 1, -2), 30)
    for length in (5e-324 * 2**60, 1e-200, 1e300):
        assert np.allclose(lajolla.rotate(np.multiply((3, 1, -2), length), 30), wanted, atol=1e-14)
    assert np.isfinite(lajolla.rotate((0, 5e-324, 0), 30)).all()


def test_factors_are_one_or_three() -> None:
    assert np.array_equal(lajolla.scale(2), lajolla.scale((2, 2, 2)))
    for wrong in ((1, 2), np.nan):
        with pytest.raises(ValueError, match="factors must be three finite numbers"):
            lajolla.scale(wrong)


# Options


REFUSED: dict[str, tuple[Callable[[lajolla.Scene], object], type[Exception], str]] = {
    "noise": (lambda s: s.rendering(noise="1%"), lajolla.OptionError, "noise must be a number, not '1%'"),
    "seconds": (lambda s: s.rendering(seconds="3"), lajolla.OptionError, "seconds must be a number, not '3'"),
    "truth": (lambda s: s.rendering(seconds=True), lajolla.OptionError, "seconds must be a number, not True"),
    "adaptive": (lambda s: s.rendering(adaptive="no"), lajolla.OptionError, "adaptive must be True or False"),
    "mixed": (lambda s: s.rendering(mixed="no"), lajolla.OptionError, "mixed must be True or False"),
    "cluster": (lambda s: s.rendering(cluster=3), lajolla.OptionError, "must be an address or a distributed"),
    "denoise": (lambda s: s.render(denoise="no"), lajolla.OptionError, "denoise must be True or False"),
    "values": (lambda s: s.update(3), TypeError, "values must be a dict, not 3"),
    "strict": (lambda s: lajolla.load_dict(ROOM, strict="no"), lajolla.OptionError, "strict must be True or"),
    "two_sided": (lambda s: lajolla.load_dict(ROOM, two_sided=1), lajolla.OptionError, "two_sided must be"),
    "channels": (lambda s: lajolla.Image(np.ones((1, 1, 3)), 3), TypeError, "channels must be a dict, not 3"),
    "features": (lambda s: s.render(spp=1).denoise(3), TypeError, "features must be a dict, not 3"),
    "layer": (lambda s: s.render(spp=1).plot(3), lajolla.ImageError, "there is no layer 3"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_wrong_options_are_refused(name: str) -> None:
    call, error, message = REFUSED[name]
    with pytest.raises(error, match=re.escape(message)):
        call(loaded(ROOM))


def test_wrong_options_of_files(repository: Path) -> None:
    path = repository / "scenes" / "cornell-box.xml"
    for option, error, message in (
        ({"reuse": 3}, TypeError, "reuse must be a Scene, not 3"),
        ({"parameters": 3}, TypeError, "parameters must be a dict, not 3"),
        ({"strict": "no"}, lajolla.OptionError, "strict must be True or False, not 'no'"),
    ):
        with pytest.raises(error, match=message):
            lajolla.load(path, **option)


def test_whole_numbers_of_any_type() -> None:
    scene = {"type": "scene", "sensor": {"type": "perspective"}, "ball": {"type": "sphere"}}
    for size in (np.array([8, 4]), (8.0, 4.0), [np.int16(8), np.float32(4)]):
        loaded = lajolla.load_dict(scene, size=size, spp=np.uint8(2))
        assert loaded.render(spp=1.0).array.shape == (4, 8, 3)
    for size in ((8.5, 4), "84", (8, 4, 2), (True, 4), {8: 1, 4: 1}):
        with pytest.raises(lajolla.OptionError, match="whole number"):
            lajolla.load_dict(scene, size=size)


def test_transforms_name_the_wrong_argument() -> None:
    for origin in ([0, 5], [0, 5, np.nan], "a"):
        with pytest.raises(ValueError, match="origin must be three finite numbers"):
            lajolla.look_at(origin, (0, 0, 0))


def test_missing_files_are_missing_files(tmp_path: Path) -> None:
    for action, kind in (
        (lambda: lajolla.load(tmp_path / "a.xml"), lajolla.SceneError),
        (lambda: lajolla.Image.open(tmp_path / "a.exr"), lajolla.ImageError),
    ):
        with pytest.raises(FileNotFoundError) as caught:
            action()
        assert isinstance(caught.value, kind)
        assert isinstance(caught.value, lajolla.Error)
        assert "no such file" in str(caught.value)


def test_names_of_the_package() -> None:
    assert {name for name in dir(lajolla) if not name.startswith("__")} == set(lajolla.__all__)


def test_features_by_the_names_of_arrays() -> None:
    image, layer = lajolla.Image(np.ones((4, 4, 3))), np.ones((4, 4, 3), np.float32)
    for features, message in (
        ({"foo": layer}, "unknown feature 'foo'"),
        ({"normal": layer}, "needs albedo.R"),
        ({"albedo": layer[..., :2]}, r"has shape \(4, 4, 2\)"),
    ):
        with pytest.raises(lajolla.ImageError, match=message):
            image.denoise(features)
    pytest.importorskip("pyoidn")
    assert set(image.denoise({"albedo": layer, "normal": layer}).channels) >= {"albedo.R", "normal.x"}


def test_colours_of_other_meshes() -> None:
    class Visual:
        kind = "vertex"
        vertex_colors = np.full((3, 4), 188, np.uint8)

    class Mesh:
        vertices, faces, visual = np.eye(3), np.array([[0, 1, 2]]), Visual()

    scene = lajolla.load_dict({"type": "scene", "sensor": {"type": "perspective"}, "mesh": Mesh()})
    assert np.allclose(scene["mesh.vertex_color"], 0.5, atol=0.01)
