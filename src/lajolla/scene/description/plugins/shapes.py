"""Shapes that become meshes, and those that contain other shapes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lajolla import _core

from ...schema import CHILDREN, COMPOSITING
from ...syntax.members import Irregular
from ...syntax.nodes import Array, Column, Node
from ...syntax.transforms import Truth, is_even, turns_over
from ..plugin import Context, Entry, Plugin, Values
from .tessellate import MeshArrays, cube_arrays, cylinder_arrays, frame_around, sphere_arrays

Build = Callable[[Context, Node, Values], Entry]


def _cube(context: Context, node: Node, values: Values) -> Entry:
    return {"type": "mesh", "mesh": context.once("cube", lambda: _core.Mesh(*cube_arrays())), **values}


def _round_shape(name: str, arrays: Callable[[Values], MeshArrays]) -> Build:
    """A builder for shapes that the core supports only with uniform scale."""

    def build(context: Context, node: Node, values: Values) -> Entry:
        if name == "sphere" and _agreed(turns_over(_matrices(values))) and node.unsaid.mirrored:
            values["flip_normals"] = not values.get("flip_normals", False)  # as in Mitsuba 3
        if name == "cylinder":
            values = _evened_cylinder(values)
        if _agreed(is_even(_matrices(values), 1e-4)):
            return {"type": name, **values}
        if node.run is not None:
            raise Irregular
        context.diagnostics.warn(
            f"a {name} with non-uniform scale is rendered as a triangle mesh", node.location
        )
        kept = ("to_world", "flip_normals", *COMPOSITING)
        placed = {k: v for k, v in values.items() if k in kept}
        return {"type": "mesh", "mesh": _core.Mesh(*arrays(values)), **placed}

    return build


def _evened_cylinder(values: Values) -> Entry:
    """The same cylinder with other ends and radius, where `to_world` scales alike across its axis.

    What is left of `to_world` turns the cylinder's own frame, so that texture coordinates stay.
    """
    matrix = np.asarray(values.get("to_world", np.eye(4)), float)
    p0 = np.asarray(values.get("p0", (0, 0, 0)), float)
    scales_nothing = np.max(np.abs(matrix[:3, :3].T @ matrix[:3, :3] - np.eye(3))) < 1e-9
    if scales_nothing and "to_world" in values and not np.any(p0):
        return values  # an evened cylinder stays as it is, bit for bit
    axis = np.asarray(values.get("p1", (0, 0, 1)), float) - p0
    length = float(np.linalg.norm(axis))
    if length == 0:
        return values
    n = axis / length
    own = np.stack([*frame_around(n), n])  # rows
    placed = matrix[:3, :3] @ own.T
    scales = np.linalg.norm(placed, axis=0)
    if np.any(scales == 0) or abs(scales[0] - scales[1]) > 1e-4 * scales[0]:
        return values
    turned = placed / scales
    if np.max(np.abs(turned.T @ turned - np.eye(3))) > 1e-4:
        return values
    to_world = np.eye(4)
    to_world[:3, :3], to_world[:3, 3] = turned @ own, matrix[:3, :3] @ p0 + matrix[:3, 3]
    end = tuple(float(v) for v in n * length * scales[2])
    radius = float(values.get("radius", 1.0) * scales[0])
    return {**values, "p0": (0.0, 0.0, 0.0), "p1": end, "radius": radius, "to_world": to_world}


def _matrices(values: Values) -> Array:
    """`to_world`, or that of each member of a run."""
    matrix = values.get("to_world", np.eye(4))
    return matrix.rows if isinstance(matrix, Column) else np.asarray(matrix, float)


def _agreed(truth: Truth) -> bool:
    """What is true of one shape, or of all members of a run.

    Raises:
        Irregular: it is true of some.
    """
    if isinstance(truth, bool):
        return truth
    if np.any(truth) != np.all(truth):
        raise Irregular
    return bool(np.all(truth))


def _grouping(name: str) -> Build:
    """A builder for groups and instances; `instances.py` expands them."""
    return lambda context, node, values: {"type": name, **values}


IN_SHAPES = CHILDREN["shape"]

PLUGINS = (
    Plugin(
        "shape",
        "shapegroup",
        "Shapes that are visible only through instances.",
        (),
        _grouping("shapegroup"),
        ("shape",),
    ),
    Plugin(
        "shape",
        "instance",
        "A transformed copy of a shapegroup.",
        (),
        _grouping("instance"),
        ("shape",),
        model="instance",
        hidden=("group",),
        in_runs=True,
    ),
    Plugin("shape", "merge", "The shapes inside.", (), _grouping("merge"), ("shape",)),
    Plugin(
        "shape",
        "cube",
        "The cube from (-1, -1, -1) to (1, 1, 1).",
        (),
        _cube,
        IN_SHAPES,
        "mesh",
        ("mesh", "normal_weights"),
        True,
    ),
    Plugin(
        "shape",
        "sphere",
        "A true sphere; one that to_world stretches becomes a fine mesh.",
        (),
        _round_shape("sphere", sphere_arrays),
        IN_SHAPES,
        "sphere",
        in_runs=True,
    ),
    Plugin(
        "shape",
        "cylinder",
        "An open tube around the axis from p0 to p1.",
        (),
        _round_shape("cylinder", cylinder_arrays),
        IN_SHAPES,
        "cylinder",
    ),
)
