"""Messages between the viewer and its page.

Both sides send JSON objects with a "type"; the pictures are binary messages. `MESSAGES` declares all that a
page may send; anything else is refused.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from lajolla.colour import FloatImage

LONGEST_MESSAGE = 1 << 16  # bytes that a page may send at once
LONGEST_TEXT = 4096
MOST_EDITS = 64  # parameters in one message
BAND_BYTES = 1 << 19  # of pixels in a binary message, about

Check: TypeAlias = Callable[[object], Any]


class ProtocolError(Exception):
    """A message that no page of ours sends."""


@dataclass(frozen=True)
class Message:
    """A valid message of a page: its type, and its fields."""

    type: str
    fields: Mapping[str, Any]

    def __getitem__(self, name: str) -> Any:  # noqa: ANN401
        return self.fields[name]


def _whole(least: int, most: int) -> Check:
    def checked(value: object) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            raise ProtocolError(f"expected a whole number from {least} to {most}")
        return value

    return checked


def _text(value: object) -> str:
    if not isinstance(value, str) or len(value) > LONGEST_TEXT:
        raise ProtocolError(f"expected a text of at most {LONGEST_TEXT} characters")
    return value


def _optional(check: Check) -> Check:
    return lambda value: None if value is None else check(value)


def _window(value: object) -> tuple[int, ...]:
    if not isinstance(value, list) or len(value) != 4:
        raise ProtocolError("expected x, y, width and height")
    return tuple(_whole(0, 65536)(number) for number in value)


def _edits(value: object) -> dict[str, Any]:
    if not isinstance(value, dict) or not 0 < len(value) <= MOST_EDITS:
        raise ProtocolError(f"expected one to {MOST_EDITS} parameters")
    return {_text(path): _parameter(item) for path, item in value.items()}


def _parameter(value: object, depth: int = 0) -> Any:  # noqa: ANN401
    """The value of a parameter: a number, a text, or a vector or matrix of numbers."""
    if isinstance(value, bool | str | int):
        return _text(value) if isinstance(value, str) else value
    if isinstance(value, float) and math.isfinite(value):
        return value
    if isinstance(value, list) and depth < 2 and len(value) <= 16:
        return [_parameter(item, depth + 1) for item in value]
    raise ProtocolError("expected a number, a text, a vector or a matrix")


PIXEL: Mapping[str, Check] = {"x": _whole(0, 65535), "y": _whole(0, 65535)}

# The types of messages, and the fields that each one has.
MESSAGES: Mapping[str, Mapping[str, Check]] = {
    "received": {"picture": _whole(0, 2**53)},  # the page has shown a picture and takes another
    "edit": {"values": _edits},  # parameters by their paths
    "choose": {"integrator": _text},
    "look": {"sensor": _text},  # through another sensor
    "save": {"name": _text},  # the scene, as a file of this name beside its own
    "show": {"layer": _text},  # "" is the picture
    "crop": {"window": _optional(_window)},
    "limit": {"samples": _optional(_whole(1, 1 << 30))},  # per pixel; null: the scene's number
    "pause": {},
    "resume": {},
    "focus": PIXEL,
    "inspect": PIXEL,
    "objects": {"search": _text},
    "parameters": {"object": _text},
}


def parse(data: str | bytes) -> Message:
    """The message that a page sent. Raises ProtocolError."""
    if isinstance(data, bytes):
        raise ProtocolError("expected text")
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        raise ProtocolError("expected JSON") from None
    if not isinstance(found, dict) or not isinstance(found.get("type"), str):
        raise ProtocolError("expected an object with a type")
    name = found.pop("type")
    if name not in MESSAGES:
        raise ProtocolError("unknown type")
    if found.keys() != MESSAGES[name].keys():
        raise ProtocolError(f"{name} has the fields {', '.join(MESSAGES[name]) or 'none'}")
    return Message(name, {field: check(found[field]) for field, check in MESSAGES[name].items()})


def event(type: str, **fields: object) -> str:
    """A message to the page. Numbers that are not finite become null."""
    return json.dumps(_finite({"type": type, **fields}), allow_nan=False)


def _finite(value: Any) -> Any:  # noqa: ANN401
    if isinstance(value, Mapping):
        return {str(name): _finite(item) for name, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _finite(value.tolist())
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@dataclass(frozen=True)
class Picture:
    """A picture to show.

    Attributes:
        pixels: linear colours, or what a layer holds, float32 (height, width, 3).
        number: grows with every picture.
        view: grows with every change of the scene or the camera.
        window: left, top, width and height of what it shows, in pixels of the film; a preview has fewer.
        limits: values of a layer that are shown as black and as white; None for light.
    """

    pixels: FloatImage
    number: int
    view: int
    window: tuple[int, int, int, int]
    limits: tuple[float, float] | None = None

    @property
    def is_whole(self) -> bool:
        """Whether it is no preview."""
        return self.pixels.shape[:2] == (self.window[3], self.window[2])


# number, view, left, top, width, height of the window, width and height of the pixels, first row of the band,
# rows of the band, whether there are limits, the limits; all little-endian, and 56 bytes long.
HEADER = struct.Struct("<10I I 2f 4x")


def bands(picture: Picture, rows: int | None = None) -> Iterator[bytes]:
    """Binary messages, each with a header and some rows of pixels as half floats, red, green and blue."""
    height, width, _ = picture.pixels.shape
    with np.errstate(over="ignore"):
        halves = np.clip(picture.pixels, -65504, 65504).astype("<f2")
    rows = rows or max(1, BAND_BYTES // (6 * width))
    low, high = picture.limits or (0.0, 0.0)
    for first in range(0, height, rows):
        band = halves[first : first + rows]
        numbers = (picture.number, picture.view, *picture.window, width, height, first, len(band))
        header = HEADER.pack(*numbers, picture.limits is not None, low, high)
        yield header + band.tobytes()


def readable(data: Sequence[bytes]) -> Picture:
    """The picture of binary messages; what the page does, for tests."""
    heads = [HEADER.unpack_from(band) for band in data]
    number, view, left, top, across, down, width, height, *_ = heads[0]
    halves = [np.frombuffer(band, "<f2", offset=HEADER.size) for band in data]
    pixels = np.concatenate(halves).reshape(height, width, 3).astype(np.float32)
    limits = (heads[0][11], heads[0][12]) if heads[0][10] else None
    return Picture(pixels, number, view, (left, top, across, down), limits=limits)
