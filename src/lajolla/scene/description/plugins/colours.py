"""Textures that are one colour: spectra as objects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ...schema import Field
from ...syntax.errors import SceneError
from ...syntax.literals import Text, checked_spectrum, parse_numbers
from ...syntax.nodes import Blackbody, Node, Rgb, Spectrum
from ..plugin import Constant, Context, Plugin, Use, Values

ONE = (1.0, 1.0, 1.0)


def _uniform(context: Context, node: Node, values: Values) -> Constant:
    return Spectrum((_needed(node, values, "value"),))


def _colour(name: str) -> Callable[[Context, Node, Values], Constant]:
    return lambda context, node, values: Rgb(_needed(node, values, name))


def _d65(context: Context, node: Node, values: Values) -> Use | Constant | None:
    nested = next((child for _, child in node.children("texture")), None)
    scale = values.get("scale", 1.0)
    if nested is None:
        red, green, blue = (scale * v for v in values.get("color", ONE))
        return Rgb((red, green, blue))
    if scale != 1:
        raise SceneError(f"{node} cannot scale the texture inside it", node.location)
    return context.texture(nested)


def _blackbody(context: Context, node: Node, values: Values) -> Constant:
    return Blackbody(_needed(node, values, "temperature"), values.get("scale", 1.0))


def _regular(context: Context, node: Node, values: Values) -> Constant:
    samples = _numbers(node, "values")
    low, high = _needed(node, values, "wavelength_min"), _needed(node, values, "wavelength_max")
    step = (high - low) / max(1, len(samples) - 1)
    return checked_spectrum(tuple(low + step * i for i in range(len(samples))), samples, node.location)


def _irregular(context: Context, node: Node, values: Values) -> Constant:
    return checked_spectrum(_numbers(node, "wavelengths"), _numbers(node, "values"), node.location)


def _needed(node: Node, values: Values, name: str) -> Any:  # noqa: ANN401
    if name not in values:
        raise SceneError(f'{node} needs "{name}"', node.location)
    return values[name]


def _numbers(node: Node, name: str) -> tuple[float, ...]:
    prop = node.find(name)
    if prop is None:
        raise SceneError(f'{node} needs "{name}"', node.location)
    return tuple(parse_numbers(Text(str(prop.value), prop.location)))


SCALE = Field("scale", "float", "factor", 1.0)
COLOR = Field("color", "spectrum", "linear sRGB", ONE)
VALUES = Field("values", "string", "samples")
WAVELENGTH_MIN = Field("wavelength_min", "float", "first wavelength", 360.0, unit="nm")
WAVELENGTH_MAX = Field("wavelength_max", "float", "last wavelength", 830.0, unit="nm")
RANGE = (WAVELENGTH_MIN, WAVELENGTH_MAX)
FIRST = replace(WAVELENGTH_MIN, doc="first wavelength; required", default=None)
LAST = replace(WAVELENGTH_MAX, doc="last wavelength; required", default=None)
TEMPERATURE = Field("temperature", "float", "of the black body", None, 1.0, unit="K")
RAW = Field("value", "spectrum", "linear sRGB")

PLUGINS = (
    Plugin("texture", "uniform", "One value.", (Field("value", "float", "the value"), *RANGE), _uniform),
    Plugin(
        "texture",
        "srgb",
        "A colour.",
        (COLOR, Field("unbounded", "boolean", "may exceed 1")),
        _colour("color"),
    ),
    Plugin("texture", "rawconstant", "A colour that is not converted.", (RAW,), _colour("value")),
    Plugin("texture", "d65", "A colour under daylight.", (SCALE, COLOR), _d65, ("texture",)),
    Plugin("texture", "blackbody", "Planck's law.", (TEMPERATURE, SCALE), _blackbody),
    Plugin("texture", "regular", "Samples at regular wavelengths.", (VALUES, FIRST, LAST), _regular),
    Plugin(
        "texture",
        "irregular",
        "Samples at given wavelengths.",
        (VALUES, Field("wavelengths", "string", "of the samples, rising", unit="nm")),
        _irregular,
    ),
)
