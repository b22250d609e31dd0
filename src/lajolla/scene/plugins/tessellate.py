"""Simple solids as triangles: vertices (N, 3), faces (M, 3), normals (N, 3), uvs (N, 2)."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from ..nodes import Array

SEGMENTS = 256


Floats: TypeAlias = npt.NDArray[np.float32]
MeshArrays: TypeAlias = tuple[Floats, npt.NDArray[np.uint32], Floats, Floats]


# Normal of each face of the cube and the direction of its u, as in Mitsuba; v runs along u x normal.
CUBE_FACES = (
    ((0, -1, 0), (0, 0, 1)),
    ((0, 1, 0), (-1, 0, 0)),
    ((1, 0, 0), (0, 1, 0)),
    ((0, 0, 1), (0, 1, 0)),
    ((-1, 0, 0), (0, 1, 0)),
    ((0, 0, -1), (0, -1, 0)),
)


def cube_arrays() -> MeshArrays:
    """The cube [-1, 1]^3, six faces of their own vertices, each with the unit square as texture space."""
    uvs = np.array([[0.0, 0], [0, 1], [1, 1], [1, 0]])
    u, v = (2 * uvs - 1).T[:, :, None]
    normals = [np.tile(normal, (4, 1)) for normal, _ in CUBE_FACES]
    vertices = [normal + u * along_u + v * np.cross(along_u, normal) for normal, along_u in CUBE_FACES]
    faces = [np.array([[0, 1, 2], [0, 2, 3]]) + 4 * i for i in range(6)]
    return _arrays(
        np.concatenate(vertices), np.concatenate(faces), np.concatenate(normals), np.tile(uvs, (6, 1))
    )


def sphere_arrays(values: dict[str, Any]) -> MeshArrays:
    """The sphere of `center` and `radius` with exact normals; u is the azimuth, v runs down from +z."""
    rows = SEGMENTS // 2
    u, v = np.meshgrid(np.linspace(0, 1, SEGMENTS + 1), np.linspace(0, 1, rows + 1))
    sin_theta = np.sin(np.pi * v)
    normals = np.stack(
        [sin_theta * np.cos(2 * np.pi * u), sin_theta * np.sin(2 * np.pi * u), np.cos(np.pi * v)], axis=-1
    ).reshape(-1, 3)
    vertices = np.asarray(values.get("center", (0, 0, 0))) + values.get("radius", 1.0) * normals
    uvs = np.stack([u, v], axis=-1).reshape(-1, 2)
    return _arrays(vertices, _grid_faces(rows, SEGMENTS), normals, uvs)


def cylinder_arrays(values: dict[str, Any]) -> MeshArrays:
    """The open tube of `radius` from `p0` to `p1` with exact normals; u is the azimuth, v runs along it."""
    p0 = np.asarray(values.get("p0", (0, 0, 0)), float)
    axis = np.asarray(values.get("p1", (0, 0, 1)), float) - p0
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    s = across / max(float(np.linalg.norm(across)), 1e-30)
    t = np.cross(axis, s) / max(float(np.linalg.norm(axis)), 1e-30)
    u, v = np.meshgrid(np.linspace(0, 1, SEGMENTS + 1), np.linspace(0, 1, 2))
    u, v = u.reshape(-1, 1), v.reshape(-1, 1)
    normals = np.cos(2 * np.pi * u) * s + np.sin(2 * np.pi * u) * t
    vertices = p0 + v * axis + values.get("radius", 1.0) * normals
    faces = _grid_faces(1, SEGMENTS)[:, ::-1]
    return _arrays(vertices, faces, normals, np.concatenate([u, v], axis=1))


def _grid_faces(rows: int, columns: int) -> Array:
    """Two triangles per cell of a grid of (rows + 1) x (columns + 1) vertices."""
    first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1, 1)
    below = first + columns + 1
    return np.concatenate([np.hstack([first, below, below + 1]), np.hstack([first, below + 1, first + 1])])


def _arrays(vertices: Array, faces: Array, normals: Array, uvs: Array) -> MeshArrays:
    """The arrays in the types that the core takes."""
    single = (np.ascontiguousarray(a, dtype=np.float32) for a in (vertices, normals, uvs))
    vertices32, normals32, uvs32 = single
    return vertices32, np.ascontiguousarray(faces, dtype=np.uint32), normals32, uvs32
