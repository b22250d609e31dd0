"""Rendering from Python: sensors and variables chosen for each render, asyncio, and rays in bulk."""

from __future__ import annotations

import asyncio
import copy
import pickle
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_params import PIXELS, ROOM, loaded

import lajolla
from lajolla import _core

SECOND = {
    "type": "perspective",
    "fov": 30,
    "to_world": lajolla.look_at((3, 2, -4), (0, 0, 0)),
    "film": {"type": "hdrfilm", "width": 7, "height": 5, "pixel_format": "rgba", "rfilter": {"type": "box"}},
    "sampler": {"type": "independent", "sample_count": 2},
}
TWO = {**ROOM, "second": SECOND}


def test_every_sensor_of_a_scene_is_usable() -> None:
    scene = loaded(TWO)
    assert (scene.sensors, scene.sensor) == (("camera", "second"), "camera")
    for sensor in (1, "second", "1"):
        image = scene.render(spp=2, sensor=sensor)
        wanted = loaded(TWO, sensor="second").render(spp=2)
        assert np.array_equal(image.array, wanted.array)
        assert np.array_equal(image.channels["A"], wanted.channels["A"])
    first = scene.render(spp=2)
    back = scene.with_sensor(1).with_sensor(0)
    assert np.array_equal(back.render(spp=2).array, first.array)
    again = pickle.loads(pickle.dumps(scene.with_sensor(1)))
    assert again.sensor == "second"
    assert np.array_equal(again.render(spp=2, sensor="camera").array, first.array)


def test_sizes_of_sensors_are_their_own() -> None:
    scene = lajolla.load_dict(TWO)
    assert scene.warnings == []  # they may be there on purpose
    assert scene.with_sensor("second").render(spp=1).array.shape == (5, 7, 3)
    assert (scene.width, scene.height) == (768, 576)
    assert scene.with_sensor(1)["sensor.fov"] == 30


def test_parameters_of_other_sensors() -> None:
    scene = lajolla.load_dict(TWO)
    first = scene["sensor.fov"]
    assert scene["second.fov"] == scene.with_sensor("second")["second.fov"] == 30
    scene.update({"second.fov": 35, "camera.fov": 50})
    assert (scene["second.fov"], scene["sensor.fov"], first) == (35, 50, 60)
    assert scene.with_sensor("second")["camera.fov"] == 50
    wanted = {**TWO, "second": {**TWO["second"], "fov": 35}}
    image = lajolla.load_dict(wanted).render(spp=1, sensor="second")
    assert np.array_equal(scene.render(spp=1, sensor="second").array, image.array)
    with pytest.raises(lajolla.ParamError, match=r"'second\.fovv'; did you mean 'second\.fov'"):
        scene["second.fovv"]


def test_a_rendering_takes_the_options_of_render() -> None:
    scene = lajolla.load_dict(TWO)
    rendering = scene.rendering(spp=1, sensor="second", aovs=["depth"])
    seen: list[float] = []
    rendering.run(progress=lambda state: seen.append(state.samples))
    image = rendering.image()
    assert np.array_equal(image.array, scene.render(spp=1, sensor="second").array)
    assert "depth.Z" in image.channels
    assert seen[-1] == 1
    assert "7 x 5 pixels, 1 samples" in repr(rendering)
    assert scene.with_sensor(1).params.info("sensor").file == "second"


def test_changes_hold_for_every_sensor() -> None:
    changed = copy.deepcopy(TWO)
    changed["red"]["reflectance"] = 0.9
    scene = loaded(TWO).with_params({"red.reflectance": 0.9})
    assert np.array_equal(scene.render(spp=1, sensor=1).array, loaded(changed, sensor=1).render(spp=1).array)


def test_pickles_do_not_hold_files(tmp_path: Path) -> None:
    camera = (
        '<sensor type="perspective"><film type="hdrfilm"><integer name="width" value="{}"/></film></sensor>'
    )
    text = f"""<scene version="3.0.0"><!-- secret --><integrator type="path"/><emitter type="constant"/>
        {camera.format(4)}{camera.format(5)}{camera.format(-1)}</scene>"""
    (tmp_path / "scene.xml").write_text(text)
    scene = lajolla.load(tmp_path / "scene.xml", sensor=0)
    data = pickle.dumps(scene)
    assert b"secret" not in data
    assert pickle.loads(data).with_sensor(1).width == 5
    with pytest.raises(lajolla.SceneError, match="between 1 and 65536"):
        pickle.loads(data).with_sensor(2)


def test_unknown_sensors_are_refused() -> None:
    with pytest.raises(lajolla.OptionError, match="unknown sensor 'secnod'; did you mean 'second'"):
        loaded(TWO).render(sensor="secnod")
    with pytest.raises(lajolla.OptionError, match="unknown sensor 2"):
        loaded(TWO).render(sensor=2)
    broken = {**TWO, "second": {**SECOND, "fov": 500}}
    with pytest.raises(lajolla.SceneError, match="fov"):
        loaded(broken).render(sensor=1)
    assert loaded(broken).render(spp=1).array.shape == (4, 4, 3)


def test_variables_are_chosen_for_each_render() -> None:
    scene = loaded(ROOM)
    arrays = scene.render(spp=2, aovs=["depth", "albedo", "shape", "alpha", "crypto_material"]).arrays()
    wanted = (
        loaded(ROOM, aovs=["depth", "albedo", "shape", "alpha", "crypto_material"]).render(spp=2).arrays()
    )
    assert arrays.keys() == wanted.keys()
    for name, values in wanted.items():
        assert np.array_equal(arrays[name], values), name
    assert set(arrays["shape_names"]) >= {"floor", "box", "ball", "lamp"}
    assert scene.render(spp=1).channels == {}
    with pytest.raises(lajolla.OptionError, match="did you mean 'depth'"):
        scene.render(aovs=["dpeth"])


def test_progress_is_reported() -> None:
    seen: list[lajolla.Progress] = []
    loaded(ROOM).render(spp=3, progress=seen.append)
    assert seen[-1].samples == 3


def test_async_renders_give_the_same_picture() -> None:
    scene = loaded(ROOM)

    async def both() -> list[lajolla.Image]:
        return await asyncio.gather(scene.render_async(spp=4), scene.render_async(spp=4, sensor=0))

    wanted = scene.render(spp=4).array
    for image in asyncio.run(both()):
        assert np.array_equal(image.array, wanted)
    with pytest.raises(TypeError, match="did you mean 'spp'"):
        asyncio.run(scene.render_async(sp=4))


def test_cancelling_a_task_stops_its_render() -> None:
    scene = loaded(ROOM)

    async def patience() -> None:
        await asyncio.wait_for(scene.render_async(spp=1 << 28), timeout=0.3)

    start = time.perf_counter()
    with pytest.raises(asyncio.TimeoutError):
        asyncio.run(patience())
    assert time.perf_counter() - start < 20
    assert np.array_equal(scene.render(spp=1).array, loaded(ROOM).render(spp=1).array)


def test_a_rendering_goes_on_after_a_cancelled_pass() -> None:
    scene = loaded(ROOM)
    rendering = scene.rendering(spp=64)

    def stop(progress: lajolla.Progress) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rendering.run(stop)
    rendering.run()
    assert np.array_equal(rendering.image().array, scene.render(spp=64).array)


# Rays


def test_intersections_of_a_sphere() -> None:
    ball = {"type": "sphere", "center": [1e6, 2, 0], "radius": 0.5}  # the scene is moved to the origin
    scene = loaded({"type": "scene", "integrator": {"type": "path"}, "sensor": ROOM["camera"], "ball": ball})
    angles = np.linspace(0, 2 * np.pi, 101)
    directions = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    origins = np.array([1e6, 2, 0]) - 2 * directions
    hits = scene.intersect(origins, 3 * directions)
    assert hits.hit.all()
    assert np.allclose(hits.distance, 0.5, atol=0.03)  # float32 resolves 1/16 there
    assert np.allclose(hits.normal, -directions, atol=0.15)
    assert [hits.shape_names[i] for i in hits.shape] == ["ball"] * 101
    assert not scene.intersect(origins, -directions).hit.any()
    assert not scene.occluded(origins, directions, 1.0).any()
    assert scene.occluded(origins, directions).all()
    assert scene.intersect(origins, directions, 1.0).distance.tolist() == [np.inf] * 101


def test_rays_are_hit_as_the_renderer_hits_them() -> None:
    scene = loaded(ROOM)
    rng = np.random.default_rng(3)
    origins = rng.uniform(-3, 3, (1000, 3)).astype(np.float32)
    directions = rng.normal(size=(1000, 3)).astype(np.float32)
    hits = scene.intersect(origins, directions)
    moved = origins + hits.distance[:, None] * directions
    assert 0.2 < hits.hit.mean() < 0.9
    assert np.allclose(hits.position[hits.hit], moved[hits.hit], atol=1e-4)
    assert np.array_equal(hits.hit, scene.occluded(origins, directions))
    assert np.array_equal(hits.hit, scene.occluded(origins, directions, hits.distance * 1.001))
    assert not scene.occluded(origins, directions, hits.distance * 0.999)[hits.hit].any()
    assert np.allclose(np.linalg.norm(hits.normal[hits.hit], axis=1), 1, atol=1e-5)
    for threads in (1, 2):
        assert np.array_equal(scene.intersect(origins, directions, threads=threads).distance, hits.distance)
    one = scene.intersect(origins[5], directions[5])
    assert one.distance.shape == (1,)
    assert one.distance[0] == hits.distance[5]
    assert one.shape[0] == hits.shape[5]
    none = scene.intersect(np.zeros((0, 3)), (0, 0, 1))
    assert none.position.shape == (0, 3)


def test_texture_coordinates_and_primitives_of_hits() -> None:
    scene = loaded(ROOM)
    hits = scene.intersect([[1.0, 1, 1.5], [-3, 1, -3]], (0, -1, 0))
    assert [hits.shape_names[i] for i in hits.shape] == ["floor", "floor"]
    assert np.allclose(hits.uv, [[(1 + 4) / 8, (4 - 1.5) / 8], [1 / 8, 7 / 8]], atol=1e-5)
    assert np.allclose(hits.geometric_normal, [[0, 1, 0]] * 2, atol=1e-6)


@pytest.mark.parametrize(
    ("origins", "directions", "far", "message"),
    [
        (np.zeros((2, 3)), np.ones((3, 3)), 1.0, "have 2, 3 and 1 rows"),
        (np.zeros((2, 2)), np.ones((2, 3)), 1.0, r"origins must have the shape \(N, 3\)"),
        ((0, 0, 0), np.ones((3, 3)), [1.0, 2.0], "have 1, 3 and 2 rows"),
    ],
)
def test_rays_of_the_wrong_shape(origins: Any, directions: Any, far: Any, message: str) -> None:  # noqa: ANN401
    with pytest.raises(ValueError, match=message):
        loaded(ROOM).intersect(origins, directions, far)


def test_rays_that_are_no_numbers_have_no_hits() -> None:
    hits = loaded(ROOM).intersect([[np.nan, 0, 0], [0, 0, np.inf]], (0, 0, 1))
    assert not hits.hit.any()


def test_numbers_of_hits_are_those_of_layers() -> None:
    """Of shapes and instances, from 1, and 0 for none; names have the same numbers."""
    copies = {"type": "shapegroup", "leaf": {"type": "sphere", "radius": 0.2}}
    place = {
        "type": "instance",
        "to_world": lajolla.translate((0, 2, -2)),
        "of": {"type": "ref", "id": "tree"},
    }
    scene = loaded({**ROOM, "tree": copies, "copy": place})
    layers = scene.render(spp=1, aovs=["shape", "instance", "material"]).layers
    hits = scene.intersect([[0, 2, -6], [0, 50, -6], [0, 0, -6]], (0, 0, 1))
    assert list(hits.shape_names) == list(layers["shape"].names)
    assert list(hits.instance_names) == list(layers["instance"].names)
    assert np.array(hits.shape_names)[hits.shape].tolist() == ["shape_5", "", "box"]
    assert np.array(hits.instance_names)[hits.instance].tolist() == ["copy", "", ""]
    assert set(layers["material"].names[1:]) <= {str(scene[path]) for path in scene if path.endswith(".bsdf")}
    assert hits == hits
    assert isinstance(hash(hits), int)


@pytest.mark.parametrize("sensor", [{}, {"type": "thinlens", "aperture_radius": 0.1}, {"near_clip": 6.0}])
def test_rays_of_the_camera_see_what_layers_show(sensor: dict[str, Any]) -> None:
    scene = loaded({**ROOM, "camera": {**ROOM["camera"], **sensor}}, crop=(1, 0, 3, 4))
    hits = scene.intersect(*scene.camera_rays())
    seen = scene.render(spp=1, aovs=["shape"]).layers["shape"].values
    assert np.array_equal(hits.shape.reshape(4, 3), seen)
    assert hits.hit.any()


def test_a_dict_without_sensor_can_be_traced() -> None:
    with pytest.warns(lajolla.SceneWarning, match="no sensor; one that sees the whole scene is added"):
        scene = lajolla.load_dict({"type": "scene", "ball": {"type": "sphere"}})
    assert scene.intersect((0, 0, 5), (0, 0, -1)).distance.tolist() == [4]
    assert (scene.sensors, scene.sensor) == ((), "")


def test_meshes_from_arrays() -> None:
    box = _core.Mesh  # noqa: F841
    positions = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    mesh = {
        "type": "mesh",
        "positions": positions,
        "triangles": [[0, 1, 2], [0, 2, 3]],
        "uvs": (positions[:, :2] + 1) / 2,
        "attributes": {"vertex_tint": np.ones((4, 3))},
        "bsdf": {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "vertex_tint"}},
    }
    scene = loaded({**ROOM, "sheet": mesh})
    assert scene["sheet.positions"].shape == (4, 3)
    assert scene["sheet.vertex_tint"].tolist() == [[1, 1, 1]] * 4
    assert np.allclose(scene["sheet.normals"], [[0, 0, 1]] * 4)
    hit = scene.intersect((0.5, 0, -3), (0, 0, 1))
    assert hit.shape_names[hit.shape[0]] in ("sheet", "box")
    for wrong, message in (
        ({"positions": np.zeros((2, 2))}, "positions must have the shape"),
        ({"triangles": [[0, 1, 7]]}, "mesh"),
        ({"triangles": [[0.5, 1, 2]]}, "whole numbers"),
        ({"attributes": {"tint": np.ones((4, 3))}}, "begins with vertex_ or face_"),
        ({"mesh": scene.description.core["shapes"][0].get("mesh", 3)}, "mesh"),
    ):
        with pytest.raises(lajolla.SceneError, match=message):
            loaded({**ROOM, "sheet": {**mesh, **wrong}})


def test_look_at_in_dicts() -> None:
    place = {"type": "look_at", "origin": [1, 2, 3], "target": [0, 0, 0], "up": [0, 0, 1]}
    scene = loaded({**ROOM, "camera": {"type": "perspective", "to_world": place}})
    assert np.allclose(scene["sensor.to_world"], lajolla.look_at((1, 2, 3), (0, 0, 0), (0, 0, 1)))
    for wrong, message in (
        ({"origin": [0, 0, 0]}, "origin and target are the same"),
        ({"target": 3}, 'needs "target": three numbers'),
        ({"tarjet": [0, 0, 0]}, 'did you mean "target"'),
    ):
        with pytest.raises(lajolla.SceneError, match=message):
            loaded({**ROOM, "camera": {"type": "perspective", "to_world": {**place, **wrong}}})
    with pytest.raises(ValueError, match="up points along"):
        lajolla.look_at((0, 0, 0), (0, 1, 0))
    with pytest.raises(ValueError, match="three finite numbers"):
        lajolla.translate((1, 2))


def test_environment_maps_and_grids_from_arrays() -> None:
    panorama = np.broadcast_to(np.float32([0.2, 0.4, 0.6]), (4, 8, 3))
    smoke = {
        "type": "heterogeneous",
        "sigma_t": {"type": "gridvolume", "grid": np.ones((2, 3, 4), np.float32)},
    }
    scene = loaded(
        {
            **{key: ROOM[key] for key in ("type", "camera")},
            "integrator": {"type": "volpath"},
            "sky": {"type": "envmap", "data": panorama},
            "cloud": {"type": "cube", "bsdf": {"type": "null"}, "interior": smoke},
        }
    )
    assert np.allclose(scene["sky.image"], panorama)
    assert scene["cloud.interior.sigma_t.grid"].shape == (2, 3, 4, 1)
    brighter = scene.with_params({"sky.image": 2 * panorama, "sky.scale": 0.5})
    assert np.allclose(brighter.render(spp=8).array, scene.render(spp=8).array, rtol=1e-5)
    assert PIXELS.shape == (4, 4, 3)
