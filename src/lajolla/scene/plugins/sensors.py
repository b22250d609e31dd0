"""Cameras, films and samplers."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any

from ..errors import Location, SceneError
from ..literals import Text, parse_float
from ..nodes import Node
from ..schema import CHILDREN, Field, Plugin

if TYPE_CHECKING:
    from ..build import Builder

FILM_DIAGONAL = math.hypot(36, 24)  # mm, of the 35 mm film that focal lengths refer to


def _perspective(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
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
    return {"type": node.plugin.lower(), **values}


def _millimeters(value: object, location: Location) -> float:
    text = Text(re.sub(r"\s*mm\s*$", "", str(value)), location)
    length = parse_float(text)
    if length <= 0:
        raise text.fail("a length above zero")
    return length


def _film(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    values.setdefault("width", 768)
    values.setdefault("height", 576)
    for side, offset, crop in (
        ("width", "crop_offset_x", "crop_width"),
        ("height", "crop_offset_y", "crop_height"),
    ):
        values.setdefault(offset, 0)
        values.setdefault(crop, values[side] - values[offset])
        if values[offset] + values[crop] > values[side] or values[crop] < 1:
            prop = node.find(crop) or node.find(offset)
            place = prop.location if prop else node.location
            raise SceneError(
                f"the crop window does not lie inside of the film's {side} of {values[side]}", place
            )
    return values


def _sobol(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    return {"type": "sobol", "sample_count": 4, **values}


def _independent(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    return {"type": "independent", "sample_count": 4, **values}


FOCAL_LENGTH = Field(
    "focal_length", "string", "instead of fov, on 35 mm film; counts where neither is given", "50mm"
)
LOW_DISCREPANCY = ("stratified", "multijitter", "ldsampler", "orthogonal", "halton", "hammersley")
PIXELS = "pixels"
FILM_FIELDS = (
    Field("width", "integer", "of the whole picture", 768, 1, 65536, PIXELS),
    Field("height", "integer", "of the whole picture", 576, 1, 65536, PIXELS),
)

PLUGINS = (
    *(
        Plugin("sensor", name, "", (FOCAL_LENGTH,), _perspective, CHILDREN["sensor"], name)
        for name in ("perspective", "thinlens")
    ),
    *(
        Plugin("film", name, doc, FILM_FIELDS, _film, CHILDREN["film"], "film")
        for name, doc in (
            ("hdrfilm", "A picture."),
            ("ldrfilm", "A picture; tone mapping is left to the writer."),
        )
    ),
    Plugin("sampler", "sobol", "", (), _sobol, model="sobol"),
    Plugin("sampler", "independent", "", (), _independent, model="independent"),
    *(Plugin("sampler", name, "The same as sobol.", (), _sobol, model="sobol") for name in LOW_DISCREPANCY),
)
