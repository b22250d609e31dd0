"""Supported picture formats by file ending."""

from __future__ import annotations

from pathlib import Path

from lajolla.messages import suggestion
from lajolla.picture_files import ImageError

HIGH_RANGE = (".exr", ".hdr", ".pfm")
MATRIX = (".npy", ".npz", ".m")
JPEG = (".jpg", ".jpeg")
# What displays show: how many channels (1 and 2 are grey, 2 and 4 have alpha) the files can hold. They hold 8
# bits, and TIFF 16. JPEG 2000 is not among them: OpenImageIO's writer crashes on small pictures.
LOW_RANGE = {
    ".png": (1, 2, 3, 4),
    **dict.fromkeys(JPEG, (1, 3)),
    ".tif": (1, 2, 3, 4),
    ".tiff": (1, 2, 3, 4),
    ".webp": (3, 4),
    ".bmp": (1, 3, 4),
    ".jxl": (3, 4),
    ".ppm": (1, 3),
    ".sgi": (1, 3, 4),
    ".tga": (1, 3, 4),
}
DEEP = (".tif", ".tiff")
ENDINGS = (*HIGH_RANGE, *LOW_RANGE, *MATRIX)
HOLD_CHANNELS = (".exr", ".npy", ".npz")  # what can hold more than a picture


def ending_of(name: Path | None, format: str | None) -> str:
    """The file ending that determines the format: of the given format, else of the file name.

    Raises:
        ImageError: there is no such format.
    """
    if format is not None:
        ending = "." + format.lower().removeprefix(".")
        if ending not in ENDINGS:
            names = [known.removeprefix(".") for known in ENDINGS]
            raise ImageError(f"there is no picture format {format!r}{suggestion(ending[1:], names)}")
        return ending
    if name is None:
        raise ImageError('a stream has no name with an ending; name the format, such as "png"')
    if name.suffix.lower() not in ENDINGS:
        known = ", ".join(ENDINGS)
        raise ImageError(f"{name}: the format follows from the file's ending, which is one of {known}")
    return name.suffix.lower()


def check_offered(ending: str) -> None:
    """Raises ImageError where OpenImageIO is needed for files of this ending, and was built without them."""
    if ending in MATRIX:
        return
    offered = _offered()
    if ending not in offered:
        there = ", ".join(known for known in ENDINGS if known in offered or known in MATRIX)
        raise ImageError(f"the installed OpenImageIO cannot write {ending} files; choose from {there}")


def _offered() -> set[str]:
    """The endings that the installed OpenImageIO writes."""
    import OpenImageIO as oiio  # here, because it takes long and many commands need no pictures

    writers = oiio.get_string_attribute("output_format_list").split(",")
    by_format = (entry.partition(":") for entry in oiio.get_string_attribute("extension_list").split(";"))
    return {
        f".{ending}" for name, _, endings in by_format if name in writers for ending in endings.split(",")
    }
