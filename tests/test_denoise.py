"""Denoising: what the denoiser is told of a scene, what it does to pictures, and that it loses none."""

from __future__ import annotations

import os
import shlex
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scene_tools import area, batch_means, check_mean, front_view, make_scene, picture, scaling, translation

import lajolla
from lajolla import _core, cli, denoising
from lajolla.comparison import compare
from lajolla.image import Image
from lajolla.render import Progress

Settings = dict[str, Any]
Capture = pytest.CaptureFixture[str]

needs_denoiser = pytest.mark.skipif(
    find_spec("pyoidn") is None, reason="Open Image Denoise is not installed (pyoidn)"
)

FLOOR = {"type": "rectangle", "to_world": scaling(50), "material": 0}
COLOUR = (0.4, 0.8, 0.6)
MATTE = {"type": "diffuse", "reflectance": COLOUR}


def view(
    *shapes: Settings,
    feature: str = "albedo",
    bsdfs: tuple[Settings, ...] = (MATTE,),
    **more: Any,  # noqa: ANN401
) -> _core.Scene:
    """A feature seen by parallel rays along -z; each material has one of the BSDFs, on both sides."""
    materials = more.pop("materials", [{"front": i, "back": i} for i in range(len(bsdfs))])
    return make_scene(
        shapes=shapes,
        bsdfs=bsdfs,
        materials=materials,
        sensor=front_view(3, 1),
        size=(4, 4),
        type="features",
        feature=feature,
        **more,
    )


def seen(scene: _core.Scene, expected: object) -> None:
    """Every sample shows the expected value."""
    np.testing.assert_allclose(picture(scene, 4), np.broadcast_to(expected, (4, 4, 3)), atol=2e-6)


# --- features -----------------------------------------------------------------------------------------------


def test_features_of_a_matte_surface() -> None:
    seen(view(FLOOR), COLOUR)
    seen(view(FLOOR, feature="normal"), (0, 0, 1))


def test_features_of_what_a_mirror_shows() -> None:
    """The colour of the wall times that of the mirror, which turns -z to +x; the normal of the wall."""
    tint = (0.9, 0.5, 0.2)
    mirror = {"type": "conductor", "eta": 0, "k": 1, "specular_reflectance": tint}
    shapes = [
        {"type": "rectangle", "to_world": turned(45) @ scaling(5), "material": 1},
        {"type": "rectangle", "to_world": translation(6, 0, 0) @ turned(-90) @ scaling(50), "material": 0},
    ]
    seen(view(*shapes, bsdfs=(MATTE, mirror)), np.multiply(COLOUR, tint))
    seen(view(*shapes, bsdfs=(MATTE, mirror), feature="normal"), (-1, 0, 0))


def turned(degrees: float) -> np.ndarray:
    """A rotation around y, from z to x."""
    angle = np.radians(degrees)
    result = np.eye(4)
    result[0, 0] = result[2, 2] = np.cos(angle)
    result[0, 2], result[2, 0] = np.sin(angle), -np.sin(angle)
    return result


@pytest.mark.parametrize("sky", [0, 0.5, 7])
def test_features_behind_glass(sky: float) -> None:
    """Fresnel's equations at normal incidence: 4 % of the sky, which is at most 1, and 96 % of the floor.

    Radiance would be larger by the square of the index of refraction inside.
    """
    surface = {"type": "rectangle", "to_world": translation(0, 0, 1) @ scaling(50), "material": 1}
    scene = {"bsdfs": ({"type": "diffuse", "reflectance": 0.3}, {"type": "dielectric", "int_ior": 1.5})}
    if sky:
        scene["emitters"] = [{"type": "constant", "radiance": sky}]
    expected = 0.04 * min(sky, 1) + 0.96 * 0.3
    check_mean(f"sky {sky}", batch_means(view(FLOOR, surface, **scene), 64), expected)
    expected = 0.96 / 3  # the mean of x, y, z; rays to the sky have no normal
    check_mean("normal", batch_means(view(FLOOR, surface, feature="normal", **scene), 64), expected)


def test_features_where_nothing_is() -> None:
    for radiance in (0.25, 3):
        sky = {"emitters": [{"type": "constant", "radiance": radiance}]}
        seen(view(**sky), min(radiance, 1))
        seen(view(feature="normal", **sky), 0)
        seen(view(hide_emitters=True, **sky), 0)
    seen(view(), 0)


def test_features_of_lights() -> None:
    """Their radiance, at most 1, beside what they reflect."""
    lamp = {"type": "rectangle", "to_world": translation(0, 0, 1) @ scaling(5), "material": 0, "emitter": 0}
    seen(view(FLOOR, lamp, emitters=[area(0.125)]), np.add(COLOUR, 0.125))
    seen(view(FLOOR, lamp, emitters=[area(9)]), np.add(COLOUR, 1))
    black = {"type": "diffuse", "reflectance": 0}
    below = {**FLOOR, "material": 1}
    hidden = view(below, lamp, emitters=[area(9)], bsdfs=(black, MATTE), hide_emitters=True)
    seen(hidden, COLOUR)


def test_features_behind_a_mask() -> None:
    """A quarter of a white sheet and three quarters of the floor behind it."""
    sheet = {"type": "rectangle", "to_world": translation(0, 0, 1) @ scaling(5), "material": 1}
    scene = view(
        FLOOR,
        sheet,
        bsdfs=({"type": "diffuse", "reflectance": 0.2}, {"type": "diffuse", "reflectance": 1}),
        adapters=[{"type": "mask", "child": 1, "opacity": 0.25}],
        materials=[{"front": 0}, {"front": {"adapter": 0}}],
    )
    check_mean("mask", batch_means(scene, 64), 0.25 * 1 + 0.75 * 0.2)


def test_features_behind_smoke() -> None:
    """Light that comes through a layer shows the floor, the rest the albedo of the medium."""
    smoke = {"type": "homogeneous", "sigma_t": 0.8, "albedo": 0.5}
    for integrator, expected in (("volpath", 0.2 * np.exp(-1.6) + 0.5 * (1 - np.exp(-1.6))), ("path", 0.2)):
        scene = lajolla.load_dict(
            {
                "type": "scene",
                "integrator": {"type": integrator},
                "sensor": {
                    "type": "orthographic",
                    "to_world": np.diag([0.1, 0.1, 1, 1]) @ translation(0, 0, -3),
                    "film": {"type": "hdrfilm", "width": 4, "height": 4, "rfilter": {"type": "box"}},
                },
                "layer": {"type": "cube", "bsdf": {"type": "null"}, "interior": smoke},
                "floor": {
                    "type": "rectangle",
                    "to_world": translation(0, 0, 3) @ np.diag([9.0, 9, -1, 1]),
                    "bsdf": {"type": "twosided", "inner": {"type": "diffuse", "reflectance": 0.2}},
                },
            }
        )
        albedo = {"integrator": denoising.features_output(scene.description.core["integrator"])["integrator"]}
        check_mean(integrator, batch_means(scene.core.with_output(albedo), 64), expected)


def test_rays_between_mirrors_end() -> None:
    mirror = {"type": "conductor", "eta": 0, "k": 1}
    shapes = [
        {"type": "rectangle", "to_world": translation(0, 0, z) @ scaling(50), "material": 0} for z in (0, 9)
    ]
    seen(view(*shapes, bsdfs=(mirror,)), 1)


def test_features_of_a_blend_belong_together() -> None:
    """Albedo and normal of a sample are those of the same leaf."""
    scene = view(
        FLOOR,
        bsdfs=({"type": "diffuse", "reflectance": 0}, {"type": "diffuse", "reflectance": 1}),
        adapters=[
            {"type": "normalmap", "child": 1, "normalmap": (1, 0.5, 1)},
            {"type": "blendbsdf", "first": 0, "second": {"adapter": 0}, "weight": 0.5},
        ],
        materials=[{"front": {"adapter": 1}}],
    )
    normal = scene.with_output({"integrator": {"type": "features", "feature": "normal"}})
    albedo, normals = picture(scene, 1)[..., 0], picture(normal, 1)
    assert 0 < albedo.mean() < 1
    np.testing.assert_allclose(normals[..., 0], albedo * np.sqrt(0.5), atol=1e-5)


def test_outputs_share_a_scene() -> None:
    """A scene with another output renders what one that was built for it renders."""
    path = make_scene(shapes=[FLOOR], emitters=[{"type": "constant"}], type="path", max_depth=3)
    depth = make_scene(shapes=[FLOOR], emitters=[{"type": "constant"}], type="field", field="depth")
    for given, wanted in ((path, depth), (depth, path)):
        entry = {"type": "field", "field": "depth"} if wanted is depth else {"type": "path", "max_depth": 3}
        np.testing.assert_array_equal(
            picture(given.with_output({"integrator": entry}), 4), picture(wanted, 4)
        )
    with pytest.raises(_core.DescriptionError, match="pfad"):
        path.with_output({"integrator": {"type": "pfad"}})


# --- denoising ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cornell_box(repository: Path) -> lajolla.Scene:
    return lajolla.load(repository / "scenes" / "cornell-box.xml", size=(48, 48))


@needs_denoiser
def test_denoising_removes_noise(cornell_box: lajolla.Scene) -> None:
    """The relative MSE falls to less than a tenth at 4 samples per pixel; seeds are fixed."""
    reference = cornell_box.render(spp=512, seed=1)
    clean = cornell_box.render(spp=4, seed=2, denoise=True)
    noisy = np.dstack([clean.channels[name] for name in denoising.NOISY])
    np.testing.assert_array_equal(noisy, cornell_box.render(spp=4, seed=2).array)
    before, after = (compare(array, reference).relative_mse.mean() for array in (noisy, clean))
    assert after < before / 10, (before, after)


@needs_denoiser
def test_features_keep_details() -> None:
    """A chessboard of two nearly equal greys, which noise hides, stays."""
    rng = np.random.default_rng(1)
    board = np.kron(np.indices((12, 12)).sum(axis=0) % 2, np.ones((4, 4)))
    truth = np.repeat((0.5 + 0.1 * board)[..., None], 3, axis=2)
    noisy = Image(truth * rng.gamma(0.5, 2, size=truth.shape))
    layers = dict.fromkeys(denoising.LAYERS["albedo"], truth[..., 0].astype(np.float32))
    without, given = (compare(noisy.denoise(f), truth).relative_mse.mean() for f in ({}, layers))
    assert given < without / 2, (without, given)


@needs_denoiser
def test_the_same_bits_on_any_number_of_threads(cornell_box: lajolla.Scene) -> None:
    images = [cornell_box.render(spp=2, threads=threads, denoise=True) for threads in (1, 2, 3)]
    for image in images[1:]:
        np.testing.assert_array_equal(image.array, images[0].array)
        assert list(image.channels) == list(images[0].channels)
        for name, values in image.channels.items():
            np.testing.assert_array_equal(values, images[0].channels[name])


@needs_denoiser
@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (3, 2), (17, 33), (65, 16)])
def test_pictures_of_any_size(shape: tuple[int, int]) -> None:
    result = Image(np.full((*shape, 3), 0.5)).denoise().array
    assert result.shape == (*shape, 3)
    np.testing.assert_allclose(result, 0.5, rtol=0.01)


@needs_denoiser
def test_pictures_of_any_brightness() -> None:
    rng = np.random.default_rng(1)
    array = rng.random((32, 40, 3), np.float32)
    expected = Image(array).denoise().array
    for scale in (2.0**-90, 2.0**-30, 2.0**30, 2.0**90):
        result = Image(array * np.float32(scale)).denoise().array
        np.testing.assert_array_equal(result, expected * np.float32(scale))
    assert not Image(np.zeros((8, 8, 3))).denoise().array.any()


@needs_denoiser
def test_values_that_are_not_finite_or_negative() -> None:
    array = np.full((16, 16, 3), 0.5, np.float32)
    array[2, 2], array[5, 5, 0], array[9, 9], array[12, 3] = np.nan, np.inf, -1, -np.inf
    black = np.where(np.isfinite(array).all(axis=2, keepdims=True), np.maximum(array, 0), 0)
    result = Image(array).denoise().array
    assert np.isfinite(result).all()
    np.testing.assert_array_equal(result, Image(black).denoise().array)
    bright = np.full((16, 16, 3), 0.5, np.float32)
    bright[8, 8] = 3e38
    assert np.isfinite(Image(bright).denoise().array).all()


@needs_denoiser
def test_other_channels_stay(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    channels = {name: rng.random((9, 7), np.float32) for name in ("A", "depth.T", "albedo.R")}
    film = lajolla.film.Film(pixel_format="rgba")
    image = Image(rng.random((9, 7, 3)), channels, film)
    image.denoise().save(tmp_path / "a.exr")
    back = Image.open(tmp_path / "a.exr")
    assert set(back.channels) == {*channels, *denoising.NOISY}
    for name, values in channels.items():
        np.testing.assert_array_equal(back.channels[name], values)
    with pytest.raises(lajolla.DenoiseError, match="denoised before"):
        back.denoise()
    with pytest.raises(lajolla.ImageError, match=r"'albedo.R' has shape \(2, 2\), not \(9, 7\)"):
        image.denoise({"albedo.R": np.zeros((2, 2), np.float32)})


@needs_denoiser
def test_layers_stay(repository: Path) -> None:
    aovs = ["albedo", "normal", "shape"]
    scene = lajolla.load(repository / "scenes" / "cornell-box.xml", size=(24, 24), spp=2, aovs=aovs)
    noisy = scene.render()
    denoised = noisy.denoise()  # by its own layers
    assert list(denoised.channels) == [*noisy.channels, "noisy.R", "noisy.G", "noisy.B"]
    assert denoised.layers == noisy.layers
    others = {name: np.zeros((24, 24)) for name in ("albedo.R", "normal.X", "normal.x", "depth.Z")}
    assert set(noisy.denoise(others).channels) == {*denoised.channels, "depth.Z"}


@needs_denoiser
def test_features_of_a_crop_window(repository: Path) -> None:
    file = repository / "scenes" / "cornell-box.xml"
    whole = lajolla.load(file, size=(32, 32)).features()
    part = lajolla.load(file, size=(32, 32), crop=(5, 9, 13, 7)).features()
    assert sorted(part) == sorted(name for names in denoising.LAYERS.values() for name in names)
    for name, values in part.items():
        np.testing.assert_array_equal(values, whole[name][9:16, 5:18])


# --- command line, failures ---------------------------------------------------------------------------------

SCENE = """\
<scene version="3.0.0">
    <integrator type="path"/>
    <sensor type="perspective">
        <film type="hdrfilm">
            <integer name="width" value="16"/><integer name="height" value="12"/>
            <string name="pixel_format" value="luminance_alpha"/>
        </film>
        <sampler type="independent"><integer name="sample_count" value="4"/></sampler>
    </sensor>
    <emitter type="constant"/>
    <shape type="sphere"><point name="center" z="5"/></shape>
</scene>"""


@pytest.fixture
def room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "room.xml").write_text(SCENE)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "room.xml"


@needs_denoiser
def test_command_line(room: Path, capsys: Capture) -> None:
    assert cli.main("render room.xml --denoise -o a.exr -o a.png --quiet".split()) == 0
    picture = Image.open("a.exr")
    features = [name for names in denoising.LAYERS.values() for name in names]
    assert set(picture.channels) == {"A", *features, *denoising.NOISY}
    expected = lajolla.load(room).render(denoise=True)
    np.testing.assert_allclose(picture.array, lajolla.colour.luminance(expected).repeat(3, axis=2), rtol=1e-6)
    expected.save("b.png")
    assert Path("a.png").read_bytes() == Path("b.png").read_bytes()

    lajolla.load(room).render().save("noisy.exr")
    assert cli.main("denoise noisy.exr -o clean.exr -o clean.png".split()) == 0
    assert capsys.readouterr().err == "lajolla: wrote clean.exr, clean.png\n"
    assert set(Image.open("clean.exr").channels) == {"A", *denoising.NOISY}
    assert cli.main("denoise clean.exr -o again.exr".split()) == 1
    assert "was denoised before" in capsys.readouterr().err


@needs_denoiser
def test_what_cannot_be_denoised(room: Path, capsys: Capture) -> None:
    for words, message in (
        ("render room.xml --denoise --integrator depth", "the integrator 'field' shows no light"),
        ("render room.xml --denoise --pixel 1,2", "--denoise cannot be combined with --pixel"),
        ("denoise missing.exr -o a.exr", "missing.exr: no such file"),
        ("denoise room.xml -o a.exr", "room.xml: cannot be read as a picture"),
        ("denoise room.xml", "required: -o/--output"),
    ):
        assert cli.main(words.split()) == 1
        assert message in capsys.readouterr().err
    assert os.listdir() == ["room.xml"]


def test_without_the_package(room: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    """One message before anything is read or rendered."""
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    for words in ("render missing.xml --denoise", "denoise missing.exr -o a.exr"):
        assert cli.main(words.split()) == 1
        message = "denoising needs Open Image Denoise, which is not installed"
        command = f"{shlex.quote(sys.executable)} -m pip install pyoidn"
        assert capsys.readouterr().err == f"lajolla: error: {message}: {command}\n"
    scene = lajolla.load(room)
    with pytest.raises(lajolla.DenoiseError, match="is not installed"):
        scene.render(denoise=True, progress=lambda progress: pytest.fail("it was rendered"))
    with pytest.raises(lajolla.DenoiseError, match="is not installed"):
        scene.render().denoise()


@needs_denoiser
@pytest.mark.parametrize("problem", [RuntimeError("the network is ill"), MemoryError()])
def test_a_failure_loses_no_picture(
    room: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture, problem: Exception
) -> None:
    def fail(*arguments: object, **settings: object) -> None:
        raise problem

    monkeypatch.setattr(denoising, "_filtered", fail)
    reason = str(problem) or "not enough memory"
    assert cli.main("render room.xml --denoise -o a.exr --quiet".split()) == 1
    message = f"Open Image Denoise failed: {reason}; the picture was saved as rendered"
    assert message in capsys.readouterr().err
    expected = lajolla.load(room).render()
    np.testing.assert_allclose(lajolla.image.read("a.exr")[..., :1], lajolla.colour.luminance(expected))
    with pytest.warns(lajolla.ImageWarning, match=reason):
        image = lajolla.load(room).render(denoise=True)
    np.testing.assert_array_equal(image.array, expected.array)


@needs_denoiser
def test_an_interrupted_picture_is_denoised(
    room: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture, as_from_a_terminal: None
) -> None:
    @contextmanager
    def interrupting(*, pixels: int, quiet: bool, label: str = "") -> Iterator[Callable[[Progress], None]]:
        def observe(progress: Progress) -> None:
            if not label and progress.samples == 2:
                os.kill(os.getpid(), signal.SIGINT)

        yield observe

    monkeypatch.setattr("lajolla.render_command.progress_display", interrupting)
    assert cli.main("render room.xml --denoise -o a.exr --spp 1000000".split()) == 130
    assert "interrupted; wrote a.exr (" in capsys.readouterr().err
    assert set(denoising.NOISY) <= set(Image.open("a.exr").channels)
