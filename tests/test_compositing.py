"""Shapes and lights that the camera sees otherwise than other rays do. What it should see is computed from
renders without these properties: of a camera behind a shape that is invisible to it, and of mattes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scene_tools import look_at, rotation, scaling, translation

import lajolla
from lajolla import _core, checkpoint
from lajolla.cli import main
from lajolla.colour import luminance
from lajolla.render import StopRules
from lajolla.scene import convert
from lajolla.scene.schema import COMPOSITING, core_schema
from lajolla.viewer.facts import inspected
from lajolla.viewer.view import View

Scene = dict[str, Any]

SIZE, SAMPLES = 8, 16  # the plane z = 0 from -1 to 1, seen from above
INTEGRATORS: dict[str, Scene] = {
    "path": {"type": "path", "max_depth": 4},
    "volpath": {"type": "volpath", "max_depth": 4},
    "direct": {"type": "direct", "emitter_samples": 2},
    "ao": {"type": "ao"},
}
GREY = {"type": "twosided", "inner": {"type": "diffuse", "reflectance": 0.6}}
BALL = {"type": "sphere", "center": [0, 0, 1], "radius": 0.5}
TUBE = "-1 0 1 0.4\n1 0 1 0.4\n"  # a curve
LEAF = {"type": "mask", "opacity": 0.5, "inner": GREY}
SKY = {"type": "constant", "radiance": {"type": "rgb", "value": [0.2, 0.3, 0.5]}}
LAMP = {
    "type": "rectangle",
    "to_world": translation(-1.5, 0, 2) @ rotation((0, 1, 0), 120) @ scaling(0.5),
    "emitter": {"type": "area", "radiance": 9.0},
    "bsdf": GREY,
}
HIDDEN = {"visible_to_camera": False}
HOLDOUT = {"holdout": True}
AOVS = ["depth", "normal", "alpha", "shape", "crypto_shape"]


def stage(integrator: Scene, *, height: float = 5, alpha: bool = True, **objects: Scene) -> Scene:
    """A floor under a lamp and a sky, and objects, seen from above by parallel rays."""
    film = {"type": "hdrfilm", "width": SIZE, "height": SIZE, "pixel_format": "rgba" if alpha else "rgb"}
    camera = look_at((0, 0, height), (0, 0, 0))
    return {
        "type": "scene",
        "integrator": integrator,
        "sensor": {"type": "orthographic", "to_world": camera, "film": {**film, "rfilter": {"type": "box"}}},
        "floor": {"type": "rectangle", "to_world": scaling(2), "bsdf": GREY},
        "lamp": LAMP,
        "sky": SKY,
        **objects,
    }


def objects_of(kind: str, folder: Path, flags: Scene) -> Scene:
    """An object of a kind above the floor, which the camera sees as the flags say."""
    if kind == "sphere":
        return {"ball": {**BALL, "bsdf": GREY, **flags}}
    if kind == "mesh":
        return {
            "box": {"type": "cube", "to_world": translation(0, 0, 1) @ scaling(0.5), "bsdf": GREY, **flags}
        }
    if kind == "curve":
        (folder / "tube.txt").write_text(TUBE)
        return {"tube": {"type": "linearcurve", "filename": folder / "tube.txt", "bsdf": GREY, **flags}}
    if kind == "mask":
        return {"leaf": {**BALL, "bsdf": LEAF, **flags}}
    group = {"type": "shapegroup", "ball": {**BALL, "bsdf": GREY, **(flags if kind == "member" else {})}}
    shown = {"type": "ref", "id": "group"}
    return {
        "group": group,
        "copy": {"type": "instance", "group": shown, **(flags if kind == "instance" else {})},
    }


def rendered(scene: Scene, **options: Any) -> lajolla.Image:  # noqa: ANN401
    return lajolla.load_dict(scene, spp=SAMPLES, **options).render()


@pytest.mark.parametrize("kind", ["sphere", "mesh", "curve", "mask", "member", "instance"])
@pytest.mark.parametrize("name", INTEGRATORS)
def test_the_camera_sees_through_what_is_invisible_to_it(name: str, kind: str, tmp_path: Path) -> None:
    """What is behind it, and there its shadow and its reflected light: as a camera under it sees."""
    above = rendered(stage(INTEGRATORS[name], **objects_of(kind, tmp_path, HIDDEN)), aovs=AOVS)
    below = rendered(stage(INTEGRATORS[name], height=0.3, **objects_of(kind, tmp_path, {})), aovs=AOVS)
    empty = rendered(stage(INTEGRATORS[name]))
    np.testing.assert_allclose(above.array, below.array, rtol=2e-3, atol=2e-3)
    assert np.abs(above.array - empty.array).max() > 0.05
    ours, theirs = above.arrays(), below.arrays()
    np.testing.assert_allclose(ours["depth"], theirs["depth"] + 4.7, rtol=1e-5)
    for layer in ("alpha", "normal", "shape", "crypto_shape", "crypto_shape_coverage"):
        np.testing.assert_allclose(ours[layer], theirs[layer], atol=1e-6)


@pytest.mark.parametrize("name", ["path", "volpath", "direct"])
def test_invisible_lights_are_those_that_an_integrator_hides(name: str) -> None:
    """Bit for bit, among them lights behind a mask, and in the features for denoising."""
    front = {"leaf": {"type": "rectangle", "to_world": translation(1.2, 0, 1), "bsdf": LEAF}}
    small = {"floor": {"type": "rectangle", "to_world": scaling(0.5), "bsdf": GREY}}
    shown = {"lamp": {**LAMP, "to_world": translation(0.5, 0, 2) @ rotation((0, 1, 0), 200) @ scaling(0.4)}}
    hidden = {name: {**light, **HIDDEN} for name, light in (*shown.items(), ("sky", SKY))}
    theirs = lajolla.load_dict(
        stage(INTEGRATORS[name], **front, **small, **shown), spp=SAMPLES, aovs=AOVS, hide_emitters=True
    )
    ours = lajolla.load_dict(stage(INTEGRATORS[name], **front, **small, **hidden), spp=SAMPLES, aovs=AOVS)
    expected, found = theirs.render().arrays(), ours.render().arrays()
    assert 0.2 < expected["alpha"].mean() < 0.8
    for layer, values in expected.items():
        np.testing.assert_array_equal(found[layer], values, err_msg=layer)
    features = ours.features()
    for layer, values in theirs.features().items():
        np.testing.assert_array_equal(features[layer], values, err_msg=layer)


def test_an_environment_that_is_no_background() -> None:
    """Of two, the other one remains; light groups add up to the picture."""
    gone = {**SKY, **HIDDEN, "lightgroup": "gone"}
    blue = {"type": "constant", "radiance": {"type": "rgb", "value": [0.0, 0.0, 0.25]}, "lightgroup": "blue"}
    half = {"floor": {"type": "rectangle", "to_world": translation(1, 0, 0), "bsdf": GREY}}
    with pytest.warns(lajolla.SceneWarning, match="several environment lights"):
        both = rendered(stage(INTEGRATORS["path"], **half, sky=gone, blue=blue), aovs=["lightgroups"])
    layers = both.arrays()
    np.testing.assert_array_equal(both.array[:, : SIZE // 2], np.tile([0, 0, 0.25], (SIZE, SIZE // 2, 1)))
    assert np.all(layers["alpha"] == 1) and np.all(layers["lightgroup_gone"][:, SIZE // 2 :] > 0)
    total = layers["lightgroup_gone"] + layers["lightgroup_blue"] + layers["lightgroup_rest"]
    np.testing.assert_allclose(total, both.array, rtol=1e-5, atol=1e-6)
    alone = rendered(stage(INTEGRATORS["path"], **half, sky=gone))
    assert np.all(alone.array[:, : SIZE // 2] == 0) and np.all(alone.channels["A"][:, : SIZE // 2] == 0)
    clear = {"type": "sky", "sun_direction": [0.5, 0.5, 1], **HIDDEN}
    assert np.all(rendered(stage(INTEGRATORS["path"], **half, sky=clear)).array[:, : SIZE // 2] == 0)


@pytest.mark.parametrize("kind", ["sphere", "mesh", "curve", "mask", "member", "instance"])
@pytest.mark.parametrize("name", INTEGRATORS)
def test_holdouts_are_holes(name: str, kind: str, tmp_path: Path) -> None:
    """Black with alpha 0, even with a sky behind; other samples are as before, bit for bit."""

    def view(flags: Scene) -> lajolla.Image:
        objects = objects_of(kind, tmp_path, flags)
        return rendered(stage(INTEGRATORS[name], **objects), aovs=AOVS)

    hole, whole = view(HOLDOUT), view({})
    names = list(whole.arrays()["crypto_shape_names"])
    floor = names.index("floor")
    layers, matte = hole.arrays(), whole.arrays()
    of_floor = np.where(matte["crypto_shape"] == floor, matte["crypto_shape_coverage"], 0).sum(axis=2)
    assert np.ptp(of_floor) > 0.4
    if (name, kind) != ("ao", "mask"):  # ambient occlusion sees no masks
        np.testing.assert_allclose(layers["alpha"], of_floor, atol=1e-6)
    outside = layers["alpha"] == 1
    np.testing.assert_array_equal(hole.array[outside], whole.array[outside])
    assert np.all(hole.array[layers["alpha"] == 0] == 0)
    assert np.all(hole.array <= whole.array + 1e-6)
    np.testing.assert_allclose(layers["depth"], 5 * of_floor, rtol=1e-5)
    assert set(np.unique(layers["crypto_shape"])) <= {0, floor}
    assert set(np.unique(layers["shape"])) <= {0, floor}


def test_half_a_pixel_of_a_hole() -> None:
    """A black holdout takes alpha alone: the premultiplied colours around it stay."""
    black = {**BALL, "bsdf": {"type": "diffuse", "reflectance": 0.0}}
    hole, whole = (rendered(stage(INTEGRATORS["path"], ball={**black, **flags})) for flags in (HOLDOUT, {}))
    np.testing.assert_array_equal(hole.array, whole.array)
    alpha = hole.channels["A"]
    assert np.any((alpha > 0) & (alpha < 1)) and np.all(whole.channels["A"] == 1)


def test_other_rays_see_holdouts_and_invisible_shapes() -> None:
    """In a mirror beside it, a ball looks the same."""
    mirror = {
        "type": "rectangle",
        "to_world": translation(0.6, 0, 0.4) @ rotation((0, 1, 0), -45) @ scaling(0.5),
        "bsdf": {"type": "twosided", "inner": {"type": "conductor"}},
    }
    ball = {"type": "sphere", "center": [-0.6, 0, 0.5], "radius": 0.3, "bsdf": GREY}
    scene = {"mirror": mirror}
    views = [
        rendered(stage(INTEGRATORS["path"], **scene, ball={**ball, **flags}))
        for flags in ({}, HOLDOUT, HIDDEN)
    ]
    right = slice(SIZE // 2 + 1, None)
    without = rendered(stage(INTEGRATORS["path"], **scene))
    for view in views:
        np.testing.assert_array_equal(view.array[:, right], views[0].array[:, right])
        assert np.abs(view.array[:, right] - without.array[:, right]).max() > 0.1


def test_features_of_holes_are_empty() -> None:
    scene = stage(INTEGRATORS["path"], ball={**BALL, "bsdf": GREY, **HOLDOUT})
    features = lajolla.load_dict(scene).features()
    middle = slice(SIZE // 2 - 1, SIZE // 2 + 1)
    for layer in ("albedo.R", "normal.z"):
        assert np.all(features[layer][middle, middle] == 0) and np.all(features[layer][0] > 0.5)


def test_denoised_holes_are_black() -> None:
    """Where nothing but a holdout is; its edges, and catchers, are denoised as all else."""
    pytest.importorskip("pyoidn")
    scene = stage(INTEGRATORS["path"], ball={**BALL, "bsdf": GREY, **HOLDOUT})
    for name in ("width", "height"):
        scene["sensor"]["film"][name] = 32
    picture = lajolla.load_dict(scene).render(spp=4, denoise=True)
    held_out, alpha = picture.channels["holdout.C"], picture.channels["A"]
    hole = alpha == 0
    assert 0.1 < hole.mean() < 0.5 and np.mean(held_out[hole]) > 0.95 and np.all(alpha[held_out == 0] > 0)
    assert np.all(picture.array[hole & (held_out == 1)] == 0) and np.all(picture.array[alpha == 1] > 0)
    plain = lajolla.load_dict(stage(INTEGRATORS["path"], **floor_of("rectangle", CATCHER)))
    assert "holdout.C" not in plain.features()


@pytest.mark.parametrize("flags", [HIDDEN, HOLDOUT])
def test_lanes_give_the_same_bits(flags: Scene) -> None:
    objects = {"ball": {**BALL, "bsdf": LEAF, **flags}, "lamp": {**LAMP, **flags}, "sky": {**SKY, **HIDDEN}}
    core = lajolla.load_dict(stage(INTEGRATORS["path"], **objects)).core
    pictures = []
    for one_lane in (False, True):
        render = _core.Render(core, 3)
        assert render.advance(SAMPLES, 2, one_lane)
        pictures.append(render.image())
    np.testing.assert_array_equal(*pictures)


@pytest.mark.parametrize("kind", ["sphere", "instance"])
@pytest.mark.parametrize("flags", [HIDDEN, HOLDOUT])
def test_they_are_parameters(flags: Scene, kind: str, tmp_path: Path) -> None:
    scene = lajolla.load_dict(stage(INTEGRATORS["path"], **objects_of(kind, tmp_path, {})), spp=SAMPLES)
    name = {"sphere": "ball", "instance": "copy"}[kind]
    ((flag, value),) = flags.items()
    assert scene[f"{name}.{flag}"] is not value
    scene[f"{name}.{flag}"] = value
    expected = rendered(stage(INTEGRATORS["path"], **objects_of(kind, tmp_path, flags)))
    np.testing.assert_array_equal(scene.render().array, expected.array)
    with pytest.raises(lajolla.SceneError, match="true or false"):
        scene[f"{name}.{flag}"] = 0.5
    scene[f"{name}.{flag}"] = not value
    assert scene.render().channels["A"].min() == 1


def test_instances_in_groups_and_their_lights() -> None:
    """A group within a group, one of whose shapes is a light, is seen as the outer instance says."""
    ball = {**BALL, "bsdf": GREY}
    lamp = {**LAMP, "to_world": translation(0.8, 0, 1) @ scaling(0.1)}
    inner = {"type": "shapegroup", "ball": ball, "glow": lamp}
    outer = {"type": "shapegroup", "copy": {"type": "instance", "group": {"type": "ref", "id": "inner"}}}
    shown = {"type": "ref", "id": "outer"}
    groups = {"inner": inner, "outer": outer, "all": {"type": "instance", "group": shown, **HOLDOUT}}
    found = rendered(stage(INTEGRATORS["path"], **groups), aovs=["crypto_shape"])
    plain = stage(INTEGRATORS["path"], ball={**ball, **HOLDOUT}, glow={**lamp, **HOLDOUT})
    np.testing.assert_array_equal(found.channels["A"], rendered(plain).channels["A"])


FILE = """<scene version="3.0.0">
    <integrator type="path"/>
    <sensor type="perspective"/>
    <emitter type="constant"><boolean name="visible_to_camera" value="false"/></emitter>
    <shape type="sphere" id="ball"><boolean name="holdout" value="true"/></shape>
    <shape type="sphere"><boolean name="visible_to_camera" value="true"/></shape>
    <shape type="shapegroup" id="group"><shape type="disk"/></shape>
    <shape type="instance"><ref id="group"/><boolean name="visible_to_camera" value="{shown}"/></shape>
</scene>"""


def test_files_and_their_conversion(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(FILE.format(shown="false"))
    core = lajolla.load(path).description.core
    assert core["shapes"][0]["holdout"] and not core["instances"][0]["visible_to_camera"]
    assert not core["emitters"][0]["visible_to_camera"]
    converted = convert(path, tmp_path / "converted.xml")
    texts = [str(warning).splitlines()[0] for warning in converted.warnings]
    assert [text.partition("Mitsuba 3 ")[2].split('"')[1] for text in texts] == [
        "visible_to_camera", "holdout", "visible_to_camera",
    ], texts  # fmt: skip
    assert not any(name in converted.text for name in COMPOSITING)
    path.write_text(FILE.format(shown="maybe"))
    with pytest.raises(lajolla.SceneError, match="maybe"):
        lajolla.load(path)


def test_names_are_those_of_the_core() -> None:
    """The reader lists them, to know which ones differ from the default."""
    fields = {f["name"]: f["default"] for f in core_schema()["instance"]["instance"]["fields"]}
    assert {name: fields[name] for name in fields if name not in ("group", "to_world")} == COMPOSITING
    for shape in core_schema()["shape"].values():
        assert COMPOSITING.items() <= {f["name"]: f["default"] for f in shape["fields"]}.items()


# --- shadow catchers


CATCHER = {"shadow_catcher": True}
UNSEEN = {"lamp": {**LAMP, **HIDDEN}, "sky": {**SKY, **HIDDEN}}
SHADED: dict[str, Scene] = {  # by light samples alone, which are those of the catcher
    "path": {"type": "path", "max_depth": 2, "strategy": "light"},
    "volpath": {"type": "volpath", "max_depth": 2, "strategy": "light"},
    "direct": {"type": "direct", "bsdf_samples": 0},
    "ao": {"type": "ao", "ray_length": 3.0},
}
SMOKE = {
    **BALL,
    "bsdf": {"type": "null"},
    "interior": {"type": "homogeneous", "albedo": 0.0, "sigma_t": 2.0},
}


def floor_of(kind: str, flags: Scene) -> Scene:
    """A floor of a kind, which the camera sees as the flags say."""
    if kind == "mesh":
        return {
            "floor": {"type": "cube", "to_world": translation(0, 0, -2) @ scaling(2), "bsdf": GREY, **flags}
        }
    if kind == "sphere":
        return {"floor": {"type": "sphere", "center": [0, 0, -9], "radius": 9.0, "bsdf": GREY, **flags}}
    floor = {"type": "rectangle", "to_world": scaling(2), "bsdf": LEAF if kind == "mask" else GREY}
    if kind in ("rectangle", "mask"):
        return {"floor": {**floor, **flags}}
    group = {"type": "shapegroup", "inner": {**floor, **(flags if kind == "member" else {})}}
    shown = {"type": "ref", "id": "group"}
    own = flags if kind == "instance" else {}
    return {"group": group, "floor": {"type": "instance", "group": shown, **own}}


def check_shadows(name: str, kind: str, **objects: Scene) -> None:
    """Alpha is 1 - (light with objects) / (light without), where the camera sees none of the objects."""

    def view(flags: Scene, **seen: Scene) -> lajolla.Image:
        return rendered(stage(SHADED[name], **UNSEEN, **floor_of(kind, flags), **seen), aovs=["alpha"])

    caught = view(CATCHER, **{name: {**each, **HIDDEN} for name, each in objects.items()})
    plate = view({})
    full = view({}, **{name: {**each, **HIDDEN} for name, each in objects.items()})
    with_objects, without = (luminance(image.array) for image in (full, plate))
    expected = plate.channels["A"] * (1 - np.squeeze(with_objects / without))
    assert np.ptp(expected) > 0.1
    np.testing.assert_allclose(caught.channels["A"], expected, atol=1e-5)
    assert list(caught.channels) == ["A"] and np.all(caught.array == 0)
    empty = view(CATCHER)
    assert np.all(empty.channels["A"] == 0) and np.all(empty.array == 0)


@pytest.mark.parametrize("name", SHADED)
def test_shadows_are_the_light_that_objects_take(name: str) -> None:
    check_shadows(name, "rectangle", ball={**BALL, "bsdf": GREY})


@pytest.mark.parametrize("kind", ["mesh", "sphere", "mask", "member", "instance"])
def test_anything_catches_shadows(kind: str) -> None:
    check_shadows("path", kind, leaf={**BALL, "bsdf": LEAF})


def test_lamps_that_are_off_cast_shadows() -> None:
    check_shadows("path", "rectangle", ball={**BALL, "emitter": {"type": "area", "radiance": 0.0}})


def test_any_number_of_surfaces_casts_shadows() -> None:
    corners = [[-1, 0.1], [1, 0.1], [1, 1.5], [-1, 1.5]]  # of upright sheets, edge-on to the camera
    positions = np.array([[x, y, z] for x in np.linspace(0.4, 0.5, 1100) for y, z in corners])
    triangles = (4 * np.arange(1100)[:, None, None] + [[0, 1, 2], [0, 2, 3]]).reshape(-1, 3)
    pile = {"type": "mesh", "positions": positions, "triangles": triangles, "bsdf": GREY}
    check_shadows("path", "rectangle", pile=pile)
    check_shadows("ao", "rectangle", pile=pile)


def test_smoke_casts_shadows() -> None:
    check_shadows("volpath", "rectangle", smoke={**SMOKE, "center": [-1.6, 0, 0.8]})


def test_light_that_objects_reflect_is_added() -> None:
    """Of all light on the floor, that which a ball has scattered; a second catcher scatters none."""
    red = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.8, 0.1, 0.1]}}
    ball = {**BALL, "bsdf": red, **HIDDEN}
    dark = {"lamp": {**UNSEEN["lamp"], "bsdf": {"type": "diffuse", "reflectance": 0.0}}, "sky": UNSEEN["sky"]}

    def view(max_depth: int, flags: Scene, **objects: Scene) -> lajolla.Image:
        integrator = {"type": "path", "max_depth": max_depth, "strategy": "light"}
        return rendered(stage(integrator, **dark, **floor_of("rectangle", flags), **objects))

    caught = view(5, CATCHER, ball=ball)
    np.testing.assert_allclose(
        caught.array, view(5, {}, ball=ball).array - view(2, {}, ball=ball).array, atol=1e-5
    )
    assert caught.array[..., 0].max() > 2 * caught.array[..., 1].max() > 0
    wall = {
        "type": "rectangle",
        "to_world": translation(-1.2, 0, 0.5) @ rotation((0, 1, 0), 90),
        "bsdf": GREY,
    }
    corner = view(5, CATCHER, wall={**wall, **CATCHER})
    assert np.all(corner.array == 0) and np.all(corner.channels["A"] == 0)  # nor a shadow
    assert view(5, CATCHER, wall=wall).array.max() > 0.05


def test_what_is_behind_a_catcher_is_not_in_the_picture() -> None:
    """And layers do not have it, nor the catcher."""
    below = {"below": {**BALL, "center": [0, 0, -1], "bsdf": GREY}}
    scene = stage(INTEGRATORS["path"], **UNSEEN, **floor_of("rectangle", CATCHER), **below)
    for layer, values in rendered(scene, aovs=AOVS).arrays().items():
        assert layer.endswith("names") or np.all(values == 0), layer


def test_pictures_are_composed_over_a_plate() -> None:
    """The result is the whole scene, also where the ball covers a part of a pixel: a distant light is alike
    everywhere, and neither has noise."""
    light = {"lamp": {"type": "directional", "direction": [0.3, 0.2, -1], "irradiance": 2.0}}
    light |= {"sky": {**UNSEEN["sky"], "radiance": 0.0}}
    ball = {"ball": {**BALL, "bsdf": GREY}}
    picture = rendered(stage(SHADED["path"], **light, **floor_of("rectangle", CATCHER), **ball), aovs=AOVS)
    layers, full = picture.arrays(), rendered(stage(SHADED["path"], **light, **ball))
    plate = rendered(stage(SHADED["path"], **light)).array
    coverage = layers["crypto_shape_coverage"].sum(axis=2)
    assert np.any((coverage > 0) & (coverage < 1)) and np.any(layers["alpha"] > coverage + 0.1)
    composed = picture.array + (1 - layers["alpha"][..., None]) * plate
    np.testing.assert_allclose(composed, full.array, atol=1e-5)
    assert np.all(layers["alpha"][coverage == 1] == 1)


def test_shadows_that_nothing_holds_are_told(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Once in the command line, and by Python; not if there is alpha, or no catcher."""
    told = "the shadows on shadow catchers are lost"
    scene = lajolla.load_dict(stage(INTEGRATORS["path"], alpha=False, **floor_of("instance", CATCHER)))
    with pytest.warns(lajolla.ImageWarning, match=told):
        scene.render(spp=1)
    assert "A" in scene.render(spp=1, aovs=["alpha"]).channels
    scene["floor.shadow_catcher"] = False
    assert "A" not in scene.render(spp=1).channels
    path = tmp_path / "scene.xml"
    path.write_text(FILE.format(shown="true").replace("holdout", "shadow_catcher"))
    words = ["render", str(path), "--size", "8x8", "--spp", "1", "-o", str(tmp_path / "a.exr"), "--quiet"]
    for options, count in (([], 1), (["--aov", "alpha"], 0)):
        assert main([*words, *options]) == 0
        assert capfd.readouterr().err.count(f"lajolla: warning: {told}") == count


def test_renders_of_catchers_in_parts(tmp_path: Path) -> None:
    """In lanes or one by one, from parts, from a file, in a viewer, and by parameters: the same alpha."""
    objects = {**UNSEEN, "ball": {**BALL, "bsdf": GREY}}
    scene = lajolla.load_dict(stage(INTEGRATORS["path"], **objects, **floor_of("rectangle", {})), spp=SAMPLES)
    before = scene.render()
    assert np.all(before.channels["A"] == 1)
    scene["floor.shadow_catcher"] = True
    rendering = scene.rendering(seed=3)
    rendering.run()
    expected = rendering.image().channels["A"]
    assert 0.05 < expected.mean() < 0.95
    loaded = lajolla.load_dict(stage(INTEGRATORS["path"], **objects, **floor_of("rectangle", CATCHER)))
    np.testing.assert_array_equal(loaded.render(spp=SAMPLES, seed=3).channels["A"], expected)
    one_lane = _core.Render(scene.core, 3)
    assert one_lane.advance(SAMPLES, 2, one_lane=True)
    np.testing.assert_array_equal(one_lane.image(), rendering.accumulator.image())
    halves = [tmp_path / "1.ckpt", tmp_path / "0.ckpt"]
    for path, first in zip(halves, (SAMPLES // 2, 0), strict=True):
        half = scene.rendering(seed=3, spp=SAMPLES // 2, first_sample=first)
        half.run()
        checkpoint.of_rendering(half).write(path)
    merged = checkpoint.merged({path: checkpoint.read(path) for path in halves})
    np.testing.assert_array_equal(merged.image().channels["A"], expected)
    view = View(scene, 0, StopRules(spp=SAMPLES), threads=2)
    view.rendering("").run()
    assert "A" in view.layers and not any(name.startswith("A.") for name in view.layers)
    assert np.ptp(view.picture("A")) > 0.05
    rendering.image().save(tmp_path / "ball.png")
    rendering.image().save(tmp_path / "ball.exr")
    saved = lajolla.Image.open(tmp_path / "ball.exr")
    np.testing.assert_array_equal(saved.channels["A"], expected)
    png = lajolla.Image.open(tmp_path / "ball.png").channels["A"]
    np.testing.assert_allclose(png, expected, atol=0.5 / 255 + 1e-6)
    scene["floor.shadow_catcher"] = False
    np.testing.assert_array_equal(scene.render().array, before.array)
    assert scene.core.channels == ["A"]


@pytest.mark.parametrize("kind", ["rectangle", "member", "instance"])
@pytest.mark.parametrize("flags", [CATCHER, HOLDOUT])
def test_viewers_find_holes(kind: str, flags: Scene) -> None:
    """So that the property can be changed back; not what is invisible."""
    above = {"ball": {**BALL, "bsdf": GREY, **HIDDEN}}
    scene = lajolla.load_dict(stage(INTEGRATORS["path"], **UNSEEN, **floor_of(kind, flags), **above))
    found = inspected(View(scene, 0, StopRules(spp=1), threads=2), SIZE // 2, SIZE // 2)
    assert found["shape"] == ("floor" if kind == "rectangle" else "shape_1")
    assert found["model"] == "diffuse" and found["distance"] == pytest.approx(5, rel=1e-4)


def test_adaptive_renders_see_shadows() -> None:
    """They count as noise, although the picture is black."""
    ball = {"ball": {**BALL, "bsdf": {"type": "diffuse", "reflectance": 0.0}, **HIDDEN}}
    scene = lajolla.load_dict(stage(SHADED["path"], **UNSEEN, **floor_of("rectangle", CATCHER), **ball))
    rendering = scene.rendering(spp=64, noise=0.001)
    rendering.run()
    assert 0 < rendering.noise < 1 and np.all(rendering.image().array == 0)
