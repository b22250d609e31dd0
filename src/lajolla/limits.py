"""What numbers options may be, from Python and on the command line; it loads nothing of the renderer."""

from collections.abc import Sequence
from typing import SupportsIndex

MOST_SAMPLES = 2**30  # of a pixel, as in the core
LARGEST = 65536  # side of a picture

# The least and the greatest of each option's numbers, whatever the scene.
LIMITS: dict[str, tuple[tuple[int, int], ...]] = {
    "spp": ((1, MOST_SAMPLES),),
    "seed": ((0, 2**32 - 1),),
    "max_depth": ((-1, 2**31 - 1),),
    "sensor": ((0, 2**31 - 1),),
    "threads": ((1, 1024),),  # TBB hangs far above
    "size": ((1, LARGEST),) * 2,
    "crop": ((0, LARGEST), (0, LARGEST), (1, LARGEST), (1, LARGEST)),
    "pixel": ((0, LARGEST),) * 2,
    "sample": ((0, MOST_SAMPLES - 1),),
}


class OptionError(ValueError):
    """A render option that does not fit the scene."""


def check(name: str, value: object) -> None:
    """Raises OptionError where an option is none of its numbers; None stands for the scene's own value."""
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
