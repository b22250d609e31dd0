"""Pictures in and out: float32 arrays of linear RGB, files by way of OpenImageIO, and error measures."""

import os
import secrets
import shutil
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import ArrayLike, NDArray

FloatImage = NDArray[np.float32]

HIGH_RANGE = (".exr", ".hdr", ".pfm")
JPEG = (".jpg", ".jpeg")
LOW_RANGE = (".png", *JPEG)
MAX_EXPOSURE = 100.0  # stops
MAX_HALF = 65504.0  # the largest finite 16-bit float
MAX_RGBE = float(np.float32(1.69e38))  # larger numbers wrap around in OpenImageIO's encoder


class ImageError(Exception):
    """A picture that cannot be read, written or compared; the message names the file and the reason."""


class ImageWarning(UserWarning):
    """A picture that is not written as it is; the message names the file and the reason."""


class Image:
    """A rendered picture: linear RGB in `array`, float32 of shape (height, width, 3), first row on top."""

    def __init__(self, array: ArrayLike) -> None:
        self.array: FloatImage = np.asarray(array, dtype=np.float32)
        if self.array.ndim != 3 or self.array.shape[2] != 3:
            raise ImageError(f"a picture has shape (height, width, 3), not {self.array.shape}")

    def save(self, path: str | os.PathLike[str], *, exposure: float = 0.0, half: bool = False) -> None:
        """Writes the picture; see `write`."""
        write(Path(path), self.array, exposure=exposure, half=half)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:  # noqa: ANN401
        return np.array(self.array, dtype=dtype) if copy else np.asarray(self.array, dtype=dtype)

    def __repr__(self) -> str:
        return f"<lajolla.Image, {self.array.shape[1]} x {self.array.shape[0]} pixels>"

    def _repr_png_(self) -> bytes:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "picture.png"
            self.save(path)
            return path.read_bytes()


def encode_srgb(linear: ArrayLike) -> FloatImage:
    """The sRGB transfer function (IEC 61966-2-1), of values clamped to [0, 1]."""
    x = np.clip(np.asarray(linear, np.float32), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055).astype(np.float32)


def decode_srgb(encoded: ArrayLike) -> FloatImage:
    """The inverse of `encode_srgb`, for values in [0, 1]."""
    x = np.asarray(encoded, np.float32)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4).astype(np.float32)


def tone_map(linear: ArrayLike, exposure: float = 0.0) -> NDArray[np.uint8]:
    """Linear radiance times 2^exposure as 8-bit sRGB; NaN is black and infinity white. Raises ImageError."""
    if not isinstance(exposure, int | float) or not abs(exposure) <= MAX_EXPOSURE:
        raise ImageError(f"exposure must be from {-MAX_EXPOSURE:g} to {MAX_EXPOSURE:g}, not {exposure}")
    with np.errstate(over="ignore"):
        scaled = np.asarray(linear, np.float32) * np.float32(2.0**exposure)
    return np.rint(255 * encode_srgb(np.where(np.isnan(scaled), 0, scaled))).astype(np.uint8)


def read(path: str | os.PathLike[str]) -> FloatImage:
    """Reads a picture as linear RGB, float32 of shape (height, width, 3).

    Files of integers (PNG, JPEG) are taken as sRGB; grey becomes three equal channels and alpha is dropped.
    Raises ImageError.
    """
    path = Path(path)
    if not path.is_file():
        raise ImageError(f"{path}: {'not a file' if path.exists() else 'no such file'}")
    config = oiio.ImageSpec()
    config.attribute("pnm:pfmflip", 0)
    source = oiio.ImageInput.open(str(path), config)
    if source is None:
        raise ImageError(f"{path}: cannot be read as a picture: {_first_line(oiio.geterror())}")
    spec = source.spec()
    pixels = source.read_image("float")
    problem = source.geterror()
    source.close()
    if pixels is None or problem:
        raise ImageError(f"{path}: cannot be read: {_first_line(problem)}")
    if path.suffix.lower() == ".pfm":
        pixels = pixels[::-1]
    rgb = _rgb(pixels, spec.channelnames)
    return np.ascontiguousarray(rgb if str(spec.format) in ("half", "float", "double") else decode_srgb(rgb))


def _rgb(pixels: FloatImage, names: tuple[str, ...]) -> FloatImage:
    if {"R", "G", "B"} <= set(names):
        return pixels[..., [names.index(channel) for channel in "RGB"]]
    return pixels[..., :3] if pixels.shape[2] >= 3 else np.repeat(pixels[..., :1], 3, axis=2)


def check_output(path: str | os.PathLike[str]) -> None:
    """Raises ImageError when no picture can be written: unknown format, no such folder, no permission."""
    path = Path(path)
    if path.suffix.lower() not in HIGH_RANGE + LOW_RANGE:
        known = ", ".join(HIGH_RANGE + LOW_RANGE)
        raise ImageError(f"{path}: the format follows from the file's ending, which is one of {known}")
    check_folder(path)


def check_folder(path: Path) -> None:
    """Raises ImageError when no file can be made at `path`."""
    folder = path.resolve().parent
    if not folder.is_dir():
        raise ImageError(f"{path}: there is no folder {folder}")
    try:
        if path.is_dir():
            raise ImageError(f"{path}: is a folder")
    except OSError as error:  # the name is too long
        raise ImageError(f"{path}: {error.strerror}") from error
    if not os.access(folder, os.W_OK):
        raise ImageError(f"{path}: the folder {folder} is not writable")


def check_space(path: Path, width: int, height: int) -> None:
    """Raises ImageError when the disk may be too full for a picture, which compression could make smaller."""
    channel = 1 if path.suffix.lower() in LOW_RANGE else 4  # bytes
    needed = 3 * width * height * channel + 65536
    if shutil.disk_usage(path.resolve().parent).free < needed:
        raise ImageError(f"{path}: no space left on the disk; the picture may need {needed / 2**20:.1f} MiB")


def write(path: Path, array: ArrayLike, *, exposure: float = 0.0, half: bool = False) -> None:
    """Writes linear RGB of shape (height, width, 3) in the format of the file's ending.

    EXR (32-bit, or 16-bit with `half`), HDR and PFM hold the values themselves; PNG and JPEG hold 8-bit sRGB
    of the values times 2^exposure. The file appears complete or not at all. Raises ImageError; what the
    format cannot hold is clamped, with an ImageWarning.
    """
    check_output(path)
    linear = np.asarray(array, np.float32)
    ending = path.suffix.lower()
    if ending in LOW_RANGE:
        write_encoded(path, tone_map(linear, exposure))
    elif half and ending == ".exr":
        write_encoded(path, _clamped(path, linear, -MAX_HALF, MAX_HALF), pixel_type="half")
    else:
        linear = _clamped(path, linear, 0.0, MAX_RGBE) if ending == ".hdr" else linear
        write_encoded(path, linear, pixel_type="float")


def _clamped(path: Path, linear: FloatImage, low: float, high: float) -> FloatImage:
    count = np.count_nonzero((linear < low) | (linear > high))
    if count:
        message = f"{path}: {count} value{'s' if count > 1 else ''} outside of {low:g} to {high:g} clamped"
        warnings.warn(message, ImageWarning, stacklevel=4)
    return np.clip(linear, low, high)


def write_encoded(path: Path, pixels: NDArray[Any], *, pixel_type: str = "uint8") -> None:
    """Writes an array (height, width, channels) as it is, atomically. Raises ImageError."""
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, pixel_type)
    if path.suffix.lower() == ".pfm":
        # OpenImageIO flips this bottom-up format chunk by chunk (its issue 5471): flip it here instead.
        spec.attribute("pnm:pfmflip", 0)
        pixels = pixels[::-1]
    if pixel_type == "uint8":
        spec.attribute("oiio:ColorSpace", "sRGB")
        spec.attribute("CompressionQuality", 95)
    with replacing(path) as temporary:
        if path.suffix.lower() in JPEG:  # libjpeg ends the process when the disk is full: ask before
            check_space(path, width, height)
        output = oiio.ImageOutput.create(str(temporary))
        if output is None:
            raise ImageError(f"{path}: {_first_line(oiio.geterror())}")
        done = output.open(str(temporary), spec) and output.write_image(np.ascontiguousarray(pixels))
        done = output.close() and done
        problem = output.geterror()  # the PNG writer reports success when the disk is full
        if not done or problem:
            raise ImageError(f"{path}: cannot be written: {_first_line(problem)}")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path of the same ending that takes the place of `path` when the block succeeds."""
    target = path.resolve()  # a symbolic link stays a link
    temporary = target.with_name(f".{os.getpid()}-{secrets.token_hex(4)}{target.suffix}")
    try:
        yield temporary
        with open(temporary, "rb+") as file:
            os.fsync(file.fileno())
        os.replace(temporary, target)
    except OSError as error:
        raise ImageError(f"{path}: cannot be written: {error.strerror}") from error
    finally:
        temporary.unlink(missing_ok=True)


def _first_line(text: str) -> str:
    return text.strip().splitlines()[0] if text.strip() else "unknown reason"


@dataclass(frozen=True)
class Comparison:
    """How far picture A is from the reference B: arrays of one value per channel (red, green, blue)."""

    mean_ratio: NDArray[np.float64]
    rmse: NDArray[np.float64]
    relative_mse: NDArray[np.float64]
    excluded: int  # pixels that are not finite in one of the pictures


def compare(a: ArrayLike, b: ArrayLike, *, epsilon: float = 1e-2) -> Comparison:
    """Compares A with the reference B, both linear RGB of one shape (height, width, 3).

    relative_mse is the mean of (A - B)^2 / (B^2 + epsilon). Raises ImageError for different sizes, or when
    no finite pixel is left.
    """
    x, y, finite = _comparable(a, b)
    if not finite.any():
        raise ImageError("no pixel is finite in both pictures")
    x, y = x[finite], y[finite]
    squared = (x - y) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = x.mean(axis=0) / y.mean(axis=0)
    return Comparison(
        mean_ratio=ratio,
        rmse=np.sqrt(squared.mean(axis=0)),
        relative_mse=(squared / (y**2 + epsilon)).mean(axis=0),
        excluded=int(finite.size - finite.sum()),
    )


def difference_picture(a: ArrayLike, b: ArrayLike, *, epsilon: float = 1e-2) -> NDArray[np.uint8]:
    """8-bit RGB of the relative difference: red where A is brighter than B, blue where darker.

    Full colour stands for a difference of half the reference; pixels that are not finite are yellow.
    """
    x, y, finite = _comparable(a, b)
    x, y = np.where(finite[..., None], x, 0).mean(axis=2), np.where(finite[..., None], y, 0).mean(axis=2)
    relative = np.clip(2 * (x - y) / np.sqrt(y**2 + epsilon), -1, 1)
    picture = np.zeros((*relative.shape, 3))
    picture[..., 0] = np.maximum(relative, 0)
    picture[..., 2] = np.maximum(-relative, 0)
    picture[~finite] = (1, 1, 0)
    return np.rint(255 * picture).astype(np.uint8)


def _comparable(
    a: ArrayLike, b: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    x, y = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if x.shape != y.shape:
        sizes = [f"{array.shape[1]} x {array.shape[0]}" for array in (x, y)]
        raise ImageError(f"the pictures differ in size: {sizes[0]} and {sizes[1]}")
    return x, y, np.isfinite(x).all(axis=2) & np.isfinite(y).all(axis=2)
