"""Films: picture size and output settings."""

from __future__ import annotations

import re

from lajolla.film import COMPONENT_FORMATS, PIXEL_FORMATS, Film

from ...schema import CHILDREN, Field
from ...syntax.errors import SceneError, did_you_mean
from ...syntax.nodes import Node
from ..outputs import Layer
from ..plugin import Context, FilmPart, Plugin, Values

PIXELS = "pixels"


def _film(context: Context, node: Node, values: Values) -> FilmPart:
    defaults = {field.name: field.default for field in context.declared("film", node.plugin)}
    for side, offset, crop in (
        ("width", "crop_offset_x", "crop_width"),
        ("height", "crop_offset_y", "crop_height"),
    ):
        values.setdefault(side, defaults[side])
        values.setdefault(offset, 0)
        values.setdefault(crop, values[side] - values[offset])
        if values[offset] + values[crop] > values[side] or values[crop] < 1:
            prop = node.find(crop) or node.find(offset)
            place = prop.location if prop else node.location
            raise SceneError(
                f"the crop window does not lie inside of the film's {side} of {values[side]}", place
            )
    settings = {name: values.pop(name, defaults[name]) for name in SETTINGS if name in defaults}
    formats, names = values.pop("pixel_format", defaults["pixel_format"]), values.pop("channel_names", "")
    values.pop("sample_border", None)
    if not (settings.get("gamma", -1) == -1 or settings["gamma"] > 0):
        raise SceneError('"gamma" must be positive, or -1 for sRGB', node.property_location("gamma"))
    if not re.fullmatch(r"[A-Za-z]\w*", settings.get("variable", "data"), re.ASCII):
        raise SceneError('"variable" must be a name', node.property_location("variable"))
    films = [
        Film(**settings, pixel_format=_pixel_format(context, node, settings["file_format"], word))
        for word in _words(formats.lower()) or [defaults["pixel_format"]]
    ]
    return FilmPart(values, films[0], _layers(node, films, _words(names)))


def _words(text: str) -> list[str]:
    return [word for word in re.split(r"[,\s]+", text) if word]


def _layers(node: Node, films: list[Film], names: list[str]) -> tuple[Layer, ...]:
    """One per pixel format with a name; a single format does not need one."""
    if len(films) != len(names) and (names or len(films) > 1):
        raise SceneError(
            f"the number of pixel formats, {len(films)}, is not that of channel names, {len(names)}",
            node.property_location("channel_names" if names else "pixel_format"),
        )
    return tuple(Layer(name, film) for name, film in zip(names, films, strict=False))


# Formats of spectral builds, and the spelling of Mitsuba 0.6.
OTHER_NAMES = {"luminancealpha": "luminance_alpha", "spectrum": "rgb", "spectrumalpha": "rgba"}
# The pixel formats that a file format supports; others support all.
HOLDS = {"rgbe": ("rgb",), "pfm": ("rgb", "luminance"), "jpeg": ("rgb", "luminance")}


def _pixel_format(context: Context, node: Node, file_format: str, word: str) -> str:
    place = node.property_location("pixel_format")
    name = OTHER_NAMES.get(word, word)
    if word.startswith("spectrum"):
        context.diagnostics.warn(f'spectral output is not supported; "{name}" is used', place)
    if name not in PIXEL_FORMATS:
        raise SceneError(f'unknown pixel format "{word}"{did_you_mean(word, PIXEL_FORMATS)}', place)
    holds = HOLDS.get(file_format, tuple(PIXEL_FORMATS))
    if name in holds:
        return name
    used = "luminance" if name == "luminance_alpha" and "luminance" in holds else "rgb"
    context.diagnostics.warn(f'{file_format} files cannot hold "{name}"; "{used}" is used', place)
    return used


SETTINGS = (
    "file_format", "component_format", "tonemap_method", "gamma", "exposure", "key", "burn", "digits",
    "variable",
)  # fmt: skip


def _size(width: int, height: int) -> tuple[Field, ...]:
    return (
        Field("width", "integer", "of the whole picture", width, 1, 65536, PIXELS),
        Field("height", "integer", "of the whole picture", height, 1, 65536, PIXELS),
        Field("sample_border", "boolean", "ignored: pixels use only their own samples", False),
    )


def _formats(*names: str) -> Field:
    doc = "default format of files; an ending given with -o overrides it"
    return Field("file_format", "choice", doc, names[0], choices=names)


def _pixels(default: str) -> Field:
    return Field("pixel_format", "string", f"{', '.join(PIXEL_FORMATS)}; alpha is the coverage", default)


HDR_FIELDS = (
    *_size(768, 576),
    _formats("openexr", "rgbe", "pfm"),
    _pixels("rgb"),
    Field("component_format", "choice", "of EXR files", "float32", choices=tuple(COMPONENT_FORMATS)),
    Field("channel_names", "string", "for multichannel: a name for each of several pixel formats", ""),
)
LDR_FIELDS = (
    *_size(768, 576),
    _formats("png", "jpeg"),
    _pixels("rgb"),
    Field(
        "tonemap_method",
        "choice",
        "exposure only, or Reinhard et al. 2002",
        "gamma",
        choices=("gamma", "reinhard"),
    ),
    Field("gamma", "float", "of the display; -1 is sRGB's curve", -1.0, -1, 100),
    Field("exposure", "float", "with gamma: brightens by 2^exposure", 0.0, -100, 100, "stops"),
    Field("key", "float", "with reinhard: how bright the average is", 0.18, 1e-6, 1),
    Field("burn", "float", "with reinhard: how much of the highlights becomes white", 0.0, 0, 1),
)
MATRIX_FIELDS = (
    *_size(1, 1),
    _formats("matlab", "mathematica", "numpy"),
    _pixels("luminance"),
    Field("digits", "integer", "significant digits of texts", 4, 1, 17),
    Field("variable", "string", "name of the variable in text files", "data"),
)

PLUGINS = tuple(
    Plugin("film", name, doc, fields, _film, CHILDREN["film"], "film")
    for name, doc, fields in (
        ("hdrfilm", "A picture of linear values.", HDR_FIELDS),
        ("tiledhdrfilm", "The same as hdrfilm.", HDR_FIELDS),
        ("ldrfilm", "A picture for displays; the linear values are written beside it.", LDR_FIELDS),
        ("mfilm", "A matrix of numbers for Matlab, Mathematica or NumPy.", MATRIX_FIELDS),
    )
)
