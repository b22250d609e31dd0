"""Integrators that are `path` or `volpath` in other words."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..nodes import Node
from ..schema import Field, Plugin

if TYPE_CHECKING:
    from ..build import Builder


def _direct(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    lights, bsdfs = values.pop("emitter_samples", 1), values.pop("bsdf_samples", 1)
    for name in ("shading_samples", "max_depth"):
        values.pop(name, None)
    strategy = "bsdf" if lights == 0 else "light" if bsdfs == 0 else "mis"
    return {"type": "path", "max_depth": 2, "strategy": strategy, **values}


def _volpath(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    return {"type": "volpath", **values}


SAMPLES = "only 0 makes a difference: this strategy is not used"

PLUGINS = (
    Plugin(
        "integrator",
        "direct",
        "Light that was scattered at most once: path with max_depth 2.",
        (
            Field("shading_samples", "integer", "no difference: the sampler's count decides", 1, 0),
            Field("emitter_samples", "integer", SAMPLES, 1, 0),
            Field("bsdf_samples", "integer", SAMPLES, 1, 0),
        ),
        _direct,
        model="path",
        hidden=("max_depth", "rr_depth", "strategy"),
    ),
    Plugin("integrator", "volpathmis", "The same as volpath.", (), _volpath, model="volpath"),
    Plugin("integrator", "volpath_simple", "The same as volpath.", (), _volpath, model="volpath"),
)
