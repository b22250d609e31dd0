"""Triangle meshes from files; an OBJ file may become one shape for each of its materials."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from lajolla import _core

from ...formats.mesh_arrays import (
    MESH_ARRAYS,
    OTHER_NAMES,
    POLYGON_ARRAYS,
    mesh_of,
    polygons_of,
    with_unit_normals,
)
from ...formats.mtl import materials_of
from ...schema import CHILDREN, Field
from ...syntax.errors import Location, SceneError
from ...syntax.files import identity
from ...syntax.names import snake_case
from ...syntax.nodes import Array, Node, below
from ...syntax.transforms import is_even, turns_over
from ..plugin import Context, Entry, Part, Plugin, Values
from . import subdivision

Mesh = _core.Mesh
WITH_POLYGONS = ("load_obj", "load_ply")
WEIGHTS = "normal_weights"
LOADING = ("flip_tex_coords", "max_smooth_angle", "shape_index", "srgb")


def _file_shape(loader: str) -> Callable[[Context, Node, Values], Entry | list[Part]]:
    """A builder for meshes that the core reads by `_core.<loader>(path, ...)`."""

    def build(context: Context, node: Node, values: Values) -> Entry | list[Part]:
        values.pop("filename", None)
        collapse, load_materials = values.pop("collapse", False), values.pop("load_materials", False)
        options = {k: values.pop(k) for k in LOADING if k in values}
        options.setdefault("flip_tex_coords", loader == "load_obj")
        path, location = context.find(node)
        settings = subdivision.take_settings(context, node, values) if loader in WITH_POLYGONS else None
        if settings is not None and "max_smooth_angle" in options:
            place = node.property_location("max_smooth_angle")
            raise SceneError(f"{node} takes max_smooth_angle or subdivision, not both", place)
        if loader in WITH_POLYGONS and (settings is not None or uses_ptex(node)):
            options["polygons"] = True
        max_angle = options.pop("max_smooth_angle", None)
        key: tuple[Any, ...] = (loader, identity(path), *sorted(options.items()))
        mesh = context.read(key, lambda: _load(context, loader, path, options, location))
        if mesh.face_normals:
            values["face_normals"] = True
        if settings is not None:
            mesh, key = subdivision.subdivided(context, node, key, mesh, settings, values), (*key, node)
        else:
            key, mesh = _with_normals(context, key, mesh, values, max_angle)
        if max_angle is None:
            _warn_of_unused_weights(context, node, mesh, values)
        parts = [] if collapse else _parts(context, node, mesh, path, load_materials=load_materials)
        if not parts:
            return {"type": "mesh", "mesh": mesh, **values}
        return [
            Part({"type": "mesh", "mesh": _part(context, key, mesh, first, count), **values}, bsdf)
            for first, count, bsdf in parts
        ]

    return build


def uses_ptex(node: Node) -> bool:
    """Whether a texture of a shape needs the faces of its mesh."""
    return any(part.kind == "texture" and part.plugin.lower() == "ptex" for part in below([node]))


def _load(context: Context, loader: str, path: Path, options: Values, location: Location) -> Mesh:
    load = getattr(_core, loader)
    index = [options["shape_index"]] if "shape_index" in options else []
    encoding = {"srgb_colors": options["srgb"]} if "srgb" in options else {}
    if "polygons" in options:
        encoding["polygons"] = True
    try:
        mesh: Mesh = load(str(path), *index, flip_uvs=options["flip_tex_coords"], **encoding)
    except _core.MeshError as problem:
        raise SceneError(f'"{path}": {problem}', location) from None
    _warn_of_lost_digits(context, mesh, path, location)
    return mesh


def _warn_of_lost_digits(context: Context, mesh: Mesh, path: Path, location: Location) -> None:
    """Tells, of the first such file, that its vertices are too far from their origin for float32."""
    if not len(mesh.vertices):
        return
    size = float(np.ptp(mesh.vertices, axis=0).max())
    farthest = np.abs(mesh.vertices).max()
    step = float(np.spacing(farthest))
    if step <= 1e-2 * size or farthest == 0:
        return
    message = (
        f'"{path}": its vertices are so far from their origin that float32 tells places {step:.2g} apart, '
        f"in a mesh of {size:.2g}; to_world can place it without that loss"
    )
    context.once(("lost digits",), lambda: context.diagnostics.warn(message, location))


def _with_normals(
    context: Context, key: tuple[Any, ...], mesh: Mesh, values: Values, max_angle: float | None = None
) -> tuple[tuple[Any, ...], Mesh]:
    """The mesh with vertex normals, which Mitsuba computes if a file has none, or with hard edges.

    Angles and weights are those in world space, so that a stretched mesh has its own.
    """
    matrix, weights = frame_of_normals(values.get("to_world", np.eye(4))), values.get(WEIGHTS, "angle")
    if max_angle is not None:
        key = (*key, "hard edges", max_angle, matrix.tobytes(), weights)
        return key, context.read(key, lambda: mesh.with_smooth_normals(matrix.tolist(), max_angle, weights))
    if mesh.normals is not None or values.get("face_normals"):
        return key, mesh
    key = (*key, "normals", matrix.tobytes(), weights)
    return key, context.read(key, lambda: mesh.with_vertex_normals(matrix.tolist(), weights))


def _warn_of_unused_weights(context: Context, node: Node, mesh: Mesh, values: Values) -> None:
    if values.get(WEIGHTS, "angle") != "angle" and not mesh.computed_normals:
        message = f'"{WEIGHTS}" of {node} changes nothing: its normals are not computed'
        context.diagnostics.warn(message, node.property_location(WEIGHTS))


def frame_of_normals(to_world: Any) -> Array:  # noqa: ANN401
    """The matrix in which vertex normals are computed for a placement of a mesh."""
    matrix = np.array(to_world, float)
    matrix[:3, 3] = 0  # angles are the same everywhere
    return np.eye(4) if is_even(matrix, 1e-5) and not turns_over(matrix) else matrix  # angles and sides stay


def _part(context: Context, key: tuple[Any, ...], mesh: Mesh, first: int, count: int) -> Mesh:
    return context.read((*key, "part", first), lambda: mesh.part(first, count))


def _parts(
    context: Context, node: Node, mesh: Mesh, path: Path, *, load_materials: bool
) -> list[tuple[int, int, Node | None]]:
    """First face, number of faces and bsdf of each part; empty if there is only one material."""
    bsdfs = _bsdfs(node, {name for name, _, _ in mesh.groups})
    if not mesh.groups or not (load_materials or len(bsdfs) > 1):
        return []
    library: dict[str, Node] = {}
    if load_materials and all(name for name, _ in bsdfs):
        location = node.property_location("filename")
        names = list(mesh.material_libraries)
        key = ("materials", identity(path), *names)
        library = context.once(key, lambda: materials_of(names, path, location, context.diagnostics))
    parts = [(first, count, _bsdf_of(name, bsdfs, library)) for name, first, count in mesh.groups]
    own = {bsdf for _, bsdf in bsdfs}
    whole = len({bsdf for _, _, bsdf in parts}) == 1 and len(own) <= 1 and own <= {parts[0][2]}
    return [] if whole and not library else parts


def _bsdfs(node: Node, materials: set[str]) -> list[tuple[str, Node]]:
    """The bsdfs of a shape, each with the name of the file's material that it applies to, "" for all.

    It applies to one material if that is its property name or, among several bsdfs, its id.
    """
    children = list(node.children("bsdf"))
    by_name = {snake_case(name): name for name in materials} | {name: name for name in materials}
    return [
        (by_name.get(prop.name) or (bsdf.id if len(children) > 1 and bsdf.id in materials else ""), bsdf)
        for prop, bsdf in children
    ]


def _bsdf_of(material: str, bsdfs: list[tuple[str, Node]], library: dict[str, Node]) -> Node | None:
    """What a material of the file looks like: later bsdfs win, also those for all."""
    result = library.get(material)
    for name, bsdf in bsdfs:
        if name in ("", material):
            result = bsdf
    return result


def _from_arrays(context: Context, node: Node, values: Values) -> Entry:
    """A mesh object, or one of arrays; without normals it is smooth, as those of files are."""
    given = {name: values.pop(name) for name in (*MESH_ARRAYS, *POLYGON_ARRAYS) if name in values}
    attributes = values.pop("attributes", {})
    if wrong := next((name for name in attributes if name in OTHER_NAMES), None):
        raise SceneError(f'{node}: "{wrong}" is no attribute; use "{OTHER_NAMES[wrong]}"', node.location)
    settings = subdivision.take_settings(context, node, values)
    if "mesh" in values:
        if settings is not None:
            raise SceneError(
                f"{node} has no polygons that could be subdivided: it takes arrays", node.location
            )
        if given or attributes:
            raise SceneError(f"{node} takes a mesh or arrays, not both", node.location)
        if values["mesh"].computed_normals:  # of another library's mesh
            frame = frame_of_normals(values.get("to_world", np.eye(4)))
            weights = values.get(WEIGHTS, "angle")
            values["mesh"] = values["mesh"].with_vertex_normals(frame.tolist(), weights)
        _warn_of_unused_weights(context, node, values["mesh"], values)
        return {"type": "mesh", **values}
    try:
        if settings is not None or "faces" in given:
            mesh = polygons_of(given, attributes)
        else:
            mesh = mesh_of({**with_unit_normals(given), **attributes})
    except ValueError as problem:
        raise SceneError(f"{node}: {problem}", node.location) from None
    if settings is not None:
        mesh = subdivision.subdivided(context, node, ("arrays", node), mesh, settings, values)
    else:
        _, mesh = _with_normals(context, ("arrays", node), mesh, values)
    _warn_of_unused_weights(context, node, mesh, values)
    return {"type": "mesh", "mesh": mesh, **values}


FILENAME = Field("filename", "string", "the mesh")
FLIP_V = "count v from the top"
SMOOTH = Field(
    "max_smooth_angle",
    "float",
    "computes vertex normals; edges with a larger angle stay hard",
    None,
    0.0,
    180.0,
    "degrees",
)
SRGB = Field("srgb", "boolean", "integers that are colours are encoded (on before version 2)", False)
INDEX = Field("shape_index", "integer", "index of the mesh in the file", 0, 0, 2**31 - 1)
OBJ = (
    Field(
        "shape_index", "integer", 'which run of faces between "g" and "usemtl"; -1: all', -1, -1, 2**31 - 1
    ),
    Field("collapse", "boolean", "one shape, also if the file names several materials", False),
    Field("load_materials", "boolean", "use the file's material library (on before version 2)", False),
)


def _file_plugin(name: str, doc: str, flip: bool, *fields: Field) -> Plugin:
    own = (FILENAME, Field("flip_tex_coords", "boolean", FLIP_V, flip), SMOOTH, *fields)
    if f"load_{name}" in WITH_POLYGONS:
        own += subdivision.FIELDS
    return Plugin(
        "shape",
        name,
        doc,
        own,
        _file_shape(f"load_{name}"),
        CHILDREN["shape"],
        model="mesh",
        hidden=("mesh",),
    )


ARRAYS = (
    Field("positions", "array", "from Python: (N, 3) vertices"),
    Field("triangles", "array", "from Python: (M, 3) indices of vertices"),
    Field("faces", "array", "from Python: polygons instead, (M, corners), or one after the other"),
    Field("face_sizes", "array", "from Python: (M,) numbers of corners, if they differ"),
    Field("corner_uvs", "array", "from Python: (corners of all faces, 2) texture coordinates"),
    Field("creases", "array", "from Python: (K, 2) vertices whose edges are sharp when they are subdivided"),
    Field("crease_sharpness", "array", "from Python: (K,) for how many levels; from 10 on always"),
    Field("sharp_corners", "array", "from Python: (K,) vertices that are sharp"),
    Field("corner_sharpness", "array", "from Python: (K,) as for creases"),
    Field("normals", "array", "from Python: (N, 3) unit vectors; computed if missing"),
    Field("uvs", "array", "from Python: (N, 2) texture coordinates"),
    Field("attributes", "arrays", 'from Python: {"vertex_...": (N, channels), "face_...": (M, channels)}'),
)

PLUGINS = (
    Plugin(
        "shape", "mesh", "", (*ARRAYS, *subdivision.FIELDS), _from_arrays, CHILDREN["shape"], model="mesh"
    ),
    _file_plugin("obj", "Triangles from a Wavefront OBJ file.", True, *OBJ),
    _file_plugin("ply", "Triangles from a PLY file, ascii or binary.", False, SRGB),
    _file_plugin("serialized", "Triangles from Mitsuba's compressed format.", False, INDEX),
)
