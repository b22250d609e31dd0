"""Ptex: files in every encoding, interpolation across faces, and what is refused."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import pytest
from ptex_files import (
    CONSTANT,
    CUBE,
    CUBE_FACES,
    DIFFERENCES,
    TILES,
    ZIPPED,
    Face,
    Ptx,
    cube_pictures,
    cube_with,
    neighbours_of,
)

import lajolla
from lajolla import _core
from lajolla.picture_files import Budget
from lajolla.scene.formats.ptx import read_ptx
from lajolla.scene.syntax.errors import Location, Source

RNG = np.random.default_rng

Numbers: TypeAlias = npt.NDArray[Any]
Quads: TypeAlias = Sequence[Sequence[int]]


def location() -> Location:
    return Location(Source("test", b"", Path()))


def written(tmp_path: Path, ptx: Ptx) -> Path:
    path = tmp_path / "faces.ptx"
    path.write_bytes(ptx.content())
    return path


def random_texels(rng: np.random.Generator, kind: str, height: int, width: int, channels: int) -> Numbers:
    whole = {"u1": 256, "u2": 65536}.get(kind)
    shape = (height, width, channels)
    return rng.integers(0, whole, shape) if whole else rng.normal(size=shape).astype(kind)


@pytest.mark.parametrize(("kind", "channels"), [*itertools.product(("u1", "u2", "f2", "f4"), (1, 3, 4))])
def test_every_encoding(tmp_path: Path, kind: str, channels: int) -> None:
    """Texels come back in every type; alpha is dropped."""
    rng = RNG(1)
    sizes = [(4, 8), (1, 1), (16, 4), (2, 2), (8, 8), (8, 2)]
    encodings = [ZIPPED, ZIPPED, DIFFERENCES, CONSTANT, TILES, TILES]
    faces = [
        Face(random_texels(rng, kind, *size, channels), encoding=encoding)
        for size, encoding in zip(sizes, encodings, strict=True)
    ]
    faces[3].texels[:] = faces[3].texels[0, 0]
    faces[4].texels[:4, :4] = faces[4].texels[0, 0]  # a constant tile
    faces.append(Face(np.broadcast_to(faces[3].texels, (2, 2, channels)), is_constant=True))
    file = read_ptx(written(tmp_path, Ptx(faces, kind)), location(), Budget())
    colours = 1 if channels == 1 else 3
    expected = [f.texels.reshape(-1, channels)[:, :colours] for f in faces]
    expected[-1], expected[1] = expected[-1][:1], expected[1][:1]
    expected = np.concatenate(expected)
    if kind == "u2":
        np.testing.assert_allclose(file.texels, expected / 65535, atol=1e-7)
    else:
        np.testing.assert_array_equal(file.texels, expected.astype(kind))
    assert file.is_integer == (kind[0] == "u")
    np.testing.assert_array_equal(file.log_sizes[[0, 2]], [[3, 2], [2, 4]])


def images_of(
    faces: Quads, rng: np.random.Generator, sizes: Sequence[tuple[int, int]]
) -> tuple[_core.FaceImages, list[Numbers]]:
    """Random pictures of a mesh's faces; `sizes` are log2 of width and height."""
    around = neighbours_of(faces)
    texels = [rng.random((1 << s[0] << s[1], 1)).astype(np.float32) for s in sizes]
    return _core.FaceImages(
        np.asarray(sizes, np.uint8),
        np.zeros(len(faces), np.uint8),
        np.array([a[0] for a in around], np.int32),
        np.array([a[1] for a in around], np.uint8),
        np.concatenate(texels),
        srgb=False,
    ), texels


def grid(n: int) -> Quads:
    """The faces of n x n quads, row by row."""
    starts = [j * (n + 1) + i for j in range(n) for i in range(n)]
    return [[v, v + 1, v + n + 2, v + n + 1] for v in starts]


def turned(faces: Quads, rng: np.random.Generator) -> Quads:
    """The same quads, each beginning at another corner."""
    return [list(np.roll(f, rng.integers(4))) for f in faces]


def test_like_one_picture() -> None:
    """On a grid of faces with equal pictures, it is bilinear interpolation of the whole picture."""
    rng = RNG(2)
    n, size = 3, 8
    faces = grid(n)
    images, texels = images_of(faces, rng, [(3, 3)] * len(faces))
    whole = np.block([[texels[j * n + i].reshape(size, size) for i in range(n)] for j in range(n)])
    places = rng.random((4000, 2)).astype(np.float32) * n
    cells = places.astype(int)
    values = images.smooth((cells[:, 1] * n + cells[:, 0]).astype(np.uint32), places - cells)[:, 0]
    x, y = (np.clip(places[:, k] * size - 0.5, 0, n * size - 1) for k in (0, 1))
    i, j = np.minimum(x.astype(int), n * size - 2), np.minimum(y.astype(int), n * size - 2)
    dx, dy = x - i, y - j
    lower = whole[j, i] * (1 - dx) + whole[j, i + 1] * dx
    upper = whole[j + 1, i] * (1 - dx) + whole[j + 1, i + 1] * dx
    np.testing.assert_allclose(values, lower * (1 - dy) + upper * dy, atol=1e-4)


@pytest.mark.parametrize("level", [-15, 0, 2])
def test_continuous_across_edges(level: int) -> None:
    """On a closed mesh whose vertices have three faces, with pictures of any size that are turned."""
    rng = RNG(3)
    faces = turned(CUBE_FACES.tolist(), rng)
    same = level >= 0  # reduced pictures are continuous between equal ones
    sizes = [(3, 3)] * 6 if same else [tuple(rng.integers(0, 5, 2)) for _ in faces]
    images, _ = images_of(faces, rng, sizes)
    along = rng.random(200).astype(np.float32)
    for f, (others, edges) in enumerate(neighbours_of(faces)):
        for e in range(4):
            here = values_on_edge(images, f, e, along, level)
            there = values_on_edge(images, others[e], edges[e], 1 - along, level)
            np.testing.assert_allclose(here, there, atol=1e-5)


def values_on_edge(images: _core.FaceImages, face: int, edge: int, along: Numbers, level: int) -> Numbers:
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], np.float32)
    places = corners[edge] + (corners[edge + 1] - corners[edge]) * along[:, None]
    return images.smooth(np.full(len(along), face, np.uint32), np.ascontiguousarray(places), level)


def test_within_faces_it_has_no_jumps() -> None:
    """Steps of a fine walk over a face are small, also near its corners."""
    rng = RNG(4)
    images, _ = images_of(CUBE_FACES.tolist(), rng, [tuple(rng.integers(0, 4, 2)) for _ in range(6)])
    walk = np.linspace(0, 1, 4001, dtype=np.float32)
    for face, offset in itertools.product(range(6), (0.01, 0.3)):
        places = np.stack([walk, np.clip(walk * 0.9 + offset, 0, 1)], 1)
        values = images.smooth(np.full(len(walk), face, np.uint32), places)[:, 0]
        assert np.abs(np.diff(values)).max() < 0.02
        assert 0 <= values.min() <= values.max() <= 1


def test_reductions_are_means() -> None:
    rng = RNG(5)
    images, texels = images_of([[0, 1, 2, 3]], rng, [(3, 2)])
    middle = np.array([[0.5, 0.5]], np.float32)
    assert images.smooth(np.zeros(1, np.uint32), middle, 3)[0, 0] == pytest.approx(texels[0].mean(), abs=1e-6)


LOOK = np.array([[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 5], [0, 0, 0, 1]], float)


def scene_of(shape: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "scene",
        "integrator": {"type": "direct"},
        "sensor": {"type": "perspective", "fov": 40, "to_world": LOOK},
        "sky": {"type": "constant"},
        "shape": shape,
    }


@pytest.mark.parametrize("subdivision", [False, True])
def test_colours_of_faces(tmp_path: Path, subdivision: bool) -> None:
    """Rays to the middles of faces find the colours of the faces, flat and subdivided, also from XML."""
    path = written(tmp_path, cube_pictures())
    rows = [" ".join(f"{x:g}" for x in v) for v in CUBE]
    lines = [f"v {row}" for row in rows] + [
        f"f {' '.join(str(v + 1) for v in f)}" for f in CUBE_FACES.tolist()
    ]
    (tmp_path / "cube.obj").write_text("\n".join(lines))
    (tmp_path / "scene.xml").write_text(f"""<scene version="3.0.0">
        <integrator type="aov"><string name="aovs" value="albedo:albedo, face:prim_index"/></integrator>
        <sensor type="perspective"><float name="fov" value="20"/><transform name="to_world">
            <lookat origin="4, 3, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
            <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="32"/>
                <rfilter type="box"/></film></sensor>
        <shape type="obj"><string name="filename" value="cube.obj"/>
            <boolean name="subdivision" value="{str(subdivision).lower()}"/>
            <bsdf type="diffuse"><texture type="ptex" name="reflectance">
                <string name="filename" value="{path.name}"/><string name="filter_type" value="nearest"/>
            </texture></bsdf></shape><emitter type="constant"/></scene>""")
    image = lajolla.load(tmp_path / "scene.xml").render(spp=1)
    albedo, number = image.channels["albedo.R"].ravel(), image.channels["face.I"].ravel()
    seen = albedo > 0
    assert len(np.unique(number[seen])) >= 3
    np.testing.assert_allclose(albedo[seen], np.linspace(0.1, 0.9, 6)[number[seen].astype(int)], rtol=1e-5)


def test_bump_and_trilinear(tmp_path: Path) -> None:
    """Scenes with each filter render, and a far cube with `trilinear` is the mean of its pictures."""
    rng = RNG(6)
    around = neighbours_of(CUBE_FACES.tolist())
    faces = [Face(rng.random((64, 64, 1)), *a) for a in around]
    path = written(tmp_path, Ptx(faces, "f4"))
    shape = cube_with(str(path), filter_type="trilinear")
    shape["to_world"] = np.diag([0.2, 0.2, 0.2, 1.0])
    image = lajolla.load_dict(scene_of(shape), aovs=["albedo"], size=(16, 16)).render(spp=1)
    albedo = image.channels["albedo.R"]
    assert np.abs(albedo[albedo > 0] - 0.5).max() < 0.05
    bump = {"type": "bumpmap", "bump": shape["bsdf"].pop("reflectance"), "bsdf": {"type": "diffuse"}}
    flat = lajolla.load_dict(scene_of({**shape, "bsdf": {"type": "diffuse"}}), size=(16, 16)).render(spp=4)
    rough = lajolla.load_dict(scene_of({**shape, "bsdf": bump}), size=(16, 16)).render(spp=4)
    assert np.abs(flat.array - rough.array).max() > 0.01


@pytest.mark.parametrize("degrees", [5, 2])
def test_trilinear_at_grazing_angles(tmp_path: Path, degrees: float) -> None:
    """Stripes that run away from the camera stay: a footprint is not as wide as it is long."""
    stripes = np.broadcast_to((np.arange(256) // 8 % 2)[:, None, None], (256, 256, 1)).astype(float)
    around = neighbours_of(CUBE_FACES.tolist())
    height, away = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    contrasts = []
    for faces in (stripes, stripes.swapaxes(0, 1)):
        path = written(tmp_path, Ptx([Face(faces, *a) for a in around], "f4"))
        scene = scene_of(cube_with(str(path), filter_type="trilinear"))
        scene["integrator"] = {"type": "path", "max_depth": 2, "strategy": "bsdf"}
        scene["light"] = {"type": "constant"}
        scene["sensor"] = {
            "type": "perspective",
            "fov": 4,
            "to_world": lajolla.look_at(
                origin=(0, 1 + 20 * height, 20 * away), target=(0, 1, 0), up=(0, 1, 0)
            ),
            "film": {"type": "hdrfilm", "width": 96, "height": 24, "rfilter": {"type": "box"}},
        }
        contrasts.append(lajolla.load_dict(scene).render(spp=64).array[11:13, 32:64, 0].std())
    assert max(contrasts) > 0.1


def test_displacement(tmp_path: Path) -> None:
    """Pictures of faces displace a surface without cracks."""
    path = written(tmp_path, cube_pictures(size=8))
    shape = cube_with(str(path)) | {
        "subdivision": True,
        "displacement": {"type": "ptex", "filename": str(path)},
    }
    scene = lajolla.load_dict(scene_of(shape), size=(16, 16))
    directions = RNG(7).normal(size=(20_000, 3))
    hits = scene.intersect(np.zeros(3), directions)
    assert hits.hit.all()
    radius = np.linalg.norm(hits.position, axis=1)
    assert radius.max() - radius.min() > 0.4


def refused(shape: dict[str, Any], message: str) -> None:
    with pytest.raises(lajolla.SceneError, match=message):
        lajolla.load_dict(scene_of(shape), size=(16, 16))


def test_other_meshes_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path, cube_pictures())
    refused({**cube_with(str(path)), "faces": CUBE_FACES[:5]}, "pictures of 6 faces, but this shape has 5")
    shape = {**cube_with(str(path)), "triangles": CUBE_FACES[:, :3]}
    del shape["faces"]
    refused(shape, "needs a mesh whose faces are known")
    refused({"type": "sphere", "bsdf": shape["bsdf"]}, "needs a mesh whose faces are known")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"magic": b"Ptix"}, "it is none"),
        ({"version": 2}, "version is 2"),
        ({"mesh_type": 0}, "meshes of triangles"),
        ({"data_type": 4}, "type of data"),
        ({"channels": 0}, "channels"),
        ({"faces": 0}, "no faces"),
        ({"faces": 2**32 - 1}, "too many"),
        ({"faces": 7}, "has not the size"),
        ({"face_info_size": 2**31}, "cut short"),
        ({"constants_size": 3}, "."),
    ],
)
def test_broken_headers(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    ptx = cube_pictures()
    ptx.changes = changes
    refused(cube_with(str(written(tmp_path, ptx))), message)


def test_edits_and_cut_files(tmp_path: Path) -> None:
    ptx = cube_pictures()
    whole = ptx.content()
    ptx.edits = b"\0" + (24).to_bytes(4, "little") + bytes(24)
    refused(cube_with(str(written(tmp_path, ptx))), "it has edits")
    path = tmp_path / "cut.ptx"
    for size in range(0, len(whole) - 8, 37):
        path.write_bytes(whole[:size])
        refused(cube_with(str(path)), "cannot be used as a Ptex file")
    ptx = cube_pictures()
    ptx.faces[2].neighbours = [9, 0, 0, 0]
    refused(cube_with(str(written(tmp_path, ptx))), "neighbour that is not there")
