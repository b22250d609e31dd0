"""Lights with alternative parameters for their position."""

from __future__ import annotations

import math

import numpy as np

from lajolla import _core

from ...formats.images import FLOAT_RGB, Pixels, read_pixels
from ...schema import Field
from ...syntax.errors import Location
from ...syntax.files import identity
from ...syntax.nodes import Node
from ..plugin import Context, Entry, Plugin, Values
from .lenses import LENS, field_of_view, width_per_axis
from .textures import ARRAYS, decode, pixels_from_python


def _envmap(context: Context, node: Node, values: Values) -> Entry:
    compensated = values.pop("mis_compensation", None)
    if compensated is not None:
        values.setdefault("sampling", "compensated" if compensated else "radiance")
    array = pixels_from_python(node, values)
    if array is not None:
        image = panorama(context, *array, "the panorama", node.location)
        return {"type": "envmap", "image": image, **values}
    values.pop("filename", None)
    path, location = context.find(node)
    key = ("envmap", identity(path))

    def read() -> _core.Image:
        pixels, is_integer = read_pixels(path, location, context.pictures, pixel=FLOAT_RGB)
        return panorama(context, pixels, is_integer, f'"{path.name}"', location)

    return {"type": "envmap", "image": context.read(key, read), **values}


def panorama(
    context: Context, pixels: Pixels, is_encoded: bool, name: str, location: Location
) -> _core.Image:
    """A picture of light: linear, and never negative."""
    linear = np.asarray(decode(pixels) if is_encoded else pixels, np.float32)
    if not is_encoded and pixels.dtype == np.uint8:
        linear = linear / np.float32(255)
    if not np.all(np.isfinite(linear)) or np.any(linear < 0):
        message = f"{name} has pixels that are negative or not finite; they are black"
        context.diagnostics.warn(message, location)
        linear = np.where(np.isfinite(linear) & (linear >= 0), linear, 0).astype(np.float32)
    rgb = np.ascontiguousarray(np.broadcast_to(linear, (*linear.shape[:2], 3)))
    return _core.Image(rgb, srgb=False)


def _point(context: Context, node: Node, values: Values) -> Entry:
    to_world = values.pop("to_world", None)
    if to_world is not None:
        values.setdefault("position", tuple(float(v) for v in to_world[:3, 3]))
    return {"type": "point", **values}


def _directional(context: Context, node: Node, values: Values) -> Entry:
    to_world = values.pop("to_world", None)
    if to_world is not None:
        values.setdefault("direction", tuple(float(v) for v in to_world[:3, 2]))
    return {"type": "directional", **values}


def _spot(context: Context, node: Node, values: Values) -> Entry:
    values.setdefault("cutoff_angle", 20.0)
    values.setdefault("beam_width", 0.75 * values["cutoff_angle"])
    return {"type": "spot", **values}


def _projector(context: Context, node: Node, values: Values) -> Entry:
    """Computes the field of view along x from the picture's aspect ratio."""
    picture = values.get("irradiance")
    entry = context.entry("textures", picture["texture"]) if isinstance(picture, dict) else {}
    if entry.get("type") == "clamped":
        entry = context.entry("textures", entry["texture"]["texture"])
    image = entry.get("image")
    values["aspect"] = image.width / image.height if image is not None else 1.0
    lens = field_of_view(node, values)
    axis, half = lens.pop("fov_axis", "x"), math.tan(math.radians(lens.pop("fov")) / 2)
    half_width = half * width_per_axis(axis, values["aspect"])
    return {"type": "projector", **lens, "fov": math.degrees(2 * math.atan(half_width))}


def _collimated(context: Context, node: Node, values: Values) -> None:
    """Ignored: the beam has zero width, so that paths from the camera cannot hit it."""
    context.diagnostics.unknown(
        f"{node} is a beam of zero width, which no path can hit; it is ignored", node.location
    )


PLACE = Field("to_world", "transform", "placement, instead of the above")
BEAM = (
    Field("to_world", "transform", "placement in the scene"),
    Field("power", "spectrum", "of the beam", 1.0, unit="W"),
    Field("irradiance", "spectrum", "of the beam", 1.0),
)
COMPENSATION = Field("mis_compensation", "boolean", "Mitsuba's name for sampling: compensated or radiance")
FILENAME = Field("filename", "string", "a latitude-longitude panorama; y is up")

PLUGINS = (
    Plugin(
        "emitter",
        "envmap",
        "",
        (FILENAME, *ARRAYS, COMPENSATION),
        _envmap,
        model="envmap",
        hidden=("image",),
    ),
    Plugin("emitter", "point", "", (PLACE,), _point, model="point"),
    Plugin("emitter", "directional", "", (PLACE,), _directional, model="directional"),
    Plugin("emitter", "spot", "", (), _spot, model="spot"),
    Plugin("emitter", "projector", "", LENS, _projector, model="projector", hidden=("aspect",)),
    Plugin("emitter", "collimated", "A beam of zero width; it is ignored.", BEAM, _collimated),
)
