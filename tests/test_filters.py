"""Every pixel filter of the list against its formula."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scene_tools import BATCHES, Settings, make_scene, picture, scaling, t_margin, translation
from statistics_tools import ROUNDING, SEED, TESTS, Z, generator, require, uniforms

from lajolla import _core, _core_testing

SAMPLES = 200_000
BINS = 32
TABULATION = 1e-3  # the core tabulates filters in a thousand cells

Formula = Callable[[Settings, np.ndarray], np.ndarray]


def cubic(b: float, c: float, x: np.ndarray) -> np.ndarray:
    """Mitchell and Netravali 1988, equation 8."""
    x = np.abs(x)
    near = (12 - 9 * b - 6 * c) * x**3 + (-18 + 12 * b + 6 * c) * x**2 + (6 - 2 * b)
    far = (-b - 6 * c) * x**3 + (6 * b + 30 * c) * x**2 + (-12 * b - 48 * c) * x + (8 * b + 24 * c)
    return np.where(x < 1, near, np.where(x < 2, far, 0)) / 6


def gaussian(s: Settings, x: np.ndarray) -> np.ndarray:
    deviation = s.get("stddev", 0.5)
    return np.exp(-0.5 * (x / deviation) ** 2) - np.exp(-0.5 * 4**2)


def lanczos(s: Settings, x: np.ndarray) -> np.ndarray:
    return np.sinc(x) * np.sinc(x / s.get("lobes", 3))


# Each filter's radius and formula, and the settings that it is tested with.
FILTERS: dict[str, tuple[Callable[[Settings], float], Formula, list[Settings]]] = {
    "box": (
        lambda s: s.get("radius", 0.5),
        lambda s, x: np.ones_like(x),
        [{}, {"radius": 0.001}, {"radius": 2}, {"radius": 64}],
    ),
    "tent": (
        lambda s: s.get("radius", 1),
        lambda s, x: 1 - np.abs(x) / s.get("radius", 1),
        [{}, {"radius": 0.001}, {"radius": 3}],
    ),
    "gaussian": (
        lambda s: 4 * s.get("stddev", 0.5),
        gaussian,
        [{}, {"stddev": 0.001}, {"stddev": 0.3}, {"stddev": 16}],
    ),
    "mitchell": (
        lambda s: 2,
        lambda s, x: cubic(s.get("B", 1 / 3), s.get("C", 1 / 3), x),
        [{}, {"B": 1, "C": 0}, {"B": 0, "C": 1}, {"B": 1.5, "C": -0.25}],
    ),
    "catmullrom": (lambda s: 2, lambda s, x: cubic(0, 0.5, x), [{}]),
    "lanczos": (lambda s: s.get("lobes", 3), lanczos, [{}, {"lobes": 1}, {"lobes": 2}, {"lobes": 16}]),
}

SETTINGS = [{"type": name} | s for name, (_, _, settings) in FILTERS.items() for s in settings]
each_filter = pytest.mark.parametrize(
    "settings", SETTINGS, ids=lambda s: " ".join(str(v) for v in s.values())
)


def radius_of(settings: Settings) -> float:
    return FILTERS[settings["type"]][0](settings)


def cumulative(settings: Settings, x: np.ndarray) -> np.ndarray:
    """The integral of the filter from its left end to x, over that to its right end."""
    radius = radius_of(settings)
    edges = np.linspace(-radius, radius, 20_001)
    values = FILTERS[settings["type"]][1](settings, (edges[1:] + edges[:-1]) / 2)
    sums = np.concatenate([[0], np.cumsum(values)])
    return np.interp(x, edges, sums / sums[-1])


def has_negative_lobes(settings: Settings) -> bool:
    radius = radius_of(settings)
    return bool((FILTERS[settings["type"]][1](settings, np.linspace(-radius, radius, 2001)) < -1e-9).any())


def require_mean(what: str, values: np.ndarray, expected: np.ndarray | float) -> None:
    """A z-test of independent values (N, ...) against their expectation."""
    margin = Z * values.std(0) / np.sqrt(len(values)) + ROUNDING
    require(np.all(np.abs(values.mean(0) - expected) < margin), what)


def test_every_filter_is_tested() -> None:
    assert set(FILTERS) == set(_core.schema()["rfilter"])
    assert len(SETTINGS) * 2 * (BINS + 32) < TESTS / 10


@each_filter
def test_weights_follow_the_formula(settings: Settings) -> None:
    offset, weight = _core_testing.filter_sample_many(settings, uniforms(generator(settings), SAMPLES, 2))
    radius = radius_of(settings)
    assert np.isfinite(offset).all() and np.abs(offset).max() <= radius * (1 + 1e-6)
    share = np.diff(cumulative(settings, np.linspace(-radius, radius, BINS + 1)))
    index = np.clip((offset / radius + 1) / 2 * BINS, 0, BINS - 1).astype(int)
    for axis in (0, 1):
        members = index[:, axis, None] == np.arange(BINS)
        require_mean(f"{settings}: weights along axis {axis}", members * weight[:, None], share)
    quarter = np.add.reduceat(share, np.arange(0, BINS, BINS // 4))
    cell = (index // (BINS // 4)) @ [4, 1]
    members = cell[:, None] == np.arange(16)
    product = np.outer(quarter, quarter).ravel()
    require_mean(f"{settings}: product of the axes", members * weight[:, None], product)


@each_filter
def test_unit_integral_and_symmetry(settings: Settings) -> None:
    offset, weight = _core_testing.filter_sample_many(settings, uniforms(generator(settings, 2), SAMPLES, 2))
    place = offset / radius_of(settings)
    require_mean(f"{settings}: integral", weight, 1)
    require_mean(f"{settings}: first moments", place * weight[:, None], 0)
    require_mean(f"{settings}: third moments", place**3 * weight[:, None], 0)


@each_filter
def test_a_constant_picture_stays_constant(settings: Settings) -> None:
    scene = make_scene(emitters=[{"type": "constant", "radiance": [1, 0.5, 3]}], rfilter=settings)
    image = picture(scene, 16)
    if not has_negative_lobes(settings):
        assert (image == np.array([1, 0.5, 3])).all()
    else:
        images = np.array([picture(scene, 64, SEED + i)[..., 0].mean() for i in range(BATCHES)])
        require_mean(f"{settings}: constant picture", images, 1)


@pytest.mark.parametrize("settings", [{"type": name} for name in FILTERS], ids=lambda s: s["type"])
def test_an_edge_shows_the_cumulative_filter(settings: Settings) -> None:
    """The camera's x points to the left of the picture: what is at x > 0 fills the left half."""
    size = 16
    light = {
        "type": "rectangle",
        "to_world": translation(50, 0, 1) @ scaling(50),
        "flip_normals": True,
        "emitter": 0,
    }
    scene = make_scene(
        shapes=[light],
        emitters=[{"type": "area", "radiance": 1}],
        sensor={"type": "orthographic"},
        rfilter=settings,
        size=(size, size),
    )
    columns = np.array([picture(scene, 64, SEED + i)[..., 0].mean(0) for i in range(BATCHES)])
    expected = cumulative(settings, size / 2 - 0.5 - np.arange(size))
    margin = t_margin(1, BATCHES - 1, 1 / BATCHES) * columns.std(0, ddof=1) + TABULATION
    require(np.all(np.abs(columns.mean(0) - expected) < margin), f"{settings}: edge")
