"""Simple solids as triangles: vertices (N, 3), faces (M, 3), normals (N, 3), uvs (N, 2)."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from ...syntax.nodes import Array
from ..plugin import Values

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


def sphere_arrays(values: Values) -> MeshArrays:
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


def cylinder_arrays(values: Values) -> MeshArrays:
    """The open tube of `radius` from `p0` to `p1` with exact normals; u is the azimuth, v runs along it."""
    p0 = np.asarray(values.get("p0", (0, 0, 0)), float)
    axis = np.asarray(values.get("p1", (0, 0, 1)), float) - p0
    s, t = frame_around(axis / max(float(np.linalg.norm(axis)), 1e-30))
    u, v = np.meshgrid(np.linspace(0, 1, SEGMENTS + 1), np.linspace(0, 1, 2))
    u, v = u.reshape(-1, 1), v.reshape(-1, 1)
    normals = np.cos(2 * np.pi * u) * s + np.sin(2 * np.pi * u) * t
    vertices = p0 + v * axis + values.get("radius", 1.0) * normals
    faces = _grid_faces(1, SEGMENTS)[:, ::-1]
    return _arrays(vertices, faces, normals, np.concatenate([u, v], axis=1))


def frame_around(n: Array) -> tuple[Array, Array]:
    """Two directions across a unit vector, as the core chooses them (Duff et al. 2017)."""
    sign = np.copysign(1.0, n[2])
    a = -1 / (sign + n[2])
    b = n[0] * n[1] * a
    s = np.array([1 + sign * n[0] ** 2 * a, sign * b, -sign * n[0]])
    return s, np.array([b, sign + n[1] ** 2 * a, -n[1]])


def height_arrays(heights: Array) -> MeshArrays:
    """A height at every point of a grid over [-1, 1]^2; u runs along the rows, v from row to row."""
    rows, columns = (size - 1 for size in heights.shape)
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    slope_y, slope_x = np.gradient(heights, 2 / rows, 2 / columns)
    normals = np.stack([-slope_x, -slope_y, np.ones_like(heights)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    vertices = np.stack([2 * u - 1, 2 * v - 1, heights], axis=-1)
    uvs = np.stack([u, v], axis=-1)
    faces = _grid_faces(rows, columns)[:, ::-1]
    return _arrays(vertices.reshape(-1, 3), faces, normals.reshape(-1, 3), uvs.reshape(-1, 2))


TUBE_SIDES = 8


def tube_arrays(points: Array, segments: npt.NDArray[np.uint32], basis: str) -> MeshArrays:
    """Open tubes around segments of curves with control points (N, 4) in world space."""
    steps = 2 if basis == "linear" else 5
    t = np.linspace(0, 1, steps)[:, None]
    if basis == "linear":
        weights, slopes = np.hstack([1 - t, t]), np.tile([-1.0, 1], (steps, 1))
    else:
        w = 1 - t
        weights = np.hstack([w**3, 3 * t**3 - 6 * t**2 + 4, 3 * w**3 - 6 * w**2 + 4, t**3]) / 6
        slopes = np.hstack([-(w**2), 3 * t**2 - 4 * t, 4 * w - 3 * w**2, t**2]) / 2
    control = points[segments[:, None] + np.arange(weights.shape[1])]  # (segments, points, 4)
    rings = np.einsum("sp,mpc->msc", weights, control)
    tangents = np.einsum("sp,mpc->msc", slopes, control[..., :3])
    size = np.linalg.norm(tangents, axis=-1, keepdims=True)
    tangents = np.where(size > 1e-30, tangents / np.maximum(size, 1e-30), [0, 0, 1.0])  # some have no length
    upright = np.abs(tangents[..., 2:]) > 0.99
    s = np.cross(tangents, np.where(upright, [1.0, 0, 0], [0, 0, 1.0]))
    s /= np.linalg.norm(s, axis=-1, keepdims=True)
    angle = np.linspace(0, 2 * np.pi, TUBE_SIDES + 1)[:, None]
    normals = np.cos(angle) * s[:, :, None] + np.sin(angle) * np.cross(tangents, s)[:, :, None]
    vertices = rings[:, :, None, :3] + rings[:, :, None, 3:] * normals
    per_segment = steps * (TUBE_SIDES + 1)
    faces = (
        _grid_faces(steps - 1, TUBE_SIDES)[:, ::-1] + per_segment * np.arange(len(segments))[:, None, None]
    )
    v = (np.arange(len(segments))[:, None] + t[:, 0]) / max(len(segments), 1)
    uvs = np.stack(np.broadcast_arrays(angle[:, 0] / (2 * np.pi), v[..., None]), axis=-1)
    return _arrays(vertices.reshape(-1, 3), faces.reshape(-1, 3), normals.reshape(-1, 3), uvs.reshape(-1, 2))


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
