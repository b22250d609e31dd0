"""The image is a function of scene, seed and sample range alone, bit for bit; infinite samples are told."""

from __future__ import annotations

import itertools
import threading
import time

import numpy as np
import pytest
from scene_tools import Settings, make_scene, scaling, translation
from statistics_tools import SEED

from lajolla import _core

SIZE = (40, 24)


def room(sampler: str = "sobol", **film: int) -> _core.Scene:
    """Several lights and materials, an aperture, and a filter with negative lobes."""
    return make_scene(
        shapes=[
            {"type": "rectangle", "to_world": translation(0, 0, 6) @ scaling(5), "material": 0},
            {"type": "sphere", "center": [0.5, 0, 4], "material": 1},
            {"type": "sphere", "center": [-1.5, 1, 4], "radius": 0.5, "material": 2},
            {"type": "sphere", "center": [0, 2, 3], "radius": 0.4, "emitter": 0},
        ],
        emitters=[{"type": "area", "radiance": [9, 5, 2]}, {"type": "constant", "radiance": 0.2}],
        bsdfs=[
            {"type": "diffuse"},
            {"type": "dielectric"},
            {"type": "roughconductor", "alpha_u": 0.2, "alpha_v": 0.2},
        ],
        adapters=[
            {"type": "mask", "opacity": 0.8, "child": 0},
            {"type": "blendbsdf", "weight": 0.4, "first": 2, "second": {"adapter": 0}},
        ],
        materials=[
            {"front": {"adapter": 0}, "back": {"adapter": 0}},
            {"front": 1},
            {"front": {"adapter": 1}},
        ],
        sensor={"type": "thinlens", "fov": 50, "aperture_radius": 0.05, "focus_distance": 4},
        size=SIZE,
        film=film,
        rfilter={"type": "mitchell"},
        sampler=sampler,
    )


def image_of(
    scene: _core.Scene, passes: tuple[int, ...] = (16,), seed: int = SEED, threads: int = 2, first: int = 0
) -> np.ndarray:
    """The mean of samples, rendered in passes that end at these counts."""
    render = _core.Render(scene, seed, first)
    for samples in passes:
        assert render.advance(samples, threads)
    assert render.samples == passes[-1]
    return render.image()


each_sampler = pytest.mark.parametrize("sampler", list(_core.schema()["sampler"]))


@each_sampler
def test_threads_and_passes_do_not_matter(sampler: str) -> None:
    scene = room(sampler)
    image = image_of(scene)
    assert np.isfinite(image).all() and image.std() > 0
    np.testing.assert_array_equal(image, image_of(scene, threads=1))
    np.testing.assert_array_equal(image, image_of(room(sampler)))
    np.testing.assert_array_equal(image, image_of(scene, (4, 8, 12, 16)))
    np.testing.assert_array_equal(image, image_of(scene, (1, 11, 16), threads=1))


@each_sampler
def test_a_crop_window_shows_the_same_pixels(sampler: str) -> None:
    full = image_of(room(sampler))
    x, y, width, height = 5, 3, 19, 17
    window = room(sampler, crop_offset_x=x, crop_offset_y=y, crop_width=width, crop_height=height)
    assert (window.width, window.height, window.crop_offset) == (width, height, (x, y))
    np.testing.assert_array_equal(image_of(window), full[y : y + height, x : x + width])


@each_sampler
def test_seeds_and_ranges_differ(sampler: str) -> None:
    scene = room(sampler)
    image = image_of(scene)
    for other in (image_of(scene, seed=SEED + 1), image_of(scene, first=16)):
        assert (image != other).any(axis=2).mean() > 0.9


def test_the_seed_of_the_scene_is_the_default() -> None:
    render = _core.Render(room())
    assert render.advance(2, 2)
    np.testing.assert_array_equal(render.image(), image_of(room(), (2,), seed=room().seed))


def test_cancelling_keeps_finished_tiles() -> None:
    scene = room()
    render = _core.Render(scene, SEED)
    assert render.advance(2, 2)
    finished: list[bool] = []
    target = 1 << 12
    worker = threading.Thread(target=lambda: finished.append(render.advance(target, 2)))
    worker.start()
    while not (render.counts == target).any():
        time.sleep(0.001)
    render.cancel()
    worker.join(timeout=60)
    assert finished == [False]
    counts = render.pixel_counts()
    assert set(np.unique(counts)) <= {2, target} and render.samples == 2
    few, many = image_of(scene, (2,)), image_of(scene, (target,))
    np.testing.assert_array_equal(render.image(), np.where((counts == target)[..., None], many, few))
    assert render.advance(target, 2)
    np.testing.assert_array_equal(render.image(), many)


def test_halves_of_cells_take_their_own_numbers_of_samples() -> None:
    """Each pixel is the mean of its own samples, whatever the others take; odd offsets of the crop window."""
    scene = room(crop_offset_x=3, crop_offset_y=2, crop_width=35, crop_height=20)
    render = _core.Render(scene, SEED)
    assert render.counts.shape == (3, 5, 2)
    counts = (np.arange(30, dtype=np.uint32) % 12).reshape(3, 5, 2)
    assert render.advance(counts, 2)
    np.testing.assert_array_equal(render.counts, counts)
    y, x = np.indices((20, 35))
    pixels = counts[y // 8, x // 8, (x + 3 + y + 2) % 2]
    np.testing.assert_array_equal(render.pixel_counts(), pixels)
    expected = np.zeros((20, 35, 3), np.float32)
    for count in range(1, 12):
        expected[pixels == count] = image_of(scene, (count,))[pixels == count]
    np.testing.assert_array_equal(render.image(), expected)


def test_ranges_of_samples_add_up_in_any_order() -> None:
    scene = room()
    ends = (0, 3, 4, 11, 16)
    parts = []
    for first, end in itertools.pairwise(ends):
        render = _core.Render(scene, SEED, first)
        assert render.advance(end - first, 2)
        parts.append(render.sums())
    counts = np.full((scene.height, scene.width), 16, np.uint32)
    for order in ((0, 1, 2, 3), (2, 0, 3, 1), (3, 2, 1, 0)):
        whole = _core.Sums(np.zeros_like(parts[0].digits), np.zeros_like(parts[0].places))
        for index in order:
            whole.add(0, parts[index])
        np.testing.assert_array_equal(whole.means(counts), image_of(scene))


def test_rows_of_tiles_add_up_in_any_order() -> None:
    """Of a crop window that begins within a tile; halves of cells take different numbers of samples."""
    scene = room(crop_offset_x=3, crop_offset_y=5, crop_width=30, crop_height=18)
    targets = np.arange(3 * 4 * 2, dtype=np.uint32).reshape(3, 4, 2) % 7
    whole = _core.Render(scene, SEED, 2)
    whole.advance(targets, 2)
    parts = [(row, before) for row in range(2) for before in (0, 2)]
    together = _core.Render(scene, SEED, 2)
    for row, before in (parts[i] for i in (3, 0, 2, 1)):
        target = targets[2 * row : 2 * row + 2]
        begin = np.minimum(target, before)
        end = target if before else np.minimum(target, 2)
        part = _core.Render(scene, SEED, 2, tile_rows=(row, row + 1))
        shape = (16 if row == 0 else 2, 30, 3)
        empty = _core.Sums(np.zeros((*shape, 2), np.int64), np.zeros(shape, np.int8))
        part.restore(empty, begin, part.rays, 0, [])
        part.advance(end, 1)
        np.testing.assert_array_equal(part.pixel_counts().shape, shape[:2])
        together.add(row, part.sums(), end - begin, part.rays, part.nonfinite, part.nonfinite_list)
    np.testing.assert_array_equal(together.counts, targets)
    np.testing.assert_array_equal(together.pixel_counts(), whole.pixel_counts())
    np.testing.assert_array_equal(together.image(), whole.image())
    assert np.array_equal(together.rays, whole.rays)


def test_rows_of_tiles_that_do_not_fit_are_refused() -> None:
    scene = room()
    for rows in ((0, 3), (1, 1), (2, 1)):
        with pytest.raises(ValueError, match="does not have these rows"):
            _core.Render(scene, SEED, tile_rows=rows)
    part = _core.Render(scene, SEED, tile_rows=(0, 1))
    whole = _core.Render(scene, SEED)
    for row in (1, 2):  # the last row of tiles is lower, or there is none
        with pytest.raises(ValueError, match="another size"):
            whole.add(row, part.sums(), part.counts, part.rays, 0, [])


def test_a_restored_render_goes_on() -> None:
    scene = room()
    render = _core.Render(scene, SEED)
    assert render.advance(np.arange(30, dtype=np.uint32).reshape(3, 5, 2) % 12, 2)
    other = _core.Render(scene, SEED)
    other.restore(render.sums(), render.counts, render.rays, render.nonfinite, render.nonfinite_list)
    assert other.advance(16, 2)
    np.testing.assert_array_equal(other.image(), image_of(scene))
    smaller = _core.Render(room(crop_width=20), SEED)
    with pytest.raises(ValueError, match="another size"):
        smaller.restore(render.sums(), render.counts, render.rays, 0, [])


def overflowing() -> _core.Scene:
    """A sheet that shines before a wall that shines: where both are seen, more than a float holds."""
    bright = {"type": "area", "radiance": [2.5e38, 1, 0]}
    sheet: Settings = {"type": "rectangle", "flip_normals": True, "emitter": 0, "material": 0}
    wall: Settings = {"type": "rectangle", "flip_normals": True, "emitter": 1, "material": 1}
    return make_scene(
        shapes=[
            {**sheet, "to_world": translation(0, 0, 2) @ scaling(0.5)},
            {**wall, "to_world": translation(0, 0, 3) @ scaling(9)},
        ],
        emitters=[bright, bright],
        adapters=[{"type": "mask", "opacity": 0.3, "child": 0}],
        materials=[{"front": {"adapter": 0}}, {"front": 0}],
        max_depth=1,
        size=SIZE,
        film={"crop_offset_x": 3, "crop_width": 30},
    )


def test_infinite_samples_are_counted_problem_and_replayed() -> None:
    scene, count = overflowing(), 8
    render = _core.Render(scene, SEED)
    assert render.advance(count, 2)
    values = replay(scene, count)
    infinite = ~np.isfinite(values).all(axis=3)
    assert 0 < infinite.sum() < infinite.size
    assert render.nonfinite == infinite.sum()
    left, top = scene.crop_offset
    told = render.nonfinite_list
    assert 0 < len(told) <= render.nonfinite and len(set(told)) == len(told)
    assert all(infinite[y - top, x - left, sample] for x, y, sample in told)
    assert np.isfinite(render.image()).all()
    mean = np.where(infinite[..., None], 0, values).astype(float).sum(axis=2) / count
    np.testing.assert_array_equal(render.image(), mean.astype(np.float32))


def replay(scene: _core.Scene, count: int) -> np.ndarray:
    """The first samples of all pixels one by one, (H, W, count, 3)."""
    left, top = scene.crop_offset
    values = [
        [
            [_core.sample_radiance(scene, SEED, left + x, top + y, i) for i in range(count)]
            for x in range(scene.width)
        ]
        for y in range(scene.height)
    ]
    return np.array(values, np.float32)


@each_sampler
def test_a_picture_is_the_mean_of_its_samples(sampler: str) -> None:
    scene = room(sampler, crop_offset_x=4, crop_offset_y=2, crop_width=12, crop_height=9)
    mean = replay(scene, 4).astype(float).sum(axis=2) / 4
    np.testing.assert_array_equal(image_of(scene, (4,)), mean.astype(np.float32))
