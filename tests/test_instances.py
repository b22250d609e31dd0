"""Groups and instances: the same hits as of shapes that are placed themselves, and what the reader makes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reader_tools import error_of, messages, read
from scene_tools import Settings, box_mesh, make_scene, rotation, scaling, translation, uv_sphere
from statistics_tools import generator

import lajolla
from lajolla import _core, _core_testing
from lajolla.scene import SceneError, describe
from lajolla.scene.description import instances
from lajolla.scene.description.default_camera import default_camera

EVEN = translation(3, -2, 1) @ rotation((1, 2, 3), 40) @ scaling(2.5)
MIRRORED = translation(3, -2, 1) @ rotation((1, 2, 3), 40) @ scaling(-0.5, 0.5, 0.5)
UNEVEN = translation(3, -2, 1) @ rotation((1, 2, 3), 40) @ scaling(0.5, 2, 0.1)
FAR = translation(300, -200, 100) @ rotation((1, 2, 3), 40) @ scaling(0.1)
PLACES = {"even": EVEN, "mirrored": MIRRORED, "uneven": UNEVEN, "far": FAR}

INNER = translation(0.2, 0.1, -0.3) @ rotation((2, 1, 0), 25)
SHAPES: dict[str, Settings] = {
    "smooth mesh": {"type": "mesh", "mesh": uv_sphere(32, 16, smooth=True)},
    "faces": {"type": "mesh", "mesh": box_mesh()},
    "rectangle": {"type": "rectangle"},
    "disk": {"type": "disk", "flip_normals": True},
    "sphere": {"type": "sphere", "center": (0.1, 0.2, 0.3), "radius": 0.8},
    "cylinder": {"type": "cylinder", "radius": 0.5},
}
SIMILAR = ("sphere", "cylinder")  # these can be placed themselves only by similarities


def instanced(shape: Settings, matrix: np.ndarray) -> _core.Scene:
    description = {
        "shapes": [{"type": "sphere", "center": (1e4, 0, 0), "radius": 1e-3}, {**shape, "to_world": INNER}],
        "groups": [{"shapes": [1]}],
        "instances": [{"group": 0, "to_world": matrix}],
        "integrator": {"type": "path"},
    }
    return _core.Scene(description)


def rays_at(matrix: np.ndarray, count: int, *name: object) -> tuple[np.ndarray, np.ndarray]:
    rng = generator("instances", *name)
    targets = rng.uniform(-0.7, 0.7, (count, 3)) @ matrix[:3, :3].T + matrix[:3, 3]
    around = rng.normal(size=(count, 3))
    size = np.linalg.norm(matrix[:3, :3])
    origins = targets + 5 * size * around / np.linalg.norm(around, axis=1, keepdims=True)
    directions = (targets - origins) / np.linalg.norm(targets - origins, axis=1, keepdims=True)
    return origins.astype(np.float32), directions.astype(np.float32)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", SHAPES)
def test_hits_are_those_of_the_placed_shape(name: str, place: str) -> None:
    if name in SIMILAR and place == "uneven":
        pytest.skip("cannot be placed so without a group")
    matrix = PLACES[place]
    plain = make_scene(shapes=[{**SHAPES[name], "to_world": matrix @ INNER}])
    origins, directions = rays_at(matrix, 2000, name, place)
    expected = _core_testing.hit_many(plain, origins, directions)
    hits = _core_testing.hit_many(instanced(SHAPES[name], matrix), origins, directions)
    both = hits["valid"] & expected["valid"]
    assert (hits["valid"] == expected["valid"]).mean() > 0.995  # edges
    assert both.mean() > 0.2
    if name == "smooth mesh" or "mesh" not in SHAPES[name]:
        slope = np.abs((expected["normal"] * directions).sum(1))
        both &= slope > 0.02  # grazing rays meet somewhere else after rounding
    size = np.abs(origins).max()
    same = both & (np.abs(hits["distance"] - expected["distance"]) < 1e-4 * size)
    assert same.sum() > 0.99 * both.sum()
    assert (hits["shape"][same] == 1).all()
    turned = place == "mirrored" and name == "faces"  # see below
    # normals are interpolated before the stretch here, and after it where vertices are placed
    interpolated = 0.1 if (name, place) == ("smooth mesh", "uneven") else 2e-3
    for key, tolerance in (("normal", 2e-3), ("shading_normal", interpolated)):
        error = np.abs(hits[key] - (-1 if turned else 1) * expected[key])[same]
        assert np.quantile(error, 0.99) < tolerance, key
    off = np.abs(((hits["position"] - expected["position"]) * expected["normal"]).sum(1))[same]
    assert np.quantile(off, 0.99) < 1e-5 * size
    for key in ("dp_du", "dp_dv"):
        scale = np.linalg.norm(expected[key], axis=1)[same]
        error = np.linalg.norm(hits[key] - expected[key], axis=1)[same]
        assert np.quantile(error / scale, 0.98) < 0.01, key
    error = np.abs(hits["uv"] - expected["uv"])[same]
    assert np.quantile(np.minimum(error, 1 - error), 0.98) < 3e-3
    if place != "uneven" or name not in SIMILAR:
        scale = np.abs(expected["mean_curvature"][same]).max() + 1e-9
        slack = 0.6 if place == "uneven" else 0.02  # only the mean is known of what is stretched
        error = np.abs(np.abs(hits["mean_curvature"]) - np.abs(expected["mean_curvature"]))[same]
        assert np.quantile(error, 0.95) < slack * scale


def test_a_mirrored_group_keeps_its_outside() -> None:
    """Normals go through the inverse transpose, whatever the order of vertices is then."""
    origins, directions = rays_at(MIRRORED, 500, "outside")
    hits = _core_testing.hit_many(instanced(SHAPES["faces"], MIRRORED), origins, directions)
    met = hits["valid"]
    assert ((hits["normal"] * directions).sum(1)[met] < 0).all()


def test_a_stretched_sphere_is_an_ellipsoid() -> None:
    """Positions, normals and mean curvature in closed form (Gray 1997, section 13.2)."""
    a, b, c = 0.5, 2.0, 0.25
    description = {
        "shapes": [{"type": "sphere"}],
        "groups": [{"shapes": [0]}],
        "instances": [{"group": 0, "to_world": scaling(a, b, c)}],
        "integrator": {"type": "path"},
    }
    origins, directions = rays_at(scaling(a, b, c), 2000, "ellipsoid")
    hits = _core_testing.hit_many(_core.Scene(description), origins, directions)
    met = hits["valid"] & (np.abs((hits["normal"] * directions).sum(1)) > 0.02)
    p = hits["position"].astype(float)[met]
    np.testing.assert_allclose(((p / [a, b, c]) ** 2).sum(1), 1, atol=1e-5)
    gradient = p / np.square([a, b, c])
    size = np.linalg.norm(gradient, axis=1)
    np.testing.assert_allclose(hits["normal"][met], gradient / size[:, None], atol=1e-4)
    squares = a**2 + b**2 + c**2
    expected = (squares - (p**2).sum(1)) / (2 * (a * b * c) ** 2 * size**3)
    np.testing.assert_allclose(hits["mean_curvature"][met], expected, rtol=1e-3)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", ["smooth mesh", "faces", "rectangle", "disk", "sphere"])
def test_rays_that_leave_a_convex_instance_do_not_meet_it_again(name: str, place: str) -> None:
    matrix = PLACES[place]
    shape = (
        SHAPES[name] if name != "smooth mesh" else {"type": "mesh", "mesh": uv_sphere(24, 12, smooth=False)}
    )
    scene = instanced(shape, matrix)
    origins, directions = rays_at(matrix, 20_000, "leave", name, place)
    hits = _core_testing.hit_many(scene, origins, directions)
    met = hits["valid"]
    origins, directions, normals = origins[met], directions[met], hits["normal"][met]
    normals = normals * np.where((normals * directions).sum(1, keepdims=True) > 0, -1, 1)
    onward = generator("onward", name, place).normal(size=normals.shape)
    onward = onward * np.where((onward * normals).sum(1, keepdims=True) < 0, -1, 1)
    sideways = np.cross(normals, onward) + 1e-3 * normals
    onward[::2] = sideways[::2]
    onward = (onward / np.linalg.norm(onward, axis=1, keepdims=True)).astype(np.float32)
    starts = _core_testing.leave_many(scene, origins, directions, onward)
    assert not _core_testing.hit_many(scene, starts, onward)["valid"].any()


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"groups": [{"shapes": [1]}]}, "groups\\[0\\].shapes"),
        ({"groups": [{"shapes": 0}]}, "a list of indices"),
        ({"instances": [{"group": 0}]}, "there is no group 0"),
        (
            {"groups": [{"shapes": [0]}], "instances": [{"group": 0, "to_world": np.zeros((4, 4))}]},
            "singular",
        ),
    ],
)
def test_descriptions_that_do_not_fit(entry: Settings, message: str) -> None:
    with pytest.raises(_core.DescriptionError, match=message):
        _core.Scene({"shapes": [{"type": "sphere"}], **entry})


def test_lights_cannot_be_members() -> None:
    with pytest.raises(_core.DescriptionError, match="cannot be a light"):
        _core.Scene(
            {
                "shapes": [{"type": "sphere", "emitter": 0}],
                "emitters": [{"type": "area"}],
                "groups": [{"shapes": [0]}],
            }
        )


HEAD = """<emitter type="constant"/>
<shape type="shapegroup" id="g"><shape type="sphere"/><shape type="rectangle">
  <bsdf type="diffuse" id="red"><rgb name="reflectance" value="1 0 0"/></bsdf></shape></shape>
"""
MOVED = '<transform name="to_world"><translate x="2"/></transform>'


def test_groups_are_built_once_and_are_not_visible_themselves(tmp_path: Path) -> None:
    use = f'<shape type="instance"><ref id="g"/>{MOVED}</shape>'
    core = read(tmp_path, HEAD + 2 * use).core
    assert len(core["shapes"]) == 2
    assert core["groups"] == [{"shapes": [0, 1]}]
    (both,) = core["instances"]  # a run
    assert [both["group"].row(i) for i in range(len(both["group"]))] == [0, 0]
    assert both["to_world"][0, 3] == 2
    assert read(tmp_path, HEAD).core["shapes"] == []


def test_nested_groups_are_composed(tmp_path: Path) -> None:
    nested = f"""<shape type="shapegroup" id="outer"><shape type="cube"/>
      <shape type="instance"><ref name="shapegroup" id="g"/>
        <transform name="toWorld"><scale value="3"/></transform></shape></shape>
      <shape type="instance"><ref id="outer"/>{MOVED.replace("to_world", "toWorld")}</shape>"""
    core = read(tmp_path, HEAD.replace("to_world", "toWorld") + nested, "0.6.0").core
    assert [entry["shapes"] for entry in core["groups"]] == [[0], [1, 2]] or core["groups"]
    matrices = [entry["to_world"] for entry in core["instances"]]
    scaled = [m for m in matrices if m[0, 0] == 3]
    assert len(matrices) == 2 and len(scaled) == 1 and scaled[0][0, 3] == 2
    _core.Scene(core)


def test_lights_in_groups_shine_at_every_place(tmp_path: Path) -> None:
    lamp = """<shape type="shapegroup" id="g"><shape type="rectangle"/><shape type="cube">
      <transform name="to_world"><scale value="0.1"/></transform>
      <bsdf type="diffuse" id="b"/><emitter type="area"><rgb name="radiance" value="1"/></emitter>
      <boolean name="face_normals" value="true"/></shape></shape>"""
    mirror = '<transform name="to_world"><scale x="-1"/><translate x="5"/></transform>'
    use = "".join(f'<shape type="instance"><ref id="g"/>{m}</shape>' for m in (MOVED, mirror))
    core = read(tmp_path, lamp + use).core
    assert len(core["emitters"]) == 2 and len(core["instances"]) == 2 and len(core["shapes"]) == 3
    lights = [shape for shape in core["shapes"] if shape["emitter"] >= 0]
    assert [float(light["to_world"][0, 3]) for light in lights] == [2, 5]
    origins = np.array([[5, 0, 3]], np.float32)
    hits = _core_testing.hit_many(_core.Scene(core), origins, np.array([[0, 0, -1]], np.float32))
    assert hits["emitter"][0] == 1 and hits["normal"][0, 2] == 1


def test_empty_groups_are_told(tmp_path: Path) -> None:
    scene = HEAD + '<shape type="shapegroup" id="e"/><shape type="instance"><ref id="e"/></shape>'
    assert any("empty" in text for text in messages(read(tmp_path, scene), tmp_path))


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<shape type="instance"/>', "needs a shape"),
        ('<shape type="instance"><shape type="sphere"/></shape>', "needs a shape"),
        (
            '<shape type="shapegroup" id="a"><shape type="instance"><ref id="b"/></shape></shape>'
            '<shape type="shapegroup" id="b"><shape type="instance"><ref id="a"/></shape></shape>'
            '<shape type="instance"><ref id="a"/></shape>',
            "contain each other",
        ),
    ],
)
def test_mistakes(tmp_path: Path, body: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        read(tmp_path, HEAD + body)


def test_groups_that_multiply_are_refused(tmp_path: Path) -> None:
    use = '<shape type="instance"><ref id="{0}"/></shape>'
    groups = [
        f'<shape type="shapegroup" id="n{i}">{100 * use.format(f"n{i - 1}" if i else "g")}</shape>'
        for i in range(8)
    ]
    with pytest.raises(SceneError, match="instances"):
        read(tmp_path, HEAD + "".join(groups) + use.format("n7"))


def test_instances_render_as_the_shapes_themselves(tmp_path: Path) -> None:
    parts = '<shape type="sphere"><bsdf type="dielectric"/></shape><shape type="rectangle">{0}</shape>'
    matrix = """<transform name="to_world"><scale value="0.7"/><rotate x="1" angle="30"/>
      <translate z="5"/></transform>"""
    head = """<integrator type="path"/><sensor type="perspective"><film type="hdrfilm"><integer name="width"
      value="24"/><integer name="height" value="24"/></film></sensor><emitter type="constant"/>
      <emitter type="point"><point name="position" x="1" y="2" z="1"/></emitter>"""
    group = f'<shape type="shapegroup" id="g">{parts.format("")}</shape>'
    with_group = head + group + f'<shape type="instance"><ref id="g"/>{matrix}</shape>'
    plain = head + parts.format(matrix).replace("<bsdf", matrix + "<bsdf")
    images = []
    for name, body in (("a", with_group), ("b", plain)):
        path = tmp_path / f"{name}.xml"
        path.write_text(f'<scene version="3.0.0">{body}</scene>')
        images.append(np.asarray(lajolla.load(path).render(spp=64, seed=1).array, float))
    assert np.abs(images[0] - images[1]).mean() < 0.005 * images[1].mean()


def test_instances_in_dicts() -> None:
    group = {"type": "shapegroup", "first": {"type": "sphere"}, "second": {"type": "cube"}}
    scene = describe(
        {
            "type": "scene",
            "integrator": {"type": "path"},
            "sensor": {"type": "perspective"},
            "light": {"type": "constant"},
            "group": group,
            "copy": {
                "type": "instance",
                "shapegroup": {"type": "ref", "id": "group"},
                "to_world": translation(0, 3, 0),
            },
        }
    )
    assert not scene.warnings
    assert len(scene.core["shapes"]) == 2 and scene.core["instances"][0]["to_world"][1, 3] == 3
    _core.Scene(scene.core)


def test_the_camera_of_old_files_sees_instances() -> None:
    groups, moved = [{"shapes": [0]}], {"group": 0, "to_world": translation(10, 0, 0)}
    camera = default_camera([{"type": "sphere"}], groups, [moved])
    assert camera["to_world"][0, 3] == pytest.approx(10)
    assert "to_world" not in default_camera([{"type": "sphere"}], groups, [])


def test_a_group_without_shapes_is_harmless() -> None:
    scene = _core.Scene({"groups": [{"shapes": []}], "instances": [{"group": 0}]})
    origins, directions = rays_at(EVEN, 10, "nothing")
    assert not _core_testing.hit_many(scene, origins, directions)["valid"].any()


@pytest.mark.parametrize("scale", [1e-30, 1e-11, 1e-6, 1e6, 1e11, 1e30])
@pytest.mark.parametrize("name", SHAPES)
def test_extreme_placements_do_no_harm(name: str, scale: float) -> None:
    for shift in (0, 1e10, 1e30):
        description = {
            "shapes": [SHAPES[name]],
            "groups": [{"shapes": [0]}],
            "instances": [{"group": 0, "to_world": translation(shift, 0, 0) @ scaling(scale)}],
        }
        try:
            scene = _core.Scene(description)
        except _core.DescriptionError as problem:
            assert "too large or too small" in str(problem) or "singular" in str(problem)
            continue
        rng = generator("extreme", name, scale)
        origins = (rng.normal(size=(100, 3)) * 10 ** rng.uniform(-5, 18, (100, 1))).astype(np.float32)
        _core_testing.hit_many(scene, origins, rng.normal(size=(100, 3)).astype(np.float32))
        _core_testing.hit_many(scene, origins, -origins / np.linalg.norm(origins, axis=1, keepdims=True))


TREE = (
    '<shape type="shapegroup" id="leaf"><shape type="sphere"/></shape><shape type="shapegroup" id="tree">'
    + '<shape type="instance"><ref id="leaf"/></shape>' * 100
    + "</shape>"
)


@pytest.mark.parametrize("last", [False, True], ids=["shapes first", "trees first"])
def test_the_number_of_objects_has_a_limit_in_any_order(
    last: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(instances, "MOST_REPEATED", 0)
    monkeypatch.setattr(instances, "MOST_PER_SHAPE", 20)
    trees, shapes = '<shape type="instance"><ref id="tree"/></shape>' * 200, '<shape type="sphere"/>' * 900
    assert (
        len(read(tmp_path, TREE + (trees + shapes if last else shapes + trees)).core["instances"]) == 20_000
    )
    message = "make 30,401 objects; the limit is 8,100"
    assert message in error_of(
        tmp_path, TREE + trees + '<shape type="instance"><ref id="tree"/></shape>' * 100
    )


def test_a_forest_of_trees_with_leaves(tmp_path: Path) -> None:
    forest = TREE + '<shape type="instance"><ref id="tree"/></shape>' * 700
    assert len(read(tmp_path, forest).core["instances"]) == 70_000
