"""Stop rules and adaptive sampling: what ends a render, where the samples go, and that they cause no bias."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from scene_tools import look_at
from scipy import stats
from statistics_tools import generator

import lajolla
from lajolla.adaptive import MOST_RATIO, ErrorEstimate, Halves
from lajolla.render import Progress

ALPHA = 1e-4  # significance level of the tests of bias

# A small lamp above a floor: soft light, noise, and a black background.
SCENE: dict[str, Any] = {
    "type": "scene",
    "integrator": {"type": "path", "max_depth": 4},
    "sensor": {
        "type": "perspective",
        "fov": 50,
        "to_world": look_at([0, 2, -6], [0, 0.5, 0]),
        "film": {"type": "hdrfilm", "width": 80, "height": 48, "rfilter": {"type": "box"}},
    },
    "floor": {"type": "sphere", "center": [0, -10, 0], "radius": 10},
    "ball": {"type": "sphere", "center": [-1, 0.6, 0], "radius": 0.6, "bsdf": {"type": "roughconductor"}},
    "lamp": {
        "type": "sphere",
        "center": [1, 1.5, 0],
        "radius": 0.2,
        "emitter": {"type": "area", "radiance": 8},
    },
}


@pytest.fixture(scope="module")
def scene() -> lajolla.Scene:
    return lajolla.load_dict(SCENE)


def finished(scene: lajolla.Scene, **rules: Any) -> lajolla.Rendering:  # noqa: ANN401
    rendering = scene.rendering(seed=1, **rules)
    rendering.run()
    return rendering


def relative_error(picture: np.ndarray, reference: np.ndarray) -> float:
    """As ErrorEstimate defines it."""
    a, b = picture.astype(float), reference.astype(float)
    return float(np.sqrt(np.minimum((a - b) ** 2 / (b**2 + b.mean() ** 2 / 100), 1).mean()))


# --- stop rules


def test_the_scenes_count_is_the_default(scene: lajolla.Scene) -> None:
    assert finished(scene).samples == scene.core.sample_count


def test_time_ends_a_render(scene: lajolla.Scene) -> None:
    rendering = finished(scene, seconds=0.5)
    assert 0.3 < rendering.seconds < 0.7
    counts = rendering.accumulator.counts
    assert counts.min() == counts.max() > 8
    same = scene.render(spp=int(counts.max()), seed=1)
    np.testing.assert_array_equal(rendering.image().array, same.array)


def test_even_the_shortest_time_gives_a_picture(scene: lajolla.Scene) -> None:
    assert finished(scene, seconds=1e-9).samples == 1
    assert finished(scene, seconds=1e-9, noise=0.01).samples >= 1


def test_time_ends_rounds(scene: lajolla.Scene) -> None:
    rendering = finished(scene, seconds=0.5, noise=1e-6)
    assert rendering.seconds < 0.7 and rendering.samples > 16


@pytest.mark.parametrize("adaptive", [False, True])
def test_noise_ends_a_render(scene: lajolla.Scene, adaptive: bool) -> None:
    """The estimate of the error is within a factor of two."""
    rendering = finished(scene, noise=0.05, adaptive=adaptive)
    assert 0.02 < rendering.noise <= 0.05
    reference = scene.render(spp=4096, seed=2).array
    assert 0.5 < relative_error(rendering.image().array, reference) / rendering.noise < 2
    earlier = finished(scene, noise=0.05, adaptive=adaptive, spp=32)
    assert earlier.samples <= 32 and earlier.noise > 0.05


def test_rules_that_cannot_be(scene: lajolla.Scene) -> None:
    for rules in ({"seconds": 0}, {"seconds": float("nan")}, {"noise": 1}, {"noise": -0.1}, {"spp": 0}):
        with pytest.raises(lajolla.OptionError):
            scene.render(**rules)
    with pytest.raises(lajolla.OptionError, match="beyond the last"):
        scene.rendering(spp=2, first_sample=2**30 - 1)


def test_progress_tells_the_noise(scene: lajolla.Scene) -> None:
    told: list[Progress] = []
    rendering = scene.rendering(seed=1, noise=0.02)
    rendering.run(told.append)
    fractions = [progress.fraction for progress in told]
    assert all(0 <= fraction <= 1 for fraction in fractions)
    assert told[0].noise == np.inf and np.isfinite(told[-1].noise)


# --- where the samples go


def test_noisy_parts_get_more_samples(scene: lajolla.Scene) -> None:
    rendering = finished(scene, spp=128, adaptive=True)
    counts = rendering.accumulator.pixel_counts()
    assert 100 < counts.mean() <= 128
    assert set(np.log2(np.unique(counts)) % 1) == {0}
    assert counts.max() <= 2 * MOST_RATIO * counts.min()
    assert counts[:8, -24:].mean() < 0.2 * counts.mean()  # the background


@pytest.mark.parametrize("offset", [(0, 0), (1, 0), (3, 2)])
@pytest.mark.parametrize("size", [(1, 1), (17, 33), (8, 9), (35, 20)])
def test_the_sizes_of_halves(size: tuple[int, int], offset: tuple[int, int]) -> None:
    halves = Halves(*size, offset)
    np.testing.assert_array_equal(halves.pixels, halves.sums(np.ones(size[::-1])))


def test_cost_follows_the_rays_of_a_sample() -> None:
    """A tile has four cells, and fewer at the right and lower ends."""
    halves = Halves(20, 18, (0, 0))
    counts = np.full(halves.shape, 4, np.uint32)
    counts[:2, :2] = 8
    pixels = np.array([[16 * 16, 4 * 16], [16 * 2, 4 * 2]])
    rays = np.array([[2, 3], [5, 7]]) * pixels * [[8, 4], [4, 4]]
    cost = halves.cost(rays.astype(np.uint64), counts)
    np.testing.assert_allclose(cost[..., 0], [[4, 4, 9], [4, 4, 9], [25, 25, 49]])


@pytest.mark.parametrize("size", [(1, 1), (17, 33), (9, 1), (33, 33)])
def test_cells_may_have_a_single_pixel(size: tuple[int, int]) -> None:
    """One of its halves is then empty."""
    for noise in (None, 0.1):
        rendering = finished(lajolla.load_dict(SCENE, size=size), spp=100, adaptive=True, noise=noise)
        assert 16 <= rendering.samples <= 100


def test_the_numbers_of_samples_are_a_layer() -> None:
    rendering = finished(lajolla.load_dict(SCENE, aovs=["samples"]), spp=64, adaptive=True)
    layer = rendering.image().channels["samples.C"]
    np.testing.assert_array_equal(layer, rendering.accumulator.pixel_counts())
    assert layer.min() < layer.max()


def test_a_picture_without_noise_is_sampled_evenly() -> None:
    sky = lajolla.load_dict({"type": "scene", "sky": {"type": "constant"}, "sensor": SCENE["sensor"]})
    assert finished(sky, spp=64, adaptive=True).samples == 64
    assert finished(sky, noise=0.01).samples == 16


def test_a_pixel_has_the_samples_of_its_own(scene: lajolla.Scene) -> None:
    """It is what it would be with this number of samples everywhere."""
    rendering = finished(scene, spp=64, adaptive=True)
    counts, picture = rendering.accumulator.pixel_counts(), rendering.image().array
    for count in np.unique(counts):
        even = scene.render(spp=int(count), seed=1).array
        np.testing.assert_array_equal(picture[counts == count], even[counts == count])


def test_threads_and_interruptions_do_not_matter(
    scene: lajolla.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = finished(scene, noise=0.15)
    rendering = scene.rendering(seed=1, noise=0.15, threads=1)
    monkeypatch.setattr("lajolla.render.POLL_SECONDS", 0.001)
    monkeypatch.setattr("lajolla.render.PASS_SECONDS", 0.02)
    calls = 0

    def interrupt(progress: Progress) -> None:
        nonlocal calls
        calls += 1
        if calls % 3 == 0:
            raise KeyboardInterrupt

    for _ in range(1000):
        try:
            rendering.run(interrupt)
            break
        except KeyboardInterrupt:
            continue
    assert calls > 3
    np.testing.assert_array_equal(rendering.accumulator.counts, expected.accumulator.counts)
    np.testing.assert_array_equal(rendering.image().array, expected.image().array)


# --- no bias


def means(scene: lajolla.Scene, seeds: range, **rules: Any) -> np.ndarray:  # noqa: ANN401
    return np.array([scene.render(seed=seed, **rules).array.mean(dtype=float) for seed in seeds])


def heavy_tailed() -> lajolla.Scene:
    """A lamp that paths find by chance: few samples have most of the light."""
    integrator = {"type": "path", "max_depth": 3, "strategy": "bsdf"}
    lamp = {**SCENE["lamp"], "emitter": {"type": "area", "radiance": 100}}
    sensor = {**SCENE["sensor"], "film": {**SCENE["sensor"]["film"], "width": 48, "height": 32}}
    return lajolla.load_dict({**SCENE, "integrator": integrator, "lamp": lamp, "sensor": sensor})


def test_the_mean_is_not_biased() -> None:
    """Welch's t-test of the means of 60 pictures each."""
    scene = heavy_tailed()
    adaptive = means(scene, range(60), spp=32, adaptive=True)
    even = means(scene, range(100, 160), spp=32)
    assert stats.ttest_ind(adaptive, even, equal_var=False).pvalue > ALPHA


def simulated_mean(rng: np.random.Generator, swap: bool) -> float:
    """Adaptive sampling of a picture of equal pixels, of mean 1, whose samples are rarely bright."""
    halves = Halves(32, 32, (0, 0))
    sums, counts = np.zeros((32, 32)), np.zeros(halves.shape, np.uint32)
    target = np.full(halves.shape, 8, np.uint32)
    estimate = ErrorEstimate(halves)
    for _ in range(5):
        of_pixels = (target - counts).ravel()[halves.of_pixels]
        sums += 200 * rng.binomial(of_pixels, 0.005)
        counts = target
        picture = np.repeat((sums / counts.ravel()[halves.of_pixels])[..., None], 3, axis=2)
        estimate.update(picture.astype(np.float32), counts)
        decider = copy.copy(estimate)
        if not swap:  # next_counts swaps the variances of the halves
            decider.errors = (estimate.errors * counts)[..., ::-1] / counts
        target = (
            2 * counts
            if np.isinf(estimate.noise)
            else decider.next_counts(counts, np.ones_like(estimate.changes), most=24)
        )
    return float(picture.mean())


def test_deciding_by_the_other_half_causes_no_bias_and_by_the_same_half_it_would() -> None:
    rng = generator("adaptive bias")
    by_other = [simulated_mean(rng, True) for _ in range(200)]
    by_itself = [simulated_mean(rng, False) for _ in range(200)]
    assert stats.ttest_1samp(by_other, 1).pvalue > ALPHA
    assert stats.ttest_1samp(by_itself, 1).pvalue < ALPHA
