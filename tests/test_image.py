"""Pictures survive the way to disk and back, appear complete or not at all, and are measured correctly."""

import os
import stat
from pathlib import Path

import numpy as np
import pytest

from lajolla import colour, comparison, image, picture_formats, whole_files
from lajolla.picture_files import Budget
from lajolla.scene.formats.images import read_pixels
from lajolla.scene.syntax.errors import Location, Source


@pytest.fixture
def picture() -> image.FloatImage:
    return (np.random.default_rng(7).random((13, 17, 3), dtype=np.float32) * 4).astype(np.float32)


@pytest.mark.parametrize(
    ("name", "half", "tolerance"),
    [
        ("a.exr", False, 0),
        ("a.pfm", False, 0),
        ("a.exr", True, 2**-11),
        ("a.hdr", False, 2**-7),
        ("A.EXR", False, 0),
    ],
)
def test_high_range_round_trip(
    tmp_path: Path, picture: image.FloatImage, name: str, half: bool, tolerance: float
) -> None:
    image.write(tmp_path / name, picture, half=half)
    bound = tolerance * picture.max(axis=2, keepdims=True)
    assert (np.abs(image.read(tmp_path / name) - picture) <= bound).all()
    assert [entry.name for entry in tmp_path.iterdir()] == [name]


def test_pfm_starts_with_the_bottom_row(tmp_path: Path, picture: image.FloatImage) -> None:
    image.write(tmp_path / "a.pfm", picture)
    stored = np.frombuffer((tmp_path / "a.pfm").read_bytes()[-picture.nbytes :], "<f4").reshape(picture.shape)
    np.testing.assert_array_equal(stored[0], picture[-1])


def test_png_is_srgb_with_exposure(tmp_path: Path) -> None:
    grey = np.full((2, 2, 3), 0.25, np.float32)
    image.write(tmp_path / "a.png", grey, exposure=1)
    # 0.5 in sRGB is 188 (IEC 61966-2-1), where gamma 2.2 would give 186.
    np.testing.assert_allclose(image.read(tmp_path / "a.png"), colour.decode_srgb(188 / 255), atol=1e-6)


def test_jpeg_is_close(tmp_path: Path) -> None:
    ramp = np.linspace(0, 1, 64, dtype=np.float32)[None, :, None].repeat(48, 0).repeat(3, 2)
    for name in ("a.jpg", "a.jpeg"):
        image.write(tmp_path / name, ramp)
        assert np.abs(colour.encode_srgb(image.read(tmp_path / name)) - colour.encode_srgb(ramp)).max() < 0.05


def test_srgb_functions_are_inverse() -> None:
    x = np.linspace(0, 1, 1001, dtype=np.float32)
    np.testing.assert_allclose(colour.decode_srgb(colour.encode_srgb(x)), x, atol=2e-6)


@pytest.mark.parametrize("name", ["a.psd", "a", "a.xml"])
def test_unknown_ending_names_the_known_ones(tmp_path: Path, name: str) -> None:
    with pytest.raises(image.ImageError, match=r"one of \.exr, \.hdr, \.pfm, \.png, \.jpg, \.jpeg"):
        image.write(tmp_path / name, np.zeros((1, 1, 3)))


def test_unusable_folders_are_found_before_rendering(tmp_path: Path) -> None:
    with pytest.raises(image.ImageError, match="does not exist"):
        image.check_output(tmp_path / "missing" / "a.exr")
    (tmp_path / "b.exr").mkdir()
    with pytest.raises(image.ImageError, match="is a folder"):
        image.check_output(tmp_path / "b.exr")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_read_only_folder(tmp_path: Path) -> None:
    tmp_path.chmod(stat.S_IRUSR | stat.S_IXUSR)
    with pytest.raises(image.ImageError, match="not writable"):
        image.check_output(tmp_path / "a.exr")


def test_failed_write_keeps_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "a.exr"
    image.write(target, np.ones((2, 2, 3)))

    def refuse(source: object, destination: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(image.ImageError, match="No space left"):
        image.write(target, np.zeros((2, 2, 3)))
    assert image.read(target).min() == 1
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.exr"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("ending", [".exr", ".hdr", ".pfm", ".png"])
def test_full_disk_is_an_error(
    tmp_path: Path, picture: image.FloatImage, ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The temporary file is a link to a device that is always full.
    monkeypatch.setattr(whole_files.secrets, "token_hex", lambda size: "00")
    prefix = whole_files._temporary_prefix(tmp_path / f"a{ending}")
    (tmp_path / f"{prefix}{os.getpid()}-00{ending}").symlink_to("/dev/full")
    with pytest.raises(image.ImageError, match=f"a{ending}"):
        image.write(tmp_path / f"a{ending}", picture)
    assert list(tmp_path.iterdir()) == []


def test_no_space_is_said_before_writing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(image.shutil, "disk_usage", lambda folder: type("Usage", (), {"free": 0}))
    with pytest.raises(image.ImageError, match="no space left"):
        image.write(tmp_path / "a.jpg", np.zeros((2, 2, 3)))  # libjpeg would end the process
    with pytest.raises(image.ImageError, match=r"no space left on the disk; the picture may need 11\.5 MiB"):
        image.check_space(tmp_path / "a.exr", 1000, 1000)
    image.write(tmp_path / "a.exr", np.zeros((2, 2, 3)))  # may be compressed


def test_long_names(tmp_path: Path) -> None:
    name = "a" * 251 + ".exr"  # as long as names may be
    image.write(tmp_path / name, np.ones((2, 2, 3)))
    assert [entry.name for entry in tmp_path.iterdir()] == [name]
    with pytest.raises(image.ImageError, match="File name too long"):
        image.check_output(tmp_path / f"a{name}")


def test_half_and_rgbe_are_clamped(tmp_path: Path) -> None:
    values = np.array([[[-1e6, 1e6, 0.5], [3e38, 0.5, -0.5]]], np.float32)
    with pytest.warns(image.ImageWarning, match=r"a.exr: 3 values outside of -65504 to 65504 clamped"):
        image.write(tmp_path / "a.exr", values, half=True)
    np.testing.assert_array_equal(image.read(tmp_path / "a.exr"), np.clip(values, -65504, 65504))
    with pytest.warns(image.ImageWarning, match=r"a.hdr: 3 values outside of 0 to 1.69e\+38 clamped"):
        image.write(tmp_path / "a.hdr", values)
    stored = image.read(tmp_path / "a.hdr")
    np.testing.assert_allclose(stored.max(axis=2), [[1e6, 1.69e38]], rtol=0.01)
    assert stored.min() == 0


@pytest.mark.filterwarnings("error")
def test_what_is_not_finite_has_a_colour() -> None:
    values = np.array([[[np.nan, np.inf, -np.inf], [3e38, 1, 0]]])
    assert image.tone_map(values, 100).tolist() == [[[0, 255, 0], [255, 255, 0]]]
    assert image.tone_map(values, -100).tolist() == [[[0, 255, 0], [255, 0, 0]]]


@pytest.mark.parametrize("exposure", [1e9, -101, float("nan"), float("inf"), "1"])
def test_impossible_exposures(tmp_path: Path, exposure: float) -> None:
    with pytest.raises(image.ImageError, match="exposure must be from -100 to 100, not"):
        image.Image(np.ones((1, 1, 3))).save(tmp_path / "a.png", exposure=exposure)


def test_links_stay_links(tmp_path: Path) -> None:
    (tmp_path / "link.exr").symlink_to(tmp_path / "target.exr")
    image.write(tmp_path / "link.exr", np.ones((2, 2, 3)))
    assert (tmp_path / "link.exr").is_symlink()
    assert image.read(tmp_path / "target.exr").max() == 1


@pytest.mark.parametrize("content", [b"", b"hello"])
@pytest.mark.parametrize("ending", [".exr", ".hdr", ".pfm", ".png", ".jpg"])
def test_broken_files_are_errors(tmp_path: Path, content: bytes, ending: str) -> None:
    path = tmp_path / f"a{ending}"
    path.write_bytes(content)
    with pytest.raises(image.ImageError, match=f"a{ending}: cannot be read"):
        image.read(path)


@pytest.mark.parametrize("ending", [".exr", ".hdr", ".pfm", ".png", ".jpg"])
def test_truncated_files_are_errors(tmp_path: Path, picture: image.FloatImage, ending: str) -> None:
    path = tmp_path / f"a{ending}"
    image.write(path, picture)
    path.write_bytes(path.read_bytes()[:-60])
    with pytest.raises(image.ImageError, match="cannot be read"):
        image.read(path)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(image.ImageError, match="not a file"):
        image.read(tmp_path)
    with pytest.raises(image.ImageError, match="no such file"):
        image.read("nowhere.exr")


def test_comparison_by_hand() -> None:
    reference = np.ones((1, 2, 3)) * [1, 2, 4]
    other = reference * 1.5
    result = comparison.compare(other, reference, epsilon=0)
    np.testing.assert_allclose(result.mean_ratio, 1.5)
    np.testing.assert_allclose(result.rmse, [0.5, 1, 2])
    np.testing.assert_allclose(result.relative_mse, 0.25)
    assert result.excluded == 0


def test_comparison_excludes_what_is_not_finite() -> None:
    reference = np.ones((2, 2, 3))
    other = reference.copy()
    other[0, 0, 1] = np.nan
    result = comparison.compare(other, reference)
    assert result.excluded == 1
    np.testing.assert_allclose(result.rmse, 0)
    assert comparison.difference_picture(other, reference)[0, 0].tolist() == [255, 255, 0]


def test_comparison_of_different_sizes() -> None:
    with pytest.raises(image.ImageError, match="2 x 1 and 1 x 2"):
        comparison.compare(np.zeros((1, 2, 3)), np.zeros((2, 1, 3)))


def test_difference_picture_shows_the_sign() -> None:
    reference = np.ones((1, 3, 3))
    other = reference * np.array([1, 2, 0.4])[None, :, None]
    black, red, blue = comparison.difference_picture(other, reference)[0].tolist()
    assert black == [0, 0, 0]
    assert red == [255, 0, 0]
    assert blue == [0, 0, 255]


def test_image_object(tmp_path: Path, picture: image.FloatImage) -> None:
    result = image.Image(picture)
    assert np.asarray(result) is result.array
    assert np.asarray(result, dtype=np.float64).dtype == np.float64
    assert result._repr_png_().startswith(b"\x89PNG")
    result.save(tmp_path / "a.exr", half=True)
    assert repr(result) == "<lajolla.Image, 17 x 13 pixels>"
    with pytest.raises(image.ImageError, match="shape"):
        image.Image(np.zeros((2, 2)))


@pytest.mark.parametrize("ending", picture_formats.ENDINGS[: -len(picture_formats.MATRIX)])
def test_the_first_row_of_every_format_is_on_top(ending: str, tmp_path: Path) -> None:
    """In pictures and in textures, also where they are written in more than one piece."""
    rows = np.linspace(0.1, 0.9, 600, dtype=np.float32)
    path = tmp_path / f"a{ending}"
    image.write(path, np.broadcast_to(rows[:, None, None], (600, 500, 3)))
    textured = (
        read_pixels(path, Location(Source("scene.xml", b"", tmp_path)), Budget())
        .pixels[:, 0, 0]
        .astype(np.float32)
    )
    lossy = ending in (".webp", ".jxl")  # a little more than JPEG, which is monotone here
    steps = np.diff(textured[::20] if lossy else textured)
    assert np.all(steps >= 0) and textured[-1] > 2 * textured[0]
    np.testing.assert_allclose(image.read(path)[:, 0, 0], rows, atol=0.02 if lossy else 0.01)
