"""Cameras and samplers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..nodes import Node
from ..schema import CHILDREN, Plugin
from .lenses import FOCAL_LENGTH, field_of_view

if TYPE_CHECKING:
    from ..build import Builder


def _perspective(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    return {"type": node.plugin.lower(), **field_of_view(node, values)}


def _sobol(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    return {"type": "sobol", "sample_count": 4, **values}


def _independent(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    return {"type": "independent", "sample_count": 4, **values}


LOW_DISCREPANCY = ("stratified", "multijitter", "ldsampler", "orthogonal", "halton", "hammersley")
PLUGINS = (
    *(
        Plugin("sensor", name, "", (FOCAL_LENGTH,), _perspective, CHILDREN["sensor"], name)
        for name in ("perspective", "thinlens")
    ),
    Plugin("sampler", "sobol", "", (), _sobol, model="sobol"),
    Plugin("sampler", "independent", "", (), _independent, model="independent"),
    *(Plugin("sampler", name, "The same as sobol.", (), _sobol, model="sobol") for name in LOW_DISCREPANCY),
)
