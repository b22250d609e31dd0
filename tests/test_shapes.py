"""Every shape of the list: sampled points, hits and their geometry, and rays that leave hits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from emitter_tools import FINE, STUDIED, Lit
from ray_tools import moller_trumbore
from scene_tools import (
    Settings,
    box_mesh,
    look_at,
    make_scene,
    picture,
    rotation,
    scaling,
    translation,
    uv_sphere,
)
from scipy import stats
from statistics_tools import LEVEL, TESTS, chi_square, generator, require, uniforms

from lajolla import _core_testing

EXACT = 4e-6  # of the largest coordinate: what a few float32 operations leave
CELLS = 8  # per axis of a chi-square test

Arrays = dict[str, np.ndarray]

SHAPES = [lit for lit in STUDIED + FINE if lit.shape is not None and not lit.textures]
each_shape = pytest.mark.parametrize("lit", SHAPES, ids=lambda lit: lit.name)


def matrix_of(shape: Settings) -> np.ndarray:
    return np.asarray(shape.get("to_world", np.eye(4)), float)


def place(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def rectangle(shape: Settings, uv: np.ndarray) -> np.ndarray:
    return place(matrix_of(shape), np.column_stack([2 * uv - 1, np.zeros(len(uv))]))


def disk(shape: Settings, uv: np.ndarray) -> np.ndarray:
    radius, angle = uv[:, 0], 2 * np.pi * uv[:, 1]
    flat = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(len(uv))], axis=1)
    return place(matrix_of(shape), flat)


def sphere(shape: Settings, uv: np.ndarray) -> np.ndarray:
    phi, theta = 2 * np.pi * uv[:, 0], np.pi * uv[:, 1]
    unit = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
    return place(matrix_of(shape), unit * shape.get("radius", 1) + np.array(shape.get("center", (0, 0, 0))))


def cylinder_axis(shape: Settings) -> tuple[np.ndarray, np.ndarray, float]:
    """The axis in world space: start, vector to the end, radius."""
    matrix = matrix_of(shape)
    ends = place(matrix, np.array([shape.get("p0", (0, 0, 0)), shape.get("p1", (0, 0, 1))], float))
    return ends[0], ends[1] - ends[0], shape.get("radius", 1) * np.cbrt(np.linalg.det(matrix[:3, :3]))


# The parametrisation of shapes whose texture coordinates have one that is fixed.
PARAMETRISED = {"rectangle": rectangle, "disk": disk, "sphere": sphere}

# Coordinates of points in the unit square in which equal areas have equal measure.
EQUAL_AREA: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "rectangle": lambda uv: uv,
    "disk": lambda uv: np.stack([uv[:, 0] ** 2, uv[:, 1]], axis=1),
    "sphere": lambda uv: np.stack([uv[:, 0], (1 - np.cos(np.pi * uv[:, 1])) / 2], axis=1),
    "cylinder": lambda uv: uv,
    "mesh": lambda b: np.stack([b.sum(1) ** 2, b[:, 1] / np.maximum(b.sum(1), 1e-9)], axis=1),
}

CURVATURE: dict[str, Callable[[Settings], float]] = {
    "rectangle": lambda s: 0,
    "disk": lambda s: 0,
    "sphere": lambda s: 1 / (s.get("radius", 1) * np.cbrt(np.linalg.det(matrix_of(s)[:3, :3]))),
    "cylinder": lambda s: 0.5 / cylinder_axis(s)[2],
}


def corners_of(shape: Settings) -> np.ndarray:
    """The corners of a mesh's triangles in world space, (M, 3, 3)."""
    mesh = shape["mesh"]
    return place(matrix_of(shape), np.asarray(mesh.vertices, float))[np.asarray(mesh.faces)]


def barycentric_points(shape: Settings, primitive: np.ndarray, b: np.ndarray) -> np.ndarray:
    a, e1, e2 = (lambda c: (c[:, 0], c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]))(corners_of(shape)[primitive])
    return a + e1 * b[:, :1] + e2 * b[:, 1:]


def sampled(lit: Lit, count: int = 20_000) -> Arrays:
    return _core_testing.shape_sample_many(lit.scene, 0, uniforms(generator("shape", lit.name), count, 3))


def hits_on(lit: Lit, count: int = 2000) -> tuple[np.ndarray, np.ndarray, Arrays]:
    """Rays from around a shape towards it that hit: origins, directions, hits."""
    rng = generator("rays", lit.name)
    targets = sampled(lit, count)["position"].astype(float)
    extent = np.ptp(targets, axis=0).max()
    around = rng.normal(size=(count, 3))
    origins = targets.mean(0) + 3 * extent * around / np.linalg.norm(around, axis=1, keepdims=True)
    directions = targets - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins, directions = origins.astype(np.float32), directions.astype(np.float32)
    hits = _core_testing.hit_many(lit.scene, origins, directions)
    valid = hits["valid"]
    assert valid.mean() > 0.95  # rays towards an edge may miss
    return origins[valid], directions[valid], {k: v[valid] for k, v in hits.items()}


def largest(points: np.ndarray) -> float:
    return float(np.abs(points).max())


@each_shape
def test_sampled_points_are_where_rays_meet_the_shape(lit: Lit) -> None:
    s = sampled(lit, 5000)
    step = 0.01 * np.ptp(s["position"], axis=0).max()
    origins = s["position"] + np.float32(step) * s["normal"]
    hits = _core_testing.hit_many(lit.scene, origins, -s["normal"])
    near = hits["valid"] & (np.abs(hits["distance"] - step) < 0.1 * step)
    assert near.mean() > 0.99  # at an edge a neighbour may be nearer
    error = EXACT * largest(s["position"])
    assert np.abs(hits["position"] - s["position"])[near].max() < 2 * error
    assert ((s["normal"] * hits["normal"]).sum(1)[near] > 1 - 1e-5).all()
    assert (s["position_error"] > 0).all()
    if lit.shape["type"] == "sphere":  # hits are more exact than sampled points
        off = np.linalg.norm(s["position"] - hits["position"], axis=1)
        assert (off < 2 * s["position_error"])[near].all()
    else:
        assert (s["position_error"] == hits["position_error"])[near].all()
    same = near & (hits["primitive"] == s["primitive"])
    assert same.mean() > 0.99
    if lit.shape["type"] in ("mesh", "rectangle"):
        assert np.abs(hits["barycentric"] - s["barycentric"])[same].max() < 1e-3


@each_shape
def test_sampled_points_are_uniform_by_area(lit: Lit) -> None:
    s = sampled(lit)
    shape = lit.shape
    hits = _core_testing.hit_many(
        lit.scene, s["position"] + s["position_error"][:, None] * s["normal"], -s["normal"]
    )
    coordinates = EQUAL_AREA[shape["type"]](s["barycentric"] if shape["type"] == "mesh" else hits["uv"])
    cell = np.clip(coordinates * CELLS, 0, CELLS - 1).astype(int) @ [CELLS, 1]
    counts = np.bincount(cell, minlength=CELLS**2)
    p = chi_square(counts, np.full(CELLS**2, len(cell) / CELLS**2))
    require(p > LEVEL, f"{lit.name}: not uniform (p = {p:.1e})")
    if shape["type"] != "mesh":
        return
    c = corners_of(shape)
    areas = np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1) / 2
    np.testing.assert_allclose(s["area_pdf"], 1 / areas.sum(), rtol=1e-5)
    counts = np.bincount(s["primitive"], minlength=len(areas))
    p = chi_square(counts, len(cell) * areas / areas.sum())
    require(p > LEVEL, f"{lit.name}: triangles are not drawn by area (p = {p:.1e})")


@each_shape
def test_hits_lie_on_the_ray_and_on_the_shape(lit: Lit) -> None:
    origins, directions, hits = hits_on(lit)
    shape, size = lit.shape, max(largest(origins), largest(hits["position"]))
    along = origins + hits["distance"][:, None] * directions.astype(float)
    slope = np.abs((hits["normal"] * directions).sum(1))
    off_ray = np.linalg.norm(along - hits["position"], axis=1)
    assert (off_ray * np.maximum(slope, 1e-3) < EXACT * size).all()
    if shape["type"] in PARAMETRISED:
        on_shape = PARAMETRISED[shape["type"]](shape, hits["uv"].astype(float))
    elif shape["type"] == "cylinder":
        start, axis, radius = cylinder_axis(shape)
        local = hits["position"] - start - hits["uv"][:, 1:] * axis
        assert np.abs(local @ axis).max() / np.linalg.norm(axis) < EXACT * size
        on_shape = start + hits["uv"][:, 1:] * axis + radius * local / np.linalg.norm(local, axis=1)[:, None]
    else:
        on_shape = barycentric_points(shape, hits["primitive"], hits["barycentric"].astype(float))
    assert np.abs(hits["position"] - on_shape).max() < EXACT * size
    assert np.linalg.norm(hits["position"] - on_shape, axis=1).max() < hits["position_error"].max()


@each_shape
def test_normals_point_outwards(lit: Lit) -> None:
    _, _, hits = hits_on(lit)
    shape, matrix = lit.shape, matrix_of(lit.shape)
    if shape["type"] in ("rectangle", "disk"):
        expected = np.tile(np.linalg.inv(matrix)[2, :3], (len(hits["normal"]), 1))
    elif shape["type"] == "sphere":
        expected = hits["position"] - place(matrix, np.array([shape.get("center", (0, 0, 0))], float))
    elif shape["type"] == "cylinder":
        start, axis, _ = cylinder_axis(shape)
        expected = hits["position"] - start - hits["uv"][:, 1:] * axis
    else:
        c = corners_of(shape)[hits["primitive"]]
        expected = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    if shape.get("flip_normals"):
        expected = -expected
    np.testing.assert_allclose(hits["normal"], expected, atol=2e-5)
    assert ((hits["normal"] * hits["shading_normal"]).sum(1) > 0).all()


@each_shape
def test_derivatives_are_those_of_the_parametrisation(lit: Lit) -> None:
    """Positions and texture coordinates of neighbouring rays differ as dp/du and dp/dv say."""
    origins, directions, hits = hits_on(lit)
    rng = generator("neighbours", lit.name)
    nudge = 1e-3 * rng.normal(size=directions.shape)
    sides = []
    for sign in (1, -1):
        turned = directions + sign * nudge
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        sides.append(_core_testing.hit_many(lit.scene, origins, turned.astype(np.float32)))
    after, before = sides
    kept = after["valid"] & before["valid"] & (after["primitive"] == before["primitive"])
    kept &= np.abs((directions * hits["normal"]).sum(1)) > 0.3
    step_uv = (after["uv"] - before["uv"]).astype(float)
    step = (after["position"] - before["position"]).astype(float)
    kept &= (np.abs(step_uv) < 0.05).all(1) & (np.linalg.norm(step, axis=1) < 0.1)
    predicted = hits["dp_du"] * step_uv[:, :1] + hits["dp_dv"] * step_uv[:, 1:]
    difference = np.linalg.norm(predicted - step, axis=1)[kept] / np.linalg.norm(step, axis=1)[kept]
    assert kept.mean() > 0.3
    assert np.quantile(difference, 0.9) < 0.01


@each_shape
def test_mean_curvature(lit: Lit) -> None:
    _, _, hits = hits_on(lit)
    sign = -1 if lit.shape.get("flip_normals") else 1
    if lit.shape["type"] in CURVATURE:
        expected = sign * CURVATURE[lit.shape["type"]](lit.shape)
        np.testing.assert_allclose(hits["mean_curvature"], expected, rtol=1e-5)
    elif lit.shape["mesh"].normals is None:
        assert (hits["mean_curvature"] == 0).all()
    else:  # of the unit sphere in triangles
        np.testing.assert_allclose(np.median(hits["mean_curvature"]), sign, rtol=0.01)
        assert (np.abs(hits["mean_curvature"] - sign) < 0.1).mean() > 0.9


def test_meshes_are_hit_where_every_triangle_says() -> None:
    """Against Möller and Trumbore's intersection of all triangles, in double precision."""
    for lit in SHAPES:
        if lit.shape["type"] != "mesh":
            continue
        origins, directions, hits = hits_on(lit, 300)
        distances, _, _ = moller_trumbore(origins, directions, corners_of(lit.shape))
        nearest = distances.min(1)
        agree = np.abs(nearest - hits["distance"]) < 1e-4 * nearest
        assert agree.mean() > 0.995, lit.name  # the rest passes by an edge


def test_ids_of_hits() -> None:
    shapes = [
        {"type": "sphere", "center": [0, 0, 3], "material": 1},
        {"type": "sphere", "center": [0, 3, 0], "emitter": 0, "material": 0},
    ]
    materials = [{"front": 0}, {"front": 0}]
    scene = make_scene(shapes=shapes, emitters=[{"type": "area"}], materials=materials)
    directions = np.array([[0, 0, 1], [0, 1, 0], [1, 0, 0]], np.float32)
    hits = _core_testing.hit_many(scene, np.zeros((1, 3), np.float32), directions)
    assert hits["valid"].tolist() == [True, True, False]
    assert hits["shape"][:2].tolist() == [0, 1]
    assert hits["material"][:2].tolist() == [1, 0]
    assert hits["emitter"][:2].tolist() == [-1, 0]


# Convex objects of size one around the origin, in scales and at distances from the origin in their sizes.
CONVEX: dict[str, Settings] = {
    "sphere": {"type": "sphere"},
    "rectangle": {"type": "rectangle", "to_world": rotation((1, 2, 3), 50)},
    "disk": {"type": "disk", "to_world": rotation((1, 2, 3), 50)},
    "box": {"type": "mesh", "mesh": box_mesh(), "to_world": rotation((1, 2, 3), 50)},
    "faceted sphere": {"type": "mesh", "mesh": uv_sphere(24, 12, smooth=False)},
}
SCALES = (1e-4, 1, 1e6)
PLACES = ((0, 0, 0), (20, -30, 10), (700, 500, -600))
each_placement = pytest.mark.parametrize(
    "name, scale, at", [(n, s, p) for n in CONVEX for s in SCALES for p in PLACES]
)


def placed(shape: Settings, scale: float, at: tuple[float, float, float]) -> Settings:
    return {**shape, "to_world": scaling(scale) @ translation(*at) @ matrix_of(shape)}


def opposite(scale: float, at: tuple[float, float, float]) -> list[Settings]:
    """A grain at the other end, so that the scene's centre, hence its origin, stays where it is."""
    place = scaling(scale) @ translation(*(-x for x in at)) @ scaling(1e-3)
    return [{"type": "sphere", "to_world": place, "material": 0}] if any(at) else []


def facing(vectors: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Vectors turned over where they point away from a side."""
    return vectors * np.where((vectors * side).sum(1, keepdims=True) < 0, -1, 1)


@each_placement
def test_rays_that_leave_a_convex_object_do_not_meet_it_again(
    name: str, scale: float, at: tuple[float, float, float]
) -> None:
    scene = make_scene(shapes=[placed(CONVEX[name], scale, at), *opposite(scale, at)])
    rng = generator("leave", name, scale, at)
    count = 20_000
    center = scale * np.array(at)
    targets = center + scale * rng.uniform(-0.6, 0.6, (count, 3))
    around = rng.normal(size=(count, 3))
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    origins = (center + scale * rng.choice([3, 30, 300], (count, 1)) * around).astype(np.float32)
    directions = targets - origins
    directions = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)
    met = _core_testing.hit_many(scene, origins, directions)["valid"]
    assert met.sum() > 1000
    origins, directions = origins[met], directions[met]
    normals = facing(_core_testing.hit_many(scene, origins, directions)["normal"], -directions)
    onward = facing(rng.normal(size=normals.shape), normals)
    sideways = np.cross(normals, onward) + 1e-3 * normals
    onward = np.where(rng.random((len(normals), 1)) < 0.5, sideways, onward)
    onward = (onward / np.linalg.norm(onward, axis=1, keepdims=True)).astype(np.float32)
    starts = _core_testing.leave_many(scene, origins, directions, onward)
    assert not _core_testing.hit_many(scene, starts, onward)["valid"].any()


@each_placement
def test_a_convex_object_does_not_shadow_itself(
    name: str, scale: float, at: tuple[float, float, float]
) -> None:
    """A white object in a white room without walls is invisible."""
    center = scale * np.array(at)
    distance = 4 * scale
    eye = look_at(center + distance * np.array([0.5, 0.6, -0.62]), center)
    for strategy in ("bsdf", "light"):
        scene = make_scene(
            shapes=[{**placed(CONVEX[name], scale, at), "material": 0}, *opposite(scale, at)],
            emitters=[{"type": "constant", "radiance": 1}],
            sensor={
                "type": "perspective",
                "to_world": eye,
                "fov": 35,
                "near_clip": 0.01 * scale,
                "far_clip": 1e4 * scale,
            },
            size=(24, 24),
            max_depth=2,
            strategy=strategy,
        )
        image = picture(scene, 16)
        if strategy == "bsdf":
            assert np.abs(image - 1).max() < 1e-5
        else:
            assert np.abs(image.mean() - 1) < 0.05  # noisy, but any occlusion would show in the other picture


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("at", PLACES)
@pytest.mark.parametrize("walls", ["mesh", "rectangles"])
def test_a_closed_box_is_dark(walls: str, at: tuple[float, float, float], scale: float) -> None:
    """No light leaks in through edges and corners, but for positions that are rounded to their far side:
    these are as rare as the last place of coordinates is small beside the box."""
    turned, samples, bounces = rotation((1, 2, 3), 50), 16, 12
    if walls == "mesh":
        shapes = [{"type": "mesh", "mesh": box_mesh(), "to_world": turned}]
    else:
        sides = [rotation(axis, angle) for axis, angle in (((1, 0, 0), 90), ((0, 1, 0), 90), ((0, 0, 1), 0))]
        shapes = [
            {"type": "rectangle", "to_world": turned @ side @ translation(0, 0, z)}
            for side in sides
            for z in (-1, 1)
        ]
    scene = make_scene(
        shapes=[{**placed(s, scale, at), "material": 0} for s in shapes],
        emitters=[{"type": "constant", "radiance": 1}],
        sensor={
            "type": "perspective",
            "to_world": look_at(scale * np.array(at), scale * np.add(at, (1, 2, 3))),
            "fov": 120,
            "near_clip": 0,
            "far_clip": 100 * scale,
        },
        size=(32, 32),
        max_depth=bounces + 1,
        rr_depth=100,
        strategy="bsdf",
    )
    leaks = picture(scene, samples)[..., 0].sum() * samples
    rounded = samples * 32 * 32 * bounces * 2**-23 * (1 + np.linalg.norm(at))
    assert leaks <= stats.poisson.isf(LEVEL, rounded)


def test_number_of_tests() -> None:
    assert len(SHAPES) * 2 < TESTS / 10
