"""Pictures in and out: float32 arrays of linear RGB, files by way of OpenImageIO."""

import os
import shutil
import tempfile
import warnings
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lajolla.colour import FloatImage, decode_srgb, encode_srgb, xyz_to_rgb
from lajolla.film import COMPONENT_FORMATS, PIXEL_FORMATS, Film, matrix_text
from lajolla.picture_files import (
    ImageError,
    ImageWarning,
    PictureError,
    channel_names,
    opened,
    plain_name,
    reason,
)
from lajolla.whole_files import check_folder, is_device, replacing, target_of

HIGH_RANGE = (".exr", ".hdr", ".pfm")
MATRIX = (".npy", ".m")
JPEG = (".jpg", ".jpeg")
LOW_RANGE = (".png", *JPEG)
ENDINGS = (*HIGH_RANGE, *LOW_RANGE, *MATRIX)
HOLD_CHANNELS = (".exr", ".npy")  # what can hold more than a picture
DEFAULT_FILM = Film()
NO_CHANNELS: Mapping[str, FloatImage] = MappingProxyType({})
MAX_EXPOSURE = 100.0  # stops
MAX_HALF = 65504.0  # the largest finite 16-bit float
MAX_UINT = 2.0**32 - 256  # the largest that float32 holds
MAX_RGBE = float(np.float32(1.69e38))  # larger numbers wrap around in OpenImageIO's encoder


class Image:
    """A rendered picture: linear RGB in `array`, float32 of shape (height, width, 3), first row on top.

    What else was rendered is in `channels`, by name: float32 of shape (height, width); "A" is alpha. `film`
    tells how the picture is written.
    """

    def __init__(
        self,
        array: ArrayLike,
        channels: Mapping[str, ArrayLike] = NO_CHANNELS,
        film: Film = DEFAULT_FILM,
    ) -> None:
        self.array: FloatImage = np.asarray(array, dtype=np.float32)
        if self.array.ndim != 3 or self.array.shape[2] != 3:
            raise ImageError(f"a picture has shape (height, width, 3), not {self.array.shape}")
        self.channels = {name: np.asarray(values, dtype=np.float32) for name, values in channels.items()}
        for name, values in self.channels.items():
            if values.shape != self.array.shape[:2]:
                raise ImageError(f"channel {name!r} has shape {values.shape}, not {self.array.shape[:2]}")
        self.film = film

    def save(self, path: str | os.PathLike[str], *, exposure: float = 0.0, half: bool = False) -> None:
        """Writes the picture; see `write`."""
        write(Path(path), self.array, exposure=exposure, half=half, channels=self.channels, film=self.film)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:  # noqa: ANN401
        return np.array(self.array, dtype=dtype) if copy else np.asarray(self.array, dtype=dtype)

    def __repr__(self) -> str:
        return f"<lajolla.Image, {self.array.shape[1]} x {self.array.shape[0]} pixels>"

    def _repr_png_(self) -> bytes:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "picture.png"
            self.save(path)
            return path.read_bytes()


def tone_map(linear: ArrayLike, exposure: float = 0.0, film: Film = DEFAULT_FILM) -> NDArray[np.uint8]:
    """Linear RGB as the film maps it, times 2^exposure, as 8-bit sRGB, or with the film's gamma.

    NaN is black and infinity white. Raises ImageError.
    """
    return np.rint(255 * _encoded(_display(linear, exposure, film), film)).astype(np.uint8)


def _display(linear: ArrayLike, exposure: float, film: Film) -> FloatImage:
    if not isinstance(exposure, int | float) or not abs(exposure) <= MAX_EXPOSURE:
        raise ImageError(f"exposure must be from {-MAX_EXPOSURE:g} to {MAX_EXPOSURE:g}, not {exposure}")
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = film.tone_map(np.asarray(linear, np.float32)) * np.float32(2.0**exposure)
    return np.where(np.isnan(scaled), 0, scaled)


def _encoded(linear: FloatImage, film: Film) -> FloatImage:
    if film.gamma == -1:
        return encode_srgb(linear)
    return np.clip(linear, 0, 1) ** np.float32(1 / film.gamma)


def _low_range(
    path: Path, linear: FloatImage, exposure: float, channels: Mapping[str, FloatImage], film: Film
) -> NDArray[np.uint8]:
    """The 8-bit picture in the film's pixel format, as far as the file can hold it; alpha stays linear."""
    names = film.names if path.suffix.lower() == ".png" else tuple(name for name in film.names if name != "A")
    kept = "".join(names).replace("XYZ", "RGB")
    pixel_format = next(name for name, letters in PIXEL_FORMATS.items() if letters == kept)
    pixels = film.develop(_display(linear, exposure, film), channels, pixel_format)
    colours = len(names) - ("A" in names)
    pixels = np.concatenate(
        [_encoded(pixels[..., :colours], film), np.clip(pixels[..., colours:], 0, 1)], axis=2
    )
    return np.rint(255 * pixels).astype(np.uint8)


def read(path: str | os.PathLike[str]) -> FloatImage:
    """Reads a picture as linear RGB, float32 of shape (height, width, 3).

    Files of integers (PNG, JPEG) are taken as sRGB; grey becomes three equal channels, XYZ becomes RGB, alpha
    and other channels are dropped. Raises ImageError.
    """
    path = Path(path)
    if not path.is_file():
        raise ImageError(f"{path}: {'not a file' if path.exists() else 'no such file'}")
    try:
        with opened(path) as source:
            spec = source.spec()
            whole = str(spec.format) == "uint"  # EXR files of whole numbers, which mean themselves
            pixels = source.read_image("uint" if whole else "float")
            problem = reason(source, "")
    except PictureError as error:
        raise ImageError(f"{path}: cannot be read as a picture: {error}") from None
    if pixels is None or problem:
        raise ImageError(f"{path}: cannot be read: {problem or 'unknown reason'}")
    rgb = _rgb(pixels.astype(np.float32, copy=False), channel_names(spec))
    linear = whole or str(spec.format) in ("half", "float", "double")
    return np.ascontiguousarray(rgb if linear else decode_srgb(rgb))


def _rgb(pixels: FloatImage, names: list[str]) -> FloatImage:
    if {"R", "G", "B"} <= set(names):
        return pixels[..., [names.index(channel) for channel in "RGB"]]
    if {"X", "Y", "Z"} <= set(names):
        return xyz_to_rgb(pixels[..., [names.index(channel) for channel in "XYZ"]])
    if "Y" in names:
        return np.repeat(pixels[..., [names.index("Y")]], 3, axis=2)
    return pixels[..., :3] if pixels.shape[2] >= 3 else np.repeat(pixels[..., :1], 3, axis=2)


def check_output(path: str | os.PathLike[str]) -> None:
    """Raises ImageError when no picture can be written: unknown format, no such folder, no permission."""
    path = Path(path)
    if path.suffix.lower() not in ENDINGS:
        known = ", ".join(ENDINGS)
        raise ImageError(f"{path}: the format follows from the file's ending, which is one of {known}")
    if path.suffix.lower() not in MATRIX:
        import OpenImageIO  # noqa: F401 # as in `read`; what would fail after rendering fails now
    check_folder(path)


def check_space(path: Path, width: int, height: int, channels: int = 3) -> None:
    """Raises ImageError when the disk may be too full for a picture, which compression could make smaller."""
    ending = path.suffix.lower()
    channel = 1 if ending in LOW_RANGE else 4  # bytes
    needed = (channels if ending in HOLD_CHANNELS else 3) * width * height * channel + 65536
    folder = tempfile.gettempdir() if is_device(path) else target_of(path).parent
    if shutil.disk_usage(folder).free < needed:
        raise ImageError(f"{path}: no space left on the disk; the picture may need {needed / 2**20:.1f} MiB")


def write(
    path: Path,
    array: ArrayLike,
    *,
    exposure: float = 0.0,
    half: bool = False,
    channels: Mapping[str, FloatImage] = NO_CHANNELS,
    film: Film = DEFAULT_FILM,
) -> None:
    """Writes linear RGB of shape (height, width, 3) in the format of the file's ending.

    EXR, HDR and PFM hold the values themselves, EXR in the film's numbers, or 16-bit ones with `half`. PNG
    and JPEG hold them as the film maps them to 8 bits, times 2^exposure. NPY and M files are matrices for
    NumPy, Matlab and Mathematica. EXR and NPY hold the `channels` too, behind the film's own. The file
    appears complete or not at all. Raises ImageError; what the format cannot hold is clamped, with an
    ImageWarning.
    """
    check_output(path)
    linear = np.asarray(array, np.float32)
    ending = path.suffix.lower()
    if ending in LOW_RANGE:
        write_encoded(path, _low_range(path, linear, exposure, channels, film))
    elif ending == ".hdr":
        write_encoded(path, _clamped(path, linear, 0.0, MAX_RGBE), pixel_type="float")
    elif ending == ".pfm":
        grey = film.develop(linear, channels) if film.names == ("Y",) else linear
        write_encoded(path, grey, pixel_type="float")
    elif ending == ".exr":
        _write_exr(path, linear, half, channels, film)
    else:
        _write_matrix(path, linear, channels, film)


def _write_exr(
    path: Path, linear: FloatImage, half: bool, channels: Mapping[str, FloatImage], film: Film
) -> None:
    others = {name: values for name, values in channels.items() if name != "A"}
    pixels = np.dstack([film.develop(linear, channels), *others.values()])
    pixel_type = "half" if half else COMPONENT_FORMATS[film.component_format]
    if pixel_type == "half":
        pixels = _clamped(path, pixels, -MAX_HALF, MAX_HALF)
    elif pixel_type == "uint":
        pixels = np.rint(_clamped(path, np.nan_to_num(pixels), 0.0, MAX_UINT)).astype(np.uint32)
    write_encoded(path, pixels, pixel_type=pixel_type, names=(*film.names, *others))


def _write_matrix(path: Path, linear: FloatImage, channels: Mapping[str, FloatImage], film: Film) -> None:
    """NumPy: (height, width), or (height, width, channels); texts hold the picture alone."""
    pixels = film.develop(linear, channels)
    with replacing(path) as temporary:
        if path.suffix.lower() == ".m":
            temporary.write_text(matrix_text(pixels, film))
            return
        others = [values for name, values in channels.items() if name != "A"]
        everything = np.dstack([pixels, *others])
        np.save(temporary, everything[..., 0] if everything.shape[2] == 1 else everything)


def _clamped(path: Path, linear: FloatImage, low: float, high: float) -> FloatImage:
    count = np.count_nonzero((linear < low) | (linear > high))
    if count:
        message = f"{path}: {count} value{'s' if count > 1 else ''} outside of {low:g} to {high:g} clamped"
        warnings.warn(message, ImageWarning, stacklevel=4)
    return np.clip(linear, low, high)


def write_encoded(
    path: Path, pixels: NDArray[Any], *, pixel_type: str = "uint8", names: tuple[str, ...] = ()
) -> None:
    """Writes an array (height, width, channels) as it is, atomically. Raises ImageError."""
    import OpenImageIO as oiio  # as in `read`

    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, pixel_type)
    if names:
        spec.channelnames = names
        spec.alpha_channel = names.index("A") if "A" in names else -1
    if path.suffix.lower() == ".pfm":
        # OpenImageIO flips this bottom-up format chunk by chunk (its issue 5471): flip it here instead.
        spec.attribute("pnm:pfmflip", 0)
        pixels = pixels[::-1]
    if pixel_type == "uint8":
        spec.attribute("oiio:ColorSpace", "sRGB")
        spec.attribute("oiio:UnassociatedAlpha", 1)  # nothing is divided by alpha
        spec.attribute("CompressionQuality", 95)
    with replacing(path) as temporary, plain_name(temporary) as name:
        if path.suffix.lower() in JPEG:  # libjpeg ends the process when the disk is full: ask before
            check_space(path, width, height)
        output = oiio.ImageOutput.create(name)
        if output is None:
            raise ImageError(f"{path}: {reason(oiio)}")
        done = output.open(name, spec) and output.write_image(np.ascontiguousarray(pixels))
        done = output.close() and done
        problem = reason(output, "")  # the PNG writer reports success when the disk is full
        if not done or problem:
            raise ImageError(f"{path}: cannot be written: {problem or 'unknown reason'}")
