"""Bounds of the values of textures, and clamping to the range of a field."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from ..syntax.nodes import Node
from .plugin import Colour, Context, Entry, Use

Bounds: TypeAlias = tuple[float, float]  # the least and the largest value of any channel

ANYTHING: Bounds = (-math.inf, math.inf)
LARGEST = float(np.finfo(np.float32).max)
OUTSIDE = {"zero": 0.0, "one": 1.0}  # what wrap modes put around a picture


def within(context: Context, value: Use, limits: Bounds, node: Node) -> Use:
    """The texture itself if all its values are within the limits, else one that clamps it."""
    found = bounds_of(context, value)
    if limits == ANYTHING or (found and limits[0] <= found[0] and found[1] <= limits[1]):
        return value
    low, high = (min(max(limit, -LARGEST), LARGEST) for limit in limits)
    clamped = {"type": "clamped", "texture": value, "low": low, "high": high}
    return {"texture": context.add_once("textures", clamped, node)}


def bounds_of(context: Context, value: Use | float | Colour) -> Bounds | None:
    """The bounds of a number, a colour or `{"texture": index}`; None where they are not known."""
    if not isinstance(value, dict):
        numbers = np.ravel(np.asarray(value, float))
        return float(numbers.min()), float(numbers.max())
    index = value["texture"]
    return context.once(("bounds", index), lambda: _bounds(context, context.entry("textures", index)))


def _bounds(context: Context, entry: Entry) -> Bounds | None:
    kind = entry["type"]
    if kind == "bitmap":
        beyond = OUTSIDE.get(entry.get("wrap_mode", ""))
        return _hull([entry["image"].bounds(), *([] if beyond is None else [(beyond, beyond)])])
    if kind == "ptex":
        return entry["images"].bounds()
    fields = context.declared("texture", kind)
    if kind == "clamped":
        default = {f.name: f.default for f in fields}
        return entry.get("low", default["low"]), entry.get("high", default["high"])
    parts = [entry.get(f.name, f.default) for f in fields if f.type == "texture_spectrum"]
    known = [bounds for part in parts if (bounds := bounds_of(context, part)) is not None]
    if not parts or len(known) < len(parts):
        return (0.0, 1.0) if kind == "curvature" else None
    return _product(*known) if kind == "scale" else _hull(known)


def _hull(parts: list[Bounds]) -> Bounds:
    return min(low for low, _ in parts), max(high for _, high in parts)


def _product(first: Bounds, second: Bounds) -> Bounds:
    corners = [a * b for a in first for b in second]
    return ANYTHING if any(map(math.isnan, corners)) else (min(corners), max(corners))
