"""Cameras, films and samplers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..errors import SceneError
from ..nodes import Node
from ..schema import CHILDREN, Field, Plugin
from .lenses import FOCAL_LENGTH, field_of_view

if TYPE_CHECKING:
    from ..build import Builder


def _perspective(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    return {"type": node.plugin.lower(), **field_of_view(node, values)}


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
