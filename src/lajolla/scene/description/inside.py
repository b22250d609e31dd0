"""Tests whether a point is inside a shape."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..syntax.nodes import Array

# Three directions, so that an edge or a hole in one of them does not matter.
DIRECTIONS = np.array([[0.31, 0.52, 0.79], [-0.83, 0.44, 0.35], [0.27, -0.91, -0.31]])

BLOCK = 1 << 16  # faces at a time, which bounds the memory


def is_inside(shape: dict[str, Any], point: Array) -> bool:
    """Whether a point is inside of a sphere or a closed mesh of a description; of others False."""
    try:
        local = np.linalg.solve(np.asarray(shape.get("to_world", np.eye(4)), float), [*point, 1.0])[:3]
    except np.linalg.LinAlgError:  # a flat shape, which the core refuses
        return False
    if shape["type"] == "sphere":
        centre, radius = shape.get("center", (0.0, 0.0, 0.0)), shape.get("radius", 1.0)
        return bool(np.linalg.norm(local - centre) < radius)
    if "mesh" not in shape:
        return False
    vertices, faces = shape["mesh"].vertices, shape["mesh"].faces
    if len(faces) == 0 or np.any(local < vertices.min(axis=0)) or np.any(local > vertices.max(axis=0)):
        return False
    crossings = np.zeros(len(DIRECTIONS), int)
    for first in range(0, len(faces), BLOCK):
        corners = vertices[faces[first : first + BLOCK]].astype(np.float64) - local
        crossings += [_crossings(corners, direction) for direction in DIRECTIONS]
    return int(np.count_nonzero(crossings % 2)) >= 2


def _crossings(corners: Array, way: Array) -> int:
    """How many triangles a ray from the origin meets (Möller and Trumbore 1997)."""
    a = corners[:, 0]
    along, across = corners[:, 1] - a, corners[:, 2] - a
    p = np.cross(way, across)
    volume = np.einsum("ij,ij->i", along, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = -np.einsum("ij,ij->i", a, p) / volume
        q = np.cross(-a, along)
        v = q @ way / volume
        t = np.einsum("ij,ij->i", across, q) / volume
        return int(np.count_nonzero((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)))
