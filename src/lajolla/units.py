"""Units of work: a render cut into pieces that may be rendered anywhere and are put together in any order."""

from __future__ import annotations

import heapq
import math
import time
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lajolla import _core
from lajolla.adaptive import CELL_SIZE, TILE_SIZE, Counts, Halves

SHORTEST = 1 / 15  # of units near the end, of the longest: all workers should end together


@dataclass(frozen=True)
class Unit:
    """Samples of a row of tiles: after those that its pixels have `before`, until they have `after`."""

    row: int
    number: int  # in the row
    before: Counts  # of each half of a cell, (cell rows, cell columns, 2)
    after: Counts
    samples: float  # of all its pixels together


@dataclass(frozen=True)
class Result:
    """The samples of a unit, as numbers that can be sent."""

    digits: NDArray[np.int64]  # of the `_core.Sums`
    places: NDArray[np.int8]
    rays: NDArray[np.uint64]  # of each tile
    nonfinite: int
    nonfinite_list: list[tuple[int, int, int]]
    seconds: float  # that one thread would need


@dataclass(frozen=True)
class Samples:
    """The samples of consecutive units of a row."""

    row: int
    sums: _core.Sums
    counts: Counts
    rays: NDArray[np.uint64]  # of each tile
    nonfinite: int
    nonfinite_list: list[tuple[int, int, int]]

    def add(self, other: Samples) -> Samples:
        """Both together; these must not be used any more."""
        self.sums.add(0, other.sums)
        return Samples(
            self.row,
            self.sums,
            self.counts + other.counts,
            self.rays + other.rays,
            self.nonfinite + other.nonfinite,
            self.nonfinite_list + other.nonfinite_list,
        )


def render(scene: _core.Scene, seed: int, first_sample: int, unit: Unit, threads: int) -> Result:
    """Renders a unit."""
    start = time.perf_counter()
    accumulator = _core.Render(scene, seed, first_sample, (unit.row, unit.row + 1))
    accumulator.restore(accumulator.sums(), unit.before, accumulator.rays, 0, [])
    accumulator.advance(unit.after, threads)
    sums = accumulator.sums()
    return Result(
        sums.digits,
        sums.places,
        accumulator.rays,
        accumulator.nonfinite,
        accumulator.nonfinite_list,
        (time.perf_counter() - start) * threads,
    )


class Row:
    """A row of tiles: makes its units, and puts their results in order."""

    def __init__(self, index: int, pixels: NDArray[np.float64], before: Counts, target: Counts) -> None:
        self.index = index
        self.pixels = pixels  # of each half, (cell rows, cell columns, 2)
        self.given = before  # samples up to which units were made
        self.target = np.maximum(target, before)
        self.made = 0  # units
        self.complete = 0  # units whose results were returned
        self.later: dict[int, tuple[int, Samples]] = {}  # runs of results after a gap: by their first, to end
        self.cost = math.nan  # seconds of a thread for a sample

    def samples(self, counts: Counts) -> float:
        """Of all pixels together."""
        return float((counts * self.pixels).sum())

    @property
    def left(self) -> float:
        """Samples that no unit has yet."""
        return self.samples(self.target - self.given)

    @property
    def fraction(self) -> float:
        """How much of it is in units."""
        return self.samples(self.given) / self.samples(self.target)

    def take(self, samples: float) -> Unit:
        """The next unit: about so many samples, but one of each pixel at least."""
        missing = self.target - self.given
        step = np.ceil(missing * min(1.0, samples / self.left)).astype(np.uint32)
        if self.samples(step) >= self.left:  # also of halves without pixels
            step = missing
        unit = Unit(self.index, self.made, self.given, self.given + step, self.samples(step))
        self.given, self.made = unit.after, self.made + 1
        return unit

    def put(self, unit: Unit, result: Result) -> Samples | None:
        """Adds a result. Returns what now follows on the samples returned before; None after a gap."""
        first, end = unit.number, unit.number + 1
        run = Samples(
            self.index,
            _core.Sums(result.digits, result.places),
            unit.after - unit.before,
            result.rays,
            result.nonfinite,
            result.nonfinite_list,
        )
        for begin, (other_end, other) in list(self.later.items()):
            if other_end == first or begin == end:  # so that there are no more runs than gaps
                del self.later[begin]
                first, end, run = min(first, begin), max(end, other_end), other.add(run)
        if first > self.complete:
            self.later[first] = end, run
            return None
        self.complete = end
        return run


class Plan:
    """The units between two states of a picture.

    Rows advance evenly. The units of a row grow with its samples until they take long enough; towards the end
    they become smaller.
    """

    def __init__(self, halves: Halves, before: Counts, target: Counts) -> None:
        cells = TILE_SIZE // CELL_SIZE
        self.rows = [
            Row(
                first // cells,
                halves.pixels[first : first + cells],
                before[first : first + cells],
                target[first : first + cells],
            )
            for first in range(0, len(before), cells)
        ]
        self.left = sum(row.left for row in self.rows)  # samples
        self.waiting = [(row.fraction, row.index) for row in self.rows if row.left > 0]
        heapq.heapify(self.waiting)
        self.lost: deque[Unit] = deque()
        self.open: set[tuple[int, int]] = set()  # units that have no result: row, number
        self.rendered, self.thread_seconds = 0.0, 0.0

    @property
    def finished(self) -> bool:
        return not self.waiting and not self.open

    def is_open(self, unit: Unit) -> bool:
        return (unit.row, unit.number) in self.open

    def cost(self, row: int) -> float:
        """Seconds of a thread for a sample of a row; not a number before any are known."""
        own = self.rows[row].cost
        if math.isfinite(own) or not self.rendered:
            return own
        return self.thread_seconds / self.rendered

    def seconds(self, unit: Unit, threads: int) -> float:
        """How long a unit should take; not a number before any is known."""
        return unit.samples * self.cost(unit.row) / threads

    def next_unit(self, threads: int, all_threads: int, longest: float, seconds_left: float) -> Unit | None:
        """The next unit for a worker, if there is one.

        Args:
            threads: of this worker.
            all_threads: of all workers.
            longest: seconds that a unit may take.
            seconds_left: until no more units will be asked for.
        """
        while self.lost:
            if self.is_open(unit := self.lost.popleft()):
                return unit
        if not self.waiting:
            return None
        row = self.rows[heapq.heappop(self.waiting)[1]]
        samples = row.samples(np.ones_like(row.given))
        if self.rendered:
            average = self.thread_seconds / self.rendered
            end = min(self.left * average / all_threads, seconds_left)
            seconds = min(max(end / 3, SHORTEST * longest), longest)
            samples = min(seconds * threads / self.cost(row.index), max(samples, 3 * row.samples(row.given)))
        unit = row.take(samples)
        self.left -= unit.samples
        self.open.add((unit.row, unit.number))
        if row.left > 0:
            heapq.heappush(self.waiting, (row.fraction, row.index))
        return unit

    def put(self, unit: Unit, result: Result) -> Samples | None:
        """Adds a result, unless the unit has one; see `Row.put`."""
        if not self.is_open(unit):
            return None
        self.open.remove((unit.row, unit.number))
        self.rendered += unit.samples
        self.thread_seconds += result.seconds
        row = self.rows[unit.row]
        row.cost = result.seconds / unit.samples
        return row.put(unit, result)
