"""Estimates of a picture's error, and where to take more samples.

The unit is half a cell of 8 x 8 pixels: those that are like the black or the white fields of a chessboard. A
round doubles the samples of some halves, once or several times, so that counts are powers of two, for which
Sobol' points are best.

If A and B are a pixel's means of its old and of its new samples, a doubling changes its mean from A to
C = (A + B) / 2. A and B are exchangeable, so that cov(A, C) = var(C), and the mean square of the change is
var(A) - var(C). If a doubling reduces the variance by a factor r, squared changes shrink by r too, which
measures it, and var(C) is the squared change times r / (1 - r). Independent samples have r = 1/2, Sobol'
points less. Of several doublings at once, the factor is a power of r.

To decide by the samples that are averaged causes bias: a pixel whose first samples are too dark seems to have
little noise, gets no more samples, and stays too dark (Kirk and Arvo 1991, "Unbiased Sampling Techniques for
Image Synthesis"). Therefore the errors of the black halves decide about the white ones and the reverse, as
the samples of different pixels are independent. What is left is an effect of second order: both halves share
what may be spent. It vanishes with the number of cells; pictures of a few cells are not free of it.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lajolla.colour import FloatImage
from lajolla.limits import MOST_SAMPLES

CELL_SIZE = 8  # as in the core, in pixels
TILE_SIZE = 2 * CELL_SIZE
FIRST_COUNT = 8  # samples before the first round
MOST_RATIO = 32  # between the sample counts of two halves, as an estimate may be far too small
REDUCTIONS = (0.1, 0.5)  # limits of r

Counts = NDArray[np.uint32]  # numbers of all halves: (cell rows, cell columns, 2), like `_core.Render.counts`


class Halves:
    """The halves of the cells of a picture, whose left upper pixel is at `offset` on the film."""

    def __init__(self, width: int, height: int, offset: tuple[int, int]) -> None:
        self.offset = offset
        self.size = height, width
        rows, columns = _by_parity(height), _by_parity(width)
        first, second = rows @ columns.T, rows[:, ::-1] @ columns.T  # where x + y is even, and odd
        order = (second, first) if sum(offset) % 2 else (first, second)
        self.pixels = np.stack(order, axis=2)  # how many each half has: zero is possible
        self.shape = self.pixels.shape
        self.tiles = -(-height // TILE_SIZE), -(-width // TILE_SIZE)

    @cached_property
    def of_pixels(self) -> NDArray[np.int64]:
        """The number of each pixel's half: (height, width). Few renders need it, and it takes much memory."""
        y, x = np.indices(self.size)
        cells = y // CELL_SIZE * self.shape[1] + x // CELL_SIZE
        return 2 * cells + (x + y + sum(self.offset)) % 2

    def sums(self, values: NDArray[np.floating]) -> NDArray[np.float64]:
        """Sums over the pixels of each half; values (height, width)."""
        size = int(np.prod(self.shape))
        found: NDArray[Any] = np.bincount(self.of_pixels.ravel(), values.ravel(), size)
        return found.reshape(self.shape)

    def cost(self, rays: NDArray[np.uint64], counts: Counts) -> NDArray[np.float64]:
        """What a sample costs in each cell, in any unit, from the rays of all tiles: (rows, columns, 1).

        A measured time would make pictures vary. Where paths have more rays, these also meet more detail and
        take longer: the time of a row of tiles grows with its rays to the power of 0.75 to 4.5, 1.6 in the
        median of 13 scenes.
        """
        samples = (counts * self.pixels).sum(axis=2)
        for axis in (0, 1):
            samples = np.add.reduceat(samples, np.arange(0, samples.shape[axis], 2), axis=axis)
        of_cells = np.repeat(np.repeat(rays / samples, 2, axis=0), 2, axis=1)
        rows, columns, _ = self.shape
        return np.maximum(of_cells[:rows, :columns, None], 1) ** 2

    def mean(self, values: NDArray[np.floating] | Counts) -> float:
        """The mean of all pixels, of values that are equal within a half."""
        return float((values * self.pixels).sum() / self.pixels.sum())


def _by_parity(length: int) -> NDArray[np.float64]:
    """The numbers of even and of odd positions in each cell along an axis: (cells, 2)."""
    positions = np.arange(length)
    cells = -(-length // CELL_SIZE)
    counts = np.bincount(2 * (positions // CELL_SIZE) + positions % 2, minlength=2 * cells)
    return counts.reshape(cells, 2).astype(np.float64)


class ErrorEstimate:
    """The squared relative error of the pixels of each half.

    Squared errors are divided by v^2 + m^2 / 100, where v is the value and m the mean of the picture. For v,
    the smaller of A and B is taken: otherwise a bright sample would hide its own error. Errors above 100 %
    count as 100 %: otherwise a few pixels with very bright samples would get all samples, with little effect.
    """

    def __init__(self, halves: Halves) -> None:
        self.halves = halves
        self.errors = np.where(halves.pixels > 0, np.inf, 0)  # means over each half; infinite if unknown
        self.changes = np.full(halves.shape, np.nan)  # squared relative changes of halves that were doubled
        self.reduction = REDUCTIONS[1]  # r, of all halves
        self.counts = np.zeros(halves.shape, np.uint32)  # samples when they were measured
        self.picture = np.zeros((*halves.size, 3), np.float32)  # of these samples

    @property
    def noise(self) -> float:
        """The relative error of the picture, root mean square; infinite if unknown."""
        return self.halves.mean(self.errors) ** 0.5

    def update(self, picture: FloatImage, counts: Counts) -> None:
        """Measures the halves that have at least twice the samples of before."""
        pixels = self.halves.pixels
        grown = (self.counts > 0) & (counts >= 2 * self.counts)
        doublings = np.log2(np.where(grown, counts / np.maximum(self.counts, 1), 2))
        changes = self._changes(picture)
        again = grown & (doublings == 1) & np.isfinite(self.changes)
        if (before := (self.changes * pixels)[again].sum()) > 0:
            self.reduction = float(np.clip((changes * pixels)[again].sum() / before, *REDUCTIONS))
        reduction = self.reduction**doublings
        found = changes * (reduction / (1 - reduction))
        known = np.isfinite(self.errors)  # half of what was known, as one doubling alone tells little
        errors = np.where(known, (found + np.where(known, self.errors, 0) * reduction) / 2, found)
        self.errors[grown] = np.where(pixels > 0, errors, 0)[grown]
        self.changes[grown] = np.where(doublings == 1, changes, np.nan)[grown]
        measured = grown | (self.counts == 0)
        self.counts[measured] = counts[measured]
        of_measured = measured.ravel()[self.halves.of_pixels]
        self.picture[of_measured] = picture[of_measured]

    def _changes(self, picture: FloatImage) -> NDArray[np.float64]:
        """The squared relative changes since the last measurement, means of the pixels of each half."""
        after, before = picture.astype(np.float64), self.picture.astype(np.float64)
        mean = self.halves.sums(after.sum(axis=2)).sum() / after.size
        smaller = np.minimum(np.abs(before), np.abs(2 * after - before))
        with np.errstate(all="ignore"):
            relative = np.nan_to_num((after - before) ** 2 / (smaller**2 + mean**2 / 100))
        of_halves = self.halves.sums(np.minimum(relative, 1).sum(axis=2) / 3)
        return of_halves / np.maximum(self.halves.pixels, 1)

    def next_counts(
        self, counts: Counts, cost: NDArray[np.float64], *, most: float, noise: float | None = None
    ) -> Counts:
        """The counts of the next round, which has at most as many samples as there are.

        The error is least, for its cost, if samples are in proportion to sqrt(variance / cost) of one sample.
        Of this, each half gets the next lower power of two, or what it has already.

        Args:
            counts: the present numbers of samples.
            cost: of a sample in each cell, in any unit, as from `Halves.cost`.
            most: samples per pixel, of all pixels in the mean, that must not be exceeded.
            noise: if given, the round is no larger than it must be for this relative error.
        """
        pixels, variance = self.halves.pixels, self.errors * counts
        best = _smoothed(np.sqrt(variance)[..., ::-1], pixels[..., ::-1]) / np.sqrt(cost)
        best = np.maximum(best, best.max() / MOST_RATIO)
        if not best.max() > 0:  # no errors at all
            best = np.ones_like(best)

        def numbers(factor: float) -> Counts:
            powers = 2 ** np.floor(np.log2(np.minimum(factor * best, MOST_SAMPLES)))
            return np.where(pixels > 0, np.maximum(counts, powers), counts).astype(np.uint32)

        def fits(factor: float) -> bool:
            samples = (numbers(factor) * pixels).sum()
            return bool(samples <= min(2 * (counts * pixels).sum(), most * pixels.sum()))

        def is_noisy(factor: float) -> bool:
            return noise is not None and self.halves.mean(variance / numbers(factor)) > noise**2

        least, greatest = (counts / best).min(), 2 * MOST_SAMPLES / best.min()
        fitting, _ = _bracket(fits, least, greatest)
        if noise is None:
            return numbers(fitting)
        _, enough = _bracket(is_noisy, least, greatest)
        return numbers(min(fitting, enough))


def _bracket(holds: Callable[[float], bool], low: float, high: float) -> tuple[float, float]:
    """The ends of a small interval in which a condition that holds for small numbers ceases to hold."""
    while high > low * (1 + 1e-6):
        middle = (low * high) ** 0.5
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low, high


def _smoothed(values: NDArray[np.float64], pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means over 3 x 3 cells, weighted by 1, 2, 1 along both axes and by numbers of pixels."""

    def blurred(array: NDArray[np.float64]) -> NDArray[np.float64]:
        padded = np.pad(array, ((1, 1), (1, 1), (0, 0)))
        rows = padded[:-2] + 2 * padded[1:-1] + padded[2:]
        return rows[:, :-2] + 2 * rows[:, 1:-1] + rows[:, 2:]

    return blurred(np.where(pixels > 0, values, 0) * pixels) / np.maximum(blurred(pixels), 1)
