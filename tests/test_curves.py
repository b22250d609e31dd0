"""Curves: hits against closed forms, differences and Mitsuba; their files, broken ones too."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from reader_tools import error_of, messages, read
from scene_tools import Settings, make_scene, rotation, scaling, translation
from statistics_tools import generator

from lajolla import _core, _core_testing
from lajolla.scene.description.default_camera import default_camera
from lajolla.scene.formats.curves import read_hair, straightened

Arrays = dict[str, np.ndarray]

PLACE = translation(3, -2, 1) @ rotation((1, 2, 3), 40)


def curves(points: list[list[float]], basis: str = "linear", matrix: np.ndarray = PLACE) -> Settings:
    needed = {"linear": 2, "bspline": 4}[basis]
    segments = np.arange(len(points) - needed + 1, dtype=np.uint32)
    made = _core.Curves(np.array(points, np.float32), segments)
    return {"type": "curves", "curves": made, "basis": basis, "to_world": matrix}


def rays_at(points: np.ndarray, spread: float, count: int, *name: object) -> tuple[np.ndarray, np.ndarray]:
    """Rays from around towards places near points."""
    rng = generator("curves", *name)
    targets = points[rng.integers(len(points), size=count)] + rng.normal(size=(count, 3)) * spread
    around = rng.normal(size=(count, 3))
    origins = targets + 5 * around / np.linalg.norm(around, axis=1, keepdims=True)
    directions = (targets - origins) / 5
    return origins.astype(np.float32), directions.astype(np.float32)


def hits_of(shape: Settings, origins: np.ndarray, directions: np.ndarray) -> Arrays:
    return _core_testing.hit_many(make_scene(shapes=[shape]), origins, directions)


def to_local(points: np.ndarray) -> np.ndarray:
    return (points - PLACE[:3, 3]) @ PLACE[:3, :3]


def along_axis(count: int = 2000, *name: object) -> tuple[np.ndarray, np.ndarray]:
    axis = np.stack([np.zeros(50), np.zeros(50), np.linspace(-1.5, 1.5, 50)], axis=1)
    return rays_at(axis @ PLACE[:3, :3].T + PLACE[:3, 3], 0.1, count, *name)


STRAIGHT = {
    "linear": [[0.0, 0, -1, 0.2], [0, 0, 0.5, 0.2], [0, 0, 1, 0.2]],
    "bspline": [[0.0, 0, z, 0.2] for z in (-2, -1, 0, 1, 2)],
}


@pytest.mark.parametrize("basis", STRAIGHT)
def test_a_straight_curve_is_a_cylinder(basis: str) -> None:
    origins, directions = along_axis(2000, basis)
    hits = hits_of(curves(STRAIGHT[basis], basis), origins, directions)
    p = to_local(hits["position"].astype(float))
    tube = hits["valid"] & (np.abs(p[:, 2]) < 0.999)
    assert tube.mean() > 0.3
    p, normal = p[tube], (hits["normal"] @ PLACE[:3, :3])[tube]
    np.testing.assert_allclose(np.hypot(p[:, 0], p[:, 1]), 0.2, atol=3e-6)
    np.testing.assert_allclose(normal, p * [5, 5, 0], atol=2e-5)
    along = origins + hits["distance"][:, None] * directions
    assert np.abs(((along - hits["position"]) * hits["normal"]).sum(1))[tube].max() < 1e-5
    np.testing.assert_allclose(hits["mean_curvature"][tube], 2.5, rtol=1e-4)
    if basis == "bspline":
        np.testing.assert_allclose(hits["uv"][tube, 1], (p[:, 2] + 1) / 2, atol=2e-5)


def test_ends_of_linear_curves_are_round() -> None:
    origins, directions = along_axis(4000, "ends")
    hits = hits_of(curves(STRAIGHT["linear"]), origins, directions)
    p = to_local(hits["position"].astype(float))
    end = hits["valid"] & (p[:, 2] > 1.001)
    assert end.sum() > 50
    np.testing.assert_allclose(np.linalg.norm(p[end] - [0, 0, 1], axis=1), 0.2, atol=3e-6)
    np.testing.assert_allclose(hits["mean_curvature"][end], 5, rtol=1e-3)


WINDING = [
    [0.0, 0, 0, 0.1],
    [1, 0, 0.2, 0.12],
    [1.6, 0.8, 0.5, 0.08],
    [1.5, 1.6, 1, 0.1],
    [0.7, 2, 1.6, 0.15],
]


@pytest.mark.parametrize("basis", ["linear", "bspline"])
def test_tangents_predict_where_neighbouring_rays_hit(basis: str) -> None:
    points = np.array(WINDING)[:, :3] @ PLACE[:3, :3].T + PLACE[:3, 3]
    middle = np.concatenate([points * (1 - t) + np.roll(points, -1, 0) * t for t in (0.3, 0.6)])
    origins, directions = rays_at(middle, 0.1, 20_000, basis)
    moved = origins + generator("step", basis).normal(size=origins.shape).astype(np.float32) * np.float32(
        2e-4
    )
    shape = curves(WINDING, basis)
    hits, near = hits_of(shape, origins, directions), hits_of(shape, moved, directions)
    v = hits["uv"][:, 1] * (len(WINDING) - {"linear": 1, "bspline": 3}[basis])
    inner = np.abs(v - np.round(v)) > 0.02  # ends have no coordinates of their own
    kept = hits["valid"] & near["valid"] & (hits["primitive"] == near["primitive"]) & inner
    change = near["uv"].astype(float) - hits["uv"]
    kept &= (np.abs(change) < 0.01).all(1)
    assert kept.sum() > 500
    step = (near["position"].astype(float) - hits["position"])[kept]
    predicted = (hits["dp_du"] * change[:, :1] + hits["dp_dv"] * change[:, 1:])[kept]
    difference = np.linalg.norm(predicted - step, axis=1) / np.linalg.norm(step, axis=1)
    assert np.quantile(difference, 0.9) < 0.02
    for tangent in ("dp_du", "dp_dv"):
        length = np.linalg.norm(hits[tangent], axis=1)
        slant = np.abs((hits["normal"] * hits[tangent]).sum(1)) / np.maximum(length, 1e-9)
        assert np.quantile(slant[kept], 0.99) < 2e-3


@pytest.mark.parametrize("scale", [1e-2, 1, 1e3])
@pytest.mark.parametrize("basis", STRAIGHT)
def test_rays_that_leave_a_straight_curve_do_not_meet_it_again(basis: str, scale: float) -> None:
    origins, directions = along_axis(20_000, "leave", basis, scale)
    matrix = scaling(scale) @ PLACE
    points = [[*p[:3], p[3] * scale] for p in STRAIGHT[basis]]
    scene = make_scene(shapes=[curves(points, basis, matrix)])
    origins = (origins * scale).astype(np.float32)
    hits = _core_testing.hit_many(scene, origins, directions)
    met = hits["valid"]
    origins, directions, normal = origins[met], directions[met], hits["normal"][met]
    onward = generator("onward", basis, scale).normal(size=normal.shape)
    onward *= np.where((onward * normal).sum(1, keepdims=True) < 0, -1, 1)
    onward[::2] = (np.cross(normal, onward) + 1e-3 * normal)[::2]
    onward = (onward / np.linalg.norm(onward, axis=1, keepdims=True)).astype(np.float32)
    starts = _core_testing.leave_many(scene, origins, directions, onward)
    assert not _core_testing.hit_many(scene, starts, onward)["valid"].any()
    inwards = _core_testing.leave_many(scene, origins, directions, -onward)  # hit from outside only
    assert not _core_testing.hit_many(scene, inwards, -onward)["valid"].any()


@pytest.mark.parametrize("plugin", ["linearcurve", "bsplinecurve"])
def test_hits_agree_with_mitsuba(plugin: str, tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    lines = (
        ["{} {} {} {}".format(*p) for p in WINDING]
        + [""]
        + ["{} {} {} 0.1".format(*p[2::-1]) for p in WINDING]
    )
    (tmp_path / "c.txt").write_text("\n".join(lines))
    place = '<transform name="to_world"><scale value="1.5"/><rotate x="1" angle="30"/></transform>'
    body = f'<shape type="{plugin}"><string name="filename" value="{tmp_path}/c.txt"/>{place}</shape>'
    core = read(tmp_path, body).core
    points = np.asarray(core["shapes"][0]["curves"].points)[:, :3] @ core["shapes"][0]["to_world"][:3, :3].T
    origins, directions = rays_at(points, 0.3, 1500, "mitsuba", plugin)
    hits = _core_testing.hit_many(_core.Scene(core), origins, directions)
    scene = mi.load_string(f'<scene version="3.0.0"><integrator type="path"/>{body}</scene>')
    theirs = [
        scene.ray_intersect(mi.Ray3f(mi.Point3f(*map(float, o)), mi.Vector3f(*map(float, d))))
        for o, d in zip(origins, directions, strict=True)
    ]
    valid = np.array([si.is_valid() for si in theirs])
    assert (valid == hits["valid"]).mean() > 0.995
    both = valid & hits["valid"]
    assert both.sum() > 100
    for name, key in (("p", "position"), ("n", "normal"), ("uv", "uv")):
        expected = np.array([np.array(getattr(si, name)) for si in theirs])
        assert np.quantile(np.abs(expected - hits[key])[both], 0.99) < 2e-5, name


def test_curves_in_groups_are_scaled_as_a_whole() -> None:
    shape = curves(STRAIGHT["linear"], "linear", np.eye(4))
    description = {
        "shapes": [shape],
        "groups": [{"shapes": [0]}],
        "instances": [{"group": 0, "to_world": scaling(2)}],
        "integrator": {"type": "path"},
    }
    origins = np.array([[5, 0, 0.1]], np.float32)
    hits = _core_testing.hit_many(_core.Scene(description), origins, np.array([[-1, 0, 0]], np.float32))
    np.testing.assert_allclose(hits["position"][0], [0.4, 0, 0.1], atol=1e-5)


@pytest.mark.parametrize(
    ("points", "segments", "message"),
    [
        ([[0, 0, 0, 1]], [0], "beyond the last"),
        ([[0, 0, 0, -1], [0, 0, 1, 1]], [0], "below zero"),
        ([[0, 0, np.nan, 1], [0, 0, 1, 1]], [0], "not finite"),
    ],
)
def test_control_points_are_checked(points: list, segments: list, message: str) -> None:
    made = _core.Curves(np.array(points, np.float32), np.array(segments, np.uint32))
    with pytest.raises(_core.DescriptionError, match=message):
        make_scene(shapes=[{"type": "curves", "curves": made}])


def test_degenerate_curves_do_no_harm() -> None:
    for basis in ("linear", "bspline"):
        for radius in (0.0, 0.1):
            shape = curves([[0, 0, 0, radius]] * 5, basis, np.eye(4))
            rng = generator("degenerate", basis)
            directions = rng.normal(size=(500, 3)).astype(np.float32)
            hits = hits_of(shape, -3 * directions, directions)
            for values in hits.values():
                assert np.isfinite(values).all()


def test_curves_cannot_be_lights_in_the_core() -> None:
    with pytest.raises(_core.DescriptionError, match="cannot be a light"):
        make_scene(shapes=[{**curves(STRAIGHT["linear"]), "emitter": 0}], emitters=[{"type": "area"}])


# Files


def shape_of(name: str, plugin: str, extra: str = "") -> str:
    return f'<shape type="{plugin}"><string name="filename" value="{name}"/>{extra}</shape>'


def test_curve_files(tmp_path: Path) -> None:
    (tmp_path / "c.txt").write_bytes(b"0 0 0 .1\r\n1 0 0 .1 \r\n\r\n \n0 1 0 2e-1\n1 1 0 .2\n2 1 0 .2")
    shape = read(tmp_path, shape_of("c.txt", "linearcurve")).core["shapes"][0]
    assert shape["type"] == "curves" and shape["basis"] == "linear"
    assert np.asarray(shape["curves"].points).shape == (5, 4)
    assert np.asarray(shape["curves"].points)[2].tolist() == pytest.approx([0, 1, 0, 0.2])
    camera = default_camera([shape])
    assert np.isfinite(camera["to_world"]).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0 0 0 1\n0 0 1\n", "line 2: expected 4 numbers"),
        ("0 0 0 1\n0 0 1 x\n", "line 2: expected 4 numbers"),
        ("0 0 0 1\n0 0 1 inf\n", "point 2 is not finite"),
        ("0 0 0 1\n0 0 1 -1\n", "below zero"),
        ("\n\n", "no points"),
        ("0 0 0 1\n\n0 0 1 1\n0 0 2 1\n", "1 control points"),
        ("\0\1\2\xff", "line 1"),
    ],
)
def test_broken_curve_files(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "c.txt").write_text(text, encoding="latin-1")
    assert message in error_of(tmp_path, shape_of("c.txt", "linearcurve"))


HAIR = "# a head\n-1 0 0\n0 0 0\n1 0 0\n\n0 1 0\n0 2 0.5\n"


def binary(strands: list[np.ndarray], count: int | None = None) -> bytes:
    total = sum(map(len, strands)) if count is None else count
    body = b"".join(
        (struct.pack("<f", np.inf) if i else b"") + strand.astype("<f4").tobytes()
        for i, strand in enumerate(strands)
    )
    return b"BINARY_HAIR" + struct.pack("<I", total) + body


def test_hair_files(tmp_path: Path) -> None:
    strands = [np.array([[-1, 0, 0], [0, 0, 0], [1, 0, 0]]), np.array([[0, 1, 0], [0, 2, 0.5]])]
    (tmp_path / "h.txt").write_text(HAIR)
    (tmp_path / "h.bin").write_bytes(binary(strands))
    for name in ("h.txt", "h.bin"):
        points, first = read_hair(tmp_path / name)
        np.testing.assert_array_equal(points, np.concatenate(strands))
        assert first.tolist() == [0, 3]
    extra = '<float name="radius" value="0.5"/><transform name="toWorld"><scale value="2"/></transform>'
    shape = read(tmp_path, shape_of("h.bin", "hair", extra), "0.6.0").core["shapes"][0]
    points = np.asarray(shape["curves"].points)
    assert len(points) == 4 and (points[:, 3] == 1).all()  # the straight one has lost its middle
    half = '<float name="reduction" value="0.5"/>'
    many = [strand + i for i in range(100) for strand in strands]
    (tmp_path / "m.bin").write_bytes(binary(many))
    thin = read(tmp_path, shape_of("m.bin", "hair", half), "0.6.0").core["shapes"][0]["curves"]
    assert 150 < len(np.asarray(thin.points)) < 250
    assert np.asarray(thin.points)[0, 3] == np.float32(0.05)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"BINARY_HAIR", "ends early"),
        (binary([np.zeros((2, 3))], 3), "2 of 3 vertices"),
        (binary([np.zeros((2, 3))], 2**32 - 1), "vertices"),
        (b"BINARY_HAIR" + struct.pack("<I5f", 1, 0, np.inf, 0, 0, 0), "within a vertex"),
        (binary([np.full((2, 3), np.nan)]), "not finite"),
        (binary([]), "no points"),
        (b"", "no points"),
        (b"1 2\n", "line 1"),
    ],
)
def test_broken_hair_files(tmp_path: Path, data: bytes, message: str) -> None:
    (tmp_path / "h").write_bytes(data)
    assert message in error_of(tmp_path, shape_of("h", "hair"), "0.6.0")


def test_straight_parts_of_hair_are_joined_one_by_one() -> None:
    """Against the same, hair by hair and point by point."""
    rng = generator("straightened")
    sizes = rng.integers(1, 30, 200)
    points = np.cumsum(rng.normal((0, 0, 1), 0.2, (sizes.sum(), 3)), axis=0).astype(np.float32)
    points[rng.random(len(points)) < 0.1] = points[0]
    first = np.cumsum(np.append(0, sizes))[:-1]
    expected: list[np.ndarray] = []
    for start, size in zip(first, sizes, strict=True):
        kept: list[np.ndarray] = []
        last, tangent = points[start], None
        for p in points[start : start + size].astype(float):
            if kept and np.array_equal(p, last):
                continue
            step = p - last
            step /= max(np.linalg.norm(step), 1e-300)
            if tangent is not None and step @ tangent > np.cos(np.radians(15)):
                kept[-1] = p
                tangent = (p - kept[-2]) / np.linalg.norm(p - kept[-2])
            else:
                tangent = step if kept else None
                kept.append(p)
            last = p
        expected += kept
    joined, starts = straightened(points, first, 15)
    np.testing.assert_array_equal(joined, np.array(expected, np.float32))
    assert len(starts) == len(first) and len(joined) < 0.9 * len(points)


def test_shining_curves_are_tubes(tmp_path: Path) -> None:
    (tmp_path / "c.txt").write_text("0 0 0 .1\n1 0 0 .1\n2 1 0 .1\n2 2 2 .1\n")
    light = '<emitter type="area"/>'
    for plugin in ("linearcurve", "bsplinecurve"):
        description = read(tmp_path, shape_of("c.txt", plugin, light))
        assert any("mesh of tubes" in text for text in messages(description, tmp_path))
        scene = _core.Scene(description.core)
        origins, directions = rays_at(np.array([[1.5, 0.5, 0]]), 0.5, 2000, plugin)
        hits = _core_testing.hit_many(scene, origins, directions)
        assert hits["valid"].mean() > 0.05
        assert (hits["emitter"][hits["valid"]] == 0).all()
        outside = (hits["normal"] * directions).sum(1)[hits["valid"]] < 0
        assert outside.mean() > 0.9  # the rest looks into an open end
