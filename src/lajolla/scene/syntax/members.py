"""The members of a run (`runs.py`): their locations, and the numbers in which they differ."""

from __future__ import annotations

import re
from array import array

import numpy as np
import numpy.typing as npt

from .errors import Source

ONE_EACH = re.compile(r"(?:[0-9.eE+-]+;)+", re.ASCII)
SOME_EACH = re.compile(r"(?:[0-9.eE+-]*[ ,;])+", re.ASCII)


class Irregular(Exception):
    """A run cannot be processed at once; its members must be processed individually."""


class Run:
    """The bytes at which the members of a run start, in order, and at which the last one ends."""

    __slots__ = ("source", "starts", "stop")

    def __init__(self, source: Source, start: int, stop: int) -> None:
        self.source = source
        self.starts = array("q", [start])
        self.stop = stop

    def __len__(self) -> int:
        return len(self.starts)

    def span(self, index: int) -> tuple[int, int]:
        """The first byte of a member, and that of the next one or the end of the run."""
        return self.starts[index], self.starts[index + 1] if index + 1 < len(self.starts) else self.stop


def numbers_of(texts: list[str]) -> npt.NDArray[np.float64]:
    """The numbers of a column: an array of shape (len(texts), numbers in each text).

    Raises:
        Irregular: a text contains something else than finite numbers, or texts differ in their count.
    """
    joined = ";".join(texts) + ";"
    if joined.count(";") != len(texts):
        raise Irregular
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
