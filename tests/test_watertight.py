"""Ray queries against Möller and Trumbore's intersection, and closed meshes that no ray may leave.

`LAJOLLA_RAYS=12500000 ./lajolla test tests/test_watertight.py` takes as many rays as the figures in
docs/testing.md: 10^7 against Möller and Trumbore, and 10^8 in closed meshes.
"""

from __future__ import annotations

import os
from collections.abc import Iterator

import numpy as np
import pytest
from ray_tools import moller_trumbore
from scene_tools import box_mesh, make_scene
from statistics_tools import generator

import lajolla
from lajolla import _core, _core_testing

RAYS = int(os.environ.get("LAJOLLA_RAYS", "50000"))
CHUNK = 100_000  # rays at a time
CLOSE = 3e-6  # of the size of a mesh: nearer to an edge, rounding decides

OCTAHEDRON = np.array([(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], float)
OCTANTS = [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4), (1, 0, 5), (2, 1, 5), (3, 2, 5), (0, 3, 5)]


def split(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each triangle in four; the midpoint of an edge is one vertex, which both of its triangles use."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, index = np.unique(edges, axis=0, return_inverse=True)
    ab, bc, ca = index.reshape(3, -1) + len(vertices)
    a, b, c = faces.T
    corners = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return (
        np.concatenate([vertices, vertices[unique].mean(1)]),
        np.concatenate([np.stack(corner, axis=1) for corner in corners]),
    )


def ball(levels: int, bumps: float = 0, stretch: tuple[float, float, float] = (1, 1, 1)) -> _core.Mesh:
    """A closed mesh around the origin: a ball of 8 * 4^levels triangles."""
    vertices, faces = OCTAHEDRON, np.array(OCTANTS)
    for _ in range(levels):
        vertices, faces = split(vertices, faces)
    vertices = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    radii = 1 + bumps * generator("bumps").uniform(-1, 1, (len(vertices), 1))
    return _core.Mesh((vertices * radii * stretch).astype(np.float32), faces.astype(np.uint32))


CLOSED = {
    "box": box_mesh(),
    "ball": ball(3),
    "rough ball": ball(5, bumps=0.2),
    "needle": ball(3, stretch=(1, 0.01, 0.01)),
}
each_mesh = pytest.mark.parametrize("name", CLOSED)


def corners_of(mesh: _core.Mesh) -> np.ndarray:
    return np.asarray(mesh.vertices, float)[np.asarray(mesh.faces)]


def thinness_of(corners: np.ndarray) -> np.ndarray:
    """The longest edge over the least height (M,): by so much barycentric coordinates enlarge errors."""
    edges = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(edges, axis=-1).max(1)
    return longest**2 / np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=-1)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def chunks(count: int) -> Iterator[int]:
    for first in range(0, count, CHUNK):
        yield min(CHUNK, count - first)


def some_rays(
    mesh: _core.Mesh, kind: str, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Rays from around a mesh to points of its bounding box; or grazing, nearly in a triangle's plane."""
    corners = corners_of(mesh)
    extent = np.abs(corners).max((0, 1))
    if kind == "random":
        origins = 3 * extent * unit(rng.normal(size=(count, 3)))
        return origins, unit(extent * rng.uniform(-1, 1, (count, 3)) - origins)
    a, e1, e2 = (lambda c: (c[:, 0], c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]))(
        corners[rng.integers(len(corners), size=count)]
    )
    b = np.sort(rng.random((count, 2)), axis=1)
    point = a + e1 * b[:, :1] + e2 * (b[:, 1:] - b[:, :1])
    angle = rng.uniform(0, 2 * np.pi, (count, 1))
    along = unit(e1) * np.cos(angle) + unit(np.cross(np.cross(e1, e2), e1)) * np.sin(angle)
    direction = unit(along + unit(np.cross(e1, e2)) * 10 ** rng.uniform(-4, -1, (count, 1)))
    return point - direction * np.linalg.norm(extent), direction


@pytest.mark.parametrize("name", ["box", "ball", "needle"])
@pytest.mark.parametrize("kind", ["random", "grazing"])
@pytest.mark.parametrize("robust", [False, True])
def test_hits_are_those_of_moller_and_trumbore(name: str, kind: str, robust: bool) -> None:
    """The same triangle at the same distance; except near edges, where rounding decides."""
    mesh = CLOSED[name]
    corners = corners_of(mesh)
    scene = make_scene(shapes=[{"type": "mesh", "mesh": mesh}], robust=robust)
    rng = generator("moller", name, kind)
    size = np.abs(corners).max()
    thinness = thinness_of(corners)
    for _ in range(0, RAYS // 15, 1000):
        origins, directions = (v.astype(np.float32) for v in some_rays(mesh, kind, 1000, rng))
        distances, inside, cosine = moller_trumbore(origins, directions, corners)
        hits = _core_testing.hit_many(scene, origins, directions)
        # Rounding moves a ray by ulps of the coordinates, on a surface by 1 / cosine as much.
        clear = (np.abs(inside) * cosine > CLOSE * size).all(1)
        found = np.isfinite(distances.min(1))
        assert (hits["valid"] == found)[clear].all()
        compared, nearest = np.flatnonzero(clear & found), distances.argmin(1)
        assert (hits["primitive"] == nearest)[compared].all()
        position = origins + directions * distances.min(1)[:, None]
        error = np.abs(hits["position"] - position).max(1) * cosine[np.arange(1000), nearest]
        assert (error < CLOSE * size * thinness[nearest])[compared].all()


def inner_rays(
    mesh: _core.Mesh, aim: str, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Rays from near the centre in any direction, or to points of edges, or to vertices."""
    corners = corners_of(mesh)
    extent = np.abs(corners).max((0, 1))
    origins = (0.1 * extent * rng.uniform(-1, 1, (count, 3))).astype(np.float32)
    if aim == "anywhere":
        return origins, unit(extent * rng.normal(size=(count, 3))).astype(np.float32)
    triangle = corners[rng.integers(len(corners), size=count)]
    along = rng.random((count, 1)) if aim == "edges" else 0
    targets = triangle[:, 0] + (triangle[:, 1] - triangle[:, 0]) * along
    return origins, unit(targets - origins).astype(np.float32)


def escaped(name: str, aim: str, *, robust: bool, count: int = RAYS) -> int:
    """How many rays leave a closed mesh."""
    scene = make_scene(shapes=[{"type": "mesh", "mesh": CLOSED[name]}], robust=robust)
    rng = generator("inside", name, aim)
    return sum(
        int((~_core_testing.hit_many(scene, *inner_rays(CLOSED[name], aim, size, rng))["valid"]).sum())
        for size in chunks(count)
    )


@each_mesh
@pytest.mark.parametrize("aim", ["anywhere", "edges"])
def test_no_ray_leaves_a_closed_mesh(name: str, aim: str) -> None:
    assert escaped(name, aim, robust=True) == 0


@each_mesh
def test_more_rays_leave_it_otherwise(name: str) -> None:
    """Of those aimed at edges and vertices; at a vertex, Embree rounds each edge by itself even if robust."""
    assert escaped(name, "edges", robust=False) > 0
    assert escaped(name, "vertices", robust=True) < 0.005 * RAYS < escaped(name, "vertices", robust=False)


def test_scenes_choose() -> None:
    mesh = CLOSED["box"]
    plain = {"type": "scene", "sensor": {"type": "perspective"}, "box": {"type": "mesh", "mesh": mesh}}
    given = {**plain, "embree_use_robust_intersections": True}
    assert "robust" not in lajolla.load_dict(plain).description.core
    assert lajolla.load_dict(given).description.core["robust"] is True
    options = lajolla.load_dict(given, robust=False)
    origins, directions = inner_rays(mesh, "edges", 10_000, generator("chosen"))
    assert lajolla.load_dict(given).intersect(origins, directions).hit.all()
    assert not options.intersect(origins, directions).hit.all()
