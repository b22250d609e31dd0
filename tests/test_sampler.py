"""The stateless sampler: uniform, well spread pairs, independent blocks, pixels and seeds."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats
from statistics_tools import LEVEL, chi_square

from lajolla import _core

KINDS = ("sobol", "independent")
PAIRS = ((0, 1), (2, 3), (4, 5), (6, 7))
each_kind = pytest.mark.parametrize("kind", KINDS)


def block(
    kind: str, *, seed: int = 0, x: int = 3, y: int = 5, first: int = 0, count: int, bounce: int = 0
) -> np.ndarray:
    return _core.sampler_blocks(kind, seed, x, y, first, count, bounce)


def cells_of(points: np.ndarray, columns: int, rows: int) -> np.ndarray:
    """How many points (N, 2) fall into each cell of a grid."""
    index = (points * (columns, rows)).astype(int)
    return np.bincount(index[:, 0] * rows + index[:, 1], minlength=columns * rows)


@each_kind
def test_numbers_are_in_the_unit_interval_and_reproducible(kind: str) -> None:
    numbers = block(kind, count=4096)
    assert numbers.dtype == np.float32 and numbers.shape == (4096, 8)
    assert numbers.min() >= 0 and numbers.max() < 1
    np.testing.assert_array_equal(numbers, block(kind, count=4096))
    np.testing.assert_array_equal(numbers[1000:1100], block(kind, first=1000, count=100))
    assert _core.sampler_camera(kind, 0, 3, 5, 0, 16).shape == (16, 5)


@pytest.mark.parametrize("bounce", [0, 7])
@pytest.mark.parametrize("log_count", [2, 5, 8, 10])
@pytest.mark.parametrize("pair", PAIRS)
def test_sobol_pairs_are_nets(pair: tuple[int, int], log_count: int, bounce: int) -> None:
    """Each of 2^k points has its own cell, however the square is divided: a (0, k, 2)-net in base 2."""
    count = 2**log_count
    for start in (0, count, 5 * count):
        points = block("sobol", first=start, count=count, bounce=bounce)[:, pair]
        for columns in 2 ** np.arange(log_count + 1):
            assert (cells_of(points, columns, count // columns) == 1).all()


@pytest.mark.parametrize("pair", [(0, 1), (2, 3)])
def test_sobol_camera_pairs_are_nets(pair: tuple[int, int]) -> None:
    points = _core.sampler_camera("sobol", 1, 2, 3, 0, 256)[:, pair]
    for columns in 2 ** np.arange(9):
        assert (cells_of(points, columns, 256 // columns) == 1).all()


@each_kind
def test_numbers_are_uniform_over_pixels(kind: str) -> None:
    """One sample of each of many pixels: no structure may be left from the sequence."""
    numbers = np.concatenate([block(kind, x=x, y=y, count=1) for x in range(120) for y in range(120)])
    for dimension in range(8):
        counts = np.bincount((numbers[:, dimension] * 128).astype(int), minlength=128)
        assert chi_square(counts, np.full(128, len(numbers) / 128)) > LEVEL
    for a, b in itertools.combinations(range(8), 2):
        assert chi_square(cells_of(numbers[:, [a, b]], 16, 16), np.full(256, len(numbers) / 256)) > LEVEL


def test_independent_numbers_are_uniform_within_a_pixel() -> None:
    numbers = block("independent", count=20_000)
    for a, b in itertools.combinations(range(8), 2):
        assert chi_square(cells_of(numbers[:, [a, b]], 16, 16), np.full(256, len(numbers) / 256)) > LEVEL


def correlations(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Correlation of every column of one array with every column of the other."""
    return np.corrcoef(a.T, b.T)[: a.shape[1], a.shape[1] :]


@each_kind
@pytest.mark.parametrize("other", [{"bounce": 1}, {"x": 4}, {"y": 6}, {"seed": 1}, {"x": 5, "y": 3}])
def test_other_blocks_pixels_and_seeds_are_independent(kind: str, other: dict[str, int]) -> None:
    """Over many seeds, a pixel's numbers tell nothing of its neighbour, another bounce or another seed.

    Within one pixel a Sobol' pair is spread too evenly for a test of independence, hence one sample per seed.
    """
    count = 4000
    seeds = 17 * np.arange(count)
    ours = np.concatenate([block(kind, seed=s, count=1) for s in seeds])
    theirs = np.concatenate(
        [block(kind, **{"seed": s, **other, "count": 1} | shifted(s, other)) for s in seeds]
    )
    limit = stats.norm.isf(LEVEL / 2) / np.sqrt(count)
    assert np.abs(correlations(ours, theirs)).max() < limit


def shifted(seed: int, other: dict[str, int]) -> dict[str, int]:
    return {"seed": seed + other.get("seed", 0)}


def test_pairs_of_one_sobol_block_are_independent() -> None:
    """Pairs are shuffled against each other: 2^12 points fill the plane of any two pairs at random."""
    numbers = block("sobol", count=4096)
    for (a, _), (b, _) in itertools.combinations(PAIRS, 2):
        assert chi_square(cells_of(numbers[:, [a, b]], 16, 16), np.full(256, 16.0)) > LEVEL


def test_bounces_of_one_pixel_are_independent() -> None:
    blocks = [block("sobol", count=4096, bounce=b) for b in range(4)]
    for first, second in itertools.combinations(blocks, 2):
        for dimension in range(8):
            points = np.stack([first[:, dimension], second[:, dimension]], axis=1)
            assert chi_square(cells_of(points, 16, 16), np.full(256, 16.0)) > LEVEL


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(ValueError, match="sobol"):
        block("halton", count=1)
