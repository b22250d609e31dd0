"""Wrapper around OpenImageIO: file names and messages of any encoding, and limits."""

import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lajolla.messages import Error, LajollaWarning

# Limits of the bytes of one picture, and of all pictures of a scene: a constant plus MAX_RATIO per byte of
# the files, so that a small file cannot request all memory. Deflate compresses constant images by a factor of
# a thousand; 1 GiB is an image of 8192 x 8192 pixels with four float32 numbers.
MAX_RATIO = 256
MAX_PICTURE = 1 << 30
MAX_PICTURES = 1 << 32


class PictureError(Exception):
    """A picture that OpenImageIO cannot read; the message is the reason alone."""


class ImageError(Error):
    """A picture that cannot be read, written or compared; the message names the file and the reason."""


class MissingImageError(ImageError, FileNotFoundError):
    """A picture whose file does not exist."""

    def __str__(self) -> str:
        return str(self.args[0])


class ImageWarning(LajollaWarning):
    """A picture that is not written as it is; the message names the file and the reason."""


@contextmanager
def opened(path: Path) -> Iterator[tuple[Any, int]]:
    """The ImageInput of a picture, whose colours are not multiplied by alpha, and the bytes of its file.

    Raises:
        PictureError: it is no picture, or would take more memory than a file of its size should.
    """
    import OpenImageIO as oiio  # here, because it takes long and many commands need no pictures

    size = _size_of(path)
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    with plain_name(path) as name:
        source = oiio.ImageInput.open(name, config)
        if source is None:
            raise PictureError(reason(oiio).replace(name, str(path)))
        try:
            spec = source.spec()
            depth = max(spec.depth, 1) * spec.nchannels * max(spec.format.size(), 1)
            check_size(size, spec.width, spec.height, depth)
            yield source, size
        finally:
            source.close()


def _size_of(path: Path) -> int:
    """The bytes of a file; raises PictureError where there is none."""
    try:
        status = path.stat()
    except (OSError, ValueError):
        status = None
    if status is None or not stat.S_ISREG(status.st_mode):
        raise PictureError("it is not a file")
    return status.st_size


def check_size(size: int, width: int, height: int, pixel: int) -> None:
    """Raises PictureError where a picture of pixels of so many bytes is too large for a file of `size`."""
    if width * height * pixel > MAX_PICTURE + MAX_RATIO * size:
        raise PictureError(f"{width} x {height} pixels are too many for a file of {size:,} bytes")


@dataclass
class Budget:
    """What the pictures of a scene take, and may take, together."""

    decoded: int = 0  # bytes
    stored: int = 0  # bytes of the files

    def spend(self, decoded: int, stored: int) -> None:
        """Adds a picture of so many bytes, with a file of so many; raises PictureError where all together are
        too many."""
        self.decoded += decoded
        self.stored += stored
        limit = MAX_PICTURES + MAX_RATIO * self.stored
        if self.decoded > limit:
            problem = f"the textures would take {self.decoded >> 20:,} MiB decoded"
            raise PictureError(f"{problem}; the limit is {limit >> 20:,} MiB")


@contextmanager
def plain_name(path: Path) -> Iterator[str]:
    """A name of a file for libraries that take UTF-8 only: its own, or that of a temporary link."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        with tempfile.TemporaryDirectory() as folder:
            link = Path(folder, "file" + (path.suffix if path.suffix.isascii() else ""))
            link.symlink_to(path.absolute())
            yield str(link)
    else:
        yield str(path)


def reason(source: Any, otherwise: str = "unknown reason") -> str:  # noqa: ANN401
    """The first line of the error message of OpenImageIO or of an open file."""
    try:
        text = source.geterror()
    except UnicodeDecodeError as problem:  # it quotes the file
        text = bytes(problem.object).decode("utf-8", "replace")
    lines = text.strip().splitlines()
    return "".join(c if c.isprintable() else "?" for c in lines[0][:300]) if lines else otherwise


def channel_names(spec: Any) -> list[str]:  # noqa: ANN401
    """The names of a picture's channels; one that is not UTF-8 is "?"."""
    try:
        return list(spec.channelnames)
    except UnicodeDecodeError:
        return [_channel_name(spec, index) for index in range(spec.nchannels)]


def _channel_name(spec: Any, index: int) -> str:  # noqa: ANN401
    try:
        return spec.channel_name(index)
    except UnicodeDecodeError:
        return "?"


def header_texts(spec: Any) -> dict[str, str]:  # noqa: ANN401
    """The texts in the header of a picture by name, without those that are not UTF-8."""
    result = {}
    for attribute in spec.extra_attribs:
        with suppress(UnicodeDecodeError):
            if isinstance(attribute.value, str):
                result[attribute.name] = attribute.value
    return result
