"""Intersections of rays and triangles in double precision."""

from __future__ import annotations

import numpy as np


def moller_trumbore(
    origins: np.ndarray, directions: np.ndarray, corners: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays (N, 3) and triangles (M, 3, 3) in double precision (Möller and Trumbore 1997).

    Returns:
        distances (N, M), inf without a hit; the distance of the point in the triangle's plane from the
        nearest edge (N, M), negative outside; and |cos| of the angle between ray and normal (N, M).
    """
    o, d = origins[:, None].astype(float), directions[:, None].astype(float)
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = np.cross(d, e2)
    det = (p * e1).sum(-1)
    t = o - corners[:, 0]
    q = np.cross(t, e1)
    with np.errstate(divide="ignore", invalid="ignore"):
        b1, b2 = (p * t).sum(-1) / det, (q * d).sum(-1) / det
        distance = (q * e2).sum(-1) / det
    area = np.linalg.norm(np.cross(e1, e2), axis=-1)
    heights = [area / np.linalg.norm(edge, axis=-1) for edge in (e2 - e1, e2, e1)]
    inside = np.minimum(np.minimum((1 - b1 - b2) * heights[0], b1 * heights[1]), b2 * heights[2])
    return np.where((inside >= 0) & (distance > 0), distance, np.inf), inside, np.abs(det) / area
