"""Pickles of scenes, and of the core's objects that descriptions hold, keep every bit."""

from __future__ import annotations

import multiprocessing
import pickle
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from measured_tools import synthetic
from scene_tools import make_scene, scaling

import lajolla
from lajolla import _core
from lajolla.scene.description.plugins.measured import measurement

SEED = 20261126
HEAT_PLY = b"""\
ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
property float u
property float v
property float heat_0
element face 1
property list uchar int vertex_indices
end_header
0 0 0 0 0 0.25
1 0 0 1 0 0.5
0 1 0 0 1 1e-40
3 0 1 2
"""
PARTS_OBJ = "mtllib some.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\nusemtl blue\nf 3 2 1\n"


def same(a: Any, b: Any) -> bool:  # noqa: ANN401
    """Whether two states are equal, with arrays of the same type and bits."""
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and (a.dtype, a.shape, a.tobytes()) == (
            b.dtype,
            b.shape,
            b.tobytes(),
        )
    if isinstance(a, Mapping):
        return list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple | list):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and a == b


def random(*shape: int) -> np.ndarray:
    return np.random.default_rng(SEED).random(shape, np.float32)


def images() -> dict[str, _core.Image]:
    bytes_ = (random(5, 7, 3) * 255).astype(np.uint8)
    return {
        "bytes": _core.Image(bytes_, srgb=True),
        "linear bytes": _core.Image(np.ascontiguousarray(bytes_[..., 0])),
        "halves": _core.Image(random(4, 6, 3).astype(np.float16)),
        "grey halves": _core.Image(random(3, 3).astype(np.float16)),
        "floats": _core.Image(random(3, 5, 3)),
        "not a number": _core.Image(np.array([[np.nan, np.inf]], np.float32)),
    }


OBJECTS: dict[str, object] = {
    **images(),
    "triangle": _core.Mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.uint32)),
    "normals": _core.Mesh(
        random(4, 3), np.array([[0, 1, 2], [3, 2, 1]], np.uint32), random(4, 3), random(4, 2)
    ),
    "empty": _core.Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint32)),
    "curves": _core.Curves(random(6, 4), np.array([0, 2], np.uint32)),
    "byte voxels": _core.Grid((random(2, 3, 4) * 255).astype(np.uint8)),
    "half voxels": _core.Grid(random(2, 3, 4, 3).astype(np.float16)),
    "voxels": _core.Grid(random(2, 3, 4, 6)),
    "isotropic": _core.Measurement(**measurement(synthetic())),
    "half": _core.Measurement(**measurement(synthetic(2, jacobian=False))),
    "numbers": _core.Column(random(5).astype(np.float64)),
    "whole numbers": _core.Column(np.arange(5)),
    "matrices": _core.Column(random(2, 4, 4).astype(np.float64)),
}


@pytest.mark.parametrize("name", OBJECTS)
@pytest.mark.parametrize("protocol", [2, pickle.HIGHEST_PROTOCOL])
def test_states_survive(name: str, protocol: int) -> None:
    restored = pickle.loads(pickle.dumps(OBJECTS[name], protocol))
    assert type(restored) is type(OBJECTS[name])
    assert same(OBJECTS[name].__getstate__(), restored.__getstate__())


def test_every_object_of_a_description_is_tested() -> None:
    held = {_core.Image, _core.Mesh, _core.Curves, _core.Grid, _core.Measurement, _core.Column}
    assert {type(value) for value in OBJECTS.values()} == held


@pytest.mark.parametrize("name", ["mesh.ply", "mesh.obj"])
def test_meshes_keep_what_their_file_said(name: str, tmp_path: Any) -> None:  # noqa: ANN401
    path = tmp_path / name
    path.write_bytes(HEAT_PLY if name.endswith("ply") else PARTS_OBJ.encode())
    mesh = _core.load_ply(path) if name.endswith("ply") else _core.load_obj(path)
    restored = pickle.loads(pickle.dumps(mesh))
    for what in ("vertices", "faces", "normals", "uvs", "attributes", "groups", "material_libraries"):
        assert same(getattr(mesh, what), getattr(restored, what)), what
    assert bool(mesh.attributes) == name.endswith("ply")
    assert bool(mesh.groups) == name.endswith("obj")


@pytest.mark.parametrize("name", images())
def test_textures_look_the_same(name: str) -> None:
    """Also at coarser levels, which are computed again."""
    image = images()[name]
    assert picture_of(image).tobytes() == picture_of(pickle.loads(pickle.dumps(image))).tobytes()


def picture_of(image: _core.Image) -> np.ndarray:
    """A ball with the image many times on it: far texels are filtered."""
    scene = make_scene(
        textures=[{"type": "bitmap", "image": image, "filter_type": "trilinear", "to_uv": scaling(20)}],
        bsdfs=[{"type": "diffuse", "reflectance": {"texture": 0}}],
        shapes=[{"type": "sphere", "center": [0, 0, 4], "material": 0}],
        emitters=[{"type": "constant", "radiance": 1}],
    )
    render = _core.Render(scene)
    render.advance(4, 1)
    return render.image()


def test_states_that_cannot_be() -> None:
    width, height, channels, srgb, kind, words = images()["floats"].__getstate__()
    for state in (
        (width, height + 1, channels, srgb, kind, words),
        (width, height, 2, srgb, kind, words),
        (width, height, channels, srgb, 9, words),
        (0, height, channels, srgb, kind, words),
    ):
        image = _core.Image.__new__(_core.Image)
        with pytest.raises(ValueError, match="image"):
            image.__setstate__(state)
    arrays, *rest = OBJECTS["triangle"].__getstate__()
    beyond = (arrays[0], arrays[1] + 1, *arrays[2:])
    with pytest.raises(ValueError, match="beyond"):
        _core.Mesh.__new__(_core.Mesh).__setstate__((beyond, *rest))
    with pytest.raises(ValueError, match="wrong length"):
        _core.Mesh.__new__(_core.Mesh).__setstate__((arrays, {"a": (True, random(2, 1))}, *rest[1:]))


SCENE = {
    "type": "scene",
    "integrator": {"type": "path"},
    "sensor": {
        "type": "perspective",
        "film": {"type": "hdrfilm", "width": 16, "height": 12},
        "sampler": {"type": "independent", "sample_count": 4},
    },
    "light": {"type": "constant", "radiance": 0.5},
    **{f"ball{i}": {"type": "sphere", "center": [i / 9 - 1, 0, 5], "radius": 0.2} for i in range(18)},
}


def test_scenes_of_files_and_options(shared_scenes: Any) -> None:  # noqa: ANN401
    path = shared_scenes / "bitterli" / "teapot-full" / "scene.xml"
    scene = lajolla.load(path, spp=1, size=(48, 32), integrator="direct", seed=3)
    restored = pickle.loads(pickle.dumps(scene))
    assert restored.core.summary() == scene.core.summary()
    assert (restored.film, restored.sensors) == (scene.film, scene.sensors)
    assert list(map(str, restored.warnings)) == list(map(str, scene.warnings))
    assert restored.render().array.tobytes() == scene.render().array.tobytes()


def test_other_processes_render_scenes() -> None:
    scene = lajolla.load_dict(SCENE, size=(9, 7))
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        picture = pool.apply(lajolla.Scene.render, (scene,), {"spp": 2})
    assert picture.array.tobytes() == scene.render(spp=2).array.tobytes()
