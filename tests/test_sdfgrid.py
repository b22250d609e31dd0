"""Signed distance grids: hits against closed forms and Mitsuba, height fields, their files."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from reader_tools import error_of, messages, read
from scene_tools import Settings, make_scene, rotation, scaling, translation
from statistics_tools import generator

from lajolla import _core, _core_testing

PLACE = translation(3, -2, 1) @ rotation((1, 2, 3), 40) @ scaling(2)


def distances(size: tuple[int, int, int], radius: float = 0.3) -> np.ndarray:
    """Distances to a sphere around (0.5, 0.5, 0.5) at the points of a grid over the unit cube, [z, y, x]."""
    axes = [np.linspace(0, 1, n) - 0.5 for n in size]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    return (np.sqrt(x**2 + y**2 + z**2) - radius).transpose(2, 1, 0).astype(np.float32)


def sdf(values: np.ndarray, matrix: np.ndarray = PLACE, normals: str = "smooth") -> Settings:
    grid = _core.Grid(np.ascontiguousarray(values[..., None]))
    return {"type": "sdfgrid", "grid": grid, "to_world": matrix, "normals": normals}


def rays_at(matrix: np.ndarray, count: int, *name: object) -> tuple[np.ndarray, np.ndarray]:
    rng = generator("sdfgrid", *name)
    targets = rng.uniform(0.2, 0.8, (count, 3)) @ matrix[:3, :3].T + matrix[:3, 3]
    around = rng.normal(size=(count, 3))
    size = np.linalg.norm(matrix[:3, :3])
    origins = targets + 5 * size * around / np.linalg.norm(around, axis=1, keepdims=True)
    directions = (targets - origins) / np.linalg.norm(targets - origins, axis=1, keepdims=True)
    return origins.astype(np.float32), directions.astype(np.float32)


def to_cube(points: np.ndarray, matrix: np.ndarray = PLACE) -> np.ndarray:
    return (points - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T


def interpolate(values: np.ndarray, points: np.ndarray) -> np.ndarray:
    from scipy.interpolate import RegularGridInterpolator

    axes = [np.linspace(0, 1, n) for n in values.shape]
    return RegularGridInterpolator(axes, values.astype(float))(np.clip(points[:, ::-1], 0, 1))


def test_a_sphere_of_distances() -> None:
    origins, directions = rays_at(PLACE, 4000, "sphere")
    values = distances((33, 41, 37))
    for normals, most in (("smooth", 0.05), ("analytic", 0.15)):
        hits = _core_testing.hit_many(make_scene(shapes=[sdf(values, normals=normals)]), origins, directions)
        exact = _core_testing.hit_many(
            make_scene(
                shapes=[{"type": "sphere", "center": (0.5, 0.5, 0.5), "radius": 0.3, "to_world": PLACE}]
            ),
            origins,
            directions,
        )
        slope = np.abs((exact["normal"] * directions).sum(1))
        both = exact["valid"] & (slope > 0.2)
        assert hits["valid"][both].all()
        assert not (hits["valid"] & ~exact["valid"]).any() or (hits["valid"] & ~exact["valid"]).mean() < 0.01
        assert np.abs(hits["distance"] - exact["distance"])[both].max() < 0.01
        assert np.abs(hits["shading_normal"] - exact["normal"])[both].max() < most
        np.testing.assert_allclose(np.median(hits["mean_curvature"][both]), 1 / 0.6, rtol=0.05)


@pytest.mark.parametrize(
    "matrix", [PLACE, translation(1, 0, 0) @ scaling(0.5, 3, -1)], ids=["even", "uneven"]
)
def test_hits_are_the_first_zeros_of_the_interpolant(matrix: np.ndarray) -> None:
    """A rough surface, against sampling along the rays."""
    values = generator("rough").normal(size=(7, 5, 6)).astype(np.float32)
    origins, directions = rays_at(matrix, 2000, "rough", matrix.tobytes())
    hits = _core_testing.hit_many(make_scene(shapes=[sdf(values, matrix)]), origins, directions)
    met = hits["valid"]
    assert met.mean() > 0.5
    p = to_cube(hits["position"].astype(float), matrix)
    assert np.abs(interpolate(values, p))[met].max() < 2e-4
    along = origins + hits["distance"][:, None].astype(float) * directions
    off = np.linalg.norm(np.cross(along - hits["position"], directions), axis=1)
    assert np.quantile(off[met], 0.99) < 1e-4
    local_origins, local_ends = to_cube(origins.astype(float), matrix), to_cube(along, matrix)
    for t in np.linspace(0, 0.9999, 400):
        q = local_origins + t * (local_ends - local_origins)
        inside = met & ((q > 1e-3) & (q < 1 - 1e-3)).all(1)
        start = np.where((interpolate(values, p - 1e-3 * (local_ends - local_origins))) > 0, 1, -1)
        wrong = inside & (interpolate(values, q) * start < -2e-2)
        assert wrong.mean() < 0.01


@pytest.mark.parametrize("scale", [1e-3, 1, 1e4])
def test_rays_that_leave_a_ball_do_not_meet_it_again(scale: float) -> None:
    matrix = scaling(scale) @ PLACE
    scene = make_scene(shapes=[sdf(distances((17, 17, 17)), matrix, "analytic")])
    origins, directions = rays_at(matrix, 20_000, "leave", scale)
    hits = _core_testing.hit_many(scene, origins, directions)
    met = hits["valid"]
    origins, directions, normal = origins[met], directions[met], hits["normal"][met]
    assert ((normal * directions).sum(1) < 1e-3).all()
    center = matrix[:3, :3] @ [0.5, 0.5, 0.5] + matrix[:3, 3]
    outward = hits["position"][met] - center
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    onward = generator("onward", scale).normal(size=normal.shape)
    onward = onward * np.where((onward * normal).sum(1, keepdims=True) < 0, -1, 1) + 0.3 * normal
    onward = (onward / np.linalg.norm(onward, axis=1, keepdims=True)).astype(np.float32)
    steep = (onward * outward).sum(1) > 0.25  # the interpolant is not convex
    starts = _core_testing.leave_many(scene, origins, directions, onward)
    assert not _core_testing.hit_many(scene, starts, onward)["valid"][steep].any()


def vol(values: np.ndarray) -> bytes:
    depth, height, width = values.shape
    head = struct.pack("<3sB5i6f", b"VOL", 3, 1, width, height, depth, 1, 0, 0, 0, 1, 1, 1)
    return head + values.astype("<f4").tobytes()


@pytest.mark.parametrize("normals", ["smooth", "analytic"])
def test_hits_agree_with_mitsuba(normals: str, tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    (tmp_path / "g.vol").write_bytes(vol(distances((10, 10, 10))))  # Mitsuba mixes up the axes of others
    body = f"""<shape type="sdfgrid"><string name="filename" value="{tmp_path}/g.vol"/>
      <string name="normals" value="{normals}"/>
      <transform name="to_world"><scale x="2" y="3" z="1.5"/><translate x="1"/></transform></shape>"""
    core = read(tmp_path, body).core
    origins, directions = rays_at(core["shapes"][0]["to_world"], 800, "mitsuba", normals)
    hits = _core_testing.hit_many(_core.Scene(core), origins, directions)
    scene = mi.load_string(f'<scene version="3.0.0"><integrator type="path"/>{body}</scene>')
    theirs = [
        scene.ray_intersect(mi.Ray3f(mi.Point3f(*map(float, o)), mi.Vector3f(*map(float, d))))
        for o, d in zip(origins, directions, strict=True)
    ]
    valid = np.array([si.is_valid() for si in theirs])
    assert (valid == hits["valid"]).mean() > 0.99
    both = valid & hits["valid"]
    for mine, name in (("position", "p"), ("normal", "n"), ("shading_normal", None)):
        expected = np.array([np.array(getattr(si, name) if name else si.sh_frame.n) for si in theirs])
        assert np.quantile(np.abs(expected - hits[mine])[both], 0.97) < 2e-4, mine


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.zeros((1, 4, 4)), "two values"),
        (np.full((4, 4, 4), np.nan), "not finite"),
    ],
)
def test_broken_grids(tmp_path: Path, values: np.ndarray, message: str) -> None:
    (tmp_path / "g.vol").write_bytes(vol(values))
    body = '<shape type="sdfgrid"><string name="filename" value="g.vol"/></shape>'
    assert message in error_of(tmp_path, body)


def test_an_empty_surface_is_not_seen() -> None:
    for values in (np.ones((4, 4, 4)), np.zeros((4, 4, 4))):
        scene = make_scene(shapes=[sdf(values.astype(np.float32))])
        assert not _core_testing.hit_many(scene, *rays_at(PLACE, 100, "empty"))["valid"].any()


@pytest.mark.parametrize("unit", [1e-38, 1e30])
def test_the_unit_of_distances_does_not_matter(unit: float) -> None:
    origins, directions = rays_at(PLACE, 500, "unit")
    plain, scaled = (
        _core_testing.hit_many(
            make_scene(shapes=[sdf(distances((9, 9, 9)) * np.float32(u))]), origins, directions
        )
        for u in (1, unit)
    )
    assert (plain["valid"] == scaled["valid"]).all()
    for key in ("position", "shading_normal", "mean_curvature"):
        np.testing.assert_allclose(scaled[key], plain[key], rtol=1e-3, atol=1e-4)


def test_sdf_grids_do_not_shine(tmp_path: Path) -> None:
    (tmp_path / "g.vol").write_bytes(vol(distances((4, 4, 4))))
    body = '<shape type="sdfgrid"><string name="filename" value="g.vol"/><emitter type="area"/></shape>'
    description = read(tmp_path, body)
    assert any("emits no light" in text for text in messages(description, tmp_path))
    assert description.core["emitters"] == []


# Height fields


def test_height_fields(tmp_path: Path) -> None:
    x, y = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 5))
    heights = (0.25 * x + 0.5 * y).astype(np.float32)
    out = oiio.ImageOutput.create(str(tmp_path / "h.exr"))
    out.open(str(tmp_path / "h.exr"), oiio.ImageSpec(9, 5, 1, "float"))
    out.write_image(heights[..., None])
    out.close()
    name = '<string name="filename" value="h.exr"/>'
    for inside in (name, f'<texture type="bitmap">{name}</texture>'):
        body = f'<shape type="heightfield">{inside}<float name="scale" value="2"/></shape>'
        description = read(tmp_path, body, "0.6.0")
        assert not messages(description, tmp_path)
        scene = _core.Scene(description.core)
        origins = np.array([[0.3, -0.4, 9], [-0.9, 0.9, 9], [1.1, 0, 9]], np.float32)
        hits = _core_testing.hit_many(scene, origins, np.tile(np.array([[0, 0, -1]], np.float32), (3, 1)))
        assert hits["valid"].tolist() == [True, True, False]
        at = origins[:2]
        np.testing.assert_allclose(hits["position"][:2, 2], 0.5 * at[:, 0] + at[:, 1], atol=1e-5)
        np.testing.assert_allclose(hits["uv"][:2], (at[:, :2] + 1) / 2, atol=1e-5)
        expected = np.array([-0.5, -1, 1]) / 1.5
        np.testing.assert_allclose(hits["normal"][:2], [expected] * 2, atol=1e-5)
        np.testing.assert_allclose(hits["shading_normal"][:2], [expected] * 2, atol=1e-5)
    assert "filename" in error_of(tmp_path, '<shape type="heightfield"/>', "0.6.0")
