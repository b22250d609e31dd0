"""Warps, frames, transforms and tabulated distributions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from quadrature_tools import box, sphere
from statistics_tools import (
    LEVEL,
    ONE_MINUS_ULP,
    Draws,
    Sampled,
    check_consistency,
    check_density,
    chi_square,
    generator,
    study,
    uniforms,
)

from lajolla import _core_testing

EDGE = np.array([[a, b] for a in (0, 0.5, ONE_MINUS_ULP) for b in (0, 0.5, ONE_MINUS_ULP)], np.float32)


def warp(
    name: str,
    domain: object,
    draw: Callable[[np.ndarray], np.ndarray],
    density: Callable[[np.ndarray], np.ndarray],
) -> Sampled:
    """A warp beside the density that it should have; every sample is valid and weighs one."""

    def evaluate(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        pdf = density(points)
        return pdf[:, None], pdf

    def sample(u: np.ndarray) -> Draws:
        points, n = draw(u), len(u)
        valid = np.ones(n, bool)
        return Draws(points, np.ones((n, 1)), density(points), valid, ~valid, np.ones(n))

    return Sampled(name, domain, 2, sample, evaluate)


def within_cone(height: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda w: (w[:, 2] > 1 - height) / (2 * np.pi * height)


WARPS = [
    warp(
        "disk",
        box((-1, -1), (1, 1)),
        _core_testing.warp_disk,
        lambda p: ((p.astype(float) ** 2).sum(1) < 1 + 1e-6) / np.pi,
    ),
    warp("triangle", box((0, 0), (1, 1)), _core_testing.warp_triangle, lambda p: 2.0 * (p.sum(1) < 1 + 1e-6)),
    warp("sphere", sphere(), _core_testing.warp_sphere, lambda w: np.full(len(w), 1 / (4 * np.pi))),
    warp(
        "cosine hemisphere",
        sphere(),
        _core_testing.warp_cosine_hemisphere,
        lambda w: np.maximum(w[:, 2], 0) / np.pi,
    ),
    warp("wide cone", sphere(), lambda u: _core_testing.warp_cone(u, 0.8), within_cone(0.8)),
]


@pytest.mark.parametrize("thing", WARPS, ids=lambda w: w.name)
def test_warps_have_their_density(thing: Sampled) -> None:
    check_density(study(thing))


@pytest.mark.parametrize("thing", WARPS, ids=lambda w: w.name)
def test_warps_at_the_edges(thing: Sampled) -> None:
    points = thing.sample(EDGE).points.astype(float)
    assert np.isfinite(points).all()
    if points.shape[1] == 3:
        np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1, atol=1e-6)


def test_small_cones_keep_their_radius() -> None:
    """The sine over the cone's radius is sqrt(u), even where one minus the cosine is tiny."""
    height = 1e-10
    u = uniforms(generator("cone"), 1000, 2)
    directions = _core_testing.warp_cone(u, height).astype(float)
    sine = np.hypot(directions[:, 0], directions[:, 1]) / np.sqrt(2 * height)
    np.testing.assert_allclose(sine, np.sqrt(u[:, 0]), rtol=1e-5, atol=1e-6)


WEIGHTS = {
    "uneven": [1, 0, 3, 0.5, 0, 0, 10, 1e-3, 2],
    "single": [4],
    "all zero": [0, 0, 0, 0],
    "zeros at the ends": [0, 0, 1, 2, 0, 0],
    "many": list(np.random.default_rng(7).lognormal(size=1000)),
}


@pytest.mark.parametrize("name", WEIGHTS)
def test_discrete_distribution(name: str) -> None:
    weights = np.array(WEIGHTS[name], np.float32)
    total = weights.sum(dtype=float)
    expected = weights / total if total > 0 else np.full(len(weights), 1 / len(weights))
    probability = _core_testing.distribution_probability(weights)
    np.testing.assert_allclose(probability, expected, rtol=1e-4, atol=2e-7)
    u = uniforms(generator("discrete", name), 50_000, 1)[:, 0]
    s = _core_testing.distribution_sample(weights, u)
    counts = np.bincount(s["index"], minlength=len(weights))
    assert (counts[probability == 0] == 0).all()
    assert chi_square(counts, len(u) * expected) > LEVEL
    np.testing.assert_array_equal(s["probability"], probability[s["index"]])
    assert s["rest"].min() >= 0 and s["rest"].max() < 1
    rest = np.bincount((s["rest"] * 64).astype(int), minlength=64)
    assert chi_square(rest, np.full(64, len(u) / 64)) > LEVEL


@pytest.mark.parametrize("name", WEIGHTS)
def test_discrete_distribution_at_the_edges(name: str) -> None:
    weights = np.array(WEIGHTS[name], np.float32)
    s = _core_testing.distribution_sample(weights, np.array([0, ONE_MINUS_ULP], np.float32))
    assert (s["probability"] > 0).all() and (s["rest"] < 1).all()
    if weights.sum() > 0:
        assert (weights[s["index"]] > 0).all()


def test_small_weights_in_a_long_table_survive() -> None:
    """A long table is summed without losing its small entries."""
    weights = np.full(1_000_000, 1e-3, np.float32)
    weights[::1000] = 1
    probability = _core_testing.distribution_probability(weights).astype(float)
    assert abs(probability[weights < 0.5].sum() - 999_000e-3 / (999_000e-3 + 1000)) < 1e-3


def grid_distribution(weights: np.ndarray) -> Sampled:
    height, width = weights.shape
    cuts = tuple(tuple(np.arange(1, n) / n) for n in (width, height))

    def evaluate(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        pdf = _core_testing.distribution2d_pdf(weights, np.ascontiguousarray(points, np.float32))
        return pdf[:, None], pdf

    def sample(u: np.ndarray) -> Draws:
        points, pdf = _core_testing.distribution2d_sample(weights, u)
        valid = np.ones(len(u), bool)
        return Draws(points, np.ones((len(u), 1)), pdf, valid, ~valid, np.ones(len(u)))

    return Sampled(f"grid {width}x{height}", box((0, 0), (1, 1), cuts), 2, sample, evaluate)


@pytest.mark.parametrize(
    "weights",
    [
        np.array([[1, 2, 0], [0, 5, 1]], np.float32),
        np.array([[0, 0], [1, 3], [0, 0]], np.float32),
        np.random.default_rng(3).lognormal(size=(6, 9)).astype(np.float32),
        np.ones((1, 1), np.float32),
    ],
    ids=lambda w: "x".join(map(str, w.shape)),
)
def test_grid_distribution(weights: np.ndarray) -> None:
    s = study(grid_distribution(weights))
    check_density(s)
    check_consistency(s)
    centres = np.stack(np.meshgrid(*[(np.arange(n) + 0.5) / n for n in weights.shape[::-1]]), -1).reshape(
        -1, 2
    )
    expected = weights.ravel() / weights.mean()
    pdf = _core_testing.distribution2d_pdf(weights, centres.astype(np.float32))
    np.testing.assert_allclose(pdf, expected, rtol=1e-4, atol=1e-5)


def unit_vectors(count: int) -> np.ndarray:
    w = generator("directions").normal(size=(count, 3))
    w[:6] = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    w[6:8] = [(1e-6, 0, -1), (-1e-6, 1e-6, -1)]
    return (w / np.linalg.norm(w, axis=1, keepdims=True)).astype(np.float32)


def assert_orthonormal(frames: np.ndarray, normals: np.ndarray, precision: float = 2e-6) -> None:
    axes = frames.reshape(-1, 3, 3).astype(float)
    np.testing.assert_allclose(
        axes @ axes.transpose(0, 2, 1), np.tile(np.eye(3), (len(axes), 1, 1)), atol=precision
    )
    np.testing.assert_allclose(np.linalg.det(axes), 1, atol=precision)
    np.testing.assert_array_equal(axes[:, 2], normals)


def test_frames_are_orthonormal_and_right_handed() -> None:
    normals = unit_vectors(2000)
    assert_orthonormal(_core_testing.frames_around(normals), normals)


@pytest.mark.parametrize("length", [1e-8, 1, 1e8])
def test_frames_follow_the_tangent(length: float) -> None:
    normals = unit_vectors(2000)
    tangents = np.roll(normals, 17, axis=0) * np.float32(length)
    frames = _core_testing.frames_along(normals, tangents)
    assert_orthonormal(frames, normals, 1e-5)  # some tangents are almost parallel to the normal
    assert ((frames[:, :3] * tangents).sum(1) > 0).all()


@pytest.mark.parametrize("tangent", [(0, 0, 0), (0, 0, 1), (np.nan, 0, 0), (np.inf, 0, 0)])
def test_frames_survive_useless_tangents(tangent: tuple[float, float, float]) -> None:
    normals = np.array([[0, 0, 1]], np.float32)
    assert_orthonormal(_core_testing.frames_along(normals, np.array([tangent], np.float32)), normals)


def test_inverse_of_affine_transforms() -> None:
    rng = generator("transforms")
    for _ in range(100):
        matrix = np.eye(4)
        matrix[:3] = rng.normal(size=(3, 4)) * 10 ** rng.uniform(-2, 2)
        inverse = np.array(_core_testing.transform_inverse(matrix.tolist()))
        np.testing.assert_allclose(
            inverse, np.linalg.inv(matrix), rtol=1e-4, atol=1e-4 * np.abs(inverse).max()
        )


def test_singular_transforms_have_no_inverse() -> None:
    assert _core_testing.transform_inverse([[1, 0, 0, 0], [0, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]) is None
