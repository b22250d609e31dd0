"""The camera of 0.x scenes that have none: it looks along +z and sees everything."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..syntax.nodes import Array
from ..syntax.transforms import translate

FOV = 45.0  # degrees
CIRCLE = np.linspace(0, 2 * np.pi, 64, endpoint=False)
ROUND = np.stack([np.cos(CIRCLE), np.sin(CIRCLE), np.zeros(64)], axis=1)


def default_camera(
    shapes: Sequence[dict[str, Any]],
    groups: Sequence[dict[str, Any]] = (),
    instances: Sequence[dict[str, Any]] = (),
) -> dict[str, Any]:
    """The sensor that Mitsuba 0.6 puts in front of a scene's bounding box."""
    camera = {"type": "perspective", "fov": FOV}
    members = {index for group in groups for index in group["shapes"]}
    corners = [box for i, shape in enumerate(shapes) if i not in members for box in _bounds(shape)]
    inside = [_corners([box for i in group["shapes"] for box in _bounds(shapes[i])]) for group in groups]
    corners += [box for instance in instances for box in _placed(instance, inside[instance["group"]])]
    if not corners:
        return camera
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    width, height, depth = (float(v) for v in high - low)
    distance = max(width, height) / (2 * np.tan(np.radians(FOV) / 2))
    center = (low + high) / 2
    return camera | {
        "to_world": translate(np.array([center[0], center[1], low[2] - distance])),
        "near_clip": float(distance / 100),
        "far_clip": float(5 * max(width, height, depth) + distance),
    }


def _corners(points: list[Array]) -> Array:
    """The eight corners of the box around some points, none without points."""
    if not points:
        return np.empty((0, 3))
    ends = zip(np.min(points, axis=0), np.max(points, axis=0), strict=True)
    return np.array(list(itertools.product(*ends)))


def _placed(instance: dict[str, Any], corners: Array) -> Array:
    """The corners of an instance's box."""
    matrix = np.asarray(instance["to_world"], float)
    return corners @ matrix[:3, :3].T + matrix[:3, 3]


def _bounds(shape: dict[str, Any]) -> list[Array]:
    """The two ends of a shape's box in world space; none for an empty mesh."""
    matrix = np.asarray(shape.get("to_world", np.eye(4)), float)
    points, margin = _points(shape)
    if len(points) == 0:
        return []
    placed = points @ matrix[:3, :3].T + matrix[:3, 3]
    reach = margin * float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))
    return [placed.min(axis=0) - reach, placed.max(axis=0) + reach]


def _points(shape: dict[str, Any]) -> tuple[Array, float]:
    """Points whose hull is the shape before `to_world`, but for a margin all around."""
    radius = float(shape.get("radius", 1.0))
    if shape["type"] == "mesh":
        return np.asarray(shape["mesh"].vertices, float), 0.0
    if shape["type"] == "curves":
        points = np.asarray(shape["curves"].points, float)
        return points[:, :3], float(points[:, 3].max(initial=0))
    if shape["type"] == "sdfgrid":
        return np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)]), 0.0
    if shape["type"] == "sphere":
        return np.array([shape.get("center", (0, 0, 0))], float), radius
    if shape["type"] == "cylinder":
        return np.array([shape.get("p0", (0, 0, 0)), shape.get("p1", (0, 0, 1))], float), radius
    return (
        (ROUND, 0.0)
        if shape["type"] == "disk"
        else (np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), 0.0)
    )
