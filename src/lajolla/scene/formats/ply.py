"""A mesh as the bytes of a PLY file (Turk 1994, "The PLY Polygon File Format"): binary, little-endian."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lajolla import _core


def ply_bytes(mesh: _core.Mesh, *, normals: bool = True) -> bytes:
    """Vertices with normals, texture coordinates and attributes, and triangles, as far as there are any.

    Args:
        mesh: a `_core.Mesh`.
        normals: whether to write its normals.
    """
    vertices = (
        _columns("x y z", mesh.vertices)
        | _columns("nx ny nz", mesh.normals if normals else None)
        | _columns("u v", mesh.uvs)
    )
    faces: dict[str, npt.NDArray[np.generic]] = {}
    for name, values in mesh.attributes.items():
        kind, _, prefix = name.partition("_")
        letters = "rgba" if prefix == "color" else "0123"
        prefix = "" if prefix == "color" else f"{prefix}_"
        names = " ".join(prefix + letter for letter in letters[: values.shape[1]])
        (faces if kind == "face" else vertices).update(_columns(names, values))
    table = np.rec.fromarrays(list(vertices.values()), dtype=[(name, "<f4") for name in vertices])
    indices = np.empty(len(mesh.faces), [("count", "u1"), ("at", "<i4", 3), *((n, "<f4") for n in faces)])
    indices["count"], indices["at"] = 3, mesh.faces
    for name, column in faces.items():
        indices[name] = column
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(table)}",
        *(f"property float {name}" for name in vertices),
        f"element face {len(indices)}",
        "property list uchar int vertex_indices",
        *(f"property float {name}" for name in faces),
        "end_header",
        "",
    ]
    return "\n".join(header).encode() + table.tobytes() + indices.tobytes()


def _columns(names: str, array: npt.NDArray[np.generic] | None) -> dict[str, npt.NDArray[np.generic]]:
    return {} if array is None else {name: array[:, i] for i, name in enumerate(names.split())}
