"""Textures from image files."""

from __future__ import annotations

import numpy as np

from lajolla import _core
from lajolla.colour import decode_srgb

from ...formats.images import FLOAT_RGB, Pixels, read_pixels
from ...formats.ptx import read_ptx
from ...schema import Field
from ...syntax.errors import SceneError
from ...syntax.files import identity
from ...syntax.nodes import Node
from ..plugin import Context, Entry, Plugin, Values


def _bitmap(context: Context, node: Node, values: Values) -> Entry:
    values.pop("filename", None)
    raw, gamma = values.pop("raw", False), values.pop("gamma", -1.0)
    channel = values.pop("channel", "")
    encoded = not (raw or gamma == 1 or is_alpha(channel))
    array = pixels_from_python(node, values, channel)
    if array is not None:
        image = bitmap_image(array[0], gamma, encoded=encoded and array[1])
    else:
        path, location = context.find(node)
        key = ("texture", identity(path), raw, gamma, channel)

        def read() -> _core.Image:
            context.reading(path, location)
            decoded = FLOAT_RGB if gamma > 0 and gamma != 1 else 0
            pixels, is_integer = read_pixels(path, location, context.pictures, channel, pixel=decoded)
            return bitmap_image(pixels, gamma, encoded=encoded and is_integer)

        image = context.read(key, read)
    return {"type": "bitmap", "image": image, **values}


def is_alpha(channel: str) -> bool:
    """Whether a channel is alpha, which is never encoded as sRGB."""
    return channel.lower() == "a"


def bitmap_image(pixels: Pixels, gamma: float = -1.0, *, encoded: bool) -> _core.Image:
    """An image of the core. What is encoded is sRGB, or follows a power law where `gamma` > 0."""
    if pixels.dtype == np.uint8 and not (encoded and gamma > 0):
        return _core.Image(pixels, srgb=encoded)
    if encoded:
        pixels = decode(pixels, gamma)
    return _core.Image(pixels, srgb=False)


def decode(pixels: Pixels, gamma: float = -1.0) -> Pixels:
    """Linear float32 values of encoded ones; sRGB where `gamma` is not above zero."""
    v = np.asarray(pixels, np.float32) / (255 if pixels.dtype == np.uint8 else 1)
    if gamma > 0:
        return np.power(v, gamma, dtype=np.float32)
    return decode_srgb(v)


CHANNELS = {1: "y", 2: "ya", 3: "rgb", 4: "rgba"}  # of an array, by their number


def pixels_from_python(node: Node, values: Values, channel: str = "") -> tuple[Pixels, bool] | None:
    """The pixels of an array as if it were a file of its type, and whether they are integers.

    Takes the array, if there is one, out of the node's values.
    """
    arrays = [values.pop(name) for name in ("data", "bitmap") if name in values]
    if not arrays:
        return None
    if len(arrays) > 1 or node.find("filename") is not None:
        raise SceneError(f"{node} takes one of a file, an array and a bitmap", node.location)
    data = arrays[0]
    try:
        array = np.asarray(data)
        array = array[:, :, None] if array.ndim == 2 else array
        if array.ndim != 3 or array.shape[2] not in CHANNELS or 0 in array.shape:
            raise SceneError(f'"data" of {node} must have the shape (height, width, 1 to 4)', node.location)
        is_integer = array.dtype in (np.uint8, np.uint16)
        if array.dtype == np.uint16:
            array = array.astype(np.float32) * np.float32(1 / 65535)  # as OpenImageIO does it
        elif array.dtype not in (np.uint8, np.float16, np.float32):
            array = array.astype(np.float32)
    except (TypeError, ValueError):
        raise SceneError(f'"data" of {node} is not an array', node.location) from None
    names = CHANNELS[array.shape[2]]
    if channel and (len(channel) != 1 or channel.lower() not in names):
        raise SceneError(
            f'"data" of {node} has no channel "{channel}", only {", ".join(names)}', node.location
        )
    wanted = [names.index(name) for name in channel.lower() or names if channel or name != "a"]
    return np.ascontiguousarray(array[:, :, wanted]), is_integer


def _scale(context: Context, node: Node, values: Values) -> Entry | None:
    """The texture inside may have any name, or be a colour called `value`."""
    fields = {"scale": FACTOR, "texture": SCALED}
    for prop, child in node.children("texture"):
        name = "scale" if prop.name == "scale" else "texture"
        if context.texture(child) is not None:  # else it was left out
            values[name] = context.convert(node, prop, fields[name])
    values.setdefault("texture", values.pop("value", None))
    if values["texture"] is None:
        if any(True for _ in node.children("texture")):
            return None
        raise SceneError(f"{node} needs a texture inside", node.location)
    return {"type": "scale", **values}


def _ptex(context: Context, node: Node, values: Values) -> Entry:
    values.pop("filename", None)
    raw = values.pop("raw", False)
    path, location = context.find(node)

    def read() -> _core.FaceImages:
        context.reading(path, location)
        file = read_ptx(path, location, context.pictures)
        encoded = file.is_integer and not raw
        texels = file.texels
        if encoded and texels.dtype != np.uint8:
            texels = decode_srgb(texels)
        return _core.FaceImages(file.log_sizes, file.flags, file.neighbours, file.edges, texels, srgb=encoded)

    return {"type": "ptex", "images": context.read(("ptex", identity(path), raw), read), **values}


def _vertex_colors(context: Context, node: Node, values: Values) -> Entry:
    return {"type": "mesh_attribute", "name": "vertex_color"}


ARRAYS = (
    Field("data", "image", "from Python: an array (height, width, 1 to 4), read as a file of its type"),
    Field("bitmap", "image", "from Python: the same"),
)
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
    Plugin(
        "texture",
        "ptex",
        "",
        (
            Field("filename", "string", "a .ptx file, with as many faces as the mesh"),
            Field("raw", "boolean", "integers are not colours: do not decode sRGB", False),
        ),
        _ptex,
        model="ptex",
        hidden=("images",),
    ),
    Plugin("texture", "vertexcolors", "The colours of a mesh's vertices.", (), _vertex_colors),
    Plugin(
        "texture",
        "bitmap",
        "An image. Integers are taken as sRGB, floating-point numbers as linear.",
        (
            Field("filename", "string", "any format that OpenImageIO reads"),
            Field("raw", "boolean", "values are not colours: do not decode sRGB", False),
            Field("gamma", "float", "exponent of the encoding; 1 is linear, -1 is sRGB", -1.0),
            Field("channel", "string", "use one channel only: r, g, b or a", ""),
            *ARRAYS,
        ),
        _bitmap,
        model="bitmap",
        hidden=("image",),
    ),
)
