"""Surfaces from grids of numbers: height fields, signed distances."""

from __future__ import annotations

import numpy as np

from lajolla import _core
from lajolla.colour import luminance

from ...formats.images import read_pixels
from ...schema import CHILDREN, Field
from ...syntax.errors import SceneError
from ...syntax.nodes import Array, Node
from ..plugin import Context, Entry, Plugin, Values
from .tessellate import height_arrays
from .textures import decode
from .volumes import load_voxels

CELL = 24  # bytes of two triangles, which a pixel becomes


def _heightfield(context: Context, node: Node, values: Values) -> Entry:
    """A mesh over [-1, 1]^2 with a vertex at every pixel; the first row of the picture is at y = -1."""
    values.pop("filename", None)
    texture = next((child for _, child in node.children("texture")), None)
    if texture is not None and texture.plugin.lower() != "bitmap":
        raise SceneError(f'{node} takes its heights from a "bitmap" only', texture.location)
    heights = _heights(context, texture or node) * values.pop("scale", 1.0)
    if not np.all(np.isfinite(heights)):
        raise SceneError(f"{node} has heights that are not finite", node.location)
    smooth = values.pop("shading_normals", True)
    for hint in ("width", "height"):
        values.pop(hint, None)
    return {
        "type": "mesh",
        "mesh": _core.Mesh(*height_arrays(heights)),
        "face_normals": not smooth,
        **values,
    }


def _heights(context: Context, owner: Node) -> Array:
    path, location = context.find(owner)
    raw = owner.find("raw")
    pixels, is_integer = read_pixels(path, location, context.pictures, pixel=CELL)
    if is_integer and not (raw and raw.value is True):
        pixels = decode(pixels)
    elif pixels.dtype == np.uint8:
        pixels = np.asarray(pixels, float) / 255
    heights = np.asarray(pixels, float)
    heights = luminance(heights)[..., 0] if heights.shape[2] == 3 else heights[..., 0]
    repeats = [2 if size == 1 else 1 for size in heights.shape]  # at least two samples each way
    return np.repeat(np.repeat(heights, repeats[0], 0), repeats[1], 1)


def _sdf_grid(context: Context, node: Node, values: Values) -> Entry:
    voxels, location = load_voxels(context, node, values)
    values.pop("use_grid_bbox", None)
    if voxels.values.shape[3] != 1:
        raise SceneError(f"{node} needs a grid of one channel", location)
    if min(voxels.values.shape[:3]) < 2:
        raise SceneError(f"{node} needs two values along each axis at least", location)
    if not np.all(np.isfinite(np.asarray(voxels.values, np.float32))):
        raise SceneError(f"{node} has values that are not finite", location)
    return {"type": "sdfgrid", "grid": _core.Grid(np.ascontiguousarray(voxels.values)), **values}


HEIGHTS = (
    Field("filename", "string", "a picture of the heights; or a bitmap texture inside"),
    Field("scale", "float", "factor on the heights", 1.0),
    Field("width", "integer", "ignored: the picture has a size", None),
    Field("height", "integer", "ignored: the picture has a size", None),
    Field("shading_normals", "boolean", "smooth shading", True),
)
SDF = (
    Field("filename", "string", "a .vol, .nvdb or .vdb file with one channel"),
    Field("grid_name", "string", "which grid of a .nvdb or .vdb file", "density"),
    Field("grid", "grid", "from Python: an array (depth, height, width[, 1]) instead of a file"),
)

PLUGINS = (
    Plugin(
        "shape",
        "heightfield",
        "A height at every pixel of a picture.",
        HEIGHTS,
        _heightfield,
        (*CHILDREN["shape"], "texture"),
        "mesh",
        ("mesh", "face_normals"),
    ),
    Plugin("shape", "sdfgrid", "", SDF, _sdf_grid, CHILDREN["shape"], "sdfgrid", ("grid",)),
)
