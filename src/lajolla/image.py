"""Reading and writing pictures: float32 arrays of linear RGB, files with OpenImageIO."""

from __future__ import annotations

import errno
import io
import os
import shutil
import tempfile
import zipfile
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lajolla import denoising
from lajolla.aovs import VARIANCE
from lajolla.colour import FloatImage, decode_srgb, encode_srgb, xyz_to_rgb
from lajolla.film import COMPONENT_FORMATS, PIXEL_FORMATS, Film, matrix_text
from lajolla.layers import NO_LAYERS, Layer, stored_cryptomattes
from lajolla.limits import COMPRESSIONS, check, check_mapping
from lajolla.messages import names_checked, shortened, suggestion, warn
from lajolla.picture_files import (
    ImageError,
    ImageWarning,
    MissingImageError,
    PictureError,
    channel_names,
    header_texts,
    opened,
    plain_name,
    reason,
)
from lajolla.picture_formats import (
    DEEP,
    HOLD_CHANNELS,
    JPEG,
    LOW_RANGE,
    check_offered,
    ending_of,
)
from lajolla.pixelwise import Pixelwise
from lajolla.plotting import plotted
from lajolla.whole_files import Target, check_folder, is_device, name_of, target_of, written_to

Source: TypeAlias = str | os.PathLike[str] | bytes | bytearray | memoryview | BinaryIO

DEFAULT_FILM = Film()
NO_CHANNELS: Mapping[str, FloatImage] = MappingProxyType({})
MAX_EXPOSURE = 100.0  # stops
MAX_HALF = 65504.0  # the largest finite 16-bit float
MAX_UINT = 2.0**32 - 256  # the largest that float32 holds
EXACT = 2**24  # whole numbers up to here are exact in float32
MAX_RGBE = float(np.float32(1.69e38))  # larger numbers wrap around in OpenImageIO's encoder


class Image(Pixelwise):
    """A rendered picture: linear RGB in `array`, float32 of shape (height, width, 3), first row on top.

    What else was rendered is in `channels`, by name: float32 of shape (height, width); "A" is alpha. `layers`
    has what is no mean of samples: ids and Cryptomattes. `film` determines how the picture is written.

    Arithmetic such as `0.5 * (a + b)` or `abs(a - b)` gives pictures with the film of the first one and no
    other channels. NumPy's functions take a picture as its array.
    """

    @names_checked
    def __init__(
        self,
        array: ArrayLike,
        channels: Mapping[str, ArrayLike] = NO_CHANNELS,
        film: Film = DEFAULT_FILM,
        layers: Mapping[str, Layer] = NO_LAYERS,
    ) -> None:
        self.array: FloatImage = np.asarray(array, dtype=np.float32)
        if self.array.ndim != 3 or self.array.shape[2] != 3:
            raise ImageError(f"a picture has shape (height, width, 3), not {self.array.shape}")
        check_mapping("channels", channels)
        check_mapping("layers", layers)
        self.channels = {name: np.asarray(values, dtype=np.float32) for name, values in channels.items()}
        for name, values in self.channels.items():
            if values.shape != self.array.shape[:2]:
                raise ImageError(f"channel {name!r} has shape {values.shape}, not {self.array.shape[:2]}")
        self.film = film
        self.layers = dict(layers)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Everything that was rendered, as in an NPZ file: an array for each layer, first row on top.

        "rgb" is float32 (height, width, 3), linear; "alpha", where it was rendered, (height, width). Channels
        "NAME.LETTER" are together in NAME, (height, width, number of letters), or (height, width) for one.
        Ids are int32, with their names in "NAME_names".
        """
        found: dict[str, list[FloatImage]] = {}
        for label, values in self.channels.items():
            found.setdefault("alpha" if label == "A" else label.rpartition(".")[0] or label, []).append(
                values
            )
        result: dict[str, NDArray[Any]] = {"rgb": self.array}
        for name, parts in found.items():
            result[name] = parts[0] if len(parts) == 1 else np.dstack(parts)
        for name, layer in self.layers.items():
            result |= layer.arrays(name)
        return result

    @staticmethod
    @names_checked
    def open(source: Source) -> Image:
        """Reads a picture of any format that OpenImageIO knows.

        Colours become linear as in `read`. What else is in the file becomes `channels`, and Cryptomattes
        become `layers`. A picture with alpha is saved with it again.

        Args:
            source: the path of a file, the bytes of one, or a binary file object.

        Raises:
            ImageError: it is no picture, or cannot be read.
        """
        array, channels, attributes = _read(source)
        film = Film(pixel_format="rgba") if "A" in channels else DEFAULT_FILM
        mattes = stored_cryptomattes(channels, attributes)
        taken = {name for matte in mattes.values() for name in matte.stored}
        others = {name: values for name, values in channels.items() if name not in taken}
        return Image(array, others, film, mattes)

    @names_checked
    def save(
        self,
        target: str | os.PathLike[str] | BinaryIO,
        *,
        format: str | None = None,
        exposure: float = 0.0,
        half: bool = False,
        compression: str = "zip",
    ) -> None:
        """Writes the picture to a file, or to a binary stream whose `format` is named; see `write`."""
        write(
            target,
            self.array,
            format=format,
            exposure=exposure,
            half=half,
            compression=compression,
            channels=self.channels,
            film=self.film,
            layers=self.layers,
        )

    @names_checked
    def denoise(
        self, features: Mapping[str, FloatImage] | None = None, *, threads: int | None = None
    ) -> Image:
        """The picture without noise, by Intel Open Image Denoise (`pip install pyoidn`).

        The result's channels contain this picture too, as "noisy.R", "noisy.G" and "noisy.B", and the
        features, if it has no such layers itself. Alpha and other layers stay as they are.

        Args:
            features: channels "albedo.R", ... and "normal.x", ... of the same size, or the arrays "albedo"
                and "normal" (height, width, 3), which say what the network should keep; `Scene.features`
                renders them. Default: those that the picture has, if any.
            threads: number of threads, with the same result; default: all.

        Raises:
            DenoiseError: Open Image Denoise is not installed, or failed; the picture was denoised before.
        """
        if any(name in self.channels for name in denoising.NOISY):
            raise denoising.DenoiseError("the picture was denoised before: it has channels noisy.R, ...")
        threads = check("threads", threads)
        given = dict(self.channels)
        if features is not None:
            check_mapping("features", features)
            given = denoising.feature_channels(features)
        for name, values in given.items():
            if np.shape(values) != self.array.shape[:2]:
                raise ImageError(f"feature {name!r} has shape {np.shape(values)}, not {self.array.shape[:2]}")
        array = denoising.denoised(self.array, given, threads=threads)
        noisy = dict(zip(denoising.NOISY, np.moveaxis(self.array, 2, 0), strict=True))
        own = {name.rpartition(".")[0] for name in self.channels}
        kept = {name: values for name, values in given.items() if name.rpartition(".")[0] not in own}
        return Image(array, {**kept, **self.channels, **noisy}, self.film, self.layers)

    @names_checked
    def to_srgb(self, exposure: float = 0.0) -> NDArray[np.uint8]:
        """The picture as screens show it: uint8 (height, width, 3), tone mapped by `film`.

        `exposure`, in stops, brightens by 2^exposure. Raises ImageError.
        """
        return tone_map(self.array, exposure, self.film)

    @names_checked
    def plot(self, layer: str = "rgb", *, exposure: float = 0.0, axes: Any = None) -> Any:  # noqa: ANN401
        """Shows the picture, or another array of `arrays`, with matplotlib.

        Args:
            layer: "rgb", or the name of a variable that was rendered, such as "depth"; colours are tone
                mapped, vectors are shown as (v + 1) / 2, and numbers with a colour bar.
            exposure: of colours, in stops.
            axes: matplotlib's axes to draw in; default: new ones.

        Returns:
            The axes.

        Raises:
            ImageError: matplotlib is not installed, or there is no such layer.
        """
        arrays = self.arrays()
        values = arrays.get(layer)
        if values is None or values.ndim < 2:
            raise ImageError(f"there is no layer {layer!r}{suggestion(str(layer), arrays)}")
        if values.ndim == 3 and (layer == "rgb" or f"{layer}.R" in self.channels):
            values = tone_map(values, exposure, self.film)
        return plotted(values, layer, axes)

    def with_array(self, array: ArrayLike) -> Image:
        """A picture of these pixels with the same film, and no other channels."""
        return Image(array, film=self.film)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:  # noqa: ANN401
        return np.array(self.array, dtype=dtype) if copy else np.asarray(self.array, dtype=dtype)

    def __repr__(self) -> str:
        return f"<lajolla.Image, {self.array.shape[1]} x {self.array.shape[0]} pixels>"

    def _repr_png_(self) -> bytes:
        stream = io.BytesIO()
        self.save(stream, format="png")
        return stream.getvalue()


@names_checked
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


def _write_low_range(
    target: Target,
    ending: str,
    linear: FloatImage,
    exposure: float,
    channels: Mapping[str, FloatImage],
    film: Film,
) -> None:
    """Writes the film's pixel format, as far as the file can hold it; alpha stays linear."""
    names, pixel_format = _held(ending, film)
    pixels = film.develop(_display(linear, exposure, film), channels, pixel_format)
    split = pixels.shape[2] - ("A" in names)
    colours, alpha = _encoded(pixels[..., :split], film), np.clip(pixels[..., split:], 0, 1)
    repeats = 3 if split == 1 and "Y" not in names else 1
    whole = np.uint16 if ending in DEEP else np.uint8
    encoded = np.concatenate([colours.repeat(repeats, axis=2), alpha], axis=2)
    write_encoded(
        target, np.rint(np.iinfo(whole).max * encoded).astype(whole), ending=ending, names=tuple(names)
    )


def _held(ending: str, film: Film) -> tuple[str, str]:
    """The channels of a file that are nearest to the film's, and the pixel format to fill them with.

    Alpha is given up before grey is stored as three equal channels.
    """
    wanted = "".join(film.names).replace("XYZ", "RGB")
    for kept in (wanted, wanted.replace("A", "")):
        for names in (kept, kept.replace("Y", "RGB")):
            if len(names) in LOW_RANGE[ending]:
                return names, next(name for name, letters in PIXEL_FORMATS.items() if letters == kept)
    raise AssertionError(f"{ending} files hold neither grey nor colours")


@names_checked
def read(source: Source) -> FloatImage:
    """Reads a picture as linear RGB, float32 of shape (height, width, 3).

    Files of integers (PNG, JPEG) are taken as sRGB; grey becomes three equal channels, XYZ becomes RGB, alpha
    and other channels are dropped.

    Args:
        source: the path of a file, the bytes of one, or a binary file object.

    Raises:
        ImageError: it is no picture, or cannot be read.
    """
    return _read(source)[0]


Contents: TypeAlias = tuple[FloatImage, dict[str, FloatImage], dict[str, str]]


def _read(source: Source) -> Contents:
    """Linear RGB, the other channels by their names, and the texts in the header."""
    if isinstance(source, str | os.PathLike):
        return _read_file(Path(source), str(source))
    if not isinstance(source, bytes | bytearray | memoryview) and not hasattr(source, "read"):
        kind = type(source).__name__
        raise TypeError(f"a picture is a file name, bytes or a binary file object, not {kind}")
    data = source if isinstance(source, bytes | bytearray | memoryview) else source.read()
    if isinstance(data, str):
        raise ImageError('a picture is read from bytes: open its file with mode "rb"')
    with tempfile.TemporaryDirectory() as folder:  # the Python module of OpenImageIO reads files only
        path = Path(folder, "picture")
        path.write_bytes(data)
        name = getattr(source, "name", None)
        return _read_file(path, name if isinstance(name, str) else "picture")


def _read_file(path: Path, name: str) -> Contents:
    try:
        if not path.is_file():
            if not path.exists():
                raise MissingImageError(f"{name}: no such file")
            raise ImageError(f"{name}: not a file")
        with opened(path) as (file, _):
            spec = file.spec()
            whole = str(spec.format) == "uint"  # EXR files of whole numbers, which mean themselves
            pixels = file.read_image("uint" if whole else "float")
            problem = reason(file, "")
    except MissingImageError:
        raise
    except OSError as error:
        shown = shortened(name) if error.errno == errno.ENAMETOOLONG else name
        raise ImageError(f"{shown}: cannot be read: {error.strerror}") from None
    except PictureError as error:
        raise ImageError(
            f"{name}: cannot be read as a picture: {str(error).replace(str(path), name)}"
        ) from None
    if pixels is None or problem:
        raise ImageError(f"{name}: cannot be read: {problem.replace(str(path), name) or 'unknown reason'}")
    pixels, names = pixels.astype(np.float32, copy=False), channel_names(spec)
    rgb = _rgb(pixels, names)
    others = {name: pixels[..., i] for i, name in enumerate(names) if name not in COLOURS}
    linear = whole or str(spec.format) in ("half", "float", "double")
    return np.ascontiguousarray(rgb if linear else decode_srgb(rgb)), others, header_texts(spec)


COLOURS = ("R", "G", "B", "X", "Y", "Z")


def _rgb(pixels: FloatImage, names: list[str]) -> FloatImage:
    if {"R", "G", "B"} <= set(names):
        return pixels[..., [names.index(channel) for channel in "RGB"]]
    if {"X", "Y", "Z"} <= set(names):
        return xyz_to_rgb(pixels[..., [names.index(channel) for channel in "XYZ"]])
    if "Y" in names:
        return np.repeat(pixels[..., [names.index("Y")]], 3, axis=2)
    return pixels[..., :3] if pixels.shape[2] >= 3 else np.repeat(pixels[..., :1], 3, axis=2)


@names_checked
def check_output(target: str | os.PathLike[str] | BinaryIO, format: str | None = None) -> None:
    """Raises ImageError if a picture cannot be written: unknown format, missing folder, no permission.

    Raises TypeError for what is neither a file name nor a binary file, ValueError for a closed one.
    """
    path = _as_target(target)
    check_offered(ending_of(path if isinstance(path, Path) else None, format))
    if isinstance(path, Path):
        check_folder(path)


def _as_target(target: str | os.PathLike[str] | BinaryIO) -> Target:
    if isinstance(target, str | os.PathLike):
        return Path(target)
    if not hasattr(target, "write"):
        raise TypeError(f"a picture goes to a file name or a binary file object, not {type(target).__name__}")
    if isinstance(target, io.TextIOBase):
        raise TypeError('a picture is written as bytes: open its file with mode "wb"')
    if getattr(target, "closed", False):
        raise ValueError("the file object for the picture is closed")
    return target


@names_checked
def check_space(path: Path, width: int, height: int, channels: int = 3, format: str | None = None) -> None:
    """Raises ImageError when the disk may be too full for a picture, which compression could make smaller."""
    ending = ending_of(path, format)
    channel = 4 if ending not in LOW_RANGE else 2 if ending in DEEP else 1  # bytes
    needed = (channels if ending in HOLD_CHANNELS else 3) * width * height * channel + 65536
    folder = tempfile.gettempdir() if is_device(path) else target_of(path).parent
    if shutil.disk_usage(folder).free < needed:
        raise ImageError(f"{path}: no space left on the disk; the picture may need {needed / 2**20:.1f} MiB")


@names_checked
def write(
    target: str | os.PathLike[str] | BinaryIO,
    array: ArrayLike,
    *,
    format: str | None = None,
    exposure: float = 0.0,
    half: bool = False,
    compression: str = "zip",
    channels: Mapping[str, FloatImage] = NO_CHANNELS,
    film: Film = DEFAULT_FILM,
    layers: Mapping[str, Layer] = NO_LAYERS,
) -> None:
    """Writes linear RGB of shape (height, width, 3) to a file or a binary stream.

    EXR, HDR and PFM hold the values themselves, EXR in the film's numbers, or colours in 16-bit ones with
    `half`. PNG, JPEG, WebP and others for displays hold them as the film maps them, times 2^exposure, to 8
    bits, TIFF to 16. NPY and M files are matrices for NumPy, Matlab and Mathematica, and NPZ files what
    `Image.arrays` returns. EXR and NPY hold the `channels` and the `layers` too, behind the film's own. A
    file appears complete or not at all.

    Args:
        format: "exr", "png", ..., where it does not follow from the ending of a file's name.
        compression: of EXR files: "zip", "piz", "dwaa", "none", ...

    Raises:
        ImageError: it cannot be written. What the format cannot hold is clamped, with an ImageWarning.
    """
    check_output(target, format)
    target, linear = _as_target(target), np.asarray(array, np.float32)
    ending = ending_of(target if isinstance(target, Path) else None, format)
    if ending in LOW_RANGE:
        _write_low_range(target, ending, linear, exposure, channels, film)
    elif ending == ".hdr":
        write_encoded(target, _clamped(target, linear, 0.0, MAX_RGBE), ending=ending)
    elif ending == ".pfm":
        grey = film.develop(linear, channels) if film.names == ("Y",) else linear
        write_encoded(target, grey, ending=ending)
    elif ending == ".exr":
        _write_exr(target, Image(linear, channels, film, layers), half, compression)
    elif ending == ".npz":
        _write_arrays(target, Image(linear, channels, film, layers).arrays())
    else:
        _write_matrix(target, ending, Image(linear, channels, film, layers))


def _write_exr(target: Target, image: Image, half: bool, compression: str) -> None:
    """Stores colours alone as 16-bit numbers, as compositors expect: these are too coarse for positions."""
    data = {k: v for name, layer in image.layers.items() for k, v in layer.channels(name).items()}
    check_exact(target, image.layers, image.film, half=half, compression=compression)
    _warn_of_large_ids(target, data)
    others = {name: values for name, values in image.channels.items() if name != "A"}
    pixels: NDArray[Any] = np.dstack(
        [image.film.develop(image.array, image.channels), *others.values(), *data.values()]
    )
    names = (*image.film.names, *others, *data)
    formats = ["float"] * len(names)
    pixel_type = "half" if half else COMPONENT_FORMATS[image.film.component_format]
    if pixel_type == "half":
        coarse = [i for i, name in enumerate(names) if name not in data and _is_colour(name, image.film)]
        pixels[..., coarse] = _clamped(target, pixels[..., coarse], -MAX_HALF, MAX_HALF)
        formats = ["half" if i in coarse else "float" for i in range(len(names))]
    elif pixel_type == "uint":
        pixels = np.rint(_clamped(target, np.nan_to_num(pixels), 0.0, MAX_UINT)).astype(np.uint32)
        formats = []
    metadata = {k: v for name, layer in image.layers.items() for k, v in layer.metadata(name).items()}
    metadata["compression"] = compression
    write_encoded(target, pixels, ending=".exr", names=names, formats=formats, attributes=metadata)


def _is_colour(channel: str, film: Film) -> bool:
    layer, _, letter = channel.rpartition(".")
    return channel in film.names or (letter in ("R", "G", "B", "A") and layer != VARIANCE)


@names_checked
def check_exact(target: Target, layers: Collection[str], film: Film, *, half: bool, compression: str) -> None:
    """Raises ImageError if an EXR file cannot hold the numbers of these layers, ids and mattes, exactly."""
    if compression not in COMPRESSIONS:
        raise ImageError(f"unknown compression {compression!r}{suggestion(compression, COMPRESSIONS)}")
    for name in layers:
        if compression == "pxr24":
            raise ImageError(
                f"{name_of(target)}: pxr24 rounds numbers, which would destroy the layer {name!r}"
            )
        if film.component_format == "uint32" and not half:
            raise ImageError(f"{name_of(target)}: a film of whole numbers cannot hold the layer {name!r}")


def _warn_of_large_ids(target: Target, data: Mapping[str, FloatImage]) -> None:
    for label, values in data.items():
        if label.endswith(".I") and values.max(initial=0) > EXACT:
            problem = f"numbers in {label} above {EXACT} are rounded, but not in NPZ"
            warn(ImageWarning(f"{name_of(target)}: {problem}"))


def _write_matrix(target: Target, ending: str, image: Image) -> None:
    """NumPy: (height, width), or (height, width, channels); texts hold the picture alone."""
    pixels = image.film.develop(image.array, image.channels)
    with written_to(target, ending) as temporary:
        if ending == ".m":
            temporary.write_text(matrix_text(pixels, image.film))
            return
        others = [values for name, values in image.channels.items() if name != "A"]
        data = [values for name, layer in image.layers.items() for values in layer.channels(name).values()]
        everything = np.dstack([pixels, *others, *data])
        np.save(temporary, everything[..., 0] if everything.shape[2] == 1 else everything)


def _write_arrays(target: Target, arrays: Mapping[str, NDArray[Any]]) -> None:
    """An NPZ file. Unlike `numpy.savez`, this takes any names."""
    with written_to(target, ".npz") as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, values in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.ascontiguousarray(values), allow_pickle=False)


def _clamped(target: Target, linear: FloatImage, low: float, high: float) -> FloatImage:
    count = np.count_nonzero((linear < low) | (linear > high))
    if count:
        values = f"{count} value{'s' if count > 1 else ''}"
        warn(ImageWarning(f"{name_of(target)}: {values} outside of {low:g} to {high:g} clamped"))
    return np.clip(linear, low, high)


# The numbers that files hold, by those of arrays.
PIXEL_TYPES = {"uint8": "uint8", "uint16": "uint16", "uint32": "uint", "float32": "float"}
NO_ATTRIBUTES: Mapping[str, str] = MappingProxyType({})


@names_checked
def write_encoded(
    target: Target,
    pixels: NDArray[Any],
    *,
    ending: str = "",
    names: tuple[str, ...] = (),
    formats: Sequence[str] = (),
    attributes: Mapping[str, str] = NO_ATTRIBUTES,
) -> None:
    """Writes an array (height, width, channels) as it is, atomically. Raises ImageError.

    Args:
        target: a file, or a stream.
        pixels: 8, 16 or 32-bit whole numbers, or 32-bit floats.
        ending: of the format, if not that of the file's name.
        names: of the channels.
        formats: of the channels, if not those of the array: "half" or "float".
        attributes: of the file.
    """
    import OpenImageIO as oiio  # as in `check_offered`

    ending = ending or ending_of(target if isinstance(target, Path) else None, None)
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, PIXEL_TYPES[pixels.dtype.name])
    if names:
        spec.channelnames = names
        spec.alpha_channel = names.index("A") if "A" in names else -1
    if formats:
        spec.channelformats = tuple(oiio.TypeDesc(name) for name in formats)
        spec.format = oiio.TypeDesc("float" if "float" in formats else "half")
    for name, value in attributes.items():
        spec.attribute(name, value)
    if ending == ".pfm":
        # OpenImageIO flips this bottom-up format chunk by chunk (its issue 5471): flip it here instead.
        spec.attribute("pnm:pfmflip", 0)
        pixels = pixels[::-1]
    if ending in LOW_RANGE:
        spec.attribute("oiio:ColorSpace", "sRGB")
        spec.attribute("oiio:UnassociatedAlpha", 1)  # nothing is divided by alpha
        spec.attribute("CompressionQuality", 95)
    with written_to(target, ending) as temporary, plain_name(temporary) as name:
        if ending in JPEG and isinstance(target, Path):  # libjpeg ends the process when the disk is full
            check_space(target, width, height, format=ending)
        output = oiio.ImageOutput.create(name)
        if output is None:
            raise ImageError(f"{name_of(target)}: {reason(oiio).replace(name, name_of(target))}")
        done = output.open(name, spec) and output.write_image(np.ascontiguousarray(pixels))
        done = output.close() and done
        problem = reason(output, "").replace(
            name, name_of(target)
        )  # the PNG writer reports success when the disk is full
        if not done or problem:
            raise ImageError(f"{name_of(target)}: cannot be written: {problem or 'unknown reason'}")
