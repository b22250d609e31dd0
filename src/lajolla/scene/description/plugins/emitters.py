"""Lights with alternative parameters for their position."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ...formats.images import FLOAT_RGB, is_integer_file, read_pixels
from ...schema import Field, Plugin
from ...syntax.nodes import Node
from .lenses import LENS, field_of_view, width_per_axis
from .textures import decode

if TYPE_CHECKING:
    from ..builder import Builder


def _envmap(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    values.pop("filename", None)
    path, location = builder.find(node)
    key = ("envmap", path.resolve())
    if key not in builder.files:
        pixels = read_pixels(path, location, builder.pictures, pixel=FLOAT_RGB)
        pixels = decode(pixels) if is_integer_file(path) else pixels.astype(np.float32)
        if not np.all(np.isfinite(pixels)) or np.any(pixels < 0):
            builder.diagnostics.warn(
                f'"{path.name}" has pixels that are negative or not finite; they are black', location
            )
            pixels = np.where(np.isfinite(pixels) & (pixels >= 0), pixels, 0).astype(np.float32)
        rgb = np.ascontiguousarray(np.broadcast_to(pixels, (*pixels.shape[:2], 3)))
        builder.files[key] = builder.core.Image(rgb, srgb=False)
    return {"type": "envmap", "image": builder.files[key], **values}


def _point(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    to_world = values.pop("to_world", None)
    if to_world is not None:
        values.setdefault("position", tuple(float(v) for v in to_world[:3, 3]))
    return {"type": "point", **values}


def _directional(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    to_world = values.pop("to_world", None)
    if to_world is not None:
        values.setdefault("direction", tuple(float(v) for v in to_world[:3, 2]))
    return {"type": "directional", **values}


def _spot(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    values.setdefault("cutoff_angle", 20.0)
    values.setdefault("beam_width", 0.75 * values["cutoff_angle"])
    return {"type": "spot", **values}


def _projector(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    """Computes the field of view along x from the picture's aspect ratio."""
    picture = values.get("irradiance")
    entry = builder.textures[picture["texture"]] if isinstance(picture, dict) else {}
    if entry.get("type") == "clamped":
        entry = builder.textures[entry["texture"]["texture"]]
    image = entry.get("image")
    values["aspect"] = image.width / image.height if image is not None else 1.0
    lens = field_of_view(node, values)
    axis, half = lens.pop("fov_axis", "x"), math.tan(math.radians(lens.pop("fov")) / 2)
    half_width = half * width_per_axis(axis, values["aspect"])
    return {"type": "projector", **lens, "fov": math.degrees(2 * math.atan(half_width))}


def _collimated(builder: Builder, node: Node, values: dict[str, Any]) -> None:
    """Ignored: the beam has zero width, so that paths from the camera cannot hit it."""
    builder.diagnostics.unknown(
        f"{node} is a beam of zero width, which no path can hit; it is ignored", node.location
    )


PLACE = Field("to_world", "transform", "placement, instead of the above")
BEAM = (
    Field("to_world", "transform", "placement in the scene"),
    Field("power", "spectrum", "of the beam", 1.0, unit="W"),
    Field("irradiance", "spectrum", "of the beam", 1.0),
)
FILENAME = Field("filename", "string", "a latitude-longitude panorama; y is up")

PLUGINS = (
    Plugin(
        "emitter",
        "envmap",
        "",
        (FILENAME,),
        _envmap,
        model="envmap",
        hidden=("image", "theta_max"),
    ),
    Plugin("emitter", "point", "", (PLACE,), _point, model="point"),
    Plugin("emitter", "directional", "", (PLACE,), _directional, model="directional"),
    Plugin("emitter", "spot", "", (), _spot, model="spot"),
    Plugin("emitter", "projector", "", LENS, _projector, model="projector", hidden=("aspect",)),
    Plugin("emitter", "collimated", "A beam of zero width; it is ignored.", BEAM, _collimated),
)
