"""Values of command line options: from text to what they mean, checked."""

import argparse
import math
import re
from collections.abc import Callable

from lajolla.aovs import check_aovs
from lajolla.limits import LIMITS, OptionError, check


def whole(option: str) -> Callable[[str], int]:
    """A parser for the value of an option that is one whole number."""

    def parsed(text: str) -> int:
        (value,) = numbers(option, text, ",", "a whole number")
        return value

    return parsed


def numbers(option: str, text: str, separator: str, form: str) -> tuple[int, ...]:
    """Parses an option's whole numbers and checks their ranges; `form` describes the expected format."""
    try:
        values = tuple(int(part) for part in text.split(separator))
    except ValueError:
        values = ()
    if len(values) != len(LIMITS[option]):
        raise argparse.ArgumentTypeError(f"{text!r} is not {form}")
    try:
        check(option, values if len(values) > 1 else values[0])
    except OptionError as problem:
        raise argparse.ArgumentTypeError(str(problem)) from None
    return values


def address(text: str) -> tuple[str, int]:
    """HOST:PORT; an IPv6 address is in brackets."""
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise argparse.ArgumentTypeError(f"{text!r} is not HOST:PORT, such as localhost:14158")
    return host.removeprefix("[").removesuffix("]"), int(port)


def size(text: str) -> tuple[int, ...]:
    return numbers("size", text.lower(), "x", "WIDTHxHEIGHT, such as 640x480")


def crop(text: str) -> tuple[int, ...]:
    return numbers("crop", text, ",", "X,Y,WIDTH,HEIGHT, such as 0,0,64,64")


def aovs(text: str) -> tuple[str, ...]:
    try:
        return check_aovs(name.strip() for name in text.split(","))
    except OptionError as problem:
        raise argparse.ArgumentTypeError(str(problem)) from None


def pixel(text: str) -> tuple[int, ...]:
    return numbers("pixel", text, ",", "X,Y, such as 10,20")


MOST_FRAMES = 1_000_000


def frames(text: str) -> tuple[int, ...]:
    """Numbers, and ranges with both ends: 1-240, 0-100:10, 3,7."""
    result: dict[int, None] = {}
    for part in text.split(","):
        found = re.fullmatch(r"\s*(-?\d{1,9})(?:-(-?\d{1,9})(?::(\d{1,9}))?)?\s*", part)
        numbers = range(0)
        if found is not None:
            first, last, step = int(found[1]), int(found[2] or found[1]), int(found[3] or 1)
            numbers = range(first, last + 1, step) if step else range(0)
        if not numbers:
            raise argparse.ArgumentTypeError(f"{text!r} are not frames, such as 1-240, 0-100:10 or 3,7")
        if len(result) + len(numbers) > MOST_FRAMES:
            raise argparse.ArgumentTypeError(f"{text!r} are more than {MOST_FRAMES} frames")
        result.update(dict.fromkeys(numbers))
    return tuple(result)


SECONDS = {"": 1, "s": 1, "m": 60, "min": 60, "h": 3600, "d": 86400}


def seconds(text: str) -> float:
    found = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+)\s*([a-z]*)", text.strip().lower())
    if found is None or found[2] not in SECONDS or not float(found[1]) > 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a time, such as 90s, 5m or 1.5h")
    return float(found[1]) * SECONDS[found[2]]


def noise(text: str) -> float:
    try:
        value = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        value = math.nan
    if not 0 < value < 1:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a relative error between 0 and 1, such as 0.01 or 1%"
        )
    return value


def finite(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) <= 100:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from -100 to 100")
    return value


def definition(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not name or not equals:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE")
    return name, value
