"""Shapes from files, and those that are meshes to the core."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import SceneError
from ..nodes import Array, Node
from ..schema import CHILDREN, Content, Field, Plugin
from .tessellate import MeshArrays, cube_arrays, cylinder_arrays, sphere_arrays

if TYPE_CHECKING:
    from ..build import Builder

Build = Callable[["Builder", Node, dict[str, Any]], dict[str, Any]]


def _file_shape(loader: str) -> Build:
    """A builder for meshes that the core reads by `_core.<loader>(path, ...)`."""

    def build(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
        values.pop("filename", None)
        options = {
            k: values.pop(k) for k in ("flip_tex_coords", "max_smooth_angle", "shape_index") if k in values
        }
        options.setdefault("flip_tex_coords", loader == "load_obj")
        path, location = builder.find(node)
        key = (loader, path.resolve(), *sorted(options.items()))
        if key not in builder.files:
            try:
                builder.files[key] = _load(builder, loader, path, options)
            except builder.core.MeshError as problem:
                raise SceneError(f'"{path}": {problem}', location) from None
        return {"type": "mesh", "mesh": builder.files[key], **values}

    return build


def _load(builder: Builder, loader: str, path: Path, options: dict[str, Any]) -> Content:
    load = getattr(builder.core, loader)
    mesh = load(str(path), options.get("shape_index", 0)) if loader == "load_serialized" else load(str(path))
    if "max_smooth_angle" in options:
        mesh = mesh.with_smooth_normals(options["max_smooth_angle"])
    return mesh.flip_uvs() if options["flip_tex_coords"] else mesh


def _cube(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    if ("cube",) not in builder.files:
        builder.files["cube",] = builder.core.Mesh(*cube_arrays())
    return {"type": "mesh", "mesh": builder.files["cube",], **values}


def _round_shape(name: str, arrays: Callable[[dict[str, Any]], MeshArrays]) -> Build:
    """A builder for shapes that the core knows only when `to_world` scales alike in all directions."""

    def build(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
        if _is_similarity(values.get("to_world", np.eye(4))):
            return {"type": name, **values}
        builder.diagnostics.warn(f"a stretched {name} is rendered as a mesh of fine triangles", node.location)
        placed = {k: values[k] for k in ("to_world", "flip_normals") if k in values}
        return {"type": "mesh", "mesh": builder.core.Mesh(*arrays(values)), **placed}

    return build


def _grouping(name: str) -> Build:
    """A builder for what is no shape itself; `instances.py` makes of it what it shows."""
    return lambda builder, node, values: {"type": name, **values}


def _is_similarity(matrix: Array) -> bool:
    gram = matrix[:3, :3].T @ matrix[:3, :3]
    size = np.trace(gram) / 3
    return bool(np.all(np.abs(gram - size * np.eye(3)) <= 1e-4 * size))


IN_SHAPES = CHILDREN["shape"]
FILENAME = Field("filename", "string", "the mesh")
FLIP_V = "count v from the top"
SMOOTH = Field(
    "max_smooth_angle",
    "float",
    "make vertex normals; edges sharper than this stay sharp",
    None,
    0.0,
    180.0,
    "degrees",
)
INDEX = Field("shape_index", "integer", "which mesh of the file", 0, 0, 2**31 - 1)


def _file_plugin(name: str, doc: str, flip: bool, *fields: Field) -> Plugin:
    own = (FILENAME, Field("flip_tex_coords", "boolean", FLIP_V, flip), SMOOTH, *fields)
    return Plugin(
        "shape", name, doc, own, _file_shape(f"load_{name}"), IN_SHAPES, model="mesh", hidden=("mesh",)
    )


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
    _file_plugin("obj", "Triangles from a Wavefront OBJ file.", True),
    _file_plugin("ply", "Triangles from a PLY file, ascii or binary.", False),
    _file_plugin("serialized", "Triangles from Mitsuba's compressed format.", False, INDEX),
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
