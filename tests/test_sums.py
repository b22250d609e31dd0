"""Sums of samples: exact enough, and the same bits in any order and from any parts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from statistics_tools import generator

from lajolla import _core, _core_testing


def total(terms: np.ndarray) -> _core.Sums:
    high, low, place = _core_testing.sum_digits(terms.astype(np.float32))
    return _core.Sums(np.array([[[[high, low]]]]), np.array([[[place]]], np.int8))


def value(sums: _core.Sums) -> float:
    return float(sums.means(np.ones((1, 1), np.uint32))[0, 0, 0])


def same(a: _core.Sums, b: _core.Sums) -> bool:
    return np.array_equal(a.digits, b.digits) and np.array_equal(a.places, b.places)


def terms_of(kind: str, count: int = 5000) -> np.ndarray:
    """Floats of one kind; `any` has all exponents, and both signs."""
    rng = generator("sums", kind)
    if kind == "radiance":
        values = rng.exponential(size=count)
    elif kind == "fireflies":
        values = rng.pareto(0.3, size=count)
    elif kind == "equal":
        values = np.full(count, 0.1)
    elif kind == "signed":
        values = rng.normal(size=count)
    else:
        values = np.ldexp(rng.uniform(-1, 1, count), rng.integers(-148, 128, count))
    return np.clip(values, -3e38, 3e38).astype(np.float32)


KINDS = ("radiance", "fireflies", "equal", "signed", "any")


@pytest.mark.parametrize("kind", KINDS)
def test_the_order_does_not_matter(kind: str) -> None:
    terms = terms_of(kind)
    expected = total(terms)
    rng = generator("order", kind)
    for order in (terms[::-1], np.sort(terms), np.sort(terms)[::-1], rng.permutation(terms)):
        assert same(total(order), expected)
    for parts in (2, 7, 1000):
        sums = [total(part) for part in np.array_split(rng.permutation(terms), parts)]
        first, *others = [sums[i] for i in rng.permutation(parts)]
        for other in others:
            first.add(0, other)
        assert same(first, expected)


@pytest.mark.parametrize("kind", KINDS)
def test_a_sum_is_exact_up_to_its_largest_term(kind: str) -> None:
    """Of each other term at most 2^-32 of the largest one is lost; floats have 24 bits."""
    terms = terms_of(kind)
    exact = math.fsum(terms.astype(float))
    lost = len(terms) * 2.0**-32 * float(np.abs(terms).max())
    assert abs(value(total(terms)) - exact) <= lost + 2.0**-24 * abs(exact)


@pytest.mark.parametrize("number", [0.0, -0.0, 1e-45, -1e-45, 1.2e-38, 1.0, -1.5, 3.4e38, np.pi, 1 / 3])
def test_one_term_is_itself(number: float) -> None:
    assert value(total(np.array([number]))) == np.float32(number)


def test_terms_that_cancel_leave_the_rest() -> None:
    terms = np.array([1e9, 1.5, -1e9], np.float32)
    assert value(total(terms)) == 1.5


def test_rows_are_added_to_rows() -> None:
    digits = np.arange(2 * 3 * 4 * 2, dtype=np.int64).reshape(2, 3, 4, 2)
    places = np.full((2, 3, 4), 3, np.int8)
    sums = _core.Sums(digits, places)
    sums.add(1, _core.Sums(digits[:1], places[:1]))
    np.testing.assert_array_equal(sums.digits[0], digits[0])
    np.testing.assert_array_equal(sums.digits[1], digits[0] + digits[1])


@pytest.mark.parametrize(
    ("digits", "places"),
    [((1, 1, 1, 3), (1, 1, 1)), ((1, 2, 1, 2), (1, 1, 1)), ((1, 1, 2), (1, 1)), ((1, 1, 1, 2), (1, 1, 2))],
)
def test_arrays_of_other_shapes_are_refused(digits: tuple[int, ...], places: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="must be"):
        _core.Sums(np.zeros(digits, np.int64), np.zeros(places, np.int8))


def test_sums_of_other_pictures_are_refused() -> None:
    sums = _core.Sums(np.zeros((2, 3, 4, 2), np.int64), np.zeros((2, 3, 4), np.int8))
    others = ((1, 2, 4, 0), (1, 3, 3, 0), (2, 3, 4, 1), (1, 3, 4, 2), (1, 3, 4, 2**64 - 1))
    for rows, width, channels, first in others:
        other = _core.Sums(
            np.zeros((rows, width, channels, 2), np.int64), np.zeros((rows, width, channels), np.int8)
        )
        with pytest.raises(ValueError, match="another size"):
            sums.add(first, other)
    with pytest.raises(ValueError, match="out of range"):
        _core.Sums(np.zeros((1, 1, 1, 2), np.int64), np.full((1, 1, 1), 9, np.int8))
    with pytest.raises(ValueError, match="counts must be"):
        sums.means(np.zeros((3, 2), np.uint32))
