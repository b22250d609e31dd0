"""Curves and hair from files."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lajolla import _core

from ...formats.curves import (
    Indices,
    Points,
    lengths,
    read_curves,
    read_hair,
    segment_starts,
    straightened,
    thinned,
)
from ...schema import CHILDREN, COMPOSITING, Field
from ...syntax.errors import SceneError
from ...syntax.nodes import Node
from ..plugin import Context, Entry, Plugin, Values
from .tessellate import tube_arrays

NEEDED = {"linear": 2, "bspline": 4}  # control points of a segment


def _curves(basis: str) -> Callable[[Context, Node, Values], Entry]:
    def build(context: Context, node: Node, values: Values) -> Entry:
        values.pop("filename", None)
        points, first = _read(context, node, lambda path: read_curves(path, 4))
        if np.any(points[:, 3] < 0):
            raise SceneError("a radius is below zero", node.property_location("filename"))
        return _entry(context, node, basis, points, first, values)

    return build


def _hair(context: Context, node: Node, values: Values) -> Entry:
    """Hair becomes cones between spheres; its radius is scaled as Mitsuba 0.6 does."""
    values.pop("filename", None)
    points, first = _read(context, node, read_hair)
    reduction, radius = values.pop("reduction", 0.0), values.pop("radius", 0.025)
    if reduction >= 1:
        raise SceneError('"reduction" must be below 1', node.property_location("reduction"))
    points, first = thinned(points, first, reduction)
    points, first = straightened(points, first, values.pop("angle_threshold", 1.0))
    scale = np.linalg.norm(np.asarray(values.get("to_world", np.eye(4)))[:3, 2])
    radii = np.full((len(points), 1), radius / (1 - reduction) * scale, np.float32)
    alone = np.repeat(lengths(first, len(points)) == 1, lengths(first, len(points)))
    if np.any(alone):
        context.diagnostics.warn(f"{node} has {alone.sum()} hairs of one point: ignored", node.location)
    return _entry(context, node, "linear", np.hstack([points, radii]), first, values, allow_short=True)


def _read(
    context: Context, node: Node, read: Callable[..., tuple[Points, Indices]]
) -> tuple[Points, Indices]:
    path, location = context.find(node)
    try:
        return read(path)
    except (ValueError, OSError) as problem:
        raise SceneError(f'"{path}": {problem}', location) from None


def _entry(
    context: Context,
    node: Node,
    basis: str,
    points: Points,
    first: Indices,
    values: Values,
    *,
    allow_short: bool = False,
) -> Entry:
    shortest = int(lengths(first, len(points)).min(initial=NEEDED[basis]))
    if shortest < NEEDED[basis] and not allow_short:
        message = f"a curve has {shortest} control points; it needs at least {NEEDED[basis]}"
        raise SceneError(message, node.property_location("filename"))
    segments = segment_starts(first, len(points), NEEDED[basis])
    points = np.ascontiguousarray(points, np.float32)
    if any(emitter.plugin.lower() == "area" for _, emitter in node.children("emitter")):
        context.diagnostics.warn(f"{node} emits light: it is rendered as a mesh of tubes", node.location)
        placed = points.astype(float)
        matrix = np.asarray(values.get("to_world", np.eye(4)))
        placed[:, :3] = placed[:, :3] @ matrix[:3, :3].T
        to_world = np.eye(4)
        to_world[:3, 3] = matrix[:3, 3]  # left to the core: float32 has no digits far from the origin
        tubes = _core.Mesh(*tube_arrays(placed, segments, basis))
        seen = {name: values[name] for name in COMPOSITING if name in values}
        return {"type": "mesh", "mesh": tubes, "to_world": to_world, **seen}
    return {"type": "curves", "curves": _core.Curves(points, segments), "basis": basis, **values}


FILENAME = Field("filename", "string", "the curves: x, y, z, radius on a line; empty lines between curves")
HIDDEN = ("curves", "basis")
HAIR = (
    Field("filename", "string", "the hair, as text or binary"),
    Field("radius", "float", "of all hairs", 0.025, 0.0),
    Field("angle_threshold", "float", "bends below this angle are straightened", 1.0, 0.0, 180.0, "degrees"),
    Field("reduction", "float", "fraction of hairs to leave out; the others become thicker", 0.0, 0.0, 1.0),
)

PLUGINS = tuple(
    Plugin("shape", name, doc, fields, build, CHILDREN["shape"], "curves", HIDDEN)
    for name, doc, fields, build in (
        ("linearcurve", "Straight tubes between control points.", (FILENAME,), _curves("linear")),
        ("bsplinecurve", "Tubes around uniform cubic B-splines.", (FILENAME,), _curves("bspline")),
        ("hair", "Straight hairs of one radius, as in Mitsuba 0.6.", HAIR, _hair),
    )
)
