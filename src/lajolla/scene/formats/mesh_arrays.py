"""Triangle meshes from arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from lajolla import _core

Array: TypeAlias = npt.NDArray[Any]

# Arrays of meshes, and what the core calls them: `positions` (N, 3), `triangles` (M, 3), `normals` (N, 3) and
# `uvs` (N, 2).
MESH_ARRAYS = {"positions": "vertices", "triangles": "faces", "normals": "normals", "uvs": "uvs"}
COLUMNS = {"positions": 3, "triangles": 3, "normals": 3, "uvs": 2}
OTHER_NAMES = {  # that Mitsuba gives them
    "vertex_positions": "positions",
    "vertex_normals": "normals",
    "vertex_texcoords": "uvs",
    "faces": "triangles",
}
ATTRIBUTES = ("vertex_", "face_")  # what names of attributes begin with


# Of meshes of polygons, with the type of their numbers and their columns; None: any number of them.
POLYGON_ARRAYS: Mapping[str, tuple[type[np.generic], int | None]] = {
    "faces": (np.uint32, None),
    "face_sizes": (np.uint32, 1),
    "corner_uvs": (np.float32, 2),
    "creases": (np.uint32, 2),
    "crease_sharpness": (np.float32, 1),
    "sharp_corners": (np.uint32, 1),
    "corner_sharpness": (np.float32, 1),
}


def polygons_of(arrays: Mapping[str, Any], attributes: Mapping[str, Any]) -> _core.Mesh:
    """A mesh of polygons, which can be subdivided.

    Args:
        arrays: by the names of `MESH_ARRAYS` and `POLYGON_ARRAYS`; `triangles` are faces too.
        attributes: of vertices, and of faces.

    Raises:
        ValueError: an array is missing or of the wrong shape, or shapes do not fit together.
    """
    given = {name: value for name, value in arrays.items() if value is not None}
    if "normals" in given:
        raise ValueError("normals are computed from faces, and are none of their arrays")
    if "positions" not in given or ("faces" in given) == ("triangles" in given):
        raise ValueError("a mesh of polygons needs positions and faces")
    if "uvs" in given and "corner_uvs" in given:
        raise ValueError("a mesh takes uvs or corner_uvs, not both")
    positions = _table("positions", given["positions"])
    if "faces" in given:
        sizes, corners = _faces(given["faces"], given.get("face_sizes"))
    else:
        corners = _table("triangles", given["triangles"]).ravel()
        sizes = np.full(len(corners) // 3, 3, np.uint32)
    uvs, uv_corners = None, None
    if "uvs" in given:
        uvs, uv_corners = _table("uvs", given["uvs"]), corners
    elif "corner_uvs" in given:
        uvs, uv_corners = np.unique(_polygon_array("corner_uvs", given), axis=0, return_inverse=True)
        uv_corners = np.ascontiguousarray(uv_corners.reshape(-1), np.uint32)
    return _core.polygon_mesh(
        positions,
        sizes,
        corners,
        uvs,
        uv_corners,
        {name: _table(name, value) for name, value in attributes.items()},
        _polygon_array("creases", given),
        _polygon_array("crease_sharpness", given).ravel(),
        _polygon_array("sharp_corners", given).ravel(),
        _polygon_array("corner_sharpness", given).ravel(),
    )


def _faces(given: object, sizes: object) -> tuple[Array, Array]:
    """The numbers of corners of faces, and the corners of all of them."""
    if sizes is not None:
        return _numbers("face_sizes", sizes).ravel(), _numbers("faces", given).ravel()
    table = _numbers("faces", given)
    if table.ndim != 2:
        raise ValueError("faces must have the shape (count, corners), or come with face_sizes")
    return np.full(len(table), table.shape[1], np.uint32), table.ravel()


def _polygon_array(name: str, given: Mapping[str, Any]) -> Array:
    """An array with its columns; empty where it is missing."""
    columns = POLYGON_ARRAYS[name][1] or 1
    table = _numbers(name, given.get(name, ()))
    if table.size % columns or (table.ndim == 2 and table.shape[1] != columns) or table.ndim > 2:
        raise ValueError(f"{name} must have the shape (count, {columns})")
    return table.reshape(-1, columns)


def _numbers(name: str, value: object) -> Array:
    try:
        table = np.asarray(value)
    except ValueError:
        table = np.empty(0, object)
    kind = POLYGON_ARRAYS[name][0]
    if table.size and table.dtype.kind not in ("iuf" if kind is np.float32 else "iu"):
        wanted = "numbers" if kind is np.float32 else "whole numbers"
        raise ValueError(f"{name} must be an array of {wanted}")
    if kind is np.uint32 and table.size and not 0 <= table.min() <= table.max() < 2**32:
        raise ValueError(f"{name} must not be negative")
    return np.ascontiguousarray(table, kind)


def mesh_of(arrays: Mapping[str, Any]) -> _core.Mesh:
    """A mesh of arrays; names other than those of `MESH_ARRAYS` are attributes, and None is left out.

    Raises:
        ValueError: an array is missing or of the wrong shape, or shapes do not fit together.
    """
    tables = {name: _table(name, value) for name, value in arrays.items() if value is not None}
    for name in ("positions", "triangles"):
        if name not in tables:
            raise ValueError(f"a mesh needs {name}")
    attributes = {name: table for name, table in tables.items() if name not in MESH_ARRAYS}
    try:
        return _core.Mesh(
            tables["positions"],
            tables["triangles"],
            tables.get("normals"),
            tables.get("uvs"),
            attributes,
        )
    except TypeError as problem:
        raise ValueError(str(problem).partition("\n")[0]) from None


def with_unit_normals(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """The arrays that a caller gives, with normals of unit length; those without length stay.

    Raises:
        ValueError: normals are not finite, or of the wrong shape.
    """
    if arrays.get("normals") is None:
        return dict(arrays)
    table = _table("normals", arrays["normals"])
    if not np.all(np.isfinite(table)):
        raise ValueError("normals must be finite")
    lengths = np.linalg.norm(table.astype(np.float64), axis=1, keepdims=True)
    wrong = (np.abs(lengths - 1) > 1e-5) & (lengths > 0)  # unit ones keep their bits
    return {**arrays, "normals": np.where(wrong, table / np.where(wrong, lengths, 1), table)}


def _table(name: str, value: object) -> Array:
    """An array with the columns that a mesh has; flat ones, as Mitsuba's, are cut into rows."""
    if name not in COLUMNS and not name.startswith(ATTRIBUTES):
        raise ValueError(f'the name of a mesh attribute begins with vertex_ or face_, not "{name}"')
    table, columns = np.asarray(value), COLUMNS.get(name, 1)
    given = table.shape
    if table.dtype.kind not in ("iu" if name == "triangles" else "iuf"):
        what = "whole numbers, indices of positions" if name == "triangles" else "real numbers"
        raise ValueError(f"{name} must be {what}, not {_described(table)}")
    if table.ndim == 1 and table.size % columns == 0:
        table = table.reshape(-1, columns)
    if table.ndim != 2 or (name in COLUMNS and table.shape[1] != columns):
        shape = f"(count, {COLUMNS.get(name, 'channels')})"
        raise ValueError(f"{name} must have the shape {shape}, not {given}")
    if name != "triangles":
        return np.ascontiguousarray(table, np.float32)
    if table.size and not 0 <= table.min() <= table.max() < 2**32:
        raise ValueError("triangles must be indices of positions, from 0")
    return np.ascontiguousarray(table, np.uint32)


def _described(table: Array) -> str:
    """What an array of another type than numbers holds."""
    kinds = {"b": "truth values", "c": "complex numbers", "f": "fractions", "O": "objects", "U": "text"}
    return f"{kinds.get(table.dtype.kind, 'others')} (dtype {table.dtype})"
