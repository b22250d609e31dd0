"""Texture images as they are stored: 8-bit stays 8-bit, half stays half."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from .errors import Location, SceneError

Pixels = npt.NDArray[np.generic]

MAX_PIXELS = 1 << 30
CHANNEL_SETS = (("R", "G", "B"), ("Y",))  # the first of these that a file has is its colour
STORED = {"uint8": "uint8", "half": "half"}  # anything else is read as float32


def read_pixels(path: Path, location: Location, channel: str = "") -> Pixels:
    """Reads a picture; colours as encoded in the file, alpha dropped and not multiplied in.

    Args:
        path: an image file of any format that OpenImageIO knows.
        location: what to blame in the scene.
        channel: the name of one channel ("r", "a", ...) to read alone.

    Returns:
        (height, width, 1 or 3): uint8, float16 or float32, top row first. Integers of 16 bits and more become
        float32 in [0, 1].

    Raises:
        SceneError: the file is no image, is cut short, or its colours are not RGB or grey.
    """
    import OpenImageIO as oiio  # here, because it takes long and many scenes have no textures

    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    opened = oiio.ImageInput.open(str(path), config)
    if opened is None:
        raise _error(path, oiio.geterror(), location)
    try:
        spec = opened.spec()
        if spec.width * spec.height > MAX_PIXELS:
            raise _error(path, f"{spec.width} x {spec.height} pixels are too many", location)
        if spec.get_string_attribute("jpeg:ColorSpace") in ("CMYK", "YCbCrK"):
            raise _error(path, "its colours are CMYK; convert it to RGB", location)
        wanted = _channels(path, list(spec.channelnames), channel, location)
        pixels = opened.read_image(0, 0, 0, spec.nchannels, STORED.get(str(spec.format), "float"))
        if pixels is None:
            raise _error(path, opened.geterror(), location)
    finally:
        opened.close()
    return np.ascontiguousarray(pixels[:, :, wanted])


def is_integer_file(path: Path) -> bool:
    """Whether a picture's file holds integers, which are sRGB-encoded unless the scene says otherwise."""
    import OpenImageIO as oiio  # as in `read_pixels`

    opened = oiio.ImageInput.open(str(path))
    kind = str(opened.spec().format) if opened else ""
    if opened:
        opened.close()
    return kind.startswith(("uint", "int"))


def _channels(path: Path, names: list[str], channel: str, location: Location) -> list[int]:
    by_name = {name.upper(): i for i, name in enumerate(names)}
    if channel:
        if channel.upper() not in by_name:
            raise _error(path, f'it has no channel "{channel}", only {", ".join(names)}', location)
        return [by_name[channel.upper()]]
    for wanted in CHANNEL_SETS:
        if all(name in by_name for name in wanted):
            return [by_name[name] for name in wanted]
    if len(names) <= 2:
        return [0]
    raise _error(path, f"its channels ({', '.join(names)}) are neither RGB nor grey", location)


def _error(path: Path, reason: str, location: Location) -> SceneError:
    first_line = (reason or "not an image").strip().splitlines()[0]
    return SceneError(f'"{path}" cannot be used as an image: {first_line}', location)
