"""Pictures in and out: float32 arrays of linear RGB, files by way of OpenImageIO, and error measures."""

import hashlib
import os
import platform
import secrets
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lajolla.film import COMPONENT_FORMATS, PIXEL_FORMATS, RGB_TO_XYZ, Film, FloatImage, matrix_text
from lajolla.messages import LajollaWarning, warn
from lajolla.picture_files import PictureError, channel_names, opened, plain_name, reason

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


class ImageError(Exception):
    """A picture that cannot be read, written or compared; the message names the file and the reason."""


class ImageWarning(LajollaWarning):
    """A picture that is not written as it is; the message names the file and the reason."""


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


def encode_srgb(linear: ArrayLike) -> FloatImage:
    """The sRGB transfer function (IEC 61966-2-1), of values clamped to [0, 1]."""
    x = np.clip(np.asarray(linear, np.float32), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055).astype(np.float32)


def decode_srgb(encoded: ArrayLike) -> FloatImage:
    """The inverse of `encode_srgb`, for values in [0, 1]."""
    x = np.asarray(encoded, np.float32)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4).astype(np.float32)


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
        return pixels[..., [names.index(channel) for channel in "XYZ"]] @ np.linalg.inv(RGB_TO_XYZ).T
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


def check_folder(path: Path) -> None:
    """Raises ImageError when no file can be made at `path`, and nothing that is there can be written to."""
    try:
        target = _target(path)
        if is_device(path):
            if not os.access(path, os.W_OK):
                raise ImageError(f"{path}: is not writable")
            return
        if not target.parent.is_dir():
            raise ImageError(f"{path}: there is no folder {target.parent}")
        if target.is_dir():
            raise ImageError(f"{path}: is a folder")
    except OSError as error:  # the name is too long
        raise ImageError(f"{path}: {error.strerror}") from error
    if not os.access(target.parent, os.W_OK):
        raise ImageError(f"{path}: the folder {target.parent} is not writable")


def _target(path: Path) -> Path:
    """The file that a link leads to, which need not be there; the path itself where it is no link."""
    target = Path(os.path.realpath(path))
    if target.is_symlink():
        raise ImageError(f"{path}: is a link that leads to itself")
    return target


def is_device(path: Path) -> bool:
    """Whether this is a pipe, a terminal or the like, which is written to instead of replaced."""
    return path.exists() and not path.is_file() and not path.is_dir()


def check_space(path: Path, width: int, height: int, channels: int = 3) -> None:
    """Raises ImageError when the disk may be too full for a picture, which compression could make smaller."""
    ending = path.suffix.lower()
    channel = 1 if ending in LOW_RANGE else 4  # bytes
    needed = (channels if ending in HOLD_CHANNELS else 3) * width * height * channel + 65536
    folder = tempfile.gettempdir() if is_device(path) else _target(path).parent
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
        warn(ImageWarning(message))
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


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path of the same ending that takes the place of `path` when the block succeeds.

    Where there is a pipe or a device, the bytes are written to it instead. A link stays a link.
    """
    try:
        target, device = _target(path), is_device(path)
        folder = Path(tempfile.gettempdir()) if device else target.parent
        prefix = _temporary_prefix(target)
        _remove_abandoned(folder, prefix)
        temporary = folder / f"{prefix}{os.getpid()}-{secrets.token_hex(4)}{path.suffix}"
        try:
            yield temporary
            if device:
                with open(temporary, "rb") as file, open(os.open(path, os.O_WRONLY), "wb") as stream:
                    shutil.copyfileobj(file, stream)
                return
            with open(temporary, "rb+") as file:
                os.fsync(file.fileno())
            os.replace(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise ImageError(f"{path}: cannot be written: {error.strerror}") from error


def _temporary_prefix(target: Path) -> str:
    """How the names of temporary files for a target begin, where process ids mean what they mean here."""
    origin = os.fsencode(target) + b"\0" + _process_space().encode()
    return f".lajolla-{hashlib.blake2b(origin, digest_size=6).hexdigest()}-"


def _process_space() -> str:
    """What has process ids of its own: a machine since it was started, and in it a container."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text() + os.readlink("/proc/self/ns/pid")
    except OSError:  # not Linux
        return platform.node()


def _remove_abandoned(folder: Path, prefix: str) -> None:
    """Removes the temporary files of processes that were killed while they wrote, as far as it can."""
    for left in folder.glob(f"{prefix}*"):
        with suppress(OSError, OverflowError, ValueError):  # it is another user's, or no name of ours
            try:
                os.kill(int(left.name[len(prefix) :].partition("-")[0]), 0)
            except ProcessLookupError:
                left.unlink()


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
