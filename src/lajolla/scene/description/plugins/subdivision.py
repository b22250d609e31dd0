"""Subdivision surfaces: how far they are divided, and displacement."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from lajolla import _core

from ...schema import Field
from ...syntax.errors import SceneError
from ...syntax.nodes import Array, Node
from ..faces import check_faces
from ..plugin import Context, Entry, Values

Levels = npt.NDArray[np.uint8]

MOST_LEVELS = 12  # as in the core
DEFAULT_LEVEL = 3
# Triangles of all subdivision surfaces of a scene: a constant, and some for each corner of their polygons.
MAX_TRIANGLES = 1 << 22
TRIANGLES_PER_CORNER = 32

FIELDS = (
    Field("subdivision", "boolean", "the polygons are those of a Catmull-Clark subdivision surface", False),
    Field(
        "subdivision_level",
        "integer",
        f"edges become 2^level pieces; with edge_length the most of them; {DEFAULT_LEVEL}, or {MOST_LEVELS} "
        "with edge_length, if missing",
        None,
        0,
        MOST_LEVELS,
    ),
    Field(
        "edge_length",
        "float",
        "the pieces of each edge are not longer, as far as levels allow, seen from the scene's camera",
        None,
        0.01,
        None,
        "pixels",
    ),
    Field(
        "boundary",
        "choice",
        "where the mesh ends: corners stay, or are rounded, or all vertices stay",
        "pin_corners",
        choices=("pin_corners", "smooth", "pin_boundary"),
    ),
    Field(
        "uv_interpolation",
        "choice",
        "subdivides texture coordinates too, within their borders, or not",
        "smooth",
        choices=("smooth", "linear"),
    ),
    Field("displacement", "texture_float", "how far the surface moves along its normal"),
    Field("displacement_scale", "float", "factor on the displacement, in the mesh's units", 1.0),
    Field("displacement_midlevel", "float", "the value of the texture that moves nothing", 0.0),
)
NAMES = tuple(field.name for field in FIELDS)


def take_settings(context: Context, node: Node, values: Values) -> Values | None:
    """Takes the fields of subdivision out of a node's values; None if it is no subdivision surface."""
    settings = {name: values.pop(name) for name in NAMES if name in values}
    if settings.pop("subdivision", False):
        return settings
    for name in settings:
        context.diagnostics.unknown(
            f'"{name}" needs "subdivision"; it is ignored', node.property_location(name)
        )
    return None


def subdivided(
    context: Context, node: Node, key: tuple[Any, ...], mesh: _core.Mesh, settings: Values, values: Values
) -> _core.Mesh:
    """The surface that a mesh of polygons describes.

    Args:
        key: identifies the mesh.
        settings: as `take_settings` returns them.
        values: of the shape's other fields.

    Raises:
        SceneError: the mesh has no polygons, or cannot be subdivided.
    """
    if not mesh.has_polygons:
        raise SceneError(f"{node} has no polygons that could be subdivided", node.location)
    levels = _levels(context, node, mesh, settings, values)
    rules = settings.get("boundary", "pin_corners"), settings.get("uv_interpolation", "smooth")
    key = (*key, "subdivided", *rules, levels.tobytes())
    surface, points, dropped = context.read(key, lambda: _divided(context, node, mesh, levels, rules))
    context.subdivision_triangles += len(surface.faces)
    if dropped:
        message = (
            f"{node} would have too many triangles: its subdivision is reduced by {dropped} "
            f"level{'s' if dropped > 1 else ''}, to {len(surface.faces):,} triangles"
        )
        context.diagnostics.warn(message, node.location)
    check_faces(context, settings, {"mesh": surface}, node.location)
    return _displaced(context, settings, surface, points)


def _divided(
    context: Context, node: Node, mesh: _core.Mesh, levels: Levels, rules: tuple[str, str]
) -> tuple[_core.Mesh, npt.NDArray[np.uint32], int]:
    most = MAX_TRIANGLES + TRIANGLES_PER_CORNER * len(levels) - context.subdivision_triangles
    try:
        return mesh.subdivided(levels, *rules, max(most, 0))
    except ValueError as problem:
        raise SceneError(f"{node} cannot be subdivided: {problem}", node.location) from None


def _levels(context: Context, node: Node, mesh: _core.Mesh, settings: Values, values: Values) -> Levels:
    """Of the edge that starts at each corner of the polygons."""
    edges = mesh.polygon_edges.reshape(-1, 2, 3).astype(np.float64)
    level = settings.get("subdivision_level")
    if "edge_length" not in settings:
        return np.full(len(edges), DEFAULT_LEVEL if level is None else level, np.uint8)
    view = context.camera()
    if view is None:
        raise SceneError('"edge_length" needs a sensor in the scene', node.property_location("edge_length"))
    matrix = np.asarray(values.get("to_world", np.eye(4)), float)
    world = edges @ matrix[:3, :3].T + matrix[:3, 3]
    lengths = np.linalg.norm(world[:, 0] - world[:, 1], axis=1)
    pixels = lengths * _pixels_per_unit(view, (world[:, 0] + world[:, 1]) / 2, node)
    with np.errstate(divide="ignore"):
        wanted = np.ceil(np.log2(pixels / settings["edge_length"]))
    return np.clip(wanted, 0, MOST_LEVELS if level is None else level).astype(np.uint8)


def _pixels_per_unit(view: Entry, points: Array, node: Node) -> Array:
    """The number of pixels that a unit of length has, at each of some points, seen face-on."""
    camera, film = view["sensor"], view["film"]
    width, height = film["width"], film["height"]
    matrix = np.asarray(camera.get("to_world", np.eye(4)), float)
    distances = np.linalg.norm(points - matrix[:3, 3], axis=1)
    kind = camera["type"]
    if kind in ("perspective", "thinlens"):
        half = math.tan(math.radians(camera.get("fov", 50.0)) / 2)
        sides = {"x": width, "y": height, "smaller": min(width, height), "larger": max(width, height)}
        side = sides.get(camera.get("fov_axis", "x"), math.hypot(width, height))
        return side / (2 * half * np.maximum(distances, camera.get("near_clip", 1e-2)))
    if kind in ("orthographic", "telecentric"):
        return np.full(len(points), width / (2 * np.linalg.norm(matrix[:3, 0])))
    if kind == "spherical":
        return width / (2 * math.pi * np.maximum(distances, np.finfo(float).tiny))
    problem = f'"edge_length" needs a camera that has pixels of a size, not "{kind}"'
    raise SceneError(problem, node.property_location("edge_length"))


def _displaced(
    context: Context, settings: Values, surface: _core.Mesh, points: npt.NDArray[np.uint32]
) -> _core.Mesh:
    given = settings.get("displacement")
    scale, middle = settings.get("displacement_scale", 1.0), settings.get("displacement_midlevel", 0.0)
    if given is None or not len(points):
        return surface
    if isinstance(given, dict):
        index = given["texture"]
        textures = [context.entry("textures", i) for i in range(index + 1)]
        heights = _core.texture_values({"textures": textures}, index, surface)
    else:
        heights = np.full(len(points), given, np.float32)
    return surface.displaced(points, ((heights - np.float32(middle)) * np.float32(scale)).astype(np.float32))
