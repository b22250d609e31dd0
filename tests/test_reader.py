"""How scene files and dicts become descriptions: parameters, references, versions, materials, shapes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reader_tools import error, error_of, messages, read, write_scene

from lajolla.scene import SceneError, describe, load_description, plugins

Core = dict[str, Any]


def shape(folder: Path, body: str, version: str = "3.0.0") -> Core:
    """The first shape of a scene."""
    return read(folder, body, version).core["shapes"][0]


def bsdf(folder: Path, body: str, version: str = "3.0.0") -> Core:
    """The first bsdf of a scene whose sphere has the given one."""
    return read(folder, f'<shape type="sphere">{body}</shape>', version).core["bsdfs"][0]


# Parameters, includes, references


def test_command_line_beats_the_first_default_which_beats_later_ones(tmp_path: Path) -> None:
    body = '<default name="r" value="2"/><default name="r" value="3"/>'
    body += '<shape type="sphere"><float name="radius" value="$r"/></shape>'
    assert shape(tmp_path, body)["radius"] == 2
    assert read(tmp_path, body, parameters={"r": "5"}).core["shapes"][0]["radius"] == 5


def test_the_longest_parameter_name_wins(tmp_path: Path) -> None:
    body = '<default name="s" value="1"/><default name="spp" value="7"/>'
    body += '<shape type="sphere"><float name="radius" value="$spp"/></shape>'
    assert shape(tmp_path, body)["radius"] == 7


def test_parameters_in_any_attribute_and_escaped(tmp_path: Path) -> None:
    (tmp_path / "$1.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    body = '<default name="axis" value="1"/><shape type="obj"><string name="filename" value="\\$1.obj"/>'
    body += '<transform name="to_world"><translate x="$axis" y="${missing"/></transform></shape>'
    assert "expected a number" in error_of(tmp_path, body)
    matrix = shape(tmp_path, body.replace("${missing", "$axis"))["to_world"]
    assert np.allclose(matrix[:3, 3], [1, 1, 0])


def test_includes_merge_and_are_relative_to_the_including_file(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "ball.xml").write_text(
        '<scene version="0.5.0"><include filename="paint.xml"/><shape type="sphere"><ref id="paint"/>'
        '<transform name="toWorld"><scale value="2"/></transform></shape></scene>'
    )
    (tmp_path / "parts" / "paint.xml").write_text('<bsdf version="3.0.0" type="dielectric" id="paint"/>')
    core = read(tmp_path, '<include filename="PARTS\\Ball.xml"/>').core
    assert core["bsdfs"][0]["type"] == "dielectric"
    assert core["shapes"][0]["to_world"][0][0] == 2


def test_duplicate_ids_across_includes_name_both_places(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text('<scene version="3.0.0">\n<bsdf type="diffuse" id="a"/></scene>')
    message = error_of(tmp_path, '<bsdf type="diffuse" id="a"/><include filename="a.xml"/>')
    assert message.startswith('a.xml:2:1: error: the id "a" is used twice; first at scene.xml:3:1')


def test_references_forward_by_alias_and_to_nested_objects(tmp_path: Path) -> None:
    body = '<shape type="sphere"><ref id="other"/></shape><alias id="inner" as="other"/>'
    body += '<bsdf type="bumpmap"><bsdf type="null" id="inner"/></bsdf>'
    assert read(tmp_path, body).core["bsdfs"][0]["type"] == "null"


def test_shared_objects_are_built_once(tmp_path: Path) -> None:
    body = '<bsdf type="diffuse" id="d"><texture type="checkerboard" name="reflectance"/></bsdf>'
    body += '<shape type="sphere"><ref id="d"/></shape>' * 2
    core = read(tmp_path, body, runs=False).core
    assert (len(core["textures"]), len(core["bsdfs"]), len(core["materials"]), len(core["shapes"])) == (
        1,
        1,
        1,
        2,
    )


# Versions


def test_old_names(tmp_path: Path) -> None:
    body = '<camera type="perspective"/>'
    body += '<luminaire type="point"><rgb name="intensity" value="1,2,3"/></luminaire>'
    core = read(tmp_path, body, "0.4.0").core
    assert core["emitters"] == [{"type": "point", "intensity": (1.0, 2.0, 3.0)}]
    glass = bsdf(tmp_path, '<bsdf type="dielectric"><string name="intIOR" value="water"/></bsdf>', "0.6.0")
    assert glass["int_ior"] == 1.333
    grey = bsdf(tmp_path, '<bsdf type="diffuse"><rgb name="diffuseReflectance" value=".2"/></bsdf>', "0.6.0")
    assert grey["reflectance"] == (0.2, 0.2, 0.2)


def test_names_of_before_0_4(tmp_path: Path) -> None:
    """Radiance and irradiance were intensities, and some parameters had other names."""
    body = """<camera type="perspective"><film type="exrfilm"><boolean name="alpha" value="true"/></film>
        <sampler type="ldsampler"><integer name="depth" value="4"/></sampler></camera>
        <luminaire type="constant"><spectrum name="intensity" value="2"/></luminaire>
        <luminaire type="directional"><spectrum name="intensity" value="3"/></luminaire>
        <shape type="sphere"><luminaire type="area"><blackbody name="intensity" temperature="5000"
            multiplier="2"/></luminaire></shape>"""
    described = read(tmp_path, body, "0.3.0")
    area, constant, directional = described.core["emitters"]
    assert constant["radiance"] == (2, 2, 2) and directional["irradiance"] == (3, 3, 3)
    plain = read(tmp_path, body.replace(' multiplier="2"', "").replace('multiplier="2"', ""), "0.3.0")
    np.testing.assert_allclose(area["radiance"], 2 * np.array(plain.core["emitters"][0]["radiance"]))
    assert described.film.has_alpha
    assert [w.message for w in described.warnings if "2 sensors" not in w.message] == []


@pytest.mark.parametrize(
    ("version", "view", "mirrored"),
    [
        ("0.4.0", '<lookAt origin="1,2,3" target="0,0,0" up="0,1,0"/>', False),
        ("0.3.0", '<lookAt origin="1,2,3" target="0,0,0" up="0,1,0"/>', True),
        (
            "0.2.0",
            '<lookAt ox="1" oy="2" oz="3" tx="0" ty="0" tz="0" ux="0" uy="1" uz="0"/>',
            False,
        ),
    ],
)
def test_cameras_of_before_0_4_are_turned_over(
    version: str, view: str, mirrored: bool, tmp_path: Path
) -> None:
    """The stylesheets of Mitsuba 0.6 put a mirror in front of each such transform, twice before 0.3."""
    body = f"""<camera type="perspective"><float name="fov" value="40"/><transform name="toWorld">{view}
        </transform></camera>"""
    sensor = read(tmp_path, body, version).core["sensor"]
    assert (np.linalg.det(np.array(sensor["to_world"])[:3, :3]) < 0) == mirrored
    np.testing.assert_allclose(np.array(sensor["to_world"])[:3, 3], [1, 2, 3])
    assert sensor.get("fov_axis", "x") == ("x" if version == "0.4.0" else "smaller")
    wide = body.replace("<transform", '<boolean name="mapSmallerSide" value="false"/><transform')
    if version != "0.4.0":
        assert read(tmp_path, wide, version).core["sensor"]["fov_axis"] == "larger"


def test_materials_of_before_0_3(tmp_path: Path) -> None:
    def old(content: str) -> dict[str, Any]:
        return bsdf(tmp_path, content, "0.2.0")

    red = '<rgb name="reflectance" value="1 0 0"/>'
    assert old(f'<bsdf type="lambertian">{red}</bsdf>') == {"type": "diffuse", "reflectance": (1, 0, 0)}
    assert old('<bsdf type="mirror"/>')["eta"] == pytest.approx(
        bsdf(tmp_path, '<bsdf type="conductor"><string name="material" value="Cr"/></bsdf>', "0.6.0")["eta"]
    )
    glass = old('<bsdf type="roughglass"><float name="alphaB" value="0.3"/></bsdf>')
    assert glass["type"] == "roughdielectric" and glass["alpha_u"] == 0.3
    plastic = old('<bsdf type="microfacet"><float name="specularAmount" value="0.25"/></bsdf>')
    assert plastic["type"] == "roughplastic" and plastic["specular_reflectance"] == (0.25,) * 3
    assert plastic["diffuse_reflectance"] == (0, 0, 0)
    phong = old('<bsdf type="phong"><float name="diffuseAmount" value="0.5"/></bsdf>')
    assert phong["diffuse_reflectance"] == (0.25,) * 3 and phong["specular_reflectance"] == (0.2,) * 3
    board = """<shape type="cylinder"><point name="p1" x="1"/><point name="p2" x="2"/><bsdf type="lambertian">
        <texture type="checkerboard" name="reflectance"><spectrum name="darkColor" value="0.1"/></texture>
        </bsdf></shape>"""
    core = read(tmp_path, board, "0.2.0").core
    assert core["textures"][0]["color1"] == (0.1,) * 3
    assert np.array(core["shapes"][0]["to_world"])[0, 3] == 1


def test_old_uv_scale_comes_before_the_offset(tmp_path: Path) -> None:
    texture = '<texture type="checkerboard" name="reflectance"><float name="uscale" value="8"/>'
    texture += '<float name="voffset" value=".25"/><float name="vscale" value="4"/></texture>'
    body = f'<shape type="sphere"><bsdf type="diffuse">{texture}</bsdf></shape>'
    to_uv = read(tmp_path, body, "0.5.0").core["textures"][0]["to_uv"]
    assert np.allclose(to_uv @ [1, 1, 0, 1], [8, 4.25, 0, 1])


def test_metals_by_default(tmp_path: Path) -> None:
    new = bsdf(tmp_path, '<bsdf type="conductor"/>')
    assert (new["eta"], new["k"]) == ((0, 0, 0), (1, 1, 1))
    old = bsdf(tmp_path, '<bsdf type="conductor"/>', "0.6.0")
    assert np.allclose(old["eta"], np.array([0.201006, 0.923749, 1.10222]) / 1.000277)
    vacuum = '<bsdf type="conductor"><string name="extEta" value="vacuum"/></bsdf>'
    assert np.allclose(bsdf(tmp_path, vacuum, "0.6.0")["k"], [3.91326, 2.45305, 2.14209])


def test_filter_by_default(tmp_path: Path) -> None:
    (tmp_path / "x.ppm").write_bytes(b"P6 1 1 255\n\x01\x02\x03")
    texture = '<texture type="bitmap" name="reflectance"><string name="filename" value="x.ppm"/></texture>'
    body = f'<shape type="sphere"><bsdf type="diffuse">{texture}</bsdf></shape>'
    assert read(tmp_path, body, "0.6.0").core["textures"][0]["filter_type"] == "ewa"
    assert "filter_type" not in read(tmp_path, body).core["textures"][0]


def test_no_integrator(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text('<scene version="0.6.0"><sensor type="perspective"/></scene>')
    assert load_description(path).core["integrator"] == {"type": "direct"}
    assert load_description(path, integrator="path").core["integrator"] == {"type": "path"}
    path.write_text('<scene version="3.0.0"><sensor type="perspective"/></scene>')
    assert load_description(path).core["integrator"] == {"type": "path"}
    assert "the scene has no integrator" in error(path, strict=True)
    path.write_text('<scene version="3.0.0"><integrator type="path"/></scene>')
    assert "the scene has no sensor" in error(path)


def test_no_sensor_in_an_old_file(tmp_path: Path) -> None:
    """The unit cube around (1, 2, 3) fills the 45 degrees of the added camera."""
    path = tmp_path / "scene.xml"
    place = '<transform name="toWorld"><translate x="1" y="2" z="3"/></transform>'
    path.write_text(f'<scene version="0.6.0"><shape type="cube">{place}</shape></scene>')
    description = load_description(path)
    sensor = description.core["sensor"]
    distance = 1 / np.tan(np.radians(22.5))
    assert np.allclose(sensor["to_world"][:3, 3], [1, 2, 2 - distance])
    assert sensor["fov"] == 45 and sensor["near_clip"] < distance < sensor["far_clip"]
    assert "one that sees the whole scene is added" in messages(description, tmp_path)[0]


def test_of_several_sensors(tmp_path: Path) -> None:
    """Mitsuba 3 takes the first, 0.6 the last."""
    second = '<sensor type="orthographic"/>'
    assert read(tmp_path, second).core["sensor"]["type"] == "perspective"
    assert read(tmp_path, second, "0.6.0").core["sensor"]["type"] == "orthographic"


def test_a_missing_version_is_guessed_from_the_names(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text('<scene><integrator type="path"><integer name="maxDepth" value="3"/></integrator>'
                    '<sensor type="perspective"/></scene>')  # fmt: skip
    description = load_description(path)
    assert description.core["integrator"]["max_depth"] == 3
    assert "the file has no version; read as 0.6" in messages(description, tmp_path)[0]


# Materials


def tree(core: dict[str, Any], material: object) -> object:
    """What a material slot holds, with names in place of indices."""
    if not isinstance(material, dict):
        return None if material == -1 else core["bsdfs"][material]["type"]
    entry = dict(core["adapters"][material["adapter"]])
    children = [tree(core, entry.pop(name)) for name in ("first", "second", "child") if name in entry]
    return (entry.pop("type"), *entry.values(), *children)


def slots(core: dict[str, Any]) -> tuple[Any, Any]:
    """The trees of the only material."""
    assert len(core["materials"]) == 1
    return tuple(tree(core, core["materials"][0][side]) for side in ("front", "back"))


RED = '<bsdf type="diffuse"><rgb name="reflectance" value="1 0 0"/></bsdf>'
GLASS = '<bsdf type="dielectric"/>'
OPACITY = '<float name="opacity" value=".25"/>'
WEIGHT = '<float name="weight" value=".25"/>'
BUMP = '<texture type="gridtexture" name="whatever"/><float name="scale" value="2"/>'
MASKED = ("mask", 0.25, "diffuse")
BUMPED = ("bumpmap", 2.0, {"texture": 0})


@pytest.mark.parametrize(
    "body, front, back",
    [
        (RED, "diffuse", None),
        (GLASS, "dielectric", None),
        (f'<bsdf type="twosided">{RED}</bsdf>', "diffuse", "diffuse"),
        (f'<bsdf type="twosided">{RED}<bsdf type="plastic"/></bsdf>', "diffuse", "plastic"),
        (f'<bsdf type="mask">{OPACITY}<bsdf type="twosided">{RED}</bsdf></bsdf>', MASKED, MASKED),
        (f'<bsdf type="twosided"><bsdf type="mask">{OPACITY}{RED}</bsdf></bsdf>', MASKED, MASKED),
        (f'<bsdf type="mask"><float name="opacity" value="1"/>{RED}</bsdf>', "diffuse", None),
        (f'<bsdf type="blendbsdf">{WEIGHT}{RED}{GLASS}</bsdf>',
         ("blendbsdf", 0.25, "diffuse", "dielectric"), None),
        (f'<bsdf type="blendbsdf">{WEIGHT}<bsdf type="twosided">{RED}</bsdf>{GLASS}</bsdf>',
         ("blendbsdf", 0.25, "diffuse", "dielectric"), ("blendbsdf", 0.25, "diffuse", "dielectric")),
        (f'<bsdf type="blendbsdf">{WEIGHT}{RED}<bsdf type="mask">{OPACITY}{RED}</bsdf></bsdf>',
         ("blendbsdf", 0.25, "diffuse", MASKED), None),
        (f'<bsdf type="mixturebsdf"><string name="weights" value=".5, .25"/>{RED}{GLASS}</bsdf>',
         ("blendbsdf", 0.5, "diffuse", ("blendbsdf", 0.5, "dielectric", None)), None),
        (f'<bsdf type="mixturebsdf"><string name="weights" value="3 1"/>{RED}{GLASS}</bsdf>',
         ("blendbsdf", 0.25, "diffuse", "dielectric"), None),
        (f'<bsdf type="twosided"><bsdf type="bumpmap">{BUMP}{RED}</bsdf></bsdf>',
         (*BUMPED, "diffuse"), (*BUMPED, "diffuse")),
        (f'<bsdf type="bumpmap">{BUMP}<bsdf type="mask">{OPACITY}{RED}</bsdf></bsdf>',
         (*BUMPED, MASKED), None),
        (f'<bsdf type="bumpmap">{BUMP}<bsdf type="twosided">{RED}</bsdf></bsdf>',
         (*BUMPED, "diffuse"), ("bumpmap", -2.0, {"texture": 0}, "diffuse")),
        (f'<bsdf type="coating"><bsdf type="blendbsdf">{WEIGHT}{RED}{GLASS}</bsdf></bsdf>',
         ("blendbsdf", 0.25, "coating", "dielectric"), None),
        (f'<bsdf type="roughcoating"><bsdf type="bumpmap">{BUMP}<bsdf type="twosided">{RED}</bsdf></bsdf>'
         "</bsdf>",
         (*BUMPED, "coating"), ("bumpmap", -2.0, {"texture": 0}, "coating")),
        (f'<bsdf type="normalmap"><rgb name="normalmap" value=".5 .5 1"/>{RED}</bsdf>',
         ("normalmap", (0.5, 0.5, 1.0), "diffuse"), None),
    ],
)  # fmt: skip
def test_material_slots(tmp_path: Path, body: str, front: object, back: object) -> None:
    core = read(tmp_path, f'<shape type="sphere">{body}</shape>').core
    assert slots(core) == (front, back)


def test_textured_opacity(tmp_path: Path) -> None:
    body = '<bsdf type="mask"><texture type="checkerboard" name="opacity"/><bsdf type="diffuse"/></bsdf>'
    core = read(tmp_path, f'<shape type="sphere">{body}</shape>', "0.6.0").core
    assert slots(core)[0] == ("mask", {"texture": 0}, "diffuse")


def test_old_bumps_have_the_rules_of_their_time(tmp_path: Path) -> None:
    body = f'<shape type="sphere"><bsdf type="bumpmap">{BUMP}{RED}</bsdf></shape>'
    rules = ("flip_invalid_normals", "use_shadowing_function")
    for version, expected in (("0.6.0", False), ("3.0.0", None)):
        entry = read(tmp_path, body, version=version).core["adapters"][0]
        assert [entry.get(rule) for rule in rules] == [expected] * 2


def test_two_sided_option_leaves_glass_alone(tmp_path: Path) -> None:
    body = '<shape type="sphere"/><shape type="cube"><bsdf type="dielectric"/></shape>'
    materials = read(tmp_path, body, two_sided=True).core["materials"]
    assert [(m["front"], m["back"]) for m in materials] == [(0, 0), (1, -1)]


def test_materials_that_nobody_wrote(tmp_path: Path) -> None:
    light = '<shape type="sphere"><emitter type="area"/></shape>'
    assert read(tmp_path, light).core["bsdfs"] == [{"type": "diffuse", "reflectance": (0, 0, 0)}]
    fog = '<shape type="sphere"><medium name="interior" type="homogeneous"/></shape>'
    assert read(tmp_path, fog).core["bsdfs"] == [{"type": "diffuse"}]
    assert read(tmp_path, fog, "0.6.0").core["bsdfs"] == [{"type": "null"}]


def test_an_invisible_surface_can_emit(tmp_path: Path) -> None:
    body = '<shape type="rectangle"><bsdf type="null"/><emitter type="area"/></shape>'
    core = read(tmp_path, body).core
    assert core["shapes"][0]["emitter"] == 0 and core["bsdfs"] == [{"type": "null"}]


def test_roughness_in_every_spelling(tmp_path: Path) -> None:
    def alphas(body: str) -> tuple[float, float]:
        metal = bsdf(tmp_path, f'<bsdf type="roughconductor">{body}</bsdf>')
        return (metal["alpha_u"], metal["alpha_v"])

    assert alphas('<float name="alpha" value=".3"/>') == (0.3, 0.3)
    assert alphas('<float name="roughness" value=".5"/>') == (0.25, 0.25)
    assert alphas('<float name="alpha_u" value=".1"/><float name="alpha_v" value=".2"/>') == (0.1, 0.2)


# Shapes, lights, cameras


def test_transforms_multiply_from_the_left(tmp_path: Path) -> None:
    operations = '<scale x="2"/><rotate z="1" angle="90"/><translate value="1, 2 3"/>'
    operations += '<matrix value="1 0 0\n0 1 0 0 0 9.42e-010"/>'
    body = f'<shape type="rectangle"><transform name="to_world">{operations}</transform></shape>'
    assert np.allclose(shape(tmp_path, body)["to_world"] @ [1, 1, 0, 1], [0, 4, 0, 1], atol=1e-6)


def test_a_stretched_sphere_becomes_a_mesh(tmp_path: Path) -> None:
    body = '<shape type="sphere"><transform name="to_world"><scale {}/></transform></shape>'
    assert shape(tmp_path, body.format('value="-3"'))["type"] == "sphere"
    stretched = read(tmp_path, body.format('y="3"'))
    assert stretched.core["shapes"][0]["type"] == "mesh"
    assert "a sphere with non-uniform scale" in messages(stretched, tmp_path)[0]


def test_meshes_are_read_once(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 .25\nf 1/1 2/1 3/1\n")
    body = '<shape type="obj"><string name="filename" value="A.OBJ"/></shape>' * 2
    first, second = read(tmp_path, body).core["shapes"]
    assert first["mesh"] is second["mesh"]


def test_places_of_lights(tmp_path: Path) -> None:
    body = '<emitter type="point"><transform name="to_world"><translate x="1"/></transform></emitter>'
    body += '<emitter type="directional"><transform name="to_world"><rotate y="1" angle="90"/></transform>'
    body += '</emitter><emitter type="spot"><float name="cutoff_angle" value="40"/></emitter>'
    point, directional, spot = read(tmp_path, body).core["emitters"]
    assert point["position"] == (1, 0, 0)
    assert np.allclose(directional["direction"], [1, 0, 0])
    assert spot["beam_width"] == 30


def test_focal_length(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    text = '<scene version="3.0.0"><integrator type="path"/><sensor type="perspective">{}</sensor></scene>'
    path.write_text(text.format(""))
    sensor = load_description(path).core["sensor"]
    assert sensor["fov"] == pytest.approx(46.793, abs=1e-3) and sensor["fov_axis"] == "diagonal"
    path.write_text(text.format('<string name="focal_length" value="100 mm"/>'))
    assert load_description(path).core["sensor"]["fov"] == pytest.approx(24.41, abs=1e-2)


def test_mirrored_sensor_keeps_its_mirror(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    mirrored = '<scale x="-1"/><lookAt origin="0 0 5" target="0 0 0"/>'
    sensor = f'<sensor type="perspective"><transform name="toWorld">{mirrored}</transform></sensor>'
    path.write_text(f'<scene version="0.5.0">{sensor}</scene>')
    matrix = load_description(path).core["sensor"]["to_world"]
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(-1)


def test_film_and_crop(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    film = '<integer name="width" value="10"/><integer name="crop_offset_x" value="{}"/>'
    sensor = f'<sensor type="perspective"><film type="hdrfilm">{film}</film></sensor>'
    text = f'<scene version="3.0.0"><integrator type="path"/>{sensor}</scene>'
    path.write_text(text.format(4))
    core = load_description(path).core
    assert core["film"]["crop_width"] == 6 and core["film"]["height"] == 576
    assert core["rfilter"] == {"type": "gaussian"} and core["sampler"] == {"type": "sobol", "sample_count": 4}
    path.write_text(text.format(10))
    assert "the crop window does not lie inside of the film's width of 10" in error(path)


# Scenes as dicts


def scene_dict(**objects: object) -> dict[str, object]:
    """A scene dict with an integrator and a sensor."""
    return {"type": "scene", "integrator": {"type": "path"}, "sensor": {"type": "perspective"}, **objects}


def test_dict_scene() -> None:
    core = describe(
        scene_dict(
            paint={"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.1, 0.2, 0.3]}},
            ball={"type": "sphere", "center": [1, 2, 3], "bsdf": {"type": "ref", "id": "paint"}},
            lamp={"type": "point", "intensity": {"type": "spectrum", "value": 5.0}},
        )
    ).core
    assert core["bsdfs"] == [{"type": "diffuse", "reflectance": (0.1, 0.2, 0.3)}]
    assert core["shapes"][0]["center"] == (1, 2, 3)
    assert core["emitters"] == [{"type": "point", "intensity": (5.0, 5.0, 5.0)}]


SELF = {"type": "twosided"}
SELF["inner"] = SELF  # type: ignore[assignment]


@pytest.mark.parametrize(
    ("objects", "expected"),
    [
        ({"s": {"type": "sphre"}}, 'scene[s]: error: unknown plugin "sphre"; did you mean "sphere"?'),
        ({"s": {"radius": 1}}, 'scene[s]: error: a dict needs a "type"'),
        ({"s": {"type": "sphere", "radius": "1"}}, 'scene[s.radius]: error: "radius" of shape "sphere"'),
        ({"s": {"type": "sphere", "center": [np.nan, 0, 0]}}, "must be finite"),
        ({"s": {"type": "sphere", "to_world": np.ones((4, 4))}}, "the last row of the transformation"),
        ({"s": SELF}, "dicts are nested more than 64 deep"),
    ],
)
def test_bad_dicts(objects: dict[str, object], expected: str) -> None:
    with pytest.raises(SceneError) as caught:
        describe(scene_dict(**objects))
    assert expected in str(caught.value)


def test_reader_plugins_describe_themselves() -> None:
    described = plugins()
    assert {"twosided", "mask"} <= described["bsdf"].keys()
    assert {"obj", "ply", "serialized", "cube"} <= described["shape"].keys()
    fields = {field["name"] for field in described["shape"]["obj"]["fields"]}
    assert {"filename", "to_world", "face_normals", "flip_tex_coords"} <= fields and "mesh" not in fields


# Public scenes

REQUIRED = [
    *(
        f"lajolla/{name}.xml"
        for name in ("cbox/cbox", "veach_mi/mi", "sponza/sponza", "matpreview/matpreview")
    ),
    "lajolla/pixel_filter_test/pixel_filter_test.xml",
    *(f"bitterli/{name}/scene.xml" for name in ("veach-mis", "cornell-box", "staircase2", "veach-ajar")),
]


@pytest.mark.parametrize("name", REQUIRED)
def test_required_scene_reads_as_written(name: str, shared_scenes: Path) -> None:
    """Nothing in these scenes is unknown, but for an integrator of its authors' own."""
    description = load_description(shared_scenes / name)
    unknown = [str(w) for w in description.warnings if "path_guiding_integrator" not in w.message]
    assert unknown == []
    assert description.core["shapes"] and description.core["emitters"]


def test_write_scene_is_valid(tmp_path: Path) -> None:
    assert load_description(write_scene(tmp_path, "")).core["shapes"] == []


def test_files_are_sought_in_the_working_folder_at_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In any case and with either slash, as beside the scene, where a file of that name comes first."""
    triangle = "v 0 0 0\nv {} 0 0\nv 0 1 0\nf 1 2 3\n"
    here, there = tmp_path / "here", tmp_path / "there"
    (here / "meshes").mkdir(parents=True)
    there.mkdir()
    (here / "meshes" / "Wall.obj").write_text(triangle.format(5))
    (here / "part.xml").write_text('<scene version="3.0.0"><shape type="cube"/></scene>')
    monkeypatch.chdir(here)
    body = '<shape type="obj"><string name="filename" value="Meshes\\wall.OBJ"/></shape>'
    core = read(there, body + '<include filename="part.xml"/>').core
    assert len(core["shapes"]) == 2 and core["shapes"][0]["mesh"].vertices.max() == 5
    assert describe(
        {
            "type": "scene",
            "integrator": {"type": "path"},
            "sensor": {"type": "perspective"},
            "wall": {"type": "obj", "filename": "meshes/Wall.obj"},
        },
        base_path=there,
    ).core["shapes"]
    (there / "meshes").mkdir()
    (there / "meshes" / "wall.obj").write_text(triangle.format(7))
    assert read(there, body).core["shapes"][0]["mesh"].vertices.max() == 7


OLD_NAMES = """<shape type="sphere"><transform name="toWorld"><scale value="2"/></transform>
    <bsdf type="roughdielectric"><float name="intIOR" value="1.2"/><float name="alphaU" value="0.3"/>
        <boolean name="sampleVisible" value="true"/></bsdf></shape>"""


def test_old_names_in_new_files_are_used_and_told(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    sensor = '<sensor type="perspective"><float name="nearClip" value="1"/><film type="hdrfilm"/></sensor>'
    path.write_text(
        '<scene version="3.0.0"><integrator type="path"><integer name="maxDepth" value="3"/></integrator>'
        f"{sensor}{OLD_NAMES}</scene>"
    )
    description = load_description(path)
    core = description.core
    assert core["integrator"]["max_depth"] == 3 and core["sensor"]["near_clip"] == 1
    assert core["shapes"][0]["to_world"][0][0] == 2
    assert (core["bsdfs"][0]["int_ior"], core["bsdfs"][0]["alpha_u"]) == (1.2, 0.3)
    told = " ".join(w.message for w in description.warnings)
    for name in ("maxDepth", "nearClip", "toWorld", "intIOR", "alphaU"):
        assert f'"{name}" of ' in told
    assert "sampleVisible" not in told  # changes nothing
    assert '"maxDepth" of integrator "path" is the old name of "max_depth"; it is read as "max_depth"' in told
    with pytest.raises(SceneError, match="maxDepth"):
        load_description(path, strict=True)


def test_old_names_do_not_beat_new_ones(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    both = '<integer name="maxDepth" value="3"/><integer name="max_depth" value="5"/>'
    path.write_text(
        f'<scene version="3.0.0"><integrator type="path">{both}</integrator>'
        '<sensor type="perspective"/></scene>'
    )
    description = load_description(path)
    assert description.core["integrator"]["max_depth"] == 5
    assert 'has no property "maxDepth"' in " ".join(w.message for w in description.warnings)


def test_old_names_in_dicts(tmp_path: Path) -> None:
    description = describe(
        {"type": "scene", "integrator": {"type": "path", "maxDepth": 3}, "sensor": {"type": "perspective"}}
    )
    assert description.core["integrator"]["max_depth"] == 3 and "maxDepth" in str(description.warnings[0])


HARMLESS = {
    "film": '<film type="hdrfilm"><boolean name="high_quality_edges" value="true"/>'
    '<boolean name="sample_border" value="true"/><boolean name="banner" value="false"/></film>',
    "shape": '<shape type="sphere"><float name="silhouette_sampling_weight" value="2"/></shape>',
    "emitter": '<emitter type="constant"><float name="sampling_weight" value="2"/></emitter>',
    "integrator": '<integrator type="path"><integer name="block_size" value="32"/></integrator>',
    "bsdf": '<shape type="sphere"><bsdf type="plastic"><float name="specularSamplingWeight" value="0.5"/>'
    "</bsdf></shape>",
    "medium": '<shape type="rectangle"><medium name="interior" type="homogeneous">'
    '<string name="strategy" value="single"/></medium></shape>',
    "texture": '<shape type="sphere"><bsdf type="diffuse"><texture type="checkerboard" name="reflectance">'
    '<boolean name="accel" value="true"/></texture></bsdf></shape>',
}


@pytest.mark.parametrize("version", ["0.6.0", "3.0.0"])
@pytest.mark.parametrize("kind", HARMLESS)
def test_what_changes_nothing_is_not_told(kind: str, version: str, tmp_path: Path) -> None:
    content = HARMLESS[kind]
    parts = {"integrator": '<integrator type="volpath"/>', "emitter": '<emitter type="constant"/>'}
    frame = "".join(part for other, part in parts.items() if other != kind)
    inside = content if kind == "film" else ""
    body = f'{frame}<sensor type="perspective">{inside}</sensor>{"" if inside else content}'
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="{version}">{body}</scene>')
    assert load_description(path, strict=True).warnings == []
