"""Parsing of numbers, colours and spectra."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from typing import NamedTuple

from lajolla.colour import decode_srgb

from .errors import Location, SceneError
from .nodes import Blackbody, Rgb, Spectrum

NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?f?", re.ASCII)
SEPARATORS = re.compile(r"[\s,]+")
HEXADECIMAL = re.compile(r"#[0-9a-fA-F]{6}")


class Text(NamedTuple):
    """The text of an attribute with its place, for messages."""

    text: str
    location: Location

    def fail(self, expected: str) -> SceneError:
        """An error that quotes the text."""
        shown = self.text if len(self.text) <= 40 else self.text[:37] + "..."
        return SceneError(f'expected {expected}, found "{shown}"', self.location)


def parse_float(text: Text) -> float:
    """One finite number."""
    return _number(text.text.strip(), text)


def _number(token: str, text: Text) -> float:
    """A number of a text."""
    if not NUMBER.fullmatch(token) or not math.isfinite(value := float(token.rstrip("f"))):
        raise Text(token, text.location).fail("a number")
    return value


def parse_integer(text: Text) -> int:
    """One whole number; `8.0` is accepted."""
    try:
        value = parse_float(text)
    except SceneError:
        raise text.fail("a whole number") from None
    if value != int(value):
        raise text.fail("a whole number")
    return int(value)


def parse_boolean(text: Text) -> bool:
    """true or false, in any case."""
    value = {"true": True, "false": False}.get(text.text.strip().lower())
    if value is None:
        raise text.fail("true or false")
    return value


def parse_floats(text: Text, counts: tuple[int, ...]) -> list[float]:
    """Numbers between spaces or commas; as many as one of `counts`."""
    tokens = SEPARATORS.split(text.text.strip(" \t\r\n,"))
    if len(tokens) not in counts:
        allowed = " or ".join(map(str, counts))
        raise text.fail(f"{allowed} number{'s' if allowed != '1' else ''}")
    return [_number(token, text) for token in tokens]


def parse_numbers(text: Text) -> list[float]:
    """Any count of numbers between spaces or commas."""
    return parse_floats(text, (len(text.text.replace(",", " ").split()),))


def parse_rgb(text: Text, *, srgb: bool) -> Rgb:
    """One or three numbers, or `#rrggbb`. With `srgb` the values are decoded to linear ones."""
    stripped = text.text.strip()
    if HEXADECIMAL.fullmatch(stripped):
        values = [int(stripped[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    else:
        values = parse_floats(text, (1, 3))
        values = values * 3 if len(values) == 1 else values
    red, green, blue = decode_srgb(values).tolist() if srgb else values
    return Rgb((red, green, blue))


def parse_spectrum(text: Text) -> Spectrum | Rgb:
    """One number, `wavelength:value` pairs in rising order, or three numbers (RGB, as 0.x files may)."""
    if ":" not in text.text:
        values = parse_floats(text, (1, 3))
        return Spectrum((values[0],)) if len(values) == 1 else Rgb((values[0], values[1], values[2]))
    pairs = [
        Text(t, text.location)
        for t in SEPARATORS.split(re.sub(r" ?: ?", ":", " ".join(text.text.split())).strip(" ,"))
    ]
    split = [pair.text.split(":") for pair in pairs]
    for pair, parts in zip(pairs, split, strict=True):
        if len(parts) != 2:
            raise pair.fail("wavelength:value")
    wavelengths = tuple(parse_float(Text(parts[0], text.location)) for parts in split)
    return checked_spectrum(
        wavelengths, tuple(parse_float(Text(p[1], text.location)) for p in split), text.location
    )


def checked_spectrum(
    wavelengths: tuple[float, ...], values: tuple[float, ...], location: Location
) -> Spectrum:
    """A spectrum over rising wavelengths.

    Raises:
        SceneError: too few samples, or wavelengths that do not rise.
    """
    if len(wavelengths) < 2 or len(wavelengths) != len(values):
        raise SceneError("a spectrum needs at least two wavelengths, each with a value", location)
    for left, right in pairwise(wavelengths):
        if right <= left:
            raise SceneError(f"wavelengths must rise, but {right:g} follows {left:g}", location)
    return Spectrum(values, wavelengths)


def parse_blackbody(temperature: Text, scale: Text | None) -> Blackbody:
    """A temperature with an optional `k`, and a scale."""
    number = temperature.text.strip()
    number = number[:-1] if number.endswith(("k", "K")) else number
    kelvin = parse_float(Text(number, temperature.location))
    if kelvin <= 0:
        raise temperature.fail("a temperature above zero")
    return Blackbody(kelvin, 1.0 if scale is None else parse_float(scale))
