"""Textures from image files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..convert import convert
from ..errors import Location, SceneError
from ..images import Pixels, is_integer_file, read_pixels
from ..nodes import Node
from ..schema import Content, Field, Plugin

if TYPE_CHECKING:
    from ..build import Builder


def _bitmap(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    values.pop("filename", None)
    raw, gamma = values.pop("raw", False), values.pop("gamma", -1.0)
    channel, data = values.pop("channel", ""), values.pop("data", None)
    if data is not None:
        image = _from_array(builder, node, data)
    else:
        path, location = builder.find(node)
        key = ("texture", path.resolve(), raw, gamma, channel)
        if key not in builder.files:
            builder.reading(path, location)
            builder.files[key] = _load(builder, path, location, raw or gamma == 1, gamma, channel)
        image = builder.files[key]
    return {"type": "bitmap", "image": image, **values}


def _load(builder: Builder, path: Path, location: Location, raw: bool, gamma: float, channel: str) -> Content:
    """An image of the core. Integers are sRGB-encoded, `raw`, or follow a power law where `gamma` > 0."""
    pixels = read_pixels(path, location, channel)
    builder.unpacked(path, pixels.nbytes, location)
    encoded = not raw and is_integer_file(path)
    if pixels.dtype == np.uint8 and (raw or gamma <= 0):
        return builder.core.Image(pixels, srgb=encoded)
    if encoded:
        pixels = decode(pixels, gamma)
    return builder.core.Image(pixels, srgb=False)


def decode(pixels: Pixels, gamma: float = -1.0) -> Pixels:
    """Linear float32 values of encoded ones; sRGB where `gamma` is not above zero."""
    v = np.asarray(pixels, np.float32) / (255 if pixels.dtype == np.uint8 else 1)
    if gamma > 0:
        return np.power(v, gamma, dtype=np.float32)
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4).astype(np.float32)


def _from_array(builder: Builder, node: Node, data: Content) -> Content:
    try:
        array = np.asarray(data)
        array = array[:, :, None] if array.ndim == 2 else array
        if array.ndim != 3 or array.shape[2] not in (1, 3) or 0 in array.shape:
            raise SceneError(f'"data" of {node} must have the shape (height, width, 1 or 3)', node.location)
        array = array if array.dtype in (np.uint8, np.float16, np.float32) else array.astype(np.float32)
    except (TypeError, ValueError):
        raise SceneError(f'"data" of {node} is not an array', node.location) from None
    return builder.core.Image(np.ascontiguousarray(array), srgb=False)


def _scale(builder: Builder, node: Node, values: dict[str, Any]) -> Content:
    """The texture inside may have any name, or be a colour called `value`."""
    fields = {"scale": FACTOR, "texture": SCALED}
    for prop, child in node.children("texture"):
        name = "scale" if prop.name == "scale" else "texture"
        if builder.texture(child) is not None:  # else it was left out
            values[name] = convert(builder, node, prop, fields[name])
    values.setdefault("texture", values.pop("value", None))
    if values["texture"] is None:
        if any(True for _ in node.children("texture")):
            return None
        raise SceneError(f"{node} needs a texture inside", node.location)
    return {"type": "scale", **values}


def _vertex_colors(builder: Builder, node: Node, values: dict[str, Any]) -> Content:
    return {"type": "mesh_attribute", "name": "vertex_color"}


SCALED = Field("texture", "texture_spectrum", "what is scaled; may have any name")
FACTOR = Field("scale", "texture_spectrum", "the factor", 1.0)
SCALED_COLOR = Field("value", "spectrum", "a colour in place of the texture")

PLUGINS = (
    Plugin(
        "texture",
        "scale",
        "",
        (SCALED, FACTOR, SCALED_COLOR),
        _scale,
        ("texture",),
        "scale",
        ("texture", "scale"),
    ),
    Plugin("texture", "vertexcolors", "The colours of a mesh's vertices.", (), _vertex_colors),
    Plugin(
        "texture",
        "bitmap",
        "An image. Integers are taken as sRGB, floating-point numbers as linear.",
        (
            Field("filename", "string", "any format that OpenImageIO reads"),
            Field("raw", "boolean", "values are not colours: take them as they are", False),
            Field("gamma", "float", "exponent of the encoding; 1 is linear, -1 is sRGB", -1.0),
            Field("channel", "string", "use one channel only: r, g, b or a", ""),
            Field(
                "data", "image", "from Python: an array (height, width, 1 or 3), linear, instead of a file"
            ),
        ),
        _bitmap,
        model="bitmap",
        hidden=("image",),
    ),
)
