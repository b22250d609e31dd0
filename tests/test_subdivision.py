"""Subdivision surfaces: limits, creases, borders, texture coordinates, and meshes without cracks."""

from __future__ import annotations

import itertools
import os
import warnings
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import pytest
from ptex_files import CUBE, CUBE_FACES
from scipy.spatial import cKDTree

import lajolla
from lajolla import _core
from lajolla.scene.description.plugins import subdivision

INFINITE = 10

Numbers: TypeAlias = npt.NDArray[Any]
Faces: TypeAlias = Sequence[Sequence[int]] | Numbers
Creases: TypeAlias = Sequence[tuple[int, int, float]]
Corners: TypeAlias = Sequence[tuple[int, float]]
Edge: TypeAlias = frozenset[int]


def polygons(
    positions: npt.ArrayLike,
    faces: Faces,
    uvs: npt.ArrayLike | None = None,
    uv_corners: npt.ArrayLike | None = None,
    attributes: dict[str, Numbers] | None = None,
    creases: Creases = (),
    corners: Corners = (),
) -> _core.Mesh:
    """A mesh of the core; `creases` are (a, b, sharpness), `corners` (vertex, sharpness)."""
    return _core.polygon_mesh(
        np.asarray(positions, np.float32),
        np.array([len(f) for f in faces], np.uint32),
        np.concatenate([np.asarray(f, np.uint32) for f in faces]),
        None if uvs is None else np.asarray(uvs, np.float32),
        None if uv_corners is None else np.asarray(uv_corners, np.uint32),
        attributes or {},
        np.array([c[:2] for c in creases], np.uint32).reshape(-1, 2),
        np.array([c[2] for c in creases], np.float32),
        np.array([c[0] for c in corners], np.uint32),
        np.array([c[1] for c in corners], np.float32),
    )


def subdivided(
    mesh: _core.Mesh,
    level: npt.ArrayLike,
    boundary: str = "pin_corners",
    uvs: str = "smooth",
    most: int = 1 << 22,
) -> tuple[_core.Mesh, Numbers, int]:
    levels = np.broadcast_to(np.asarray(level, np.uint8), len(mesh.polygon_edges))
    return mesh.subdivided(np.ascontiguousarray(levels), boundary, uvs, most)


def test_limit_of_a_cube() -> None:
    """Against the limit masks of Halstead et al. 1993, and values of Embree 3.13."""
    mesh, _, _ = subdivided(polygons(CUBE, CUBE_FACES), 2)
    corners = np.array(list(itertools.product([-0.5, 0.5], repeat=3)))
    distances, found = cKDTree(mesh.vertices).query(corners)
    assert distances.max() < 1e-6  # (9 V + 4 (E1 + E2 + E3) + F1 + F2 + F3) / 24
    np.testing.assert_allclose(mesh.normals[found], corners * (2 / np.sqrt(3)), atol=1e-6)
    others = [[0, 0.83950621, 0], [0, 0.609568, 0.609568], [0.3161571, 0.7289899, 0.3161571]]
    assert cKDTree(mesh.vertices).query(others)[0].max() < 1e-6


class Reference:
    """One step of subdivision at a time, as DeRose et al. 1998 define it, with Python's numbers."""

    def __init__(
        self,
        positions: npt.ArrayLike,
        faces: Faces,
        creases: Creases = (),
        corners: Corners = (),
        boundary: str = "pin_corners",
    ) -> None:
        self.positions = np.asarray(positions, float)
        self.faces = [list(f) for f in faces]
        self.creases = {frozenset(c[:2]): float(c[2]) for c in creases}
        self.corners = {int(v): float(s) for v, s in corners}
        uses = Counter(edge for f in self.faces for edge in self.edges_of(f))
        count = Counter(v for f in self.faces for v in f)
        for edge in uses:
            if uses[edge] == 1:
                self.creases[edge] = INFINITE
                for v in edge:
                    if boundary == "pin_boundary" or (boundary == "pin_corners" and count[v] == 1):
                        self.corners[v] = INFINITE

    @staticmethod
    def edges_of(face: Sequence[int]) -> list[Edge]:
        return [frozenset((face[i], face[(i + 1) % len(face)])) for i in range(len(face))]

    def refined(self) -> Reference:
        p = self.positions
        centre = np.array([p[f].mean(0) for f in self.faces])
        faces_at: dict[int, list[int]] = defaultdict(list)
        edges_at: dict[int, set[Edge]] = defaultdict(set)
        sides: dict[Edge, list[int]] = defaultdict(list)
        for i, f in enumerate(self.faces):
            for v in f:
                faces_at[v].append(i)
            for edge in self.edges_of(f):
                sides[edge].append(i)
                for v in edge:
                    edges_at[v].add(edge)
        points = [self.moved(v, faces_at[v], edges_at[v], centre) for v in range(len(p))]
        number: dict[Edge, int] = {}
        for edge, around in sides.items():
            middle = p[list(edge)].mean(0)
            sharp = min(self.creases.get(edge, 0), 1)
            smooth = (middle * 2 + centre[around].sum(0)) / 4 if len(around) == 2 else middle
            number[edge] = len(points)
            points.append(sharp * middle + (1 - sharp) * smooth)
        faces = []
        for i, f in enumerate(self.faces):
            edges = self.edges_of(f)
            faces += [[v, number[edges[k]], len(points) + i, number[edges[k - 1]]] for k, v in enumerate(f)]
        result = Reference(np.array([*points, *centre]), [])
        result.faces = faces
        for edge, sharpness in self.creases.items():
            for v in edge:
                result.creases[frozenset((v, number[edge]))] = self.decayed(sharpness)
        result.corners = {v: self.decayed(s) for v, s in self.corners.items()}
        return result

    @staticmethod
    def decayed(sharpness: float) -> float:
        return sharpness if sharpness >= INFINITE else max(sharpness - 1, 0)

    def moved(self, v: int, faces: list[int], edges: set[Edge], centre: Numbers) -> Numbers:
        here = {edge: self.creases.get(edge, 0) for edge in edges}
        corner = self.corners.get(v, 0)
        then = {edge: self.decayed(s) for edge, s in here.items()}
        kinds = [self.kind(corner, here), self.kind(self.decayed(corner), then)]
        ending = [s for s in (corner, *here.values()) if s > 0 and self.decayed(s) == 0]
        share = 1 if kinds[0] == kinds[1] else min(np.mean(ending), 1) if ending else 0
        rules = [self.rule(k, v, faces, s, centre) for k, s in zip(kinds, (here, then), strict=True)]
        return share * rules[0] + (1 - share) * rules[1]

    @staticmethod
    def kind(corner: float, edges: dict[Edge, float]) -> str:
        sharp = sum(s > 0 for s in edges.values())
        return "corner" if corner > 0 or sharp > 2 else "crease" if sharp == 2 else "smooth"

    def rule(self, kind: str, v: int, faces: list[int], edges: dict[Edge, float], centre: Numbers) -> Numbers:
        p = self.positions
        ends = [next(iter(edge - {v})) for edge, s in edges.items() if s > 0 or kind == "smooth"]
        if kind == "corner":
            return p[v]
        if kind == "crease":
            return 0.75 * p[v] + 0.125 * p[ends].sum(0)
        n = len(faces)
        return ((n - 2) * p[v] + p[ends].mean(0) + centre[faces].mean(0)) / n


# A house whose ridge ends in a triangle, with a pentagonal wall and an open floor.
HOUSE = np.array(
    [
        [0, 0, 0],
        [2, 0, 0],
        [2, 0, 3],
        [0, 0, 3],
        [0, 2, 0],
        [2, 2, 0],
        [2, 2, 3],
        [0, 2, 3],
        [1, 3, 0],
        [1, 3, 2],
    ],
    np.float32,
)
HOUSE_FACES = [
    [0, 4, 8, 5, 1],
    [1, 5, 6, 2],
    [2, 6, 7, 3],
    [3, 7, 4, 0],
    [4, 7, 9, 8],
    [8, 9, 6, 5],
    [7, 6, 9],
]
SETTINGS: dict[str, tuple[Creases, Corners, str]] = {
    "smooth": ([], [], "smooth"),
    "corners": ([], [], "pin_corners"),
    "boundary": ([], [], "pin_boundary"),
    "creases": ([(4, 7, 1.0), (7, 6, 1.5), (5, 6, 0.5), (8, 9, INFINITE), (9, 6, 1.8)], [], "pin_corners"),
    "sharp corners": ([(1, 5, INFINITE), (5, 8, INFINITE)], [(9, 1.5), (7, INFINITE), (4, 0.3)], "smooth"),
}


@pytest.mark.parametrize("name", SETTINGS)
def test_surface_against_a_slow_one(name: str) -> None:
    """Vertices after many steps of another implementation are near the limit of those of the second step."""
    creases, corners, boundary = SETTINGS[name]
    mesh, _, _ = subdivided(polygons(HOUSE, HOUSE_FACES, creases=creases, corners=corners), 2, boundary)
    slow = Reference(HOUSE, HOUSE_FACES, creases, corners, boundary)
    steps, errors = [len(slow.positions)], []
    for _ in range(5):
        slow = slow.refined()
        steps.append(len(slow.positions))
        if len(steps) > 3:
            errors.append(cKDTree(mesh.vertices).query(slow.positions[: steps[2]])[0].max())
    assert len(np.unique(mesh.vertices, axis=0)) == steps[2]
    # Steps converge by a factor of four, but at the ends of creases by two, and semi-sharp ones begin late.
    assert errors[-1] < 4e-3
    assert errors[-1] < 0.5 * errors[-2] < 0.25 * errors[-3]


def test_normals_against_differences() -> None:
    """At a fine level, triangles are nearly tangent to the surface."""
    mesh, _, _ = subdivided(polygons(HOUSE, HOUSE_FACES, creases=[(4, 7, 2.0), (8, 9, INFINITE)]), 6)
    flat = mesh.with_vertex_normals(np.eye(4).tolist())
    errors: list[float] = []
    for triangle in mesh.faces[:: max(1, len(mesh.faces) // 20000)]:
        a, b, c = mesh.vertices[triangle].astype(float)
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        errors.append(1 - min(mesh.normals[triangle] @ normal) / length if length > 1e-12 else 0)
    assert np.quantile(errors, 0.99) < 5e-3
    assert np.isfinite(flat.normals).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)


def test_sharp_edges_have_two_normals() -> None:
    creases = [(a, b, INFINITE) for a, b in itertools.combinations(range(8), 2) if (a ^ b).bit_count() == 1]
    mesh, points, _ = subdivided(polygons(CUBE, CUBE_FACES, creases=creases), 2)
    assert len(mesh.vertices) == 6 * 25
    assert len(np.unique(points)) == 98
    np.testing.assert_allclose(np.abs(mesh.vertices).max(1), 1, atol=1e-6)
    triangles = mesh.vertices[mesh.faces]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(mesh.normals[mesh.faces], np.repeat(normals[:, None], 3, 1), atol=1e-6)


def grid(n: int, seed: int = 3) -> tuple[Numbers, list[list[int]]]:
    """A grid of quads in a plane, with irregular places: vertices and faces."""
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0))
    places = np.stack([x.ravel(), y.ravel()], 1)
    places += np.random.default_rng(seed).uniform(-0.2, 0.2, places.shape)
    faces = [
        [j * (n + 1) + i, j * (n + 1) + i + 1, (j + 1) * (n + 1) + i + 1, (j + 1) * (n + 1) + i]
        for j in range(n)
        for i in range(n)
    ]
    return places, faces


def test_uvs_and_attributes_move_with_the_surface() -> None:
    """Texture coordinates that equal positions stay equal where both have the same borders."""
    places, faces = grid(3)
    corners = np.concatenate(faces)
    attributes = {
        "vertex_place": np.ascontiguousarray(places, np.float32),
        "face_number": np.arange(9, dtype=np.float32)[:, None],
    }
    control = polygons(np.c_[places, np.zeros(16)], faces, places, corners, attributes)
    mesh, _, _ = subdivided(control, 2, "pin_boundary")
    np.testing.assert_allclose(mesh.uvs, mesh.vertices[:, :2], atol=1e-6)
    np.testing.assert_allclose(mesh.attributes["vertex_place"], mesh.vertices[:, :2], atol=1e-6)
    numbers = mesh.attributes["face_number"].ravel()
    np.testing.assert_array_equal(numbers, np.repeat(np.arange(9), 32))

    linear, _, _ = subdivided(control, 2, "pin_boundary", "linear")
    middle = linear.uvs[linear.faces[4 * 32 : 5 * 32]].reshape(-1, 2)
    expected = places[faces[4]].mean(0)
    assert np.abs(middle - expected).sum(1).min() < 1e-6  # the middle of the quad, not of the surface
    assert not np.allclose(linear.uvs, linear.vertices[:, :2], atol=1e-3)


def open_edges(triangles: list[list[int]]) -> int:
    """The number of directed edges that lack one in the other direction."""
    edges: Counter[tuple[int, int]] = Counter()
    for a, b, c in triangles:
        edges.update([(a, b), (b, c), (c, a)])
    return sum(abs(count - edges[b, a]) for (a, b), count in edges.items())


@pytest.mark.parametrize("displaced", [False, True])
def test_no_cracks_between_levels(displaced: bool) -> None:
    """Closed meshes stay closed where levels of edges differ, and at seams of texture coordinates."""
    rng = np.random.default_rng(5)
    uvs = rng.random((24, 2))
    control = polygons(CUBE, CUBE_FACES, uvs, np.arange(24), creases=[(0, 1, INFINITE), (1, 3, 1.5)])
    for _ in range(5):
        mesh, points, _ = subdivided(control, rng.integers(0, 6, 24))
        if displaced:
            mesh = mesh.displaced(points, rng.normal(0, 0.05, len(points)).astype(np.float32))
        assert open_edges(points[mesh.faces].tolist()) == 0
        places = {tuple(v): i for i, v in enumerate(mesh.vertices.tolist())}
        same = np.array([places[tuple(v)] for v in mesh.vertices.tolist()])
        assert open_edges(same[mesh.faces].tolist()) == 0


def sphere_like(levels: dict[str, Any], **more: Any) -> dict[str, Any]:  # noqa: ANN401
    return {"type": "mesh", "positions": CUBE, "faces": CUBE_FACES, "subdivision": True, **levels, **more}


def scene_of(shape: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "scene",
        "integrator": {"type": "path"},
        "sensor": {"type": "perspective", "fov": 40, "to_world": LOOK},
        "sky": {"type": "constant"},
        "shape": shape,
    }


LOOK = np.array([[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 5], [0, 0, 0, 1]], float)


RAYS = int(os.environ.get("LAJOLLA_RAYS", "100000"))


def test_no_ray_escapes() -> None:
    """From inside, with other levels for each edge. `LAJOLLA_RAYS` of them: docs/testing.md."""
    rng = np.random.default_rng(7)
    mesh, _, _ = subdivided(polygons(CUBE, CUBE_FACES), rng.integers(1, 7, 24))
    scene = lajolla.load_dict(scene_of({"type": "mesh", "mesh": mesh}), size=(16, 16), robust=True)
    for _ in range(max(1, RAYS // 100_000)):
        directions = rng.normal(size=(100_000, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        hits = scene.intersect(rng.uniform(-0.2, 0.2, (100_000, 3)), directions)
        assert hits.hit.all()


def test_levels_follow_the_camera() -> None:
    near, far = (
        triangles_of(scene_of(sphere_like({"edge_length": 4}, to_world=np.diag([size, size, size, 1]))))
        for size in (1, 0.1)
    )
    assert near > 10 * far > 0
    assert triangles_of(scene_of(sphere_like({"edge_length": 4, "subdivision_level": 2}))) == 6 * 32
    assert triangles_of(scene_of(sphere_like({"subdivision_level": 4}))) == 6 * 512


def triangles_of(scene: dict[str, Any]) -> int:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return len(mesh_of(lajolla.load_dict(scene, size=(128, 128))).faces)


def mesh_of(scene: lajolla.Scene) -> _core.Mesh:
    return scene.description.core["shapes"][0]["mesh"]


def test_too_many_triangles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Levels are reduced until the surfaces of a scene have few enough triangles together."""
    monkeypatch.setattr(subdivision, "MAX_TRIANGLES", 6 * 2 * 4**3)
    monkeypatch.setattr(subdivision, "TRIANGLES_PER_CORNER", 0)
    with pytest.warns(lajolla.SceneWarning, match="reduced by 9 levels, to 768 triangles"):
        lajolla.load_dict(scene_of(sphere_like({"subdivision_level": 12})), size=(16, 16))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"creases": [[0, 7]], "crease_sharpness": [1.0]}, "0 and 7, which no edge joins"),
        ({"creases": [[0, 1]], "crease_sharpness": [-1.0]}, "must not be below 0"),
        ({"creases": [[0, 1]]}, "needs its sharpness"),
        ({"faces": [[0, 1, 3, 3]]}, "face 0 has the vertex 3 twice"),
        ({"faces": [[0, 1, 3, 9]]}, "vertex 9"),
        ({"faces": [[0, 1]]}, "fewer than three corners"),
        ({"boundary": "edge"}, "pin_corners"),
        ({"normals": CUBE}, "normals are computed"),
    ],
)
def test_mistakes(change: dict[str, Any], message: str) -> None:
    with pytest.raises(lajolla.SceneError, match=message):
        lajolla.load_dict(scene_of({**sphere_like({}), **change}), size=(16, 16))


def test_settings_need_subdivision() -> None:
    shape = {"type": "mesh", "positions": CUBE, "faces": CUBE_FACES, "edge_length": 3}
    with pytest.warns(lajolla.SceneWarning, match='"edge_length" needs "subdivision"'):
        lajolla.load_dict(scene_of(shape), size=(16, 16))


OBJ = """{vertices}
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl one
f 1/1 2/2 4/3 3/4
f 5/1 7/2 8/3 6/4
usemtl two
f 1/1 5/2 6/3 2/4
f 3/1 4/2 8/3 7/4
usemtl one
f 1/1 3/2 7/3 5/4
f 2/1 6/2 8/3 4/4
t crease 2/1/0 0 1 2.5
t corner 1/1/0 7 10
t interpolateboundary 1/0/0 1
"""
PLY = """ply
format ascii 1.0
element vertex 8
property float x
property float y
property float z
element face 6
property list uchar int vertex_indices
property list uchar float texcoord
end_header
{vertices}
{faces}
"""


def test_files(tmp_path: Path) -> None:
    """OBJ files with tags, and PLY files, describe the same surface as arrays."""
    rows = [" ".join(f"{x:g}" for x in v) for v in CUBE]
    (tmp_path / "cube.obj").write_text(OBJ.format(vertices="\n".join(f"v {row}" for row in rows)))
    faces = [f"4 {' '.join(map(str, f))} 8 0 0 1 0 1 1 0 1" for f in CUBE_FACES.tolist()]
    (tmp_path / "cube.ply").write_text(PLY.format(vertices="\n".join(rows), faces="\n".join(faces)))
    of_arrays, _, _ = subdivided(
        polygons(CUBE, CUBE_FACES, creases=[(0, 1, 2.5)], corners=[(7, INFINITE)]), 2
    )
    obj = _core.load_obj(str(tmp_path / "cube.obj"), polygons=True)
    mesh, _, _ = subdivided(obj, 2)
    assert cKDTree(mesh.vertices).query(of_arrays.vertices)[0].max() < 1e-6
    assert mesh.groups == [("one", 0, 4 * 32), ("two", 4 * 32, 2 * 32)]
    ply, _, _ = subdivided(_core.load_ply(str(tmp_path / "cube.ply"), polygons=True), 2)
    smooth, _, _ = subdivided(polygons(CUBE, CUBE_FACES), 2)
    assert cKDTree(ply.vertices).query(smooth.vertices)[0].max() < 1e-6
    assert ply.uvs.min() == 0
    assert ply.uvs.max() == 1


def test_displacement_by_a_texture() -> None:
    """A cube of radius 0.5 to 0.9 that grows by 0.3 where the texture is white."""
    white = {"type": "bitmap", "data": np.ones((2, 2, 3), np.float32)}
    shape = sphere_like(
        {"subdivision_level": 3},
        corner_uvs=np.tile([[0, 0], [1, 0], [1, 1], [0, 1]], (6, 1)),
        displacement=white,
        displacement_scale=0.6,
        displacement_midlevel=0.5,
    )
    moved = lajolla.load_dict(scene_of(shape), size=(16, 16))
    plain = lajolla.load_dict(scene_of(sphere_like({"subdivision_level": 3})), size=(16, 16))
    origins = np.tile([[0.0, 0.0, 5.0]], (9, 1))
    directions = np.array([[x, y, -5] for x in (-0.3, 0, 0.3) for y in (-0.3, 0, 0.3)])
    heights = [scene.intersect(origins, directions).position[4, 2] for scene in (moved, plain)]
    assert heights[0] - heights[1] == pytest.approx(0.3, abs=1e-4)


def test_faces_are_primitives() -> None:
    """The layer `primitive` has the faces of the control mesh."""
    scene = lajolla.load_dict(
        scene_of(sphere_like({"subdivision_level": 2})), aovs=["primitive"], size=(32, 32)
    )
    numbers = scene.render(spp=1).layers["primitive"]
    hits = scene.intersect((0, 0, 5), (0.01, -0.02, -5))
    assert numbers.values[16, 16] == hits.primitive[0] // 32
