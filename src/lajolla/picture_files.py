"""Wrapper around OpenImageIO: file names and messages of any encoding, and limits."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lajolla.messages import LajollaWarning

# A picture takes so many bytes at most, and so many more for each byte of its file, and so do all pictures of
# a scene together: a small file cannot ask for all memory there is. Deflated data of one colour is a
# thousandth of it; 1 GiB is what 8192 x 8192 pixels of it are as four float32 numbers each.
MAX_RATIO = 256
MAX_PICTURE = 1 << 30
MAX_PICTURES = 1 << 32


class PictureError(Exception):
    """A picture that OpenImageIO cannot read; the message is the reason alone."""


class ImageError(Exception):
    """A picture that cannot be read, written or compared; the message names the file and the reason."""


class ImageWarning(LajollaWarning):
    """A picture that is not written as it is; the message names the file and the reason."""


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """The ImageInput of a picture, whose colours are not multiplied by alpha.

    Raises:
        PictureError: it is no picture, or would take more memory than a file of its size should.
    """
    import OpenImageIO as oiio  # here, because it takes long and many commands need no pictures

    if not path.is_file():
        raise PictureError("it is not a file")
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    with plain_name(path) as name:
        source = oiio.ImageInput.open(name, config)
        if source is None:
            raise PictureError(reason(oiio).replace(name, str(path)))
        try:
            spec = source.spec()
            depth = max(spec.depth, 1) * spec.nchannels * max(spec.format.size(), 1)
            check_size(path, spec.width, spec.height, depth)
            yield source
        finally:
            source.close()


def check_size(path: Path, width: int, height: int, pixel: int) -> None:
    """Raises PictureError where a picture of pixels of so many bytes is too large for its file."""
    size = path.stat().st_size
    if width * height * pixel > MAX_PICTURE + MAX_RATIO * size:
        raise PictureError(f"{width} x {height} pixels are too many for a file of {size:,} bytes")


@dataclass
class Budget:
    """What the pictures of a scene take, and may take, together."""

    decoded: int = 0  # bytes
    stored: int = 0  # bytes of the files

    def spend(self, path: Path, size: int) -> None:
        """Adds a picture of so many bytes; raises PictureError where all together are too many."""
        self.decoded += size
        self.stored += path.stat().st_size
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
