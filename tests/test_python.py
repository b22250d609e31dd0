"""The Python package, as its users see it: options, warnings, pictures, and what shows itself."""

from __future__ import annotations

import inspect
import io
import pickle
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lajolla
from lajolla import comparison, image

SCENE = """\
<scene version="3.0.0">
    <default name="level" value="0.5"/>
    <integrator type="path"/>
    <sensor type="perspective">
        <film type="hdrfilm"><integer name="width" value="6"/><integer name="height" value="4"/></film>
    </sensor>
    <emitter type="constant"><rgb name="radiance" value="$level"/></emitter>
    {body}
</scene>
"""
DICT = {"type": "scene", "integrator": {"type": "path"}, "sensor": {"type": "perspective"}}
LIGHT = {"type": "constant"}


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("room.xml").write_text(SCENE.format(body=""))


def scene_with(body: str) -> Path:
    Path("other.xml").write_text(SCENE.format(body=body))
    return Path("other.xml")


# --- options


def loaded() -> lajolla.Scene:
    return lajolla.load("room.xml", size=(2, 2))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: lajolla.load("room.xml", sppp=3), "no option 'sppp', .*; did you mean 'spp'?"),
        (
            lambda: lajolla.load("room.xml", leve=3),
            "nor has the scene such a parameter; did you mean 'level'",
        ),
        (lambda: lajolla.load("room.xml", strickt=True), "did you mean 'strict'"),
        (
            lambda: lajolla.load("room.xml", qqq=3),
            "valid: strict, two_sided, parameters, reuse, spp, size, crop, seed, sampler, integrator, "
            "max_depth, strategy, footprint, sensor, hide_emitters, robust, aovs, level$",
        ),
        (
            lambda: loaded().render(wrong=1, sppp=3),
            r"Scene.render\(\) has no option 'wrong'; valid: spp, seconds",
        ),
        (lambda: lajolla.load_dict(DICT, szie=(2, 2)), r"load_dict\(\) has no option 'szie'; .* 'size'"),
        (lambda: lajolla.load_dict(DICT, basepath="."), "did you mean 'base_path'"),
        (lambda: loaded().render(sppp=3), r"Scene.render\(\) has no option 'sppp'; did you mean 'spp'"),
        (lambda: loaded().rendering(thread=3), "did you mean 'threads'"),
        (lambda: loaded().radiance(0, 0, samples=3), "did you mean 'sample'"),
        (lambda: image.Image(np.zeros((2, 2, 3)), channel={}), "did you mean 'channels'"),
        (lambda: image.Image(np.zeros((2, 2, 3))).save("a.png", exposur=1), "did you mean 'exposure'"),
        (lambda: image.Image.open(source="a.png", forma="png"), "no option 'forma'"),
        (lambda: image.write("a.png", np.zeros((2, 2, 3)), halve=True), "did you mean 'half'"),
        (lambda: image.read(paht="a.png"), "no option 'paht'"),
        (lambda: image.tone_map(np.zeros((2, 2, 3)), exposre=1), "did you mean 'exposure'"),
        (lambda: comparison.compare(np.ones((2, 2, 3)), np.ones((2, 2, 3)), epsilom=1), "'epsilon'"),
    ],
)
def test_unknown_options_are_refused_with_the_nearest(call: Callable[[], object], message: str) -> None:
    with pytest.raises(TypeError, match=message):
        call()


def test_every_public_function_checks_its_options() -> None:
    """Of all that the package names, and of the modules that write and compare pictures."""
    functions: list[Callable[..., Any]] = []
    for name in lajolla.__all__:
        value = getattr(lajolla, name)
        if inspect.isfunction(value):
            functions.append(value)
        elif inspect.isclass(value) and not issubclass(value, Exception):
            own = [v for k, v in vars(value).items() if not k.startswith("_")]
            functions += [v.__func__ if isinstance(v, staticmethod) else v for v in own]
    functions += [f for module in (image, comparison) for f in vars(module).values() if inspect.isfunction(f)]
    public = [f for f in functions if inspect.isfunction(f) and not f.__name__.startswith("_")]
    for function in public:
        parameters = inspect.signature(function).parameters.values()
        if any(p.kind == p.VAR_KEYWORD for p in parameters):  # `load` and `load_dict`, as above
            continue
        optional = [p for p in parameters if p.kind == p.KEYWORD_ONLY or p.default is not p.empty]
        own = ("image", "comparison", "loaded_scene", "loading", "render")
        if optional and function.__module__.removeprefix("lajolla.") in own:
            with pytest.raises(TypeError, match="has no option 'nonsense'"):
                function(nonsense=1)


def test_too_long_names_are_scene_errors() -> None:
    with pytest.raises(lajolla.SceneError, match=r"^x{77}\.\.\.: error: cannot be read: File name too long$"):
        lajolla.load("x" * 5000)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"spp": 0}, "spp must be in 1 to"),
        ({"spp": "many"}, "spp must be a whole number"),
        ({"sampler": "halton"}, "unknown sampler 'halton'; valid: sobol, independent"),
        ({"sampler": "sobl"}, "unknown sampler 'sobl'; did you mean 'sobol'"),
        ({"integrator": "pth"}, "did you mean 'path'"),
        ({"size": 3}, "size must be 2 whole numbers"),
    ],
)
def test_impossible_options(options: dict[str, Any], message: str) -> None:
    for opened in (lambda: lajolla.load("room.xml", **options), lambda: lajolla.load_dict(DICT, **options)):
        with pytest.raises(lajolla.OptionError, match=message):
            opened()


def test_parameters_can_be_options() -> None:
    assert lajolla.load("room.xml", level=2).render(spp=1).array[0, 0, 0] == 2
    assert lajolla.load("room.xml", parameters={"level": 3}).render(spp=1).array[0, 0, 0] == 3
    with pytest.warns(lajolla.SceneWarning, match='parameter "leve" is not used; did you mean "level"'):
        lajolla.load("room.xml", parameters={"leve": 3})


# --- samplers


@pytest.mark.parametrize("name", ["independent", "stratified", "sobol", "halton"])
def test_every_sampler_of_a_scene_means_the_same(name: str) -> None:
    """In files and in dicts; the option chooses for certain."""
    sampler = f'<sampler type="{name}"><integer name="sample_count" value="4"/></sampler>'
    path = scene_with("")
    path.write_text(path.read_text().replace("<film", f"{sampler}<film"))
    sensor = {**DICT["sensor"], "sampler": {"type": name, "sample_count": 4}}  # type: ignore[dict-item]
    scenes = (
        lambda **options: lajolla.load(path, **options),
        lambda **options: lajolla.load_dict(
            {**DICT, "sensor": sensor, "l": LIGHT, "s": {"type": "sphere", "center": [0, 0, 4]}},
            size=(4, 4),
            **options,
        ),
    )
    for opened in scenes:
        default, sobol, independent = (
            opened(**options).render(seed=1).array
            for options in ({}, {"sampler": "sobol"}, {"sampler": "independent"})
        )
        np.testing.assert_array_equal(default, sobol)
        assert opened().core.sample_count == 4
        if opened is scenes[1]:
            assert not np.array_equal(default, independent)


# --- warnings


def test_warnings_come_with_their_place() -> None:
    path = scene_with('<shape type="spere"/>')
    with pytest.warns(lajolla.SceneWarning) as caught:
        scene = lajolla.load(path)
    assert [str(warning.message) for warning in caught] == [str(warning) for warning in scene.warnings]
    assert caught[0].filename == __file__
    (warning,) = scene.warnings
    assert isinstance(warning, lajolla.LajollaWarning)
    assert str(warning).splitlines()[0] == 'other.xml:8:18: warning: unknown shape "spere"; "sphere" is used'
    assert repr(warning) == '<SceneWarning: unknown shape "spere"; "sphere" is used, at other.xml:8:18>'
    assert (warning.location.line, warning.location.column, warning.count) == (8, 18, 1)
    assert "<scene" not in repr(warning.location)


def test_warnings_of_dicts_have_the_key() -> None:
    with pytest.warns(
        lajolla.SceneWarning, match=r"scene\[ball.radus\]: warning: .* did you mean \"radius\""
    ):
        lajolla.load_dict({**DICT, "light": LIGHT, "ball": {"type": "sphere", "radus": 2}})


def test_twenty_thousand_alike_are_one() -> None:
    bad = '<shape type="sphere"><float name="radus" value="1"/></shape>'
    with pytest.warns(lajolla.SceneWarning) as caught:
        scene = lajolla.load(scene_with(bad * 20_000))
    assert len(caught) == len(scene.warnings) == 1
    assert scene.warnings[0].count == 20_000
    assert "(20000 times)" in str(caught[0].message)
    assert len(repr(scene.warnings)) < 200


def test_warnings_can_be_filtered() -> None:
    path = scene_with('<shape type="spere"/>')
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", lajolla.LajollaWarning)
        assert len(lajolla.load(path).warnings) == 1
        warnings.simplefilter("error", lajolla.SceneWarning)
        with pytest.raises(lajolla.SceneWarning, match="spere"):
            lajolla.load(path)


def test_pictures_that_are_clamped_are_warned_about() -> None:
    with pytest.warns(lajolla.ImageWarning, match=r"a\.exr: 3 values outside of") as caught:
        image.Image(np.full((1, 1, 3), 1e6)).save("a.exr", half=True)
    assert caught[0].filename == __file__


def test_programs_show_warnings_at_their_line() -> None:
    scene_with('<shape type="spere"/>')
    Path("program.py").write_text('import lajolla\nlajolla.load("other.xml")\n')
    command = [sys.executable, "program.py"]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "program.py:2: SceneWarning: other.xml:8:18: warning: " in result.stderr
    assert result.stderr.count("SceneWarning: other") == 1


def test_errors_and_warnings_can_be_pickled() -> None:
    """As they are when they leave a process of a pool."""
    with pytest.raises(lajolla.SceneError) as caught:
        lajolla.load(scene_with('<shape type="spere"/>'), strict=True)
    with pytest.warns(lajolla.SceneWarning):
        warning = lajolla.load("other.xml").warnings[0]
    for message in (caught.value, warning):
        copy = pickle.loads(pickle.dumps(message))
        assert str(copy) == str(message)


# --- scenes from streams


def test_scenes_from_binary_files() -> None:
    with open("room.xml", "rb") as file:
        assert lajolla.load(file, size=(2, 2)).width == 2
    text = SCENE.format(body='<shape type="spere"/>').encode()
    with pytest.raises(lajolla.SceneError, match=r"^scene:8:18: error: "):
        lajolla.load(io.BytesIO(text), strict=True)
    with open("room.xml") as file, pytest.raises(TypeError, match='mode "rb"'):
        lajolla.load(file)  # type: ignore[arg-type]


def test_files_of_an_open_scene_are_beside_it() -> None:
    Path("folder").mkdir()
    image.write("folder/sky.pfm", np.full((2, 4, 3), 3.0))
    sky = '<emitter type="envmap"><string name="filename" value="sky.pfm"/></emitter>'
    Path("folder/scene.xml").write_text(SCENE.format(body=sky).replace("$level", "0"))
    with open("folder/scene.xml", "rb") as file:
        assert lajolla.load(file, spp=1).render().array[0, 0, 0] == pytest.approx(3)


# --- pictures

RAMP = np.linspace(0.05, 0.95, 12, dtype=np.float32).reshape(2, 2, 3)


def test_pictures_from_paths_bytes_and_files() -> None:
    image.Image(RAMP, {"A": np.full((2, 2), 0.5)}, lajolla.film.Film(pixel_format="rgba")).save("a.png")
    opened = [lajolla.Image.open(source) for source in ("a.png", Path("a.png"), Path("a.png").read_bytes())]
    with open("a.png", "rb") as file:
        opened.append(lajolla.Image.open(file))
    opened.append(lajolla.Image.open(io.BytesIO(Path("a.png").read_bytes())))
    for picture in opened:
        np.testing.assert_allclose(picture.array, RAMP, atol=0.005)
        np.testing.assert_allclose(picture.channels["A"], 0.5, atol=0.002)
    opened[0].save("again.png")
    assert Path("again.png").read_bytes() == Path("a.png").read_bytes()


def test_channels_come_back() -> None:
    channels = {
        "A": np.full((2, 2), 0.25),
        "depth.T": np.arange(4).reshape(2, 2),
        "albedo.R": np.ones((2, 2)),
    }
    image.Image(RAMP, channels, lajolla.film.Film(pixel_format="rgba")).save("a.exr")
    opened = lajolla.Image.open("a.exr")
    np.testing.assert_array_equal(opened.array, RAMP)
    assert set(opened.channels) == set(channels)
    for name, values in channels.items():
        np.testing.assert_array_equal(opened.channels[name], values)


@pytest.mark.parametrize("ending", lajolla.picture_formats.ENDINGS)
def test_streams_get_what_files_get(ending: str) -> None:
    picture = image.Image(np.broadcast_to(RAMP[:1, :1], (8, 8, 3)))
    picture.save(f"a{ending}")
    Path("named").unlink(missing_ok=True)
    picture.save("named", format=ending)
    stream = io.BytesIO()
    picture.save(stream, format=ending.removeprefix(".").upper())
    if ending not in (".exr", ".tif", ".tiff"):  # which hold the time of writing
        assert stream.getvalue() == Path(f"a{ending}").read_bytes() == Path("named").read_bytes()
    if ending not in lajolla.picture_formats.MATRIX:
        np.testing.assert_allclose(image.read(stream.getvalue()), image.read(f"a{ending}"))


@pytest.mark.parametrize("ending", lajolla.picture_formats.LOW_RANGE)
@pytest.mark.parametrize("pixel_format", ["rgb", "rgba", "luminance", "luminance_alpha", "xyza"])
def test_displays_get_every_pixel_format(ending: str, pixel_format: str) -> None:
    """Files without room for alpha do without it, and those without grey are coloured."""
    values = np.broadcast_to(np.float32([0.5, 0.25, 0.125]), (16, 16, 3))
    film = lajolla.film.Film(pixel_format=pixel_format)
    image.Image(values, {"A": np.full((16, 16), 0.5)}, film).save(f"a{ending}")
    opened = image.Image.open(f"a{ending}")
    expected = values if pixel_format.startswith(("rgb", "xyz")) else values @ [0.212671, 0.71516, 0.072169]
    np.testing.assert_allclose(
        opened.array, np.broadcast_to(np.reshape(expected, (16, 16, -1)), (16, 16, 3)), atol=0.02
    )
    if "a" in pixel_format.removeprefix("luminance") and 4 in lajolla.picture_formats.LOW_RANGE[ending]:
        np.testing.assert_allclose(opened.channels["A"], 0.5, atol=0.01)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda p: p.save(io.BytesIO()), "a stream has no name with an ending; name the format"),
        (lambda p: p.save("a.png", format="gnp"), "no picture format 'gnp'"),
        (lambda p: p.save("a.psd"), "one of .exr, .hdr, .pfm, .png"),
        (lambda p: image.Image.open(b"no picture"), "picture: cannot be read as a picture"),
        (lambda p: image.Image.open(io.StringIO("text")), 'mode "rb"'),
        (lambda p: image.Image.open("nowhere.png"), "nowhere.png: no such file"),
    ],
)
def test_pictures_that_cannot_be(call: Callable[[image.Image], object], message: str) -> None:
    with pytest.raises(lajolla.ImageError, match=message):
        call(image.Image(RAMP))


def closed() -> io.BytesIO:
    stream = io.BytesIO()
    stream.close()
    return stream


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: lajolla.load(3), TypeError, "a scene is a file name or a binary file object, not int"),
        (lambda: lajolla.load(None), TypeError, "binary file object, not NoneType"),
        (lambda: lajolla.load(closed()), ValueError, "closed file"),
        (lambda: image.Image.open(3), TypeError, "a picture is a file name, bytes or a .* not int"),
        (lambda: image.Image.open(closed()), ValueError, "closed file"),
        (lambda: image.Image(RAMP).save(None), TypeError, "a picture goes to a file name or .* not NoneType"),
        (lambda: image.Image(RAMP).save(3), TypeError, "binary file object, not int"),
        (lambda: image.Image(RAMP).save(io.StringIO(), format="png"), TypeError, 'with mode "wb"'),
        (lambda: image.Image(RAMP).save(closed(), format="png"), ValueError, "file object .* is closed"),
    ],
)
def test_what_is_no_file(call: Callable[[], object], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        call()


def test_messages_name_no_file_of_ours() -> None:
    with pytest.raises(lajolla.ImageError) as caught:
        image.Image.open(io.BytesIO(b"abc"))
    assert str(caught.value).startswith("picture: cannot be read as a picture: ")
    assert tempfile.gettempdir() not in str(caught.value)


def test_formats_that_the_installed_library_lacks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lajolla.picture_formats, "_offered", lambda: {".exr", ".png"})
    with pytest.raises(
        lajolla.ImageError, match=r"OpenImageIO cannot write \.webp files; choose from \.exr, \.png, \.npy"
    ):
        image.Image(RAMP).save("a.webp")


# --- what shows itself


def test_the_version() -> None:
    assert lajolla.__version__ == version("lajolla")


def test_what_is_shown() -> None:
    assert repr(lajolla.load("room.xml", spp=7)) == "<lajolla.Scene, 6 x 4 pixels, 7 samples per pixel>"
    assert repr(image.Image(RAMP)) == "<lajolla.Image, 2 x 2 pixels>"
