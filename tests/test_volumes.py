"""Volumes against SciPy's interpolation, walks through majorants against brute force, and media."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from statistics_tools import generator

from lajolla import _core, _core_testing

TO_WORLD = np.array([[1.2, 0.3, 0, -0.4], [-0.2, 0.9, 0.1, 0.3], [0.1, 0, 2.0, -1], [0, 0, 0, 1]])
Array = np.ndarray


def positions(key: object, count: int = 4000, *, beyond: float = 0.0) -> Array:
    """Points of the unit cube, or of what is around it, in world space."""
    p = generator(key).uniform(-beyond, 1 + beyond, (count, 3))
    return (p @ TO_WORLD[:3, :3].T + TO_WORLD[:3, 3]).astype(np.float32)


def in_cube(points: Array) -> Array:
    return (points.astype(float) - TO_WORLD[:3, 3]) @ np.linalg.inv(TO_WORLD[:3, :3]).T


def voxels(shape: tuple[int, ...], dtype: type = np.float32) -> Array:
    values = generator(shape).random(shape)
    return (255 * values).astype(dtype) if dtype is np.uint8 else values.astype(dtype)


def decoded(array: Array) -> Array:
    return array.astype(float) / (255 if array.dtype == np.uint8 else 1)


def volume(array: Array, **fields: object) -> dict[str, object]:
    return {"type": "gridvolume", "grid": _core.Grid(array), "to_world": TO_WORLD.tolist(), **fields}


def read(points: Array, array: Array, **fields: object) -> Array:
    return _core.Media({"volumes": [volume(array, **fields)]}).volume_many(0, points)


def reference(points: Array, array: Array, *, corners: bool, method: str = "linear") -> Array:
    """SciPy's interpolation; beyond the outermost samples their values."""
    size = np.array(array.shape[2::-1])
    at = in_cube(points) * (size - 1) if corners else in_cube(points) * size - 0.5
    at = np.clip(at, 0, size - 1)[:, ::-1]
    axes = tuple(np.arange(n) for n in array.shape[:3])
    return RegularGridInterpolator(axes, decoded(array), method=method)(at)


@pytest.mark.parametrize("dtype", [np.uint8, np.float16, np.float32])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("corners", [False, True])
def test_values_are_interpolated(dtype: type, channels: int, corners: bool) -> None:
    array, points = voxels((4, 7, 5, channels), dtype), positions("inside", beyond=0.2)
    expected = reference(points, array, corners=corners)
    values = read(points, array, align_corners=corners)
    np.testing.assert_allclose(values, np.broadcast_to(expected, values.shape), atol=2e-5)


def test_nearest_samples() -> None:
    array, points = voxels((4, 7, 5, 1)), positions("nearest")
    cell = np.minimum((in_cube(points) * (5, 7, 4)).astype(int), (4, 6, 3))
    expected = array[cell[:, 2], cell[:, 1], cell[:, 0], 0]
    values = read(points, array, filter_type="nearest")[:, 0]
    assert np.mean(values != expected) < 2e-3  # points on the walls between cells


@pytest.mark.parametrize("mode, numpy_mode", [("repeat", "wrap"), ("mirror", "symmetric"), ("clamp", "edge")])
def test_wrapping(mode: str, numpy_mode: str) -> None:
    array, points = voxels((4, 7, 5, 1)), positions("wrap", beyond=0.9)
    padded = np.pad(array, [(8, 8), (8, 8), (8, 8), (0, 0)], numpy_mode)
    at = (in_cube(points) * (5, 7, 4) - 0.5 + 8)[:, ::-1]
    expected = RegularGridInterpolator(tuple(np.arange(n) for n in padded.shape[:3]), padded)(at)
    np.testing.assert_allclose(read(points, array, wrap_mode=mode)[:, :1], expected, atol=3e-5)


@pytest.mark.parametrize("mode, value", [("zero", 0), ("one", 1)])
def test_constant_surroundings(mode: str, value: float) -> None:
    array, points = voxels((4, 7, 5, 1)), positions("outside", beyond=0.5)
    inside = np.all((in_cube(points) > 1e-5) & (in_cube(points) < 1 - 1e-5), axis=1)
    outside = np.any((in_cube(points) < -1e-5) | (in_cube(points) > 1 + 1e-5), axis=1)
    values = read(points, array, wrap_mode=mode)
    assert (values[outside] == value).all()
    np.testing.assert_allclose(values[inside], read(points[inside], array), atol=1e-6)


def test_grids_of_one_voxel_are_constant() -> None:
    for corners in (False, True):
        values = read(positions("one"), np.full((1, 1, 1, 1), 0.25, np.float32), align_corners=corners)
        assert (values == 0.25).all()


def test_hostile_positions_are_answered() -> None:
    far = np.array([[1e30, -1e30, 0], [np.inf, 0, 0], [np.nan, 0, 0], [3e38, 3e38, 3e38]], np.float32)
    for mode in ("repeat", "mirror", "clamp", "zero", "one"):
        assert np.isfinite(read(far, voxels((4, 7, 5, 1)), wrap_mode=mode)).all()


@pytest.mark.parametrize(
    "array",
    [
        np.zeros((2, 2), np.float32),
        np.zeros((2, 2, 2, 2), np.float32),
        np.zeros((0, 2, 2), np.float32),
        np.zeros((2, 2, 2), np.float64),
        np.full((2, 2, 2), np.nan, np.float32),
    ],
)
def test_impossible_grids_are_refused(array: Array) -> None:
    with pytest.raises(ValueError, match="voxels must"):
        _core.Grid(array)


def media(array: Array, **medium: object) -> _core.Media:
    """One heterogeneous medium over a volume of extinction."""
    return _core.Media(
        {"volumes": [volume(array)], "media": [{"type": "heterogeneous", "sigma_t": {"volume": 0}, **medium}]}
    )


WO = np.array([[0, 0, 1]], np.float32)


def test_coefficients_are_extinction_times_albedo() -> None:
    array, points = voxels((4, 7, 5, 3)), positions("coefficients", beyond=0.3)
    found = media(array, albedo=[0.25, 0.5, 1], emission=[3, 2, 1], scale=7).coefficients_many(0, points, WO)
    inside = np.all((in_cube(points) >= 0) & (in_cube(points) <= 1), axis=1)
    sigma_t = 7 * np.where(inside[:, None], reference(points, array, corners=False), 0)
    np.testing.assert_allclose(found["sigma_s"], sigma_t * (0.25, 0.5, 1), atol=2e-4)
    np.testing.assert_allclose(found["sigma_a"], sigma_t * (0.75, 0.5, 0), atol=2e-4)
    np.testing.assert_allclose(found["emission"], sigma_t * (2.25, 1, 0), atol=1e-3)


def test_negative_voxels_and_albedos_above_one_do_no_harm() -> None:
    array = voxels((4, 7, 5, 1)) - np.float32(0.5)
    albedo = volume(4 * voxels((3, 3, 3, 1)))
    medium = {"type": "heterogeneous", "sigma_t": {"volume": 0}, "albedo": {"volume": 1}}
    found = _core.Media({"volumes": [volume(array), albedo], "media": [medium]}).coefficients_many(
        0, positions("negative"), WO
    )
    assert all((found[name] >= 0).all() and np.isfinite(found[name]).all() for name in found)


@pytest.mark.parametrize("shape", [(3, 3, 3, 1), (20, 9, 33, 1), (7, 300, 5, 3)])
def test_majorants_bound_the_extinction_and_pieces_adjoin(shape: tuple[int, ...]) -> None:
    """Against brute force: along every ray, the extinction at many points and the way through the cube."""
    array = voxels(shape)
    array[array < 0.9] *= 0.01  # bounds that differ
    medium, rng = media(array, scale=3.0), generator("rays", shape)
    for _ in range(60):
        origin, target = (positions(rng.random(), 1, beyond=b)[0] for b in (1.0, 0.0))
        direction = (target - origin) / np.linalg.norm(target - origin)
        near, far = (0.0, 1e30) if rng.random() < 0.7 else (0.5, 1.125)
        pieces = _core_testing.majorants_along(
            medium, 0, np.array([*origin, *direction, near, far], np.float32)
        ).astype(float)
        t = np.linspace(near, min(far, 8.0), 4000)
        points = (origin + t[:, None] * direction).astype(np.float32)
        at = in_cube(points)
        inside = np.all((at > 1e-4) & (at < 1 - 1e-4), axis=1)
        if len(pieces) == 0:
            assert inside.sum() == 0
            continue
        assert (pieces[:, 0] < pieces[:, 1]).all() and (pieces[1:, 0] == pieces[:-1, 1]).all()
        assert pieces[0, 0] >= near and pieces[-1, 1] <= far
        covered = (t >= pieces[0, 0]) & (t <= pieces[-1, 1])
        assert covered[inside].all()
        found = medium.coefficients_many(0, points[covered], WO)
        sigma_t = (found["sigma_a"] + found["sigma_s"]).max(axis=1)
        piece = np.minimum(np.searchsorted(pieces[:, 1], t[covered]), len(pieces) - 1)
        assert (sigma_t <= pieces[piece, 2] * (1 + 1e-5) + 1e-5).all()


def test_majorants_are_local() -> None:
    array = np.zeros((40, 40, 40, 1), np.float32)
    array[30, 30, 30] = 1
    pieces = _core_testing.majorants_along(
        media(array), 0, np.array([*TO_WORLD[:3, 3], 1, 1, 1, 0, 10], np.float32)
    )
    assert pieces[0, 2] == 0 and len(pieces) > 3


@pytest.mark.parametrize(
    "direction", [(1, 0, 0), (0, -1, 0), (0, 0, 0), (1e-30, 1, 1e-30), (np.nan, 1, 0), (np.inf, 0, 0)]
)
def test_hostile_rays_end(direction: tuple[float, ...]) -> None:
    medium = media(voxels((20, 9, 33, 1)))
    for near, far in ((0, np.inf), (0, 1), (1, 0), (np.nan, np.nan)):
        for origin in ((0.5, 0.5, 0.5), tuple(TO_WORLD[:3, 3]), (np.nan, 0, 0), (1e30, 0, 0)):
            pieces = _core_testing.majorants_along(
                medium, 0, np.array([*origin, *direction, near, far], np.float32)
            )
            assert len(pieces) < 200


def test_constant_extinction_is_everywhere() -> None:
    medium = _core.Media({"media": [{"type": "heterogeneous", "sigma_t": [1, 2, 3], "scale": 2}]})
    pieces = _core_testing.majorants_along(medium, 0, np.array([0, 0, 0, 0, 0, 1, 0.5, np.inf], np.float32))
    np.testing.assert_array_equal(pieces, [[0.5, np.inf, 6]])
    found = medium.coefficients_many(0, 1e6 * positions("far"), WO)
    np.testing.assert_allclose(found["sigma_a"] + found["sigma_s"], np.broadcast_to([2, 4, 6], (4000, 3)))


def test_microflakes_change_the_extinction() -> None:
    """Within the majorants, by the projected area along the ray, at grid points that differ."""
    rng = generator("flakes")
    roots = rng.normal(size=(4, 4, 4, 3, 3))
    s = np.einsum("...ij,...kj->...ik", roots, roots)
    flakes = np.stack(
        [s[..., 0, 0], s[..., 1, 1], s[..., 2, 2], s[..., 0, 1], s[..., 0, 2], s[..., 1, 2]], -1
    )
    description = {
        "volumes": [volume(voxels((4, 7, 5, 1))), volume(flakes.astype(np.float32))],
        "phases": [{"type": "sggx", "S": {"volume": 1}}],
        "media": [{"type": "heterogeneous", "sigma_t": {"volume": 0}, "phase": 0}],
    }
    medium, points = _core.Media(description), positions("flakes", 500)
    plain = media(voxels((4, 7, 5, 1))).coefficients_many(0, points, WO)
    for w in rng.normal(size=(5, 3)):
        wo = (w / np.linalg.norm(w)).astype(np.float32)
        area = medium.phase_area_many(0, np.broadcast_to(wo, points.shape).copy(), points)
        found = medium.coefficients_many(0, points, wo[None])
        np.testing.assert_allclose(found["sigma_a"], plain["sigma_a"] * area[:, None], rtol=1e-4)
        pieces = _core_testing.majorants_along(medium, 0, np.array([*points[0], *wo, -10, 10], np.float32))
        assert (found["sigma_a"] + found["sigma_s"])[0].max() <= pieces[:, 2].max()


@pytest.mark.parametrize(
    "description, message",
    [
        ({"media": [{"type": "homogeneous", "sigma_a": -1}]}, "sigma_a: expected .* >= 0"),
        ({"media": [{"type": "heterogeneous", "sigma_t": -1}]}, "sigma_t: expected .* >= 0"),
        ({"media": [{"type": "heterogeneous", "albedo": 1.5}]}, r"albedo: expected .* in \[0, 1\]"),
        ({"media": [{"type": "heterogeneous", "sigma_t": {"volume": 0}}]}, "there is no volume 0"),
        ({"media": [{"type": "homogeneous", "phase": 0}]}, "there is no phase function 0"),
        ({"media": [{"type": "homogeneous", "phase": -2}]}, "the index of a phase function"),
        ({"media": [{"type": "homogeneous", "sigma_a": 3e38, "sigma_s": 3e38}]}, "too dense"),
        ({"media": [{"type": "heterogeneous", "sigma_t": 1e38, "scale": 1e38}]}, "too dense"),
        ({"volumes": [{"type": "gridvolume"}]}, "needs a grid"),
        ({"volumes": [volume(voxels((2, 2, 2, 1))) | {"to_world": np.zeros((4, 4))}]}, "flattens"),
        (
            {
                "volumes": [volume(voxels((2, 2, 2, 6)))],
                "media": [{"type": "heterogeneous", "sigma_t": {"volume": 0}}],
            },
            "one channel or three",
        ),
        (
            {"volumes": [volume(voxels((2, 2, 2, 1)))], "phases": [{"type": "sggx", "S": {"volume": 0}}]},
            "six channels",
        ),
        (
            {
                "volumes": [volume(voxels((2, 2, 2, 6)))],
                "phases": [{"type": "sggx", "S": {"volume": 0}}],
                "media": [{"type": "homogeneous", "phase": 0}],
            },
            "cannot have particles that differ",
        ),
    ],
)
def test_what_does_not_fit_is_refused(description: dict[str, object], message: str) -> None:
    with pytest.raises(_core.DescriptionError, match=message):
        _core.Media(description)
