"""Texture images in their stored precision: 8-bit, half or float."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from lajolla.picture_files import Budget, PictureError, channel_names, check_size, opened, reason

from ..syntax.errors import Location, SceneError

Pixels = npt.NDArray[np.generic]

CHANNEL_SETS = (("R", "G", "B"), ("Y",))  # the first of these that a file has is its colour
FLOAT_RGB = 12  # bytes
STORED = {"uint8": ("uint8", 1), "half": ("half", 2)}  # and bytes; anything else is read as float32


class Stored(NamedTuple):
    """The pixels of a file, and whether it holds integers, which are sRGB-encoded unless the scene says
    otherwise."""

    pixels: Pixels
    is_integer: bool


def read_pixels(
    path: Path, location: Location, budget: Budget, channel: str = "", *, pixel: int = 0
) -> Stored:
    """Reads a picture; colours as encoded in the file, alpha dropped and not multiplied in.

    Args:
        path: an image file of any format that OpenImageIO knows.
        location: what to blame in the scene.
        budget: what all pictures of the scene share.
        channel: the name of one channel ("r", "a", ...) to read alone.
        pixel: bytes that a pixel will take, where that is more than in the file.

    Returns:
        (height, width, 1 or 3): uint8, float16 or float32, top row first. Integers of 16 bits and more become
        float32 in [0, 1].

    Raises:
        SceneError: the file is no image, is cut short, or its colours are not RGB or grey; it
            is too large for its file, or all pictures together are.
    """
    try:
        with opened(path) as (source, stored):
            spec = source.spec()
            check_size(stored, spec.width, spec.height, pixel)
            if spec.get_string_attribute("jpeg:ColorSpace") in ("CMYK", "YCbCrK"):
                raise PictureError("its colours are CMYK; convert it to RGB")
            wanted = _channels(channel_names(spec), channel)
            written = str(spec.format)
            kept, size = STORED.get(written, ("float", 4))
            budget.spend(spec.width * spec.height * max(len(wanted) * size, pixel), stored)
            pixels = source.read_image(0, 0, 0, spec.nchannels, kept)
            if pixels is None:
                raise PictureError(reason(source))
    except PictureError as problem:
        raise SceneError(f'"{path}" cannot be used as an image: {problem}', location) from None
    if wanted != list(range(pixels.shape[2])):
        pixels = np.ascontiguousarray(pixels[:, :, wanted])
    return Stored(pixels, written.startswith(("uint", "int")))


def _channels(names: list[str], channel: str) -> list[int]:
    by_name = {name.upper(): i for i, name in enumerate(names)}
    if channel:
        if channel.upper() not in by_name:
            raise PictureError(f'it has no channel "{channel}", only {", ".join(names[:12])}')
        return [by_name[channel.upper()]]
    for wanted in CHANNEL_SETS:
        if all(name in by_name for name in wanted):
            return [by_name[name] for name in wanted]
    if len(names) <= 2:
        return [0]
    raise PictureError(f"its channels ({', '.join(names[:12])}) are neither RGB nor grey")
