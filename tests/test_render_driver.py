"""The progressive driver: options, passes, interruption; pictures depend on scene and seed alone."""

import math
from concurrent.futures import Future, wait
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import lajolla
from lajolla.options import Options, apply_options
from lajolla.render import Progress, Rendering, StopRules
from lajolla.scene import describe

SCENE: dict[str, Any] = {
    "type": "scene",
    "integrator": {"type": "path", "max_depth": 3},
    "sensor": {
        "type": "perspective",
        "film": {"type": "hdrfilm", "width": 16, "height": 12, "rfilter": {"type": "box"}},
        "sampler": {"type": "independent", "sample_count": 16},
    },
    "light": {"type": "constant", "radiance": 0.5},
    "ball": {"type": "sphere", "center": [0, 0, 5], "radius": 1},
}

CORE: dict[str, Any] = {
    "film": {
        "width": 64,
        "height": 48,
        "crop_offset_x": 1,
        "crop_offset_y": 2,
        "crop_width": 3,
        "crop_height": 4,
    },
    "sampler": {"type": "sobol", "sample_count": 4, "seed": 9},
    "integrator": {"type": "path", "max_depth": 8},
}


@pytest.fixture(scope="module")
def scene() -> lajolla.Scene:
    return lajolla.load_dict(SCENE)


def test_no_option_changes_nothing() -> None:
    assert apply_options(CORE, Options()) == CORE


def test_options_replace_the_scenes_values() -> None:
    result = apply_options(CORE, Options(spp=7, seed=3, size=(10, 20), crop=(1, 1, 5, 5), max_depth=2))
    assert result["sampler"] == {"type": "sobol", "sample_count": 7, "seed": 3}
    assert result["integrator"] == {"type": "path", "max_depth": 2}
    crop = {"crop_offset_x": 1, "crop_offset_y": 1, "crop_width": 5, "crop_height": 5}
    assert result["film"] == {"width": 10, "height": 20, **crop}


def test_size_drops_the_scenes_crop() -> None:
    assert apply_options(CORE, Options(size=(10, 20)))["film"] == {"width": 10, "height": 20}


def integrator_of(given: dict[str, Any], **options: Any) -> dict[str, Any]:  # noqa: ANN401
    """What becomes of a scene's integrator with another one asked for."""
    core = describe({**SCENE, "integrator": given}, **options).core
    return core["integrator"]


def test_another_integrator_takes_what_it_knows() -> None:
    path = {"type": "path", "max_depth": 3, "rr_depth": 2}
    assert integrator_of(path, integrator="depth") == {"type": "field", "field": "depth"}
    assert integrator_of(path, integrator="path") == path
    assert integrator_of(path, integrator="direct") == {"type": "direct"}
    assert integrator_of({"type": "direct", "emitter_samples": 0}, integrator="path") == {"type": "path"}
    assert integrator_of({"type": "volpath", "max_depth": 7}, integrator="path") == path_of_depth(7)
    aov = {"type": "aov", "aovs": "d:depth", "inner": path_of_depth(4)}
    assert integrator_of(aov, integrator="path") == path_of_depth(4)


def path_of_depth(depth: int) -> dict[str, Any]:
    return {"type": "path", "max_depth": depth}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (Options(crop=(60, 0, 10, 10)), "outside of the film"),
    ],
)
def test_options_that_do_not_fit(options: Options, message: str) -> None:
    with pytest.raises(lajolla.OptionError, match=message):
        apply_options(CORE, options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"integrator": "pth"}, "did you mean 'path'"),
        ({"integrator": 5}, "unknown integrator 5"),
        ({"integrator": "depth", "max_depth": 3}, "has no max_depth"),
        ({"max_depth": -2}, "max_depth must be in -1 to"),
        ({"spp": 2.5}, "spp must be a whole number, not 2.5"),
        ({"spp": True}, "spp must be a whole number, not True"),
        ({"seed": 2**32}, "seed must be in 0 to 4294967295, not 4294967296"),
        ({"size": 5}, "size must be 2 whole numbers, not 5"),
        ({"size": (5, 0)}, "size must be in 1 to 65536, not 0"),
        ({"crop": (1, 2, 3)}, r"crop must be 4 whole numbers, not \(1, 2, 3\)"),
        ({"crop": (1, 2, 0, 0)}, "crop must be in 1 to 65536, not 0"),
        ({"crop": (1.5, 2, 3, 3)}, "crop must be a whole number, not 1.5"),
    ],
)
def test_options_that_no_scene_can_have(options: dict[str, Any], message: str) -> None:
    with pytest.raises(lajolla.OptionError, match=message):
        lajolla.load_dict(SCENE, **options)


def test_picture(scene: lajolla.Scene) -> None:
    picture = scene.render(spp=2)
    assert picture.array.shape == (12, 16, 3)
    assert picture.array.dtype == np.float32
    np.testing.assert_allclose(picture.array[0, 0], 0.5, rtol=1e-6)  # the background


def test_picture_depends_on_scene_and_seed_alone(scene: lajolla.Scene) -> None:
    one = scene.render(spp=16, seed=1, threads=1).array
    two = scene.render(spp=16, seed=1, threads=2).array
    np.testing.assert_array_equal(one, two)
    assert not np.array_equal(one, scene.render(spp=16, seed=2).array)
    four_by_four = scene.rendering(spp=16, seed=1)
    for samples in range(4, 17, 4):
        four_by_four.accumulator.advance(samples, 2)
    np.testing.assert_array_equal(one, four_by_four.image().array)


def test_passes_double(scene: lajolla.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lajolla.render.PASS_SECONDS", 1e9)
    done: list[float] = []
    rendering = scene.rendering(spp=20)
    rendering.run(lambda progress: done.append(progress.samples))
    assert [value for value in done if value in (1, 2, 4, 8, 16, 20)] == [1, 2, 4, 8, 16, 20]
    assert rendering.samples == 20


def test_passes_are_limited_in_time(scene: lajolla.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lajolla.render.PASS_SECONDS", 0)
    rendering = scene.rendering(spp=5)
    counts = []
    rendering.run(lambda progress: counts.append(rendering.samples))
    assert set(counts) == {1, 2, 3, 4, 5}


def test_interruption_keeps_finished_tiles(scene: lajolla.Scene) -> None:
    rendering = scene.rendering(spp=1_000_000, seed=5, threads=1)

    def interrupt(progress: Progress) -> None:
        if rendering.samples >= 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rendering.run(interrupt)
    assert 4 <= rendering.samples < 1_000_000
    kept = scene.render(spp=int(rendering.samples), seed=5)  # a single tile
    np.testing.assert_array_equal(rendering.image().array, kept.array)


def test_an_interrupted_rendering_goes_on(scene: lajolla.Scene) -> None:
    rendering = scene.rendering(spp=16, seed=1)

    def interrupt(progress: Progress) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rendering.run(interrupt)
    rendering.run()
    np.testing.assert_array_equal(rendering.image().array, scene.render(spp=16, seed=1).array)


def test_a_rendering_interrupted_in_a_pass_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lajolla.render.POLL_SECONDS", 0)
    scene = lajolla.load_dict(SCENE, size=(512, 512), spp=2)
    rendering = scene.rendering(seed=1)

    def interrupt(progress: Progress) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rendering.run(interrupt)
    assert rendering.samples < 1
    rendering.run()
    assert rendering.samples == 2
    np.testing.assert_array_equal(rendering.image().array, scene.render(seed=1).array)


def test_a_rendering_interrupted_after_a_pass_goes_on(
    scene: lajolla.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The pass ends between the look at it and the interruption."""
    rendering = scene.rendering(spp=8, seed=1)

    def late(tasks: list[Future[bool]], timeout: float) -> SimpleNamespace:
        wait(tasks)
        return SimpleNamespace(done=set())

    def interrupt(progress: Progress) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("lajolla.render.wait", late)
        with pytest.raises(KeyboardInterrupt):
            rendering.run(interrupt)
    assert rendering.samples == 1
    rendering.run()
    np.testing.assert_array_equal(rendering.image().array, scene.render(spp=8, seed=1).array)


def test_a_cancelled_pass_ends_the_run(scene: lajolla.Scene) -> None:
    rendering = scene.rendering(spp=4)

    class Cancelled:
        counts = np.zeros((1, 1, 2), np.uint32)
        progress = 0.0

        def advance(self, counts: np.ndarray, threads: int) -> bool:
            return False

    rendering.accumulator = Cancelled()
    with pytest.raises(RuntimeError, match="cancelled"):
        rendering.run()


def test_radiance_counts_pixels_from_the_films_corner() -> None:
    scene = lajolla.load_dict(SCENE, crop=(5, 4, 6, 4))
    picture = scene.render().array
    np.testing.assert_allclose(scene.radiance(8, 6), picture[2, 3], rtol=1e-5)
    with pytest.raises(lajolla.OptionError, match=r"pixel must be a whole number, not 8\.5"):
        scene.radiance(8.5, 6)
    for x, y in ((4, 4), (5, 3), (11, 4), (5, 8)):
        with pytest.raises(lajolla.OptionError, match="6 x 4, which begins at 5,4"):
            scene.radiance(x, y)


def test_radiance_of_a_pixel_is_that_of_the_picture(scene: lajolla.Scene) -> None:
    picture = scene.render().array
    np.testing.assert_allclose(scene.radiance(8, 6), picture[6, 8], rtol=1e-5)
    samples = [scene.radiance(8, 6, sample) for sample in range(16)]
    np.testing.assert_allclose(np.mean(samples, axis=0), picture[6, 8], rtol=1e-5)
    with pytest.raises(lajolla.OptionError, match="outside of the picture, 16 x 12"):
        scene.radiance(16, 0)


def test_options_of_load_dict() -> None:
    scene = lajolla.load_dict(SCENE, spp=3, size=(5, 4))
    assert (scene.width, scene.height, scene.core.sample_count) == (5, 4, 3)
    largest = 2**32 - 1
    assert lajolla.load_dict(SCENE, seed=largest).core.seed == largest
    with pytest.raises(TypeError, match="did you mean 'spp'"):
        lajolla.load_dict(SCENE, sp=3)


@pytest.mark.parametrize(
    "options", [{"spp": 0}, {"spp": 2**40}, {"seed": 2**32}, {"threads": 0}, {"threads": 2**20}, {"seed": -1}]
)
def test_impossible_numbers(scene: lajolla.Scene, options: dict[str, int]) -> None:
    with pytest.raises(lajolla.OptionError, match=f"must be in .*, not {next(iter(options.values()))}"):
        scene.render(**options)


@pytest.mark.parametrize("options", [{"spp": 2.5}, {"seed": "1"}, {"threads": 1.5}])
def test_numbers_that_are_not_whole(scene: lajolla.Scene, options: dict[str, Any]) -> None:
    with pytest.raises(lajolla.OptionError, match="must be a whole number, not "):
        scene.render(**options)


def test_progress() -> None:
    progress = Progress(samples=5, seconds=10, rules=StopRules(spp=20))
    assert progress.fraction == 0.25
    assert progress.seconds_left == 30
    assert Progress(5, 10, StopRules(spp=20, seconds=20)).fraction == 0.5
    assert Progress(5, 10, StopRules(noise=0.1), noise=0.2).fraction == pytest.approx(0.25)
    assert Progress(5, 10, StopRules(noise=0.1)).fraction == 0
    assert Progress(5, 10, StopRules(noise=0.1)).seconds_left == math.inf


def test_a_failing_pass_raises(scene: lajolla.Scene) -> None:
    rendering = Rendering(scene.core, scene.description.core, rules=StopRules(spp=4), seed=0, threads=1)

    class Failing:
        counts = np.zeros((1, 1, 2), np.uint32)
        progress = 0.0

        def advance(self, counts: np.ndarray, threads: int) -> bool:
            raise MemoryError

    rendering.accumulator = Failing()
    with pytest.raises(MemoryError):
        rendering.run()
