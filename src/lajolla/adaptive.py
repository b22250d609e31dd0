"""Estimates of a picture's error, and where to take more samples.

The unit is half a tile: its pixels that are like the black or the white fields of a chessboard. A round
doubles the samples of some halves, so that counts are powers of two, for which Sobol' points are best. If A
and B are a pixel's means of its old and of its new samples, their mean after the round is (A + B) / 2; its
variance is that of (B - A) / 2, which is how much the round has changed it. The estimate is rather too large,
because together the points of A and B are better distributed than in A or B.

To decide by the samples that are averaged causes bias: a pixel whose first samples are too dark seems to have
little noise, gets no more samples, and stays too dark (Kirk and Arvo 1991, "Unbiased Sampling Techniques for
Image Synthesis"). Therefore the errors of the black halves decide about the white ones and the reverse, as
the samples of different pixels are independent.
"""

import numpy as np
from numpy.typing import NDArray

from lajolla.colour import FloatImage
from lajolla.limits import MOST_SAMPLES

TILE_SIZE = 16  # as in the core
FIRST_COUNT = 8  # samples before the first round
MOST_RATIO = 32  # between the sample counts of two halves, as an estimate may be far too small
SPREAD = 4  # halves whose gains are within this factor are doubled together

Counts = NDArray[np.uint32]  # numbers of all halves: (tile rows, tile columns, 2), like `_core.Render.counts`


class Halves:
    """The halves of the tiles of a picture, whose left upper pixel is at `offset` on the film."""

    def __init__(self, width: int, height: int, offset: tuple[int, int]) -> None:
        y, x = np.indices((height, width))
        self.shape = (-(-height // TILE_SIZE), -(-width // TILE_SIZE), 2)
        tiles = y // TILE_SIZE * self.shape[1] + x // TILE_SIZE
        self.of_pixels = 2 * tiles + (x + y + sum(offset)) % 2  # (height, width), numbers of halves
        self.pixels = self.sums(np.ones((height, width)))  # how many each half has: zero is possible

    def sums(self, values: NDArray[np.floating]) -> NDArray[np.float64]:
        """Sums over the pixels of each half; values (height, width)."""
        return np.bincount(self.of_pixels.ravel(), values.ravel(), int(np.prod(self.shape))).reshape(
            self.shape
        )

    def mean(self, values: NDArray[np.floating] | Counts) -> float:
        """The mean of all pixels, of values that are equal within a half."""
        return float((values * self.pixels).sum() / self.pixels.sum())


class ErrorEstimate:
    """The squared relative error of the pixels of each half.

    The error of a value v is divided by v^2 + m^2 / 100, where m is the mean of the picture.
    """

    def __init__(self, halves: Halves) -> None:
        self.halves = halves
        self.errors = np.full(halves.shape, np.inf)
        self.counts = np.zeros(halves.shape, np.uint32)  # samples with which they were measured
        self.picture = np.zeros((*halves.of_pixels.shape, 3), np.float32)  # of these samples

    @property
    def noise(self) -> float:
        """The relative error of the picture, root mean square; infinite before it is measured."""
        return self.halves.mean(np.where(self.halves.pixels > 0, self.errors, 0)) ** 0.5

    def update(self, picture: FloatImage, counts: Counts) -> None:
        """Measures the halves that have twice the samples of before."""
        measurable = (self.counts > 0) & (counts >= 2 * self.counts)
        values = picture.astype(np.float64)
        mean = self.halves.sums(values.sum(axis=2)).sum() / values.size
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = np.nan_to_num((values - self.picture) ** 2 / (values**2 + mean**2 / 100))
        means = self.halves.sums(relative.sum(axis=2) / 3) / np.maximum(self.halves.pixels, 1)
        self.errors[measurable] = means[measurable]
        changed = measurable | (self.counts == 0)
        self.counts[changed] = counts[changed]
        of_changed = changed.ravel()[self.halves.of_pixels]
        self.picture[of_changed] = picture[of_changed]

    def next_counts(self, counts: Counts, *, most: float, noise: float | None = None) -> Counts:
        """The counts of the next round: those of the halves that gain most by a sample are doubled.

        Args:
            counts: the present numbers of samples.
            most: samples per pixel, of all pixels in the mean, that must not be exceeded.
            noise: if given, the round is no larger than it must be for this relative error.
        """
        pixels, cost = self.halves.pixels, counts * self.halves.pixels
        gain = _smoothed(self.errors[..., ::-1], pixels[..., ::-1]) / np.maximum(counts, 1)
        order = np.argsort(-gain, axis=None, kind="stable")
        high = gain.flat[order[np.searchsorted(np.cumsum(cost.flat[order]), 0.05 * cost.sum())]]
        chosen = (gain >= high / SPREAD) | (counts * MOST_RATIO < counts.max())
        order = order[chosen.flat[order]]
        taken = np.cumsum(cost.flat[order]) <= most * pixels.sum() - cost.sum()
        if noise is not None:  # a doubling halves the squared error at least
            squared = np.where(pixels > 0, self.errors * pixels, 0)
            left = squared.sum() - np.cumsum(squared.flat[order]) / 2
            taken &= np.concatenate([[True], left[:-1] > noise**2 * pixels.sum()])
        result = counts.copy()
        result.flat[order[taken]] *= 2
        return np.minimum(result, MOST_SAMPLES)


def _smoothed(errors: NDArray[np.float64], pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means over 3 x 3 tiles, weighted by 1, 2, 1 along both axes and by numbers of pixels."""

    def blurred(values: NDArray[np.float64]) -> NDArray[np.float64]:
        padded = np.pad(values, ((1, 1), (1, 1), (0, 0)))
        rows = padded[:-2] + 2 * padded[1:-1] + padded[2:]
        return rows[:, :-2] + 2 * rows[:, 1:-1] + rows[:, 2:]

    return blurred(np.where(pixels > 0, errors, 0) * pixels) / np.maximum(blurred(pixels), 1)
