"""Cameras and samplers."""

from __future__ import annotations

import numpy as np

from ...schema import CHILDREN, Field
from ...syntax.errors import SceneError
from ...syntax.nodes import Array, Node
from ..plugin import Context, Entry, Plugin, Values
from .lenses import FOCAL_LENGTH, field_of_view


def _perspective(context: Context, node: Node, values: Values) -> Entry:
    return {"type": node.plugin.lower(), **field_of_view(node, values)}


def _along_ray(context: Context, node: Node, values: Values) -> Entry:
    """`origin` and `direction` in place of `to_world`, and an optional target."""
    origin, direction = (values.pop(name, None) for name in ("origin", "direction"))
    if (origin or direction) and "to_world" not in values:
        values["to_world"] = _looking_along(
            node, np.array(direction or (0, 0, 1), float), np.array(origin or (0, 0, 0), float)
        )
    if "target" in values:
        values["has_target"] = True
    return {"type": node.plugin.lower(), **values}


def _looking_along(node: Node, direction: Array, origin: Array) -> Array:
    if not np.linalg.norm(direction) > 0:
        raise SceneError(f"{node} has no direction", node.property_location("direction"))
    z = direction / np.linalg.norm(direction)
    x = np.cross((0.0, 1, 0) if abs(z[1]) < 0.9 else (1.0, 0, 0), z)
    x = x / np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3] = np.stack([x, np.cross(z, x), z, origin], axis=1)
    return matrix


def _sobol(context: Context, node: Node, values: Values) -> Entry:
    kept = {name: value for name, value in values.items() if name not in POINTS}
    return {"type": "sobol", "sample_count": 4, **kept}


# How Mitsuba's samplers arrange their points. Here all of them mean the arrangement with the least noise:
# most scenes name `independent` because it is Mitsuba's default. The option `sampler` chooses for certain.
SAME = "ignored: points are those of sobol"
POINTS = {
    "jitter": Field("jitter", "boolean", SAME, True),
    "strength": Field("strength", "integer", SAME, 2, 0),
    "dimension": Field("dimension", "integer", SAME, 4, 0),
    "scramble": Field("scramble", "integer", SAME, -1),
}
SAMPLERS = {
    "independent": (),
    "stratified": ("jitter", "dimension"),
    "multijitter": ("jitter",),
    "orthogonal": ("jitter", "strength"),
    "ldsampler": ("dimension",),
    "halton": ("scramble",),
    "hammersley": ("scramble",),
}
DIRECTION = Field("direction", "vector", "in which the ray goes, instead of to_world")
ORIGIN = Field("origin", "vector", "where the ray starts, instead of to_world")

PLUGINS = (
    Plugin(
        "sensor", "radiancemeter", "", (ORIGIN, DIRECTION), _along_ray, CHILDREN["sensor"], "radiancemeter"
    ),
    Plugin("sensor", "distant", "", (DIRECTION,), _along_ray, CHILDREN["sensor"], "distant", ("has_target",)),
    *(
        Plugin("sensor", name, "", (FOCAL_LENGTH,), _perspective, CHILDREN["sensor"], name)
        for name in ("perspective", "thinlens")
    ),
    Plugin("sampler", "sobol", "", (POINTS["scramble"],), _sobol, model="sobol"),
    *(
        Plugin("sampler", name, "The same as sobol.", tuple(POINTS[p] for p in points), _sobol, model="sobol")
        for name, points in SAMPLERS.items()
    ),
)
