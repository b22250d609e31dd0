"""Shapes that are meshes to the core, and those that hold other shapes."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ..nodes import Array, Node
from ..schema import CHILDREN, Field, Plugin
from .tessellate import MeshArrays, cube_arrays, cylinder_arrays, sphere_arrays

if TYPE_CHECKING:
    from ..build import Builder

Build = Callable[["Builder", Node, dict[str, Any]], dict[str, Any]]


def _cube(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    if ("cube",) not in builder.files:
        builder.files["cube",] = builder.core.Mesh(*cube_arrays())
    return {"type": "mesh", "mesh": builder.files["cube",], **values}


def _round_shape(name: str, arrays: Callable[[dict[str, Any]], MeshArrays]) -> Build:
    """A builder for shapes that the core knows only when `to_world` scales alike in all directions."""

    def build(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
        if name == "sphere" and _mirrors(values) and node.version >= (2, 0, 0):
            values["flip_normals"] = not values.get("flip_normals", False)  # as in Mitsuba 3
        if _is_similarity(values.get("to_world", np.eye(4))):
            return {"type": name, **values}
        builder.diagnostics.warn(f"a stretched {name} is rendered as a mesh of fine triangles", node.location)
        placed = {k: values[k] for k in ("to_world", "flip_normals") if k in values}
        return {"type": "mesh", "mesh": builder.core.Mesh(*arrays(values)), **placed}

    return build


def _mirrors(values: dict[str, Any]) -> bool:
    return bool(np.linalg.det(np.asarray(values.get("to_world", np.eye(4)))[:3, :3]) < 0)


def _grouping(name: str) -> Build:
    """A builder for what is no shape itself; `instances.py` makes of it what it shows."""
    return lambda builder, node, values: {"type": name, **values}


def _is_similarity(matrix: Array) -> bool:
    gram = matrix[:3, :3].T @ matrix[:3, :3]
    size = np.trace(gram) / 3
    return bool(np.all(np.abs(gram - size * np.eye(3)) <= 1e-4 * size))


IN_SHAPES = CHILDREN["shape"]
TO_WORLD = Field("to_world", "transform", "placement in the scene", np.eye(4).tolist())

PLUGINS = (
    Plugin(
        "shape",
        "shapegroup",
        "Shapes that are seen through instances only.",
        (),
        _grouping("shapegroup"),
        ("shape",),
    ),
    Plugin(
        "shape",
        "instance",
        "A placed copy of a shapegroup.",
        (TO_WORLD,),
        _grouping("instance"),
        ("shape",),
    ),
    Plugin("shape", "merge", "The shapes inside.", (), _grouping("merge"), ("shape",)),
    Plugin(
        "shape", "cube", "The cube from (-1, -1, -1) to (1, 1, 1).", (), _cube, IN_SHAPES, "mesh", ("mesh",)
    ),
    Plugin(
        "shape",
        "sphere",
        "A true sphere; one that to_world stretches becomes a fine mesh.",
        (),
        _round_shape("sphere", sphere_arrays),
        IN_SHAPES,
        "sphere",
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
