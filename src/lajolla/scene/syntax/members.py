"""The members of a run (`runs.py`): where they stand, and the numbers in which they differ."""

from __future__ import annotations

import re
from array import array

import numpy as np
import numpy.typing as npt

from .errors import Source

ONE_EACH = re.compile(r"(?:[0-9.eE+-]+;)+", re.ASCII)
SOME_EACH = re.compile(r"(?:[0-9.eE+-]*[ ,;])+", re.ASCII)


class Irregular(Exception):
    """A member of a run is out of the ordinary."""


class Run:
    """The places where the members of a run start, in order, and where the last one ends."""

    __slots__ = ("source", "starts", "stop")

    def __init__(self, source: Source, start: int, stop: int) -> None:
        self.source = source
        self.starts = array("q", [start])
        self.stop = stop

    def __len__(self) -> int:
        return len(self.starts)

    def span(self, index: int) -> tuple[int, int]:
        """From where to where a member stands, with what is behind it."""
        return self.starts[index], self.starts[index + 1] if index + 1 < len(self.starts) else self.stop


def numbers_of(texts: list[str]) -> npt.NDArray[np.float64]:
    """The numbers of a column, as many in each text: (count, n).

    Raises:
        Irregular: not all of them are numbers, or there are more in one than in others.
    """
    joined = ";".join(texts) + ";"
    if not ONE_EACH.fullmatch(joined):
        sizes = {len(text.replace(",", " ").split()) for text in texts}
        if len(sizes) != 1 or sizes == {0} or not SOME_EACH.fullmatch(joined):
            raise Irregular
    try:
        numbers = np.array(list(map(float, joined.replace(",", " ").replace(";", " ").split())))
    except ValueError:
        raise Irregular from None
    if not np.all(np.isfinite(numbers)):
        raise Irregular
    return numbers.reshape(len(texts), -1)
