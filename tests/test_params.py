"""Parameters of loaded scenes: changes give the bits of a scene that was built with them."""

from __future__ import annotations

import copy
import pickle
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plugin_tools import plugin_entry, scene_with
from reader_tools import write_scene
from test_faults import KINDS, files  # noqa: F401

import lajolla
from lajolla import _core
from lajolla.scene import core_schema, plugins_by_kind
from lajolla.scene.schema import Field

SIZE = (4, 4)
LIGHT = {"type": "point", "position": [0, 3, 1], "intensity": 40.0}


def rendered(core: _core.Scene) -> np.ndarray:
    render = _core.Render(core, 1)
    render.advance(3, 1)
    return render.image()


def loaded(scene: dict[str, Any], **options: Any) -> lajolla.Scene:  # noqa: ANN401
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", lajolla.SceneWarning)
        return lajolla.load_dict(scene, size=SIZE, **options)


def assert_as_if_loaded(scene: lajolla.Scene) -> None:
    """A scene that was changed is one that is built from its description."""
    fresh = rendered(_core.Scene(scene.description.core))
    assert np.array_equal(rendered(scene.core), fresh, equal_nan=True)


def other(value: Any, field: Field) -> Any:  # noqa: ANN401
    """Another value for a numeric field, within its range; None for fields of another type."""
    low = -np.inf if field.minimum is None else field.minimum
    high = np.inf if field.maximum is None else field.maximum
    if isinstance(value, bool):
        return not value
    if field.choices:
        return next(choice for choice in (*field.choices, value) if choice != value)
    if isinstance(value, int):
        return int(value + 1 if value + 1 <= high else value - 1)
    if field.type == "transform" and field.name == "to_uv":
        return value @ np.diag([1.1, 1.2, 1.0, 1.0])
    if field.type == "transform":
        return value @ np.diag([1.1, 1.1, 1.1, 1.0])
    if field.type in ("image", "grid"):
        return None if value is None else np.asarray(value, np.float32)[::-1] * np.float32(0.7)
    numbers = np.asarray(value)
    if numbers.dtype.kind != "f":
        return None
    moved = numbers * 0.9 + 0.05 * np.arange(1, numbers.size + 1).reshape(numbers.shape)
    clipped = np.clip(moved, low, high)
    return clipped if numbers.shape else float(clipped)


def same(value: Any, expected: Any) -> bool:  # noqa: ANN401
    if isinstance(expected, str):
        return bool(value == expected)
    return bool(np.allclose(value, expected, rtol=2e-3, atol=1e-6))  # half precision of voxels


# Or that scenes here cannot ask for.
WITHOUT_NUMBERS = {"bsdf": {"measured"}, "sampler": {"independent"}, "texture": {"ptex"}}
PIXELS = np.linspace(0.1, 0.9, 48, dtype=np.float32).reshape(4, 4, 3)
INSIDE = {name: {"map": {"type": "bitmap", "data": PIXELS}} for name in ("bumpmap", "normalmap")}


@pytest.mark.parametrize("kind", KINDS)
def test_every_parameter_of_every_model(kind: str, files: Path) -> None:  # noqa: F811
    changed, seen = 0, set()
    for plugin in plugins_by_kind()[kind].values():
        try:
            entry = {**plugin_entry(kind, plugin.name), **INSIDE.get(plugin.name, {})}
            scene = loaded({**scene_with(kind, entry), "light": LIGHT}, base_path=files)
        except lajolla.SceneError:
            continue  # a plugin of which the file is another one
        before = rendered(scene.core)
        seen.update((found.kind, found.model) for found in scene.params.objects.values())
        for path, value in scene.params.items():
            new = other(value, scene.params.field(path))
            if new is None:
                continue
            try:
                scene_after = scene.with_params({path: new})
            except lajolla.SceneError as problem:
                assert "\n" not in problem.message, path  # several fields depend on each other
                continue
            if path.endswith(".normals") and np.ndim(new) == 2:  # they get unit length
                new = new / np.linalg.norm(new, axis=1, keepdims=True)
            if not path.startswith("film."):  # a window is cut where the film ends
                assert same(scene_after[path], new), path
            assert_as_if_loaded(scene_after)
            changed += 1
        assert np.array_equal(rendered(scene.core), before, equal_nan=True), plugin.name
    assert changed
    hidden = {"clamped"}  # the reader's own
    for checked in ("bsdf", "adapter") if kind == "bsdf" else (kind,):
        every = set(core_schema()[checked]) - WITHOUT_NUMBERS.get(checked, set()) - hidden
        assert {(checked, model) for model in every} <= seen


ROOM: dict[str, Any] = {
    "type": "scene",
    "integrator": {"type": "path"},
    "camera": {
        "type": "perspective",
        "fov": 60,
        "to_world": {"type": "look_at", "origin": [0, 1, -6], "target": [0, 0, 0]},
    },
    "red": {"type": "diffuse", "reflectance": [0.6, 0.1, 0.1]},
    "wood": {"type": "bitmap", "data": PIXELS},
    "floor": {
        "type": "rectangle",
        "to_world": lajolla.translate((0, -1, 0)) @ lajolla.rotate((1, 0, 0), -90) @ lajolla.scale(4),
        "bsdf": {
            "type": "twosided",
            "bsdf": {"type": "diffuse", "reflectance": {"type": "ref", "id": "wood"}},
        },
    },
    "box": {"type": "cube", "bsdf": {"type": "ref", "id": "red"}},
    "blue": {"type": "diffuse", "reflectance": [0.6, 0.1, 0.1]},
    "ball": {"type": "sphere", "center": [0, 2.0, 0], "radius": 0.5, "bsdf": {"type": "ref", "id": "blue"}},
    "lamp": {
        "type": "rectangle",
        "to_world": lajolla.translate((0, 4, 0)) @ lajolla.rotate((1, 0, 0), 90),
        "emitter": {"type": "area", "radiance": 5.0},
    },
    "sky": {"type": "constant", "radiance": 0.2},
}


@pytest.mark.parametrize(
    ("path", "value", "key"),
    [
        ("red.reflectance", (0.1, 0.5, 0.2), ("red", "reflectance")),
        ("lamp.emitter.radiance", (9.0, 2.0, 2.0), ("lamp", "emitter", "radiance")),
        ("sky.radiance", (0.0, 0.3, 0.0), ("sky", "radiance")),
        ("sensor.fov", 40.0, ("camera", "fov")),
        ("camera.to_world", lajolla.look_at((1, 2, -5), (0, 0, 0)), ("camera", "to_world")),
        ("ball.radius", 0.8, ("ball", "radius")),
        ("box.to_world", lajolla.rotate((0, 1, 0), 30), ("box", "to_world")),
        ("wood.data", PIXELS[::-1], ("wood", "data")),
        ("integrator.max_depth", 2, ("integrator", "max_depth")),
    ],
)
def test_a_change_is_what_a_scene_with_the_value_is(path: str, value: Any, key: tuple[str, ...]) -> None:  # noqa: ANN401
    path = path.replace("wood.data", "wood.image")
    scene = loaded(ROOM)
    before = rendered(scene.core)
    changed = scene.with_params({path: value})
    other_room = copy.deepcopy(ROOM)
    inner = other_room
    for name in key[:-1]:
        inner = inner[name]
    inner[key[-1]] = value
    wanted = rendered(loaded(other_room).core)
    assert np.array_equal(rendered(changed.core), wanted)
    assert not np.array_equal(before, wanted)
    assert np.array_equal(rendered(scene.core), before)
    scene[path] = value
    assert np.array_equal(rendered(scene.core), wanted)


def test_several_changes_at_once() -> None:
    scene = loaded(ROOM)
    scene.update({"red.reflectance": 0.3, "film.size": (6, 2), "lamp.emitter.radiance": 1.0})
    assert scene.params["film.size"] == (6, 2)
    assert scene.render(spp=1).array.shape == (2, 6, 3)
    assert scene["red.reflectance"].tolist() == [0.3, 0.3, 0.3]
    assert_as_if_loaded(scene)


def test_objects_with_other_ids_are_changed_alone() -> None:
    scene = loaded(ROOM).with_params({"red.reflectance": (0.0, 0.9, 0.0)})
    assert scene["blue.reflectance"].tolist() == [0.6, 0.1, 0.1]


def test_meshes_by_their_arrays() -> None:
    scene = loaded(ROOM)
    positions = scene["box.positions"]
    moved = scene.with_params({"box.positions": positions * (1, 2, 1)})
    stretched = loaded({**ROOM, "box": {**ROOM["box"], "to_world": lajolla.scale((1, 2, 1))}})
    assert np.allclose(rendered(moved.core), rendered(stretched.core), rtol=1e-4, atol=1e-5)
    assert_as_if_loaded(moved)
    flat = scene.with_params({"box.normals": None, "box.vertex_heat": np.arange(len(positions))})
    assert flat["box.normals"] is None
    assert flat["box.vertex_heat"].shape == (len(positions), 1)
    assert_as_if_loaded(flat)
    with pytest.raises(lajolla.SceneError, match=r"params\[box.uvs\]: error: .*one uv per vertex"):
        scene.with_params({"box.uvs": np.zeros((3, 2))})
    with pytest.raises(lajolla.SceneError, match="triangles"):
        scene.with_params({"box.triangles": [[0, 1, 99]]})


def test_references_are_names() -> None:
    scene = loaded(ROOM)
    assert scene["box.bsdf"] == "red"
    assert scene["floor.bsdf.reflectance"] == "wood"
    changed = scene.with_params({"box.bsdf": "floor.bsdf", "red.reflectance": "wood"})
    assert (changed["box.bsdf"], changed["red.reflectance"]) == ("floor.bsdf", "wood")
    assert_as_if_loaded(changed)
    plain = scene.with_params({"floor.bsdf.reflectance": 0.5})
    assert plain.with_params({"blue.reflectance": "wood"})["blue.reflectance"] == "wood"
    textured = scene.with_params({"red.reflectance": {"type": "bitmap", "data": PIXELS}})
    assert np.allclose(textured["red.reflectance.image"], PIXELS)
    assert_as_if_loaded(textured)


def test_objects_know_where_they_come_from(tmp_path: Path) -> None:
    body = """<bsdf type="twosided" id="red">
<bsdf type="diffuse"/></bsdf>
<shape type="cube"><ref id="red"/></shape>
<emitter type="sky"/>"""
    path = write_scene(tmp_path, body)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        params = lajolla.load(path, size=SIZE).params
    info = params.info("red.reflectance")
    assert (info.kind, info.plugin, info.model, info.line) == ("bsdf", "diffuse", "diffuse", 4)
    assert (params.info("shape_1").plugin, params.info("shape_1").model) == ("cube", "mesh")
    assert params.info("emitter_1").plugin == "sky"
    assert info.file == str(path)
    assert params.field("red.reflectance").maximum == 1
    assert list(params) == list(dict.fromkeys(params))
    assert loaded(ROOM).params.info("lamp.emitter").file == "lamp.emitter"


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("rde.reflectance", 1, "no parameter 'rde.reflectance'; did you mean 'red.reflectance'"),
        ("red.reflectanc", 1, "did you mean 'red.reflectance'"),
        ("red.reflectance", "marble", "expected the name of a texture, got 'marble'; the scene has wood"),
        ("ball.radius", -1, "must be at least 0, not -1"),
        ("ball.radius", "big", "expects a number"),
        ("sensor.fov", float("nan"), "must be finite"),
        ("integrator.max_depth", 1.5, "expects a whole number"),
        ("wood.filter_type", "linaer", "no choice"),
        ("film.size", 3, "two whole numbers"),
        ("film.size", (0, 3), "between 1 and 65536"),
        ("box.bsdf", "lamp", "expected the name of a bsdf"),
        ("sensor.to_world", np.diag([1.0, 1, 0, 1]), "to_world of the sensor is singular"),
        ("ball.to_world", lajolla.scale((1, 2, 1)), "ball: to_world of a sphere must scale alike"),
    ],
)
def test_mistakes_are_one_message(path: str, value: Any, message: str) -> None:  # noqa: ANN401
    scene = loaded(ROOM)
    with pytest.raises((lajolla.ParamError, lajolla.SceneError)) as caught:
        scene[path] = value
    assert message in str(caught.value), str(caught.value)
    assert "\n" not in str(caught.value)


def test_colours_out_of_range_are_clamped_with_a_warning() -> None:
    scene = loaded(ROOM)
    with pytest.warns(lajolla.SceneWarning, match="above 1"):
        scene["red.reflectance"] = 1.5
    assert scene["red.reflectance"].tolist() == [1, 1, 1]


def test_what_does_not_change_is_not_made_again() -> None:
    rng = np.random.default_rng(1)
    triangles = rng.uniform(-1, 1, (100_000, 1, 3)) + rng.normal(scale=0.01, size=(100_000, 3, 3))
    dust = {
        "type": "mesh",
        "positions": triangles.reshape(-1, 3),
        "triangles": np.arange(300_000).reshape(-1, 3),
        "face_normals": True,
    }
    scene = loaded({**ROOM, "dust": dust})
    scene["sensor.fov"] = 61  # makes the names

    def seconds(action: Callable[[], object]) -> float:
        times = []
        for _ in range(5):
            start = time.perf_counter()
            action()
            times.append(time.perf_counter() - start)
        return min(times)

    build = seconds(lambda: _core.Scene(scene.description.core))
    for path in (
        "sensor.fov",
        "red.reflectance",
        "lamp.emitter.radiance",
        "ball.bsdf",
        "integrator.max_depth",
    ):
        value = "red" if path == "ball.bsdf" else 3
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", lajolla.SceneWarning)
            assert seconds(lambda: scene.with_params({path: value})) < build / 10, path  # noqa: B023


def test_changes_survive_pickles() -> None:
    scene = loaded(ROOM)
    scene["red.reflectance"] = 0.9
    again = pickle.loads(pickle.dumps(scene))
    assert again["red.reflectance"].tolist() == [0.9, 0.9, 0.9]
    assert np.array_equal(rendered(again.core), rendered(scene.core))


def test_one_of_many_shapes_read_together(tmp_path: Path) -> None:
    balls = "\n".join(
        f'<shape type="sphere"><float name="radius" value="{0.1 * i + 0.1}"/></shape>' for i in range(12)
    )
    path = write_scene(tmp_path, balls)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene = lajolla.load(path, size=SIZE, integrator="depth")
    changed = scene.with_params({"shape_3.radius": 4.0, "shape_5.radius": 5.0, "shape_12.radius": 0.2})
    assert [changed[f"shape_{i}.radius"] for i in (1, 2, 3, 4, 5, 6, 12)] == pytest.approx(
        [0.1, 0.2, 4.0, 0.4, 5.0, 0.6, 0.2]
    )
    assert_as_if_loaded(changed)


def test_scenes_far_from_the_origin_and_instances() -> None:
    far = {
        "type": "scene",
        "integrator": {"type": "path"},
        "camera": {"type": "perspective", "to_world": lajolla.look_at((1e6, 1, -6), (1e6, 0, 0))},
        "group": {"type": "shapegroup", "ball": {"type": "sphere"}, "box": {"type": "cube"}},
        "copy": {
            "type": "instance",
            "to_world": lajolla.translate((1e6, 0, 0)),
            "group": {"type": "ref", "id": "group"},
        },
        "lamp": {"type": "point", "position": [1e6, 4, -3]},
        "floor": {"type": "rectangle", "to_world": lajolla.translate((1e6, -1, 3))},
    }
    scene = loaded(far)
    for path, value in (
        ("sensor.to_world", lajolla.look_at((1e6 + 1, 2, -5), (1e6, 0, 0))),
        ("lamp.position", (1e6 + 1, 3, -3)),
        ("copy.to_world", lajolla.translate((1e6, 0.5, 0))),
        ("floor.to_world", lajolla.translate((1e6, -1, 2))),
        ("shape_1.radius", 1.2),
    ):
        assert_as_if_loaded(scene.with_params({path: value}))


# Materials

GREY = {"type": "diffuse", "reflectance": 0.4}
THIN = {"type": "mask", "opacity": 0.5, "inside": GREY}


def room(**shapes: dict[str, Any]) -> dict[str, Any]:
    return {**ROOM, **{name: {**ROOM["ball"], "bsdf": copy.deepcopy(bsdf)} for name, bsdf in shapes.items()}}


def test_equal_bsdfs_of_several_shapes_are_changed_one_by_one(tmp_path: Path) -> None:
    scene = loaded(room(a=GREY, b=GREY, c=THIN, d=THIN))
    for shape, path, other in (
        ("b", "b.bsdf.reflectance", "a.bsdf.reflectance"),
        ("d", "d.bsdf.child.reflectance", "c.bsdf.child.reflectance"),
        ("d", "d.bsdf.opacity", "c.bsdf.opacity"),
    ):
        changes = scene.params.edits({path: 0.8}).changes()
        assert not any(name.startswith("shapes") and "type" in entry for name, entry in changes.items())
        changed = scene.with_params({path: 0.8})
        assert np.allclose(changed[path], 0.8), path
        assert np.allclose(changed[other], scene[other]), path
        assert changed[f"{shape}.bsdf"] == f"{shape}.bsdf"
        assert list(changed.params) == list(scene.params)
        assert_as_if_loaded(changed)
    blend = {"type": "blendbsdf", "weight": 0.5, "x": THIN, "y": THIN}
    inside = loaded(room(a=blend, b=blend, c={"type": "twosided", "front": GREY, "back": GREY}))
    inside.update({"b.bsdf.second.child.reflectance": 0.1, "c.bsdf_back.reflectance": 0.2})
    paths = [f"{s}.bsdf.{side}.child.reflectance" for s in "ab" for side in ("first", "second")]
    assert [inside[path][0] for path in [*paths, "c.bsdf.reflectance"]] == pytest.approx(
        [0.4] * 3 + [0.1, 0.4]
    )
    assert_as_if_loaded(inside)
    linked = scene.with_params({"b.bsdf": "a.bsdf"}).with_params({"a.bsdf.reflectance": 0.1})
    assert linked["b.bsdf"] == "a.bsdf"
    assert np.allclose(linked.with_params({"b.bsdf": "b.bsdf"})["b.bsdf.reflectance"], 0.4)
    again = pickle.loads(pickle.dumps(scene)).with_params({"b.bsdf.reflectance": 0.2})
    assert (again["a.bsdf.reflectance"][0], again["b.bsdf.reflectance"][0]) == (0.4, 0.2)
    ball = '<shape type="sphere"><float name="radius" value="{}"/><bsdf type="diffuse"/></shape>\n'
    path = write_scene(tmp_path, "".join(ball.format(0.1 + 0.1 * i) for i in range(12)))
    spheres = lajolla.load(path, size=SIZE).with_params({"shape_7.bsdf.reflectance": 0.7})
    assert [spheres[f"shape_{i}.bsdf.reflectance"][0] for i in (6, 7, 8)] == pytest.approx([0.5, 0.7, 0.5])
    assert_as_if_loaded(spheres)


@pytest.mark.parametrize("two_sided", [False, True])
@pytest.mark.parametrize(
    "bsdf",
    [
        {"type": "roughconductor", "material": "Au", "alpha": 0.3},
        {"type": "twosided", "front": GREY, "back": {"type": "plastic"}},
        {"type": "mask", "opacity": 0.3, "inside": {"type": "bumpmap", "inside": GREY, **INSIDE["bumpmap"]}},
    ],
)
def test_a_shape_takes_a_new_bsdf(bsdf: dict[str, Any], two_sided: bool) -> None:
    scene = loaded(room(a=GREY, b=GREY), two_sided=two_sided)
    wanted = rendered(loaded(room(a=GREY, b=bsdf), two_sided=two_sided).core)
    changed = scene.with_params({"b.bsdf": bsdf})
    assert np.array_equal(rendered(changed.core), wanted)
    assert changed["b.bsdf"] == "b.bsdf"
    counts = set()
    for opacity in (0.1, 0.2, 0.3, 0.4):
        changed["b.bsdf"] = {**bsdf, "opacity": opacity} if "opacity" in bsdf else bsdf
        counts.add(tuple(len(changed.description.core[k]) for k in ("bsdfs", "adapters", "materials")))
    assert len(counts) == 1
    changed["b.bsdf"] = bsdf
    assert np.array_equal(rendered(changed.core), wanted)


def test_new_bsdfs_are_checked_and_named() -> None:
    scene = loaded({**room(a=GREY), "spare": {"type": "plastic"}, "coat": {**THIN, "inside": GREY}})
    named = scene.with_params({"a.bsdf": {"type": "plastic", "id": "shiny"}})
    assert named["a.bsdf"] == "shiny"
    assert named["shiny.int_ior"] == pytest.approx(1.49)
    unused = scene.with_params({"a.bsdf": "coat", "box.bsdf": {"type": "ref", "id": "spare"}})
    assert (unused["a.bsdf"], unused["box.bsdf"], unused["coat.opacity"]) == ("coat", "spare", 0.5)
    assert_as_if_loaded(unused)
    unused["coat.child"] = {"type": "conductor"}
    assert (unused["coat.child"], unused["coat.child.k"].tolist()) == ("coat.child", [1, 1, 1])
    with pytest.raises(lajolla.SceneError, match="a new adapter comes after"):
        unused["coat.child"] = THIN
    for value, message in (
        ({"type": "point"}, "expected a bsdf, got emitter"),
        ({"type": "diffuse", "reflectance": "red paint"}, "reflectance"),
        ("marble", "expected the name of a bsdf, got 'marble'; the scene has .*spare"),
    ):
        with pytest.raises(lajolla.SceneError, match=message):
            scene["a.bsdf"] = value


# What programs try


def test_arrays_of_a_scene_are_read_only() -> None:
    scene = loaded(ROOM)
    for path in ("box.positions", "sensor.to_world", "red.reflectance", "wood.image"):
        with pytest.raises(ValueError, match="read-only"):
            scene[path][..., 0] += 1


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("box.vertex_positions", "did you mean 'box.positions'"),
        ("box.faces", "did you mean 'box.triangles'"),
        ("red.roughness", "red has reflectance"),
        ("nothing.alike.at.all", "scene.params lists all"),
    ],
)
def test_unknown_paths_name_what_there_is(path: str, message: str) -> None:
    scene = loaded(ROOM)
    with pytest.raises(lajolla.ParamError, match=message) as caught:
        scene[path] = np.zeros((3, 3))
    assert len(str(caught.value)) < 150
    assert path not in scene
    assert "box.positions" in scene
    assert list(scene) == list(scene.params)


def test_parameters_that_stand_for_several() -> None:
    metal = {"type": "roughconductor", "alpha": 0.3}
    fog = {"type": "homogeneous", "sigma_t": 2.0, "albedo": 0.75}
    scene = loaded({**room(a=metal), "box": {"type": "cube", "bsdf": {"type": "null"}, "interior": fog}})
    scene.update({"a.bsdf.alpha": 0.2, "a.bsdf.material": "Au"})
    scene.update({"box.interior.albedo": 0.5, "box.interior.sigma_t": (1, 2, 4)})
    assert scene["a.bsdf.alpha"] == scene["a.bsdf.alpha_v"] == pytest.approx(0.2)
    gold = loaded(room(a={**metal, "material": "Au"}))
    assert np.allclose(scene["a.bsdf.eta"], gold["a.bsdf.eta"])
    assert scene["box.interior.sigma_s"].tolist() == [0.5, 1, 2]
    assert scene["box.interior.sigma_t"].tolist() == [1, 2, 4]
    scene["a.bsdf.alpha_u"] = 0.1
    with pytest.raises(lajolla.ParamError, match="stands for alpha_u and alpha_v"):
        scene["a.bsdf.alpha"]
    for path, value in (("a.bsdf.material", "Unobtainium"), ("box.interior.albedo", 2)):
        with pytest.raises(lajolla.SceneError, match=path):
            scene[path] = value


def test_normals_get_unit_length_and_arrays_are_checked() -> None:
    scene = loaded(ROOM)
    normals, positions = scene["box.normals"], scene["box.positions"]
    assert np.array_equal(scene.with_params({"box.normals": normals})["box.normals"], normals)
    assert np.allclose(scene.with_params({"box.normals": 5 * normals})["box.normals"], normals)
    for path, value, message in (
        ("box.normals", np.nan * normals, "normals must be finite"),
        ("box.positions", positions.astype(complex), "real numbers, not complex numbers"),
        ("box.positions", positions.astype(object), "real numbers, not objects"),
        ("box.triangles", np.ones((2, 3), bool), "whole numbers.*not truth values"),
    ):
        with pytest.raises(lajolla.SceneError, match=message):
            scene[path] = value


def test_warnings_of_changes_are_the_scenes() -> None:
    scene = loaded(ROOM)
    before = len(scene.warnings)
    with pytest.warns(lajolla.SceneWarning):
        scene["red.reflectance"] = 1.5
    with pytest.warns(lajolla.SceneWarning):
        scene["red.reflectance"] = 1.25
    assert [w.message for w in scene.warnings[before:]] == [
        '"reflectance" of bsdf "diffuse" is above 1 (1.25, 1.25, 1.25) and clamped'
    ]
    scene["red.reflectance"] = 0.5
    assert len(scene.warnings) == before


def test_roughness_tables_stay_when_colours_change() -> None:
    rough = {"type": "roughdielectric", "alpha": 0.3, "multiscatter": True}
    scene = loaded(room(a=rough, b={"type": "roughplastic"}))
    scene["sensor.fov"] = 61  # makes the names

    def seconds(path: str) -> float:
        times = []
        for i in range(4):
            start = time.perf_counter()
            scene[path] = 0.2 + 0.1 * i
            times.append(time.perf_counter() - start)
        return min(times)

    for colour, roughness in (
        ("a.bsdf.specular_reflectance", "a.bsdf.alpha"),
        ("b.bsdf.diffuse_reflectance", "b.bsdf.alpha"),
    ):
        assert seconds(colour) < seconds(roughness) / 3
