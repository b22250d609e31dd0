"""Fields of view, of cameras and projectors."""

from __future__ import annotations

import math

from ...schema import Field
from ...syntax.errors import Location, SceneError
from ...syntax.literals import Text, parse_float
from ...syntax.nodes import Node
from ..plugin import Entry, Values

FILM_DIAGONAL = math.hypot(36, 24)  # mm, of the 35 mm film that focal lengths refer to


def field_of_view(node: Node, values: Values) -> Entry:
    """The values with "fov", if need be from the focal length."""
    focal_length = node.find("focal_length")
    values.pop("focal_length", None)
    if "fov" not in values:
        millimeters = (
            50.0 if focal_length is None else _millimeters(focal_length.value, focal_length.location)
        )
        values["fov"] = math.degrees(2 * math.atan(FILM_DIAGONAL / (2 * millimeters)))
        values["fov_axis"] = "diagonal"
    elif focal_length is not None:
        raise SceneError('give either "fov" or "focal_length"', focal_length.name_location)
    return values


def _millimeters(value: object, location: Location) -> float:
    text = Text(str(value).strip().removesuffix("mm"), location)
    length = parse_float(text)
    if length <= 0:
        raise text.fail("a length above zero")
    return length


def width_per_axis(axis: str, aspect: float) -> float:
    """The width of a picture in units of what an axis of it measures."""
    if axis == "diagonal":
        return aspect / math.hypot(aspect, 1)
    along_y = axis == "y" or (axis == "smaller" and aspect > 1) or (axis == "larger" and aspect <= 1)
    return aspect if along_y else 1.0


FOCAL_LENGTH = Field(
    "focal_length", "string", "instead of fov, on 35 mm film; default if neither is given", "50mm"
)
AXES = ("x", "y", "diagonal", "smaller", "larger")
LENS = (FOCAL_LENGTH, Field("fov_axis", "choice", "which side of the picture fov spans", "x", choices=AXES))
