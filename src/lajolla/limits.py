"""Ranges and choices of options, for Python and the command line. Does not import the renderer."""

import math
import operator
from collections.abc import Iterable, Mapping
from numbers import Real
from typing import Any, SupportsIndex

from lajolla.messages import Error

MOST_SAMPLES = 2**30  # per pixel, as in the core
LARGEST = 65536  # width or height of a picture

# Minimum and maximum of each number of an option, for any scene.
LIMITS: dict[str, tuple[tuple[int, int], ...]] = {
    "spp": ((1, MOST_SAMPLES),),
    "seed": ((0, 2**32 - 1),),
    "max_depth": ((-1, 2**31 - 1),),
    "sensor": ((0, 2**31 - 1),),
    "threads": ((1, 1024),),  # TBB hangs with many more
    "size": ((1, LARGEST),) * 2,
    "crop": ((0, LARGEST), (0, LARGEST), (1, LARGEST), (1, LARGEST)),
    "pixel": ((0, LARGEST),) * 2,
    "port": ((0, 65535),),
    "sample": ((0, MOST_SAMPLES - 1),),
}

# Compressions of EXR files, as far as programs read them. Some are not exact: PXR24 rounds 32-bit floats to
# 24 bits, B44 changes 16-bit ones, and DWA changes colours.
COMPRESSIONS = ("none", "rle", "zip", "zips", "piz", "pxr24", "b44", "b44a", "dwaa", "dwab")

STRATEGIES = ("mis", "bsdf", "light")  # of the integrators path and volpath
FOOTPRINTS = ("differentials", "cone")  # of the same


class OptionError(Error, ValueError):
    """A render option that does not fit the scene."""


def check_flag(name: str, value: object) -> None:
    """Raises OptionError for what is neither True nor False, such as "no"; None, the default, is valid."""
    if value is not None and not isinstance(value, bool):
        raise OptionError(f"{name} must be True or False, not {value!r}")


def check_real(name: str, value: object) -> None:
    """Raises OptionError for what is no real number, such as "1%"; None, the default, is valid."""
    if value is not None and (isinstance(value, bool) or not isinstance(value, Real)):
        raise OptionError(f"{name} must be a number, not {value!r}")


def check_mapping(name: str, value: object) -> None:
    """Raises TypeError for what is no dict or the like."""
    if not isinstance(value, Mapping):
        raise TypeError(f"{name} must be a dict, not {value!r}")


def whole(value: object) -> int | None:
    """A whole number as Python's own: also one of NumPy's, or a float such as 4.0. None for anything else."""
    if isinstance(value, bool):
        return None
    if isinstance(value, SupportsIndex):
        try:
            return operator.index(value)
        except TypeError:  # NumPy's truth values, and arrays
            return None
    real = float(value) if isinstance(value, Real) else math.nan
    return int(real) if real.is_integer() else None


def check(name: str, value: object) -> Any:  # noqa: ANN401
    """The value of an option, with Python's whole numbers; None, the scene's own value, stays.

    Raises OptionError if it is not valid.
    """
    limits = LIMITS[name]
    if value is None:
        return None
    values = [value]
    if len(limits) > 1:
        values = list(value) if hasattr(value, "__len__") and isinstance(value, Iterable) else []
        if len(values) != len(limits) or isinstance(value, str | Mapping):
            raise OptionError(f"{name} must be {len(limits)} whole numbers, not {value!r}")
    numbers = []
    for given, (lowest, highest) in zip(values, limits, strict=True):
        number = whole(given)
        if number is None:
            raise OptionError(f"{name} must be a whole number, not {given!r}")
        if not lowest <= number <= highest:
            raise OptionError(f"{name} must be in {lowest} to {highest}, not {number}")
        numbers.append(number)
    return tuple(numbers) if len(limits) > 1 else numbers[0]
