"""What films say of the files of pictures, against the formulas of Mitsuba 0.6 and files of Mitsuba 3."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from reader_tools import error

import lajolla
from lajolla import cli, film, image
from lajolla.colour import RGB_TO_XYZ, luminance
from lajolla.film import Film
from lajolla.scene import load_description

RGB = np.random.default_rng(5).gamma(0.6, 0.8, (6, 9, 3)).astype(np.float32)
ALPHA = np.linspace(0, 1, 54, dtype=np.float32).reshape(6, 9)
DEPTH = np.arange(54, dtype=np.float32).reshape(6, 9)
CHANNELS = {"A": ALPHA, "d.T": DEPTH}


def stored(path: Path) -> tuple[tuple[str, ...], str, np.ndarray]:
    """Names, number type and values of a file, read by OpenImageIO as they are."""
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(str(path), config)
    spec = source.spec()
    whole = str(spec.format) == "uint"
    values = source.read_image("uint" if whole else "float")
    return spec.channelnames, str(spec.format), values.astype(np.float32)


def saved(tmp_path: Path, name: str, **settings: object) -> tuple[tuple[str, ...], str, np.ndarray]:
    path = tmp_path / name
    image.Image(RGB, CHANNELS, Film(**settings)).save(path)  # type: ignore[arg-type]
    return stored(path)


@pytest.mark.parametrize("pixel_format", film.PIXEL_FORMATS)
def test_exr_holds_the_film_s_channels_and_all_others(tmp_path: Path, pixel_format: str) -> None:
    names, kind, values = saved(tmp_path, "a.exr", pixel_format=pixel_format)
    letters = film.PIXEL_FORMATS[pixel_format]
    assert set(names) == {*letters, "d.T"} and kind == "float"
    by_name = {name: values[..., i] for i, name in enumerate(names)}
    expected = {**dict(zip("RGB", np.moveaxis(RGB, 2, 0), strict=True)), "A": ALPHA, "d.T": DEPTH}
    # The primaries of Rec. 709 with white D65 (IEC 61966-2-1).
    x, y, z = np.linalg.inv(
        [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
    )
    expected |= {name: RGB @ row for name, row in (("X", x), ("Y", y), ("Z", z))}
    for name in names:
        np.testing.assert_allclose(by_name[name], expected[name], atol=2e-3, err_msg=name)
    if "R" in letters or "X" in letters:  # read back as a picture
        np.testing.assert_allclose(image.read(tmp_path / "a.exr"), RGB, rtol=1e-4, atol=1e-4)
    else:
        assert np.ptp(image.read(tmp_path / "a.exr"), axis=2).max() == 0


@pytest.mark.parametrize(("component", "kind"), film.COMPONENT_FORMATS.items())
def test_numbers_of_exr_files(tmp_path: Path, component: str, kind: str) -> None:
    names, found, values = saved(tmp_path, "a.exr", component_format=component)
    spec = oiio.ImageInput.open(str(tmp_path / "a.exr")).spec()
    formats = dict(zip(names, map(str, spec.channelformats or [spec.format] * len(names)), strict=True))
    assert formats == {**dict.fromkeys("RGB", kind), "d.T": "float" if kind == "half" else kind}
    assert found == formats["d.T"]
    expected = np.rint(RGB) if kind == "uint" else RGB
    np.testing.assert_allclose(values[..., :3], expected, rtol=2**-11, atol=1e-6)
    np.testing.assert_array_equal(image.read(tmp_path / "a.exr"), values[..., :3])


def test_whole_numbers_are_clamped(tmp_path: Path) -> None:
    wild = np.array([[[-5, np.nan, 1e20]]], np.float32)
    picture = image.Image(wild, {}, Film(component_format="uint32"))
    with pytest.warns(image.ImageWarning, match="2 values outside of 0 to"):
        picture.save(tmp_path / "a.exr")
    np.testing.assert_array_equal(stored(tmp_path / "a.exr")[2][0, 0], [0, 0, np.float32(2**32 - 256)])


def encoded(linear: np.ndarray, gamma: float) -> np.ndarray:
    """The curves of Mitsuba 0.6: sRGB for -1, else a power; 8 bits, rounded."""
    x = np.clip(linear, 0, 1).astype(np.float64)
    srgb = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return np.floor(255 * (srgb if gamma == -1 else x ** (1 / gamma)) + 0.5)


def reinhard_of_mitsuba(rgb: np.ndarray, key: float, burn: float) -> np.ndarray:
    """Bitmap::tonemapReinhard of Mitsuba 0.6 in double precision: through xyY, white at burn^4."""
    to_xyz = np.asarray(RGB_TO_XYZ, np.float64)
    xyz = rgb.astype(np.float64) @ to_xyz.T
    light = xyz[..., 1]
    scale = key / np.exp(np.log(1e-3 + light).mean())
    inverse_white = 1 / ((light.max() * scale) ** 2 * (1 - burn) ** 4)
    chromaticity = xyz / xyz.sum(axis=2, keepdims=True)
    scaled = light * scale
    mapped = scaled * (1 + scaled * inverse_white) / (1 + scaled)
    return (chromaticity * (mapped / chromaticity[..., 1])[..., None]) @ np.linalg.inv(to_xyz).T


CURVES: dict[str, tuple[dict[str, object], Callable[[np.ndarray], np.ndarray]]] = {
    "sRGB": ({}, lambda rgb: encoded(rgb, -1)),
    "exposure": ({"exposure": -1.5}, lambda rgb: encoded(rgb * 2**-1.5, -1)),
    "gamma": ({"gamma": 2.2, "exposure": 0.5}, lambda rgb: encoded(rgb * 2**0.5, 2.2)),
    "reinhard": ({"tonemap_method": "reinhard"}, lambda rgb: encoded(reinhard_of_mitsuba(rgb, 0.18, 0), -1)),
    "burn": (
        {"tonemap_method": "reinhard", "key": 0.5, "burn": 0.6, "gamma": 1.8, "exposure": 3.0},
        lambda rgb: encoded(reinhard_of_mitsuba(rgb, 0.5, 0.6), 1.8),
    ),
}


@pytest.mark.parametrize("name", CURVES)
def test_png_pixels_are_those_of_mitsuba(tmp_path: Path, name: str) -> None:
    """Exactly, but for ties of rounding."""
    settings, formula = CURVES[name]
    _, _, values = saved(tmp_path, "a.png", file_format="png", **settings)
    difference = np.abs(255 * values - formula(RGB))
    assert difference.max() < 1.01 and (difference > 0.01).mean() < 0.02


def test_png_in_other_pixel_formats(tmp_path: Path) -> None:
    """Alpha is linear, and nothing is divided by it."""
    for pixel_format, count in (("rgba", 4), ("luminance", 1), ("luminance_alpha", 2), ("xyza", 4)):
        _, _, values = saved(tmp_path, "a.png", pixel_format=pixel_format)
        assert values.shape == (6, 9, count)
        colour = RGB if count == 4 else luminance(RGB)
        assert np.abs(255 * values[..., : colour.shape[2]] - encoded(colour, -1)).max() < 1.01
        if "A" in film.PIXEL_FORMATS[pixel_format]:
            np.testing.assert_allclose(values[..., -1], ALPHA, atol=0.51 / 255)
    assert saved(tmp_path, "a.jpg", pixel_format="rgba")[2].shape == (6, 9, 3)
    assert saved(tmp_path, "b.jpg", pixel_format="luminance_alpha")[2].shape == (6, 9, 1)


def test_black_and_broken_pictures_are_tone_mapped() -> None:
    for values in (0, -1, np.nan, np.inf, 1e38, 1e-40):
        for method in ("gamma", "reinhard"):
            rgb = np.full((2, 2, 3), values, np.float32)
            rgb[0, 0] = 0.5
            assert image.tone_map(rgb, 0.0, Film(tonemap_method=method)).dtype == np.uint8


def test_matrices(tmp_path: Path) -> None:
    grey = {"pixel_format": "luminance"}
    light = luminance(RGB)[..., 0]
    np.testing.assert_array_equal(np.load(saved_matrix(tmp_path, "a.npy")), np.dstack([RGB, DEPTH]))
    np.testing.assert_array_equal(np.load(saved_matrix(tmp_path, "b.npy", **grey))[..., 0], light)
    text = saved_matrix(tmp_path, "a.m", **grey, digits=7, variable="x").read_text()
    assert text.startswith("x = [") and text.endswith("];\n")
    rows = [[float(v) for v in row.split(",")] for row in text[5:-3].split(";")]
    np.testing.assert_allclose(rows, light, rtol=1e-6)
    assert saved_matrix(tmp_path, "b.m").read_text().count("data(:, :, ") == 2
    braces = saved_matrix(tmp_path, "c.m", **grey, file_format="mathematica", digits=3).read_text()
    assert braces.startswith("data = {{") and "e-" not in braces
    colour = saved_matrix(tmp_path, "d.m", file_format="mathematica").read_text()
    assert colour.startswith("data = Transpose[{{{") and colour.endswith("{3, 1, 2}];\n")


def saved_matrix(tmp_path: Path, name: str, **settings: object) -> Path:
    image.Image(RGB, CHANNELS, Film(**settings)).save(tmp_path / name)  # type: ignore[arg-type]
    return tmp_path / name


# --- Scene files ----------------------------------------------------------------------------------


def write(folder: Path, kind: str, properties: str = "", version: str = "3.0.0") -> Path:
    size = "" if kind == "mfilm" else '<integer name="width" value="8"/><integer name="height" value="6"/>'
    path = folder / "room.xml"
    path.write_text(
        f"""<scene version="{version}"><integrator type="path"/><sensor type="perspective">
        <film type="{kind}">{size}{properties}</film></sensor><emitter type="constant"/></scene>"""
    )
    return path


def texts(**properties: str) -> str:
    return "".join(f'<string name="{name}" value="{value}"/>' for name, value in properties.items())


def test_old_films(tmp_path: Path) -> None:
    properties = (
        texts(tonemapMethod="Reinhard", pixelFormat="luminanceAlpha", fileFormat="PNG")
        + '<float name="key" value="0.3"/><float name="burn" value="0.1"/><float name="gamma" value="2"/>'
        + '<boolean name="banner" value="true"/><boolean name="highQualityEdges" value="true"/>'
    )
    description = load_description(write(tmp_path, "ldrfilm", properties, "0.6.0"))
    assert not description.warnings
    assert description.film == Film(
        "luminance_alpha", "float32", "png", tonemap_method="reinhard", gamma=2, key=0.3, burn=0.1
    )
    assert [c["recorded"] for c in description.core["channels"]] == ["alpha"]


@pytest.mark.parametrize("kind", ["hdrfilm", "tiledhdrfilm", "specfilm"])
def test_hdr_films(tmp_path: Path, kind: str) -> None:
    properties = texts(file_format="pfm", pixel_format="luminance", component_format="float16")
    description = load_description(write(tmp_path, kind, properties))
    assert description.film == Film("luminance", "float16", "pfm")
    told = [warning.message for warning in description.warnings]
    assert told == (['unknown film "specfilm"; "hdrfilm" is used'] if kind == "specfilm" else [])


def test_matrix_films(tmp_path: Path) -> None:
    description = load_description(write(tmp_path, "mfilm", '<integer name="digits" value="9"/>'))
    assert description.film == Film("luminance", file_format="matlab", digits=9)
    assert (description.core["film"]["width"], description.core["film"]["height"]) == (1, 1)
    assert description.core["rfilter"]["type"] == "box"


@pytest.mark.parametrize(
    ("kind", "properties", "used", "told"),
    [
        ("hdrfilm", texts(file_format="rgbe", pixel_format="rgba"), "rgb", 'rgbe files cannot hold "rgba"'),
        ("hdrfilm", texts(file_format="pfm", pixel_format="xyz"), "rgb", 'pfm files cannot hold "xyz"'),
        ("ldrfilm", texts(file_format="jpeg", pixel_format="rgba"), "rgb", 'jpeg files cannot hold "rgba"'),
        ("hdrfilm", texts(pixel_format="spectrum"), "rgb", "spectral output is not supported"),
    ],
)
def test_what_a_file_cannot_hold(tmp_path: Path, kind: str, properties: str, used: str, told: str) -> None:
    description = load_description(write(tmp_path, kind, properties))
    assert description.film.pixel_format == used
    assert len(description.warnings) == 1 and told in description.warnings[0].message


@pytest.mark.parametrize(
    ("kind", "properties", "message"),
    [
        ("hdrfilm", texts(pixel_format="rgbb"), 'unknown pixel format "rgbb"; did you mean "rgb"'),
        ("hdrfilm", texts(file_format="openexe"), 'did you mean "openexr"'),
        ("hdrfilm", texts(component_format="float64"), '"float64" is no choice'),
        ("hdrfilm", texts(pixel_format="rgb, rgb"), "the number of pixel formats, 2, is not"),
        ("hdrfilm", texts(channel_names="a, b"), "the number of pixel formats, 1, is not"),
        ("ldrfilm", texts(tonemap_method="filmic"), '"filmic" is no choice'),
        ("ldrfilm", '<float name="gamma" value="0"/>', "must be positive, or -1"),
        ("ldrfilm", '<float name="gamma" value="-0.5"/>', "must be positive, or -1"),
        ("ldrfilm", '<float name="key" value="0"/>', "must be between"),
        ("mfilm", texts(variable="x = 1; y"), '"variable" must be a name'),
    ],
)
def test_mistakes_are_told(tmp_path: Path, kind: str, properties: str, message: str) -> None:
    assert message in error(write(tmp_path, kind, properties))


@pytest.mark.parametrize(
    ("kind", "properties", "endings"),
    [
        ("hdrfilm", "", {".exr", ".png"}),
        ("hdrfilm", texts(file_format="rgbe"), {".hdr", ".png"}),
        ("hdrfilm", texts(file_format="pfm"), {".pfm", ".png"}),
        ("ldrfilm", "", {".exr", ".png"}),
        ("ldrfilm", texts(file_format="jpeg"), {".exr", ".jpg"}),
        ("mfilm", "", {".m", ".png"}),
        ("mfilm", texts(file_format="numpy"), {".npy", ".png"}),
    ],
)
def test_files_that_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, properties: str, endings: set[str]
) -> None:
    """By default those of the film; an ending that is given wins."""
    monkeypatch.chdir(write(tmp_path, kind, properties).parent)
    assert cli.main(["render", "room.xml", "--quiet", "--spp", "1"]) == 0
    assert {path.suffix for path in tmp_path.iterdir()} == {".xml", *endings}
    assert cli.main(["render", "room.xml", "--quiet", "--spp", "1", "-o", "other.pfm"]) == 0
    assert (tmp_path / "other.pfm").exists() and not (tmp_path / "other.exr").exists()


def test_tone_mapping_of_any_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On the command line it wins over the film's."""
    monkeypatch.chdir(write(tmp_path, "hdrfilm").parent)
    for method in ("gamma", "reinhard"):
        words = ["render", "room.xml", "--quiet", "--spp", "1", "-o", f"{method}.png", "--tonemap", method]
        assert cli.main(words) == 0
    assert (stored(tmp_path / "gamma.png")[2] == 1).all()
    grey = stored(tmp_path / "reinhard.png")[2]
    assert np.ptp(grey) == 0 and 0.5 < grey.max() < 1.01


def test_files_that_cannot_hold_all_channels_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(write(tmp_path, "hdrfilm", texts(pixel_format="rgba")).parent)
    words = ["render", "room.xml", "--quiet", "--spp", "1", "-o"]
    assert cli.main([*words, "a.pfm"]) == 0
    assert "only .exr, .npy and .npz files hold all channels" in capsys.readouterr().err
    assert cli.main([*words, "a.exr", "-o", "a.pfm"]) == 0
    assert capsys.readouterr().err == ""


def test_a_picture_knows_its_film(tmp_path: Path) -> None:
    picture = lajolla.load(write(tmp_path, "hdrfilm", texts(pixel_format="xyza"))).render(spp=1)
    picture.save(tmp_path / "a.exr")
    assert set(stored(tmp_path / "a.exr")[0]) == set("XYZA")
    with pytest.raises(image.ImageError, match="channel 'x' has shape"):
        image.Image(RGB, {"x": np.zeros((1, 2))})


def test_files_of_the_oracle_have_the_same_channels(tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    for pixel_format in film.PIXEL_FORMATS:
        path = write(tmp_path, "hdrfilm", texts(pixel_format=pixel_format, component_format="float16"))
        theirs = mi.load_file(str(path))
        mi.render(theirs, spp=4)
        theirs.sensors()[0].film().write(str(tmp_path / "theirs.exr"))
        lajolla.load(path).render(spp=4).save(tmp_path / "ours.exr")
        a, b = stored(tmp_path / "ours.exr"), stored(tmp_path / "theirs.exr")
        assert a[:2] == b[:2]
        np.testing.assert_allclose(a[2], b[2], rtol=2e-3)
