"""Objects of other libraries in scene dicts: taken by what they offer, or refused with one message."""

from __future__ import annotations

import pathlib
import warnings
from typing import Any

import numpy as np
import pytest

import lajolla
from lajolla.scene import Description, describe

EYE = [[1.0, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]


class Tensor:
    """As of PyTorch: an array by `__array__`, unless it needs a gradient."""

    def __init__(self, values: object, requires_grad: bool = False) -> None:
        self.values = np.asarray(values)
        self.requires_grad = requires_grad
        self.shape = self.values.shape

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:  # noqa: ANN401
        if self.requires_grad:
            raise RuntimeError("Can't call numpy() on Tensor that requires grad.\nDetails follow")
        return self.values.astype(dtype) if dtype else self.values


class Shared:
    """An array by DLPack alone."""

    def __init__(self, values: np.ndarray) -> None:
        self.values = values

    def __dlpack__(self, **options: object) -> object:
        return self.values.__dlpack__()

    def __dlpack_device__(self) -> tuple[int, int]:
        return self.values.__dlpack_device__()


class Interface:
    """An array by the older protocol."""

    def __init__(self, values: np.ndarray) -> None:
        self.__array_interface__ = values.__array_interface__
        self.values = values

    @property
    def __array_interface__(self) -> dict[str, Any]:
        return self.values.__array_interface__

    @__array_interface__.setter
    def __array_interface__(self, value: object) -> None: ...


class Transform:
    """As of Mitsuba: no array, but with a matrix."""

    def __init__(self, matrix: object) -> None:
        self.matrix = matrix


class Picture(Tensor):
    """As of PIL: of a palette's indices."""

    mode = "P"

    def convert(self, mode: str) -> Tensor:
        assert mode == "RGB"
        return Tensor(np.full((2, 3, 3), 255, np.uint8))


class Mesh:
    """As of trimesh."""

    def __init__(self, faces: object = ((0, 1, 2), (0, 2, 3)), uv: object = None) -> None:
        self.vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float64)
        self.faces = np.array(faces)
        self.visual = type("Visual", (), {"uv": uv})()


def scene_with(**objects: object) -> dict[str, Any]:
    return {"type": "scene", "integrator": {"type": "path"}, "sensor": {"type": "perspective"}, **objects}


def described(**objects: object) -> Description:
    description = describe(scene_with(light={"type": "constant"}, **objects), strict=True)
    lajolla._core.Scene(description.core)
    return description


ARRAYS = [
    lambda values: np.asarray(values),
    lambda values: Tensor(values),
    lambda values: Shared(np.array(values, np.float64)),
    lambda values: Interface(np.array(values, np.float64)),
    lambda values: memoryview(np.array(values, np.float64)),
]


@pytest.mark.parametrize("kind", ARRAYS)
def test_arrays_are_numbers_vectors_colours_and_transforms(kind: Any) -> None:  # noqa: ANN401
    ball = {
        "type": "sphere",
        "radius": kind(2.0) if kind is not ARRAYS[4] else 2,
        "center": kind([1.0, 2, 3]),
        "to_world": kind(EYE),
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": kind([0.1, 0.2, 0.3])}},
    }
    core = described(ball=ball).core
    shape = core["shapes"][0]
    assert (shape["radius"], tuple(shape["center"])) == (2, (1, 2, 3))
    np.testing.assert_array_equal(shape["to_world"], EYE)
    np.testing.assert_allclose(core["bsdfs"][0]["reflectance"], (0.1, 0.2, 0.3))


@pytest.mark.parametrize("number", [np.float32(2), np.float16(2), np.int8(2), np.uint64(2), Tensor(2.0)])
def test_scalars_of_numpy(number: object) -> None:
    assert described(ball={"type": "sphere", "radius": number}).core["shapes"][0]["radius"] == 2
    flag = np.bool_(True)
    assert described(ball={"type": "sphere", "flip_normals": flag}).core["shapes"][0]["flip_normals"] is True
    depth = {"type": "path", "max_depth": np.int64(5)}
    assert described(integrator=depth).core["integrator"]["max_depth"] == 5


@pytest.mark.parametrize("matrix", [EYE, np.array(EYE), Tensor(EYE)])
def test_transforms_have_a_matrix(matrix: object) -> None:
    shape = described(ball={"type": "cube", "to_world": Transform(matrix)}).core["shapes"][0]
    np.testing.assert_array_equal(shape["to_world"], EYE)


def test_paths(tmp_path: pathlib.Path) -> None:
    lajolla.image.write(tmp_path / "a.png", np.ones((2, 2, 3)))

    class Named:
        def __init__(self, name: str | bytes) -> None:
            self.name = name

        def __fspath__(self) -> str | bytes:
            return self.name

    name = str(tmp_path / "a.png")
    for path in (tmp_path / "a.png", pathlib.PurePosixPath(name), Named(name), Named(name.encode())):
        texture = {"type": "bitmap", "filename": path}
        bsdf = {"type": "diffuse", "reflectance": texture}
        assert described(ball={"type": "sphere", "bsdf": bsdf}).core["textures"]


@pytest.mark.parametrize("name", ["data", "bitmap"])
@pytest.mark.parametrize(
    ("picture", "size"),
    [
        (Tensor(np.zeros((2, 3, 3), np.uint8)), (3, 2)),
        (Interface(np.zeros((2, 3), np.float32)), (3, 2)),
        (Picture(np.zeros((2, 3), np.uint8)), (3, 2)),
        (lajolla.Image(np.zeros((2, 3, 3))), (3, 2)),
    ],
)
def test_pictures(name: str, picture: object, size: tuple[int, int]) -> None:
    bsdf = {"type": "diffuse", "reflectance": {"type": "bitmap", name: picture}}
    image = described(ball={"type": "sphere", "bsdf": bsdf}).core["textures"][0]["image"]
    assert (image.width, image.height) == size


@pytest.mark.parametrize(
    "shape", [Mesh(), {"type": "mesh", "mesh": Mesh(uv=[[0, 0], [1, 0], [1, 1], [0, 1]])}]
)
def test_meshes(shape: object) -> None:
    """By themselves, and with a transform and materials around them."""
    mesh = described(square=shape).core["shapes"][0]["mesh"]
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3]])
    np.testing.assert_allclose(mesh.normals, np.broadcast_to([0, 0, 1], (4, 3)))
    assert (mesh.uvs is not None) == isinstance(shape, dict)


@pytest.mark.parametrize(
    ("objects", "message"),
    [
        (
            {"ball": {"type": "sphere", "radius": object()}},
            "[ball.radius]: error: an object of the type object",
        ),
        ({"ball": {"type": "sphere", "radius": None}}, "[ball.radius]: error: nothing (None) cannot be part"),
        ({"ball": None}, "[ball]: error: nothing (None)"),
        ({"ball": object()}, "[ball]: error: an object of the type object cannot be part of a scene"),
        ({"ball": {1, 2}}, "of the type set cannot"),
        ({"balls": [{"type": "sphere"}]}, "[balls]: error: a list of objects cannot be part of a scene"),
        ({"balls": (Mesh(), Mesh())}, "a list of objects"),
        ({"ball": {"type": "sphere", "nonsense": len}}, "[ball.nonsense]: error: "),
        ({"ball": {"type": "sphere", "radius": 1 + 2j}}, "of the type complex cannot"),
        ({"ball": {"type": "sphere", "radius": b"2"}}, "of the type bytes cannot"),
        (
            {"ball": {"type": "sphere", "radius": Tensor(2.0, requires_grad=True)}},
            "Tensor cannot become an array: Can't call numpy() on Tensor that requires grad.",
        ),
        (
            {"mesh": Mesh(((0, 1, 7),))},
            "Mesh is no triangle mesh: its faces name vertices that are not there",
        ),
        ({"mesh": Mesh(((0, 1, 2, 3),))}, "is no triangle mesh: "),
        ({"mesh": {"type": "mesh", "mesh": 3}}, "expects a mesh object"),
        (
            {"ball": {"type": "sphere", "to_world": Transform(object())}},
            '"to_world" of shape "sphere" expects',
        ),
    ],
)
def test_others_are_refused(objects: dict[str, object], message: str) -> None:
    with pytest.raises(lajolla.SceneError) as caught:
        describe(scene_with(**objects))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_objects_of_mitsuba() -> None:
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    bitmap = mitsuba.Bitmap(np.full((2, 3, 3), 0.5, np.float32))
    matrix = mitsuba.ScalarTransform4f().translate([1, 2, 3])
    ball = {
        "type": "sphere",
        "to_world": matrix,
        "center": mitsuba.ScalarPoint3f(1, 2, 3),
        "bsdf": {"type": "diffuse", "reflectance": {"type": "bitmap", "bitmap": bitmap, "raw": True}},
        "inner": {"type": "rgb", "value": mitsuba.ScalarColor3f(1, 2, 3)},
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        core = describe(scene_with(ball=ball)).core
    np.testing.assert_array_equal(core["shapes"][0]["to_world"], EYE)
    assert tuple(core["shapes"][0]["center"]) == (1, 2, 3)
    assert core["textures"][0]["image"].width == 3
    smoke = {
        "type": "cube",
        "interior": {
            "type": "heterogeneous",
            "sigma_t": {"type": "gridvolume", "grid": mitsuba.VolumeGrid(np.ones((2, 3, 4, 1), np.float32))},
        },
    }
    assert describe(scene_with(smoke=smoke)).core["volumes"]
    with pytest.raises(lajolla.SceneError, match="mitsuba"):
        describe(scene_with(ball=mitsuba.load_dict({"type": "sphere"})))
