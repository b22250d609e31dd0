"""Ranges and choices of options, for Python and the command line. Does not import the renderer."""

from collections.abc import Mapping, Sequence
from numbers import Real
from typing import SupportsIndex

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


class OptionError(ValueError):
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


def check(name: str, value: object) -> None:
    """Raises OptionError if a value is not valid for an option; None, the scene's own value, is valid."""
    limits = LIMITS[name]
    if value is None:
        return
    values = [value]
    if len(limits) > 1:
        if not isinstance(value, Sequence) or len(value) != len(limits):
            raise OptionError(f"{name} must be {len(limits)} whole numbers, not {value!r}")
        values = list(value)
    for number, (lowest, highest) in zip(values, limits, strict=True):
        if isinstance(number, bool) or not isinstance(number, SupportsIndex):
            raise OptionError(f"{name} must be a whole number, not {number!r}")
        if not lowest <= number.__index__() <= highest:
            raise OptionError(f"{name} must be in {lowest} to {highest}, not {number}")
