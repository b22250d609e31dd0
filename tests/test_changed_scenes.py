"""A changed scene is what a freshly loaded one is: sides, normals, ranges, names, and what it costs."""

from __future__ import annotations

import pickle
import threading
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reader_tools import write_scene
from test_params import PIXELS, ROOM, assert_as_if_loaded, loaded, rendered

import lajolla
from lajolla import _core

CAMERA = {"type": "perspective", "fov": 50, "to_world": lajolla.look_at((0.5, 1, 5), (0, 0, 0))}
BITMAP = {"type": "bitmap", "data": PIXELS}
LAMP = {"type": "sphere", "emitter": {"type": "area"}}
MIRROR = lajolla.scale((-1, 1, 1))
TETRAHEDRON = {
    "type": "mesh",
    "positions": np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    "triangles": np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
}


def scene_of(**objects: Any) -> dict[str, Any]:  # noqa: ANN401
    sky = {"type": "constant", "radiance": 0.5}
    return {"type": "scene", "integrator": {"type": "path"}, "camera": CAMERA, "sky": sky, **objects}


def wall(**bsdf: Any) -> dict[str, Any]:  # noqa: ANN401
    return {"type": "rectangle", "bsdf": {"type": "diffuse", **bsdf}}


def same_picture(a: lajolla.Scene, b: lajolla.Scene) -> bool:
    return bool(np.array_equal(rendered(a.core), rendered(b.core), equal_nan=True))


# Two-sided materials

A, B = (
    {"type": "diffuse", "reflectance": [0.7, 0.1, 0.1]},
    {"type": "diffuse", "reflectance": [0.1, 0.1, 0.8]},
)
REF_A, REF_B = {"type": "ref", "id": "A"}, {"type": "ref", "id": "B"}


def from_behind(x: float, bsdf: dict[str, Any]) -> dict[str, Any]:
    turned = lajolla.translate((x, 0, 0)) @ lajolla.rotate((0, 1, 0), 180)
    return {"type": "rectangle", "to_world": turned, "bsdf": bsdf}


def test_a_shape_that_keeps_its_bsdf_keeps_its_sides() -> None:
    sides = {
        "s": from_behind(-1, {"type": "twosided", "first": REF_A}),
        "t": from_behind(1, {"type": "twosided", "first": REF_A, "second": REF_B}),
        "r": from_behind(3, REF_A),
    }
    scene = loaded(scene_of(A=A, B=B, **sides))
    for shape in sides:
        assert same_picture(scene.with_params({f"{shape}.bsdf": scene[f"{shape}.bsdf"]}), scene), shape
    mixed = scene_of(A=A, B=B, **sides, b=from_behind(0, REF_B))
    assert same_picture(
        loaded(mixed).with_params({"b.bsdf": "A"}), loaded({**mixed, "b": from_behind(0, REF_A)})
    )
    del mixed["r"]
    with pytest.raises(lajolla.SceneError, match=r'several shapes.*"s.bsdf"'):
        loaded(mixed).with_params({"b.bsdf": "A"})


@pytest.mark.parametrize("like", ["r", "s", "t"])
def test_a_shape_looks_like_another_shape(like: str) -> None:
    sides = {
        "s": from_behind(-1, {"type": "twosided", "first": REF_A}),
        "t": from_behind(1, {"type": "twosided", "first": REF_A, "second": REF_B}),
        "r": from_behind(3, REF_A),
    }
    scene = loaded(scene_of(A=A, B=B, **sides, b=from_behind(0, REF_B)))
    wanted = loaded(scene_of(A=A, B=B, **sides, b=from_behind(0, sides[like]["bsdf"])))
    assert same_picture(scene.with_params({"b.bsdf": f"{like}.bsdf"}), wanted)


# Mirrors and normals


@pytest.mark.parametrize("shape", [LAMP, {**TETRAHEDRON, "emitter": {"type": "area"}}])
@pytest.mark.parametrize("before", [np.eye(4), MIRROR])
@pytest.mark.parametrize("after", [np.eye(4), MIRROR, lajolla.scale((1.5, 1.5, -1.5))])
def test_mirrors_turn_sides(shape: dict[str, Any], before: np.ndarray, after: np.ndarray) -> None:
    scene = loaded(scene_of(s={**shape, "to_world": before}))
    changed = scene.with_params({"s.to_world": after})
    assert same_picture(changed, loaded(scene_of(s={**shape, "to_world": after})))
    assert_as_if_loaded(changed)


def test_mirrors_leave_spheres_of_old_files_alone(tmp_path: Path) -> None:
    body = '<shape type="sphere" id="s">{}<emitter type="area"/></shape>'
    other = tmp_path / "mirrored"
    other.mkdir()
    mirror = '<transform name="toWorld"><scale x="-1"/></transform>'
    plain, wanted = (
        lajolla.load(write_scene(folder, body.format(text), version="0.6.0"), size=(4, 4), integrator="path")
        for text, folder in (("", tmp_path), (mirror, other))
    )
    assert same_picture(plain.with_params({"s.to_world": MIRROR}), wanted)


def test_a_given_side_is_not_turned() -> None:
    scene = loaded(scene_of(s=LAMP)).with_params({"s.to_world": MIRROR, "s.flip_normals": False})
    assert scene["s.flip_normals"] is False


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("arrays", [False, True])
def test_vertex_normals_follow_the_placement(tmp_path: Path, given: bool, arrays: bool) -> None:
    shape: dict[str, Any] = dict(TETRAHEDRON)
    if given:
        shape["normals"] = np.array([[-1, -1, -1], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) / np.sqrt(
            [[3], [1], [1], [1]]
        )
    uvs = {"uvs": np.random.default_rng(1).random((4, 2))} if arrays else {}
    stretch = lajolla.scale((1, 3, 0.5)) @ lajolla.rotate((1, 1, 0), 40)
    wanted = loaded(scene_of(s={**shape, **uvs, "to_world": stretch}))
    scene = loaded(scene_of(s=shape)).with_params({f"s.{name}": value for name, value in uvs.items()})
    changed = scene.with_params({"s.to_world": stretch})
    assert np.array_equal(changed["s.normals"], wanted["s.normals"])
    again = pickle.loads(pickle.dumps(changed)).with_params({"s.to_world": np.eye(4)})
    assert np.array_equal(again["s.normals"], loaded(scene_of(s=shape))["s.normals"])


def test_flat_meshes_become_smooth_as_loaded_ones() -> None:
    flat = loaded(scene_of(s={**TETRAHEDRON, "face_normals": True}))
    assert same_picture(flat.with_params({"s.face_normals": False}), loaded(scene_of(s=TETRAHEDRON)))


def test_meshes_of_other_libraries_are_smooth_where_they_are_placed() -> None:
    class Other:
        vertices, faces = TETRAHEDRON["positions"], TETRAHEDRON["triangles"]

    stretch = lajolla.scale((1, 3, 0.5))
    meshes = ({**TETRAHEDRON}, {"type": "mesh", "mesh": Other()})
    arrays, other = (loaded(scene_of(s={**mesh, "to_world": stretch})) for mesh in meshes)
    assert np.array_equal(arrays["s.normals"], other["s.normals"])
    moved = loaded(scene_of(s=meshes[1])).with_params({"s.to_world": stretch})
    assert np.array_equal(moved["s.normals"], other["s.normals"])


def test_seams_of_parts_are_not_lost(tmp_path: Path) -> None:
    lines = ["v 0 0 0", "v 1 0 0", "v 0 1 0", "v 0 0 1", "usemtl a", "f 1 3 2", "f 1 2 4"]
    (tmp_path / "parts.obj").write_text("\n".join([*lines, "usemtl b", "f 1 4 3", "f 2 3 4"]))
    inner = {"a": {"type": "diffuse", "id": "a"}, "b": {"type": "diffuse", "id": "b"}}
    scene = loaded(scene_of(s={"type": "obj", "filename": str(tmp_path / "parts.obj"), **inner}))
    with pytest.raises(lajolla.SceneError, match="vertex normals continue in other shapes"):
        scene.with_params({"s.to_world": lajolla.scale((1, 3, 1))})
    assert scene.with_params({"s.to_world": lajolla.scale(2)})["s.to_world"][0, 0] == 2


# Ranges


@pytest.mark.parametrize(
    ("texture", "path", "value"),
    [
        (BITMAP, "image", 3 * PIXELS),
        (BITMAP, "image", PIXELS - 0.5),
        (BITMAP, "wrap_mode", "zero"),
        ({"type": "checkerboard"}, "color0", (2.0, 0.5, 3.0)),
        ({"type": "scale", "texture": BITMAP, "scale": 0.5}, "scale", 4.0),
    ],
)
def test_textures_stay_in_the_range_of_their_users(texture: dict[str, Any], path: str, value: Any) -> None:  # noqa: ANN401
    name = "data" if path == "image" else path
    users = {"s": wall(reflectance={"type": "ref", "id": "t"}), "floor": ROOM["floor"], "wood": ROOM["wood"]}
    scene = loaded(scene_of(t=texture, **users))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", lajolla.SceneWarning)
        changed = scene.with_params({f"t.{path}": value})
    wanted = loaded(scene_of(t={**texture, name: value}, **users))
    assert same_picture(changed, wanted)
    assert_as_if_loaded(changed)
    original = scene[f"t.{path}"]
    assert same_picture(changed.with_params({f"t.{path}": original}), scene)


def test_textures_that_leave_the_range_are_reported() -> None:
    scene = loaded(scene_of(t=BITMAP, s=wall(reflectance={"type": "ref", "id": "t"})))
    with pytest.warns(
        lajolla.SceneWarning, match='"reflectance" of bsdf "diffuse" is above 1 somewhere and clamped'
    ):
        scene["t.image"] = 3 * PIXELS
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene["t.to_uv"] = lajolla.scale(2)


# The film and the sensor


def test_the_size_of_the_film() -> None:
    scene = lajolla.load_dict(
        ROOM | {"camera": {**CAMERA, "film": {"type": "hdrfilm", "width": 8, "height": 6}}}
    )
    film = {"type": "hdrfilm", "width": 12, "height": 5}
    wanted = lajolla.load_dict(ROOM | {"camera": {**CAMERA, "film": film}})
    changed = scene.with_params({"film.width": 12, "film.height": 5})
    assert (changed.width, changed.height) == (12, 5)
    assert same_picture(changed, wanted)
    window = scene.with_params({"film.crop_offset_x": 2, "film.crop_width": 3})
    assert window.with_params({"film.width": 9}).width == 3
    with pytest.raises(lajolla.SceneError, match="film"):
        window.with_params({"film.width": 4})


def test_the_target_of_a_sensor() -> None:
    camera = {"type": "distant", "to_world": lajolla.look_at((0, 0, 5), (0, 0, 0))}
    shapes = {"s": wall(reflectance=0.9), "sky": {"type": "constant"}}
    scene = loaded(scene_of(**shapes) | {"camera": camera})
    changed = scene.with_params({"sensor.target": (0.2, 0.1, 0)})
    assert changed["sensor.has_target"]
    assert same_picture(changed, loaded(scene_of(**shapes) | {"camera": {**camera, "target": [0.2, 0.1, 0]}}))


# References


@pytest.mark.parametrize(
    ("bsdf", "field"),
    [
        ({"type": "diffuse", "reflectance": BITMAP}, "reflectance"),
        ({"type": "normalmap", "map": BITMAP, "inner": A}, "normalmap"),
        ({"type": "bumpmap", "map": BITMAP, "inner": A}, "map"),
    ],
)
def test_old_textures_come_back(bsdf: dict[str, Any], field: str) -> None:
    scene = loaded(scene_of(s={"type": "rectangle", "bsdf": bsdf}))
    path = f"s.bsdf.{field}"
    old = scene[path]
    changed = scene.with_params({path: {"type": "bitmap", "data": PIXELS[::-1]}})
    assert changed[path] != old
    assert not same_picture(changed, scene)
    assert same_picture(changed.with_params({path: old}), scene)
    assert same_picture(changed.with_params({path: changed[path]}), changed)


def test_a_checkerboard_that_is_a_number_stays_itself() -> None:
    board = {"type": "checkerboard", "color0": 0.1, "color1": 0.6}
    scene = loaded(scene_of(s={"type": "rectangle", "bsdf": {"type": "roughconductor", "alpha": board}}))
    assert same_picture(scene.with_params({"s.bsdf.alpha_u": scene["s.bsdf.alpha_u"]}), scene)


@pytest.mark.parametrize("texture", [BITMAP, {"type": "bitmap", "data": 3 * PIXELS}])
def test_textures_in_textures_are_replaced(texture: dict[str, Any]) -> None:
    board = {"type": "checkerboard", "color0": 0.1, "color1": 0.6}
    users = {
        "s": wall(reflectance={"type": "ref", "id": "t"}),
        "u": wall(reflectance={"type": "ref", "id": "t"}),
    }
    scene = loaded(scene_of(t=board, **users))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", lajolla.SceneWarning)
        changed = scene.with_params({"t.color0": texture})
    assert same_picture(changed, loaded(scene_of(t={**board, "color0": texture}, **users)))
    assert_as_if_loaded(changed)
    assert changed["s.bsdf.reflectance"] == "t"
    assert np.allclose(changed["t.color0.image"], texture["data"])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", lajolla.SceneWarning)
        again = changed.with_params({"t.color0": BITMAP, "t.color1": texture})
    assert same_picture(again, loaded(scene_of(t={**board, "color0": BITMAP, "color1": texture}, **users)))
    with pytest.raises(lajolla.SceneError, match="cannot contain itself"):
        changed.with_params({"t.color1": "t"})


def test_adapters_contain_what_is_before_them() -> None:
    mask = {"type": "rectangle", "bsdf": {"type": "mask", "id": "mk", "opacity": 0.5, "inner": A}}
    blend = {"type": "rectangle", "bsdf": {"type": "blendbsdf", "id": "bl", "first": A, "second": B}}
    scene = loaded(scene_of(m=mask, b=blend))
    with pytest.raises(lajolla.SceneError, match='"bl" comes after "mk" in the scene'):
        scene.with_params({"mk.child": "bl"})
    loaded(scene_of(b=blend, m=mask)).with_params({"mk.child": "bl"})


def test_pickles_keep_names() -> None:
    scene = loaded(scene_of(s=wall(reflectance=BITMAP), r=wall(reflectance=0.2)))
    changed = scene.with_params({"s.bsdf": "r.bsdf"})
    again = pickle.loads(pickle.dumps(changed))
    assert list(again.params) == list(changed.params)
    assert again["r.bsdf.reflectance"].tolist() == pytest.approx([0.2] * 3)
    assert same_picture(again.with_params({"s.bsdf": "s.bsdf"}), scene)
    assert changed.with_aovs(["depth"])["r.bsdf.reflectance"].tolist() == pytest.approx([0.2] * 3)


def test_loops_do_not_grow() -> None:
    scene = loaded(scene_of(s=wall(reflectance=BITMAP), r=wall(reflectance=0.2)))
    counts = []
    rng = np.random.default_rng(2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", lajolla.SceneWarning)
        for i in range(12):
            pixels = rng.random((4, 4, 3), np.float32) * (1 + i % 2)
            scene["s.bsdf.reflectance"] = {"type": "bitmap", "data": pixels}
            scene["r.bsdf"] = ("r.bsdf", "s.bsdf")[i % 2]
            assert np.allclose(scene[scene["s.bsdf.reflectance"] + ".image"], pixels)
            counts.append(sum(len(scene.description.core[k]) for k in ("textures", "materials", "bsdfs")))
    assert_as_if_loaded(scene)
    assert max(counts[4:]) <= max(counts[:4])


# Mistakes, and threads


def test_mistakes_are_clear() -> None:
    scene = loaded(scene_of(m=TETRAHEDRON))
    with pytest.raises(lajolla.ParamError, match=r"no parameter 'm.vertex_nope'"):
        scene["m.vertex_nope"]
    for size in ((np.inf, 5), (32.7, 5.9), (np.nan, 1), (1, 2, 3)):
        with pytest.raises(lajolla.SceneError, match="two whole numbers"):
            scene["film.size"] = size
    with pytest.raises(TypeError, match="values must be a dict"):
        scene.update([("film.size", (4, 4))])  # type: ignore[arg-type]


def test_threads_update_one_scene() -> None:
    scene = loaded(ROOM)
    problems = []

    def work(shape: str) -> None:
        try:
            for i in range(40):
                scene.update({f"{shape}.bsdf": ("red", "blue", "floor.bsdf")[i % 3]})
                scene["red.reflectance"] = {"type": "bitmap", "data": PIXELS}
        except Exception as problem:
            problems.append(problem)

    threads = [threading.Thread(target=work, args=(shape,)) for shape in ("box", "ball", "floor")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert problems == []
    assert (scene["box.bsdf"], scene["ball.bsdf"]) == ("red", "red")
    assert np.array_equal(rendered(scene.core), rendered(_core.Scene(scene.description.core)))
