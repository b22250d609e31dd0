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
