"""Cameras and samplers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..nodes import Node
from ..schema import CHILDREN, Field, Plugin
from .lenses import FOCAL_LENGTH, field_of_view

if TYPE_CHECKING:
    from ..build import Builder


def _perspective(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    return {"type": node.plugin.lower(), **field_of_view(node, values)}


def _sobol(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    kept = {name: value for name, value in values.items() if name not in POINTS}
    return {"type": "sobol", "sample_count": 4, **kept}


def _independent(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    return {"type": "independent", "sample_count": 4, **values}


# How Mitsuba's samplers arrange their points. There is one arrangement here, which serves all of them.
SAME = "no difference: points are those of sobol"
POINTS = {
    "jitter": Field("jitter", "boolean", SAME, True),
    "strength": Field("strength", "integer", SAME, 2, 0),
    "dimension": Field("dimension", "integer", SAME, 4, 0),
    "scramble": Field("scramble", "integer", SAME, -1),
}
LOW_DISCREPANCY = {
    "stratified": ("jitter", "dimension"),
    "multijitter": ("jitter",),
    "orthogonal": ("jitter", "strength"),
    "ldsampler": ("dimension",),
    "halton": ("scramble",),
    "hammersley": ("scramble",),
}

PLUGINS = (
    *(
        Plugin("sensor", name, "", (FOCAL_LENGTH,), _perspective, CHILDREN["sensor"], name)
        for name in ("perspective", "thinlens")
    ),
    Plugin("sampler", "sobol", "", (POINTS["scramble"],), _sobol, model="sobol"),
    Plugin("sampler", "independent", "", (), _independent, model="independent"),
    *(
        Plugin("sampler", name, "The same as sobol.", tuple(POINTS[p] for p in points), _sobol, model="sobol")
        for name, points in LOW_DISCREPANCY.items()
    ),
)
