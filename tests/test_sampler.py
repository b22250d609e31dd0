"""The stateless sampler: uniform, well spread pairs, independent blocks, pixels and seeds."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy import stats
from statistics_tools import LEVEL, chi_square, generator

from lajolla import _core_testing

KINDS = ("sobol", "independent")
PAIRS = ((0, 1), (2, 3), (4, 5), (6, 7))
each_kind = pytest.mark.parametrize("kind", KINDS)


def rows(*columns: ArrayLike) -> np.ndarray:
    """What the core takes: columns of numbers or arrays as rows of uint32."""
    return np.column_stack(np.broadcast_arrays(*columns)).astype(np.uint32)


def block(
    kind: str,
    *,
    seed: ArrayLike = 0,
    x: ArrayLike = 3,
    y: ArrayLike = 5,
    index: ArrayLike = 0,
    bounce: ArrayLike = 0,
) -> np.ndarray:
    """The numbers (N, 8) of a bounce."""
    return _core_testing.sampler_bounces(kind, rows(seed, x, y, index, bounce))


def cameras(kind: str, *, seed: int, x: int, y: int, count: int) -> np.ndarray:
    """The camera's numbers (count, 6) of a pixel."""
    return _core_testing.sampler_cameras(kind, rows(seed, x, y, np.arange(count)))


def cells_of(points: np.ndarray, columns: int, rows: int) -> np.ndarray:
    """How many points (N, 2) fall into each cell of a grid."""
    index = (points * (columns, rows)).astype(int)
    return np.bincount(index[:, 0] * rows + index[:, 1], minlength=columns * rows)


@each_kind
def test_numbers_are_in_the_unit_interval_and_reproducible(kind: str) -> None:
    numbers = block(kind, index=np.arange(4096))
    assert numbers.dtype == np.float32 and numbers.shape == (4096, 8)
    assert numbers.min() >= 0 and numbers.max() < 1
    np.testing.assert_array_equal(numbers, block(kind, index=np.arange(4096)))
    np.testing.assert_array_equal(numbers[1000:1100], block(kind, index=np.arange(1000, 1100)))
    assert cameras(kind, seed=0, x=3, y=5, count=16).shape == (16, 6)


@each_kind
@pytest.mark.parametrize("count", [1, 7, 8, 9, 37, 1001])
def test_lanes_hold_the_numbers_of_single_samples(kind: str, count: int) -> None:
    """Whatever samples and bounces share a vector; indices are used to their last bit."""
    rng = generator("lanes", kind, count)
    whole, small = rng.integers(2**32, size=(count, 4)), rng.integers(64, size=(count, 5))
    for given in (np.column_stack([whole, small[:, 4]]), small):
        samples = given.astype(np.uint32)
        for core, columns in ((_core_testing.sampler_bounces, 5), (_core_testing.sampler_cameras, 4)):
            some = np.ascontiguousarray(samples[:, :columns])
            np.testing.assert_array_equal(core(kind, some), core(kind, some, one_lane=True))


@pytest.mark.parametrize("bounce", [0, 7])
@pytest.mark.parametrize("log_count", [2, 5, 8, 10])
@pytest.mark.parametrize("pair", PAIRS)
def test_sobol_pairs_are_nets(pair: tuple[int, int], log_count: int, bounce: int) -> None:
    """Each of 2^k points has its own cell, however the square is divided: a (0, k, 2)-net in base 2."""
    count = 2**log_count
    for start in (0, count, 5 * count):
        points = block("sobol", index=start + np.arange(count), bounce=bounce)[:, pair]
        for columns in 2 ** np.arange(log_count + 1):
            assert (cells_of(points, columns, count // columns) == 1).all()


@pytest.mark.parametrize("pair", [(0, 1), (2, 3)])
def test_sobol_camera_pairs_are_nets(pair: tuple[int, int]) -> None:
    points = cameras("sobol", seed=1, x=2, y=3, count=256)[:, pair]
    for columns in 2 ** np.arange(9):
        assert (cells_of(points, columns, 256 // columns) == 1).all()


@each_kind
@pytest.mark.parametrize("index", [0, 1, 100])
def test_numbers_are_uniform_over_pixels(kind: str, index: int) -> None:
    """One sample of each of many pixels: no structure may be left from the sequence."""
    x, y = np.divmod(np.arange(120 * 120), 120)
    numbers = block(kind, x=x, y=y, index=index)
    for dimension in range(8):
        counts = np.bincount((numbers[:, dimension] * 128).astype(int), minlength=128)
        assert chi_square(counts, np.full(128, len(numbers) / 128)) > LEVEL
    for a, b in itertools.combinations(range(8), 2):
        assert chi_square(cells_of(numbers[:, [a, b]], 16, 16), np.full(256, len(numbers) / 256)) > LEVEL


@each_kind
@pytest.mark.parametrize("index", [0, 1, 100])
def test_bounces_are_independent_over_pixels(kind: str, index: int) -> None:
    """One sample of each of many pixels: any number of one bounce and any of another fill their plane evenly.

    The samples of one pixel cannot be tested so. Two shuffled sequences, each of them a net, put points into
    the cells of a plane that are no multinomial counts even if all permutations are truly random: nested
    ones move whole ranges together. Pixels have permutations of their own, so that these are independent.
    """
    x, y = np.divmod(np.arange(64 * 64), 64)
    blocks = [block(kind, x=x, y=y, index=index, bounce=bounce) for bounce in range(4)]
    for first, second in itertools.combinations(blocks, 2):
        for a, b in itertools.product(range(8), range(8)):
            points = np.stack([first[:, a], second[:, b]], axis=1)
            assert chi_square(cells_of(points, 16, 16), np.full(256, 16.0)) > LEVEL


def test_independent_numbers_are_uniform_within_a_pixel() -> None:
    numbers = block("independent", index=np.arange(20_000))
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
    ours = block(kind, seed=seeds)
    theirs = block(kind, **{**other, "seed": seeds + other.get("seed", 0)})
    limit = stats.norm.isf(LEVEL / 2) / np.sqrt(count)
    assert np.abs(correlations(ours, theirs)).max() < limit


def nested_permutation(x: np.ndarray, bits: int, rng: np.random.Generator) -> np.ndarray:
    """Owen's: each bit of x < 2^bits is flipped or not, as a coin for the bits above it tells."""
    result = np.zeros_like(x)
    for bit in reversed(range(bits)):
        coins = rng.integers(2, size=2 ** (bits - 1 - bit))
        result |= (((x >> bit) & 1) ^ coins[x >> bit >> 1]) << bit
    return result


def unevenness(a: np.ndarray, b: np.ndarray) -> float:
    """The chi-square statistic of pairs of numbers in [0, 1) over 16 x 16 cells."""
    counts = cells_of(np.stack([a, b], axis=1), 16, 16)
    return float(((counts - counts.mean()) ** 2 / counts.mean()).sum())


@pytest.mark.parametrize("bounces", [(0, 0), (0, 1), (2, 3)])
def test_pairs_of_dimensions_are_shuffled_within_a_pixel(bounces: tuple[int, int]) -> None:
    """2^12 points of a pixel are as uneven in the plane of two pairs as those of truly random shuffles.

    That is more than multinomial counts are: hence Kolmogorov and Smirnov's test of many pixels against
    radical inverses whose indices are permuted by coins. Without shuffles the plane would be filled evenly.
    """
    bits, pixels = 12, 600
    rng, index = generator("shuffles", bounces), np.arange(2**bits)
    reverse = sum(((index >> bit) & 1) << (bits - 1 - bit) for bit in range(bits))

    def random_sequence() -> np.ndarray:
        return nested_permutation(reverse[nested_permutation(index, bits, rng)], bits, rng) / 2**bits

    expected = [unevenness(random_sequence(), random_sequence()) for _ in range(pixels)]
    x, y = np.divmod(np.repeat(np.arange(pixels), 2**bits), 30)
    first, second = (
        block("sobol", x=x, y=y, index=np.tile(index, pixels), bounce=b).reshape(pixels, 2**bits, 8)
        for b in bounces
    )
    for a, b in itertools.combinations(range(0, 8, 2), 2):
        observed = [unevenness(first[pixel, :, a], second[pixel, :, b]) for pixel in range(pixels)]
        assert stats.ks_2samp(expected, observed).pvalue > LEVEL


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(ValueError, match="sobol"):
        block("halton")
