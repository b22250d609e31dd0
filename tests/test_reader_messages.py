"""What the scene reader says about bad scenes: one message each, with place and caret, never a traceback."""

from __future__ import annotations

from pathlib import Path

import pytest
from reader_tools import error, error_of, messages, read, write_scene

import lajolla
from lajolla import _core
from lajolla.scene import SceneError, convert

SPHERE = '<shape type="sphere">{}</shape>'

GOLDEN = {
    "unknown element": (
        '<shap type="sphere"/>',
        'scene.xml:3:1: error: unknown element <shap>; did you mean "shape"?\n'
        '    <shap type="sphere"/>\n'
        "    ^",
    ),
    "missing attribute": (
        SPHERE.format('<float nme="radius" value="1"/>'),
        'scene.xml:3:22: error: <float> needs the attribute "name", it has: nme, value\n'
        '    <shape type="sphere"><float nme="radius" value="1"/></shape>\n'
        "                         ^",
    ),
    "not a number": (
        SPHERE.format('\n  <float name="radius" value="1_000"/>\n'),
        'scene.xml:4:31: error: expected a number, found "1_000"\n'
        '    <float name="radius" value="1_000"/>\n'
        "                                ^",
    ),
    "wrong type": (
        SPHERE.format('\n<string name="radius" value="big"/>'),
        'scene.xml:4:30: error: "radius" of shape "sphere" expects a number\n'
        '    <string name="radius" value="big"/></shape>\n'
        "                                 ^",
    ),
    "out of range": (
        SPHERE.format('\n<float name="radius" value="-1"/>'),
        'scene.xml:4:29: error: "radius" must be at least 0, not -1\n'
        '    <float name="radius" value="-1"/></shape>\n'
        "                                ^",
    ),
    "unknown id": (
        '<bsdf type="diffuse" id="white"/>\n' + SPHERE.format('<ref id="whit"/>'),
        'scene.xml:4:31: error: no object has the id "whit"; did you mean "white"?\n'
        '    <shape type="sphere"><ref id="whit"/></shape>\n'
        "                                  ^",
    ),
    "id used twice": (
        '<bsdf type="diffuse" id="a"/>\n<texture type="checkerboard" id="a"/>',
        'scene.xml:4:1: error: the id "a" is used twice; first at scene.xml:3:1\n'
        '    <texture type="checkerboard" id="a"/>\n'
        "    ^",
    ),
    "alias of an id that is taken": (
        '<bsdf type="diffuse" id="a"/>\n<alias id="a" as="a"/>',
        'scene.xml:4:19: error: the id "a" is used twice; first at scene.xml:3:1\n'
        '    <alias id="a" as="a"/>\n'
        "                      ^",
    ),
    "aliases in a circle": (
        '<alias id="a" as="b"/><alias id="b" as="a"/>',
        "scene.xml:3:19: error: aliases form a cycle: b -> a -> b\n"
        '    <alias id="a" as="b"/><alias id="b" as="a"/>\n'
        "                      ^",
    ),
    "objects in a circle": (
        '<bsdf type="twosided" id="a"><ref id="b"/></bsdf>\n'
        '<bsdf type="twosided" id="b"><ref id="a"/></bsdf>',
        "scene.xml:3:1: error: objects contain each other: a -> b -> a\n"
        '    <bsdf type="twosided" id="a"><ref id="b"/></bsdf>\n'
        "    ^",
    ),
    "an unknown choice": (
        SPHERE.format('<bsdf type="roughconductor">\n<string name="distribution" value="gxx"/></bsdf>'),
        'scene.xml:4:36: error: "gxx" is no choice for "distribution"; did you mean "ggx"?\n'
        '    <string name="distribution" value="gxx"/></bsdf></shape>\n'
        "                                       ^",
    ),
    "an unknown metal": (
        SPHERE.format('<bsdf type="conductor">\n<string name="material" value="Agg"/></bsdf>'),
        'scene.xml:4:32: error: no conductor is called "Agg"; did you mean "Ag"?\n'
        '    <string name="material" value="Agg"/></bsdf></shape>\n'
        "                                   ^",
    ),
    "an unknown index of refraction": (
        SPHERE.format('<bsdf type="dielectric">\n<string name="int_ior" value="watr"/></bsdf>'),
        'scene.xml:4:31: error: no index of refraction is known for "watr"; did you mean "water"?\n'
        '    <string name="int_ior" value="watr"/></bsdf></shape>\n'
        "                                  ^",
    ),
    "a matrix of the wrong size": (
        SPHERE.format('<transform name="to_world">\n<matrix value="1 2 3"/></transform>'),
        'scene.xml:4:16: error: expected 9 or 16 numbers, found "1 2 3"\n'
        '    <matrix value="1 2 3"/></transform></shape>\n'
        "                   ^",
    ),
    "not a transformation": (
        SPHERE.format('<transform name="to_world">\n<translat x="1"/></transform>'),
        'scene.xml:4:1: error: <translat> is no transformation; did you mean "translate"?\n'
        '    <translat x="1"/></transform></shape>\n'
        "    ^",
    ),
    "wavelengths that fall": (
        SPHERE.format('<bsdf type="diffuse">\n<spectrum name="reflectance" value="500:1, 400:1"/></bsdf>'),
        "scene.xml:4:37: error: wavelengths must rise, but 400 follows 500\n"
        '    <spectrum name="reflectance" value="500:1, 400:1"/></bsdf></shape>\n'
        "                                        ^",
    ),
    "an adapter without its material": (
        SPHERE.format('\n<bsdf type="twosided"/>'),
        'scene.xml:4:1: error: bsdf "twosided" needs one or two bsdfs inside\n'
        '    <bsdf type="twosided"/></shape>\n'
        "    ^",
    ),
    "a file without a name": (
        '<shape type="obj"/>',
        'scene.xml:3:1: error: shape "obj" needs the string "filename"\n    <shape type="obj"/>\n    ^',
    ),
}


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_message(name: str, tmp_path: Path) -> None:
    body, expected = GOLDEN[name]
    assert error_of(tmp_path, body) == expected


WARNINGS = {
    "unknown property": (
        SPHERE.format('<float name="radus" value="1"/>'),
        'scene.xml:3:35: warning: shape "sphere" has no property "radus"; did you mean "radius"?',
    ),
    "unknown attribute": (
        SPHERE.format('<float name="radius" value="1" unit="m"/>'),
        'scene.xml:3:59: warning: <float> has no attribute "unit"; valid: intent, name, value',
    ),
    "misspelt plugin": (
        SPHERE.format('<bsdf type="difuse"/>'),
        'scene.xml:3:34: warning: unknown bsdf "difuse"; "diffuse" is used',
    ),
    "plugin with a known substitute": (
        SPHERE.format('<bsdf type="hk"/>'),
        'scene.xml:3:34: warning: unknown bsdf "hk"; "diffuse" is used',
    ),
    "plugin without a substitute": (
        '<emitter type="laser"/>',
        'scene.xml:3:16: warning: unknown emitter "laser"; it is ignored',
    ),
    "undefined parameter": (
        SPHERE.format('<float name="radius" value="$r"/>'),
        'scene.xml:3:50: warning: parameter "$r" is not defined, <float> is ignored',
    ),
    "undefined plugin type": (
        SPHERE.format('<bsdf type="$material"/>'),
        'scene.xml:3:34: warning: parameter "$material" is not defined, the default bsdf is used',
    ),
}


@pytest.mark.parametrize("name", WARNINGS)
def test_unknown_names_warn_and_are_errors_when_strict(name: str, tmp_path: Path) -> None:
    body, expected = WARNINGS[name]
    assert messages(read(tmp_path, body), tmp_path) == [expected]
    refusal = error_of(tmp_path, body, strict=True).splitlines()[0]
    assert refusal == expected.replace(": warning: ", ": error: ")


def test_reflectance_above_one_is_clamped(tmp_path: Path) -> None:
    body = SPHERE.format('<bsdf type="diffuse"><rgb name="reflectance" value="1.5 .2 .2"/></bsdf>')
    description = read(tmp_path, body, strict=True)
    assert description.core["bsdfs"][0]["reflectance"] == (1.0, 0.2, 0.2)
    assert messages(description, tmp_path) == [
        'scene.xml:3:74: warning: "reflectance" of bsdf "diffuse" is above 1 (1.5, 0.2, 0.2) and clamped'
    ]


def test_repeated_warnings_are_counted(tmp_path: Path) -> None:
    body = SPHERE.format('<float name="radus" value="1"/>') * 3
    assert [w.count for w in read(tmp_path, body).warnings if "radus" in str(w)] == [3]


def test_missing_file_tells_where_it_was_sought(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    body = '<path value="meshes"/><shape type="obj"><string name="filename" value="no.obj"/></shape>'
    first_line = messages(read(tmp_path, body), tmp_path)[0].replace(str(tmp_path), "HERE")
    sought = 'file "no.obj" not found; searched: HERE, meshes, .'
    assert first_line == f'scene.xml:3:72: warning: {sought}; shape "obj" is ignored'
    assert f"error: {sought.split(';')[0]}" in error_of(tmp_path, body, strict=True)


def test_missing_texture_leaves_the_default(tmp_path: Path) -> None:
    texture = '<texture type="bitmap" name="reflectance"><string name="filename" value="no.png"/></texture>'
    description = read(tmp_path, SPHERE.format(f'<bsdf type="diffuse">{texture}</bsdf>'))
    assert "reflectance" not in description.core["bsdfs"][0]
    assert 'texture "bitmap" is ignored' in messages(description, tmp_path)[0]


def test_what_the_core_refuses_has_a_place(tmp_path: Path) -> None:
    description = read(tmp_path, SPHERE.format("") + "\n" + SPHERE.format('<float name="radius" value="0"/>'))
    with pytest.raises(_core.DescriptionError) as caught:
        _core.Scene(description.core)
    first_line = str(description.refusal(caught.value)).replace(f"{tmp_path}/", "").splitlines()[0]
    assert first_line.startswith("scene.xml:4:1: error: ") and "radius above zero" in first_line


def test_long_lines_are_cut_around_the_caret(tmp_path: Path) -> None:
    body = SPHERE.format(" " * 200 + '<float name="radius" value="x"/>' + " " * 200)
    _, excerpt, caret = error_of(tmp_path, body).split("\n")
    assert len(excerpt) <= 104
    assert excerpt[caret.index("^")] == "x"


def test_unused_parameter(tmp_path: Path) -> None:
    path = write_scene(tmp_path, SPHERE.format('<float name="radius" value="$radius"/>'))
    message = error(path, parameters={"radius": "1", "raduis": "2"}, strict=True)
    assert 'parameter "raduis" is not used; did you mean "radius"?' in message


HOSTILE = {
    "empty": (b"", "not valid XML: no element found"),
    "binary": (bytes(range(256)), "not valid XML"),
    "NUL": (b'<scene version="3.0.0">\0</scene>', "not valid XML: not well-formed"),
    "cut short": (b'<scene version="3.0.0"><shape ty', "not valid XML: unclosed token"),
    "entities": (
        b'<!DOCTYPE s [<!ENTITY a "aa">]><scene version="3.0.0">&a;</scene>',
        "entities are refused",
    ),
    "undefined entity": (b'<scene version="3.0.0">&a;</scene>', "not valid XML: undefined entity"),
    "deep": (b'<scene version="3.0.0">' + b'<bsdf type="mask">' * 100_000, "nested more than 64 deep"),
    "another root": (b"<html/>", "the root element is <html>, not <scene>"),
    "no version number": (b'<scene version="new"/>', '"new" is not a version'),
    "unknown encoding": (b'<?xml version="1.0" encoding="hex"?><scene/>', 'unknown text encoding "hex"'),
    "itself": (b'<scene version="3.0.0"><include filename="hostile.xml"/></scene>', "includes itself"),
    "growing defaults": (
        b'<scene version="3.0.0"><default name="a0" value="aaaaaaaaaa"/>'
        + b"".join(b'<default name="a%d" value="%s"/>' % (i, b"$a%d" % (i - 1) * 10) for i in range(1, 9))
        + b"</scene>",
        "longer than 1000000 characters",
    ),
    "a long chain": (
        b'<scene version="3.0.0">'
        + b"".join(b'<bsdf type="twosided" id="b%d"><ref id="b%d"/></bsdf>' % (i, i + 1) for i in range(5000))
        + b'<bsdf type="diffuse" id="b5000"/></scene>',
        "objects are nested more than 64 deep",
    ),
    "a long number": (
        b'<scene version="3.0.0"><shape type="sphere"><float name="radius" value="%s"/></shape></scene>'
        % (b"9" * 1_000_000),
        "expected a number",
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_text(name: str, tmp_path: Path) -> None:
    data, expected = HOSTILE[name]
    path = tmp_path / "hostile.xml"
    path.write_bytes(data)
    message = error(path)
    assert message.startswith("hostile.xml") and expected in message
    assert len(message) < 1000


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "latin-1"])
def test_encodings(encoding: str, tmp_path: Path) -> None:
    body = SPHERE.format('<!-- caf\u00e9 --><float name="r\u00e9" value="1"/>')
    path = write_scene(tmp_path, body)
    path.write_bytes(path.read_text(encoding="utf-8").encode(encoding))
    said = "\n".join(error(path, strict=True).splitlines())
    assert 'property "r\u00e9"' in said


@pytest.mark.parametrize("path", ["/", "/nonexistent/scene.xml", "/dev/zero"])
def test_what_is_no_file(path: str) -> None:
    assert "error: " in error(Path(path))


@pytest.mark.parametrize(
    ("body", "line", "message"),
    [
        (
            '<emitter type="spot"><float name="cutoff_angle" value="10"/>'
            '<float name="beam_width" value="20"/></emitter>',
            3,
            "beam_width is larger than cutoff_angle",
        ),
        (
            SPHERE.format('\n<bsdf type="roughplastic"><float name="alpha" value="1e300"/></bsdf>'),
            4,
            "error: alpha: expected a number >= 0, got 1e",
        ),
        (
            SPHERE.format('\n<bsdf type="conductor"><float name="ext_eta" value="1e-20"/></bsdf>'),
            4,
            "k: expected",
        ),
        (SPHERE.format('\n<bsdf type="dielectric"><float name="int_ior" value="0"/></bsdf>'), 4, "int_ior"),
        ('<shape type="cylinder"><float name="radius" value="0"/></shape>', 3, "error: a cylinder needs"),
    ],
)
def test_refusals_of_the_core_have_a_place(tmp_path: Path, body: str, line: int, message: str) -> None:
    path = write_scene(tmp_path, body)
    with pytest.raises(lajolla.SceneError, match=message) as caught:
        lajolla.load(path)
    assert caught.value.location is not None
    assert caught.value.location.line == line


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<emitter type="envmap"/>', 'emitter "envmap" needs the string "filename"'),
        (
            SPHERE.format('<bsdf type="conductor"><float name="ext_eta" value="0"/></bsdf>'),
            '"ext_eta" must be above zero, not 0',
        ),
        (
            SPHERE.format('<bsdf type="roughdielectric"><float name="roughness" value="1e200"/></bsdf>'),
            'scene.xml:3:82: error: "roughness" must be at most 1e+09, not 1e+200',
        ),
        (
            '<shape type="serialized"><integer name="shape_index" value="3000000000"/></shape>',
            '"shape_index" must be between 0 and 2147483647, not 3000000000',
        ),
    ],
)
def test_refused_values(tmp_path: Path, body: str, message: str) -> None:
    assert message in error_of(tmp_path, body)


CHECKERBOARD = '<texture type="checkerboard" name="eta"/>'


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<shape type=""/>', "the type of <shape> is empty"),
        (
            SPHERE.format(f'<bsdf type="conductor">{CHECKERBOARD}<float name="ext_eta" value="1.3"/></bsdf>'),
            '"eta" of bsdf "conductor" is a texture, which is not divided by "ext_eta"',
        ),
        (
            SPHERE.format('<bsdf type="difuse"><float name="shine" value="1"/></bsdf>'),
            'has no property "shine"',
        ),
        (
            SPHERE.format(
                '<medium name="interior" type="heterogeneous"><volume name="density" type="foo"/></medium>'
            ),
            'unknown volume "foo"; "constvolume" is used',
        ),
    ],
)
def test_problem_and_rendered_otherwise(tmp_path: Path, body: str, message: str) -> None:
    assert message in "\n".join(messages(read(tmp_path, body), tmp_path))


@pytest.mark.parametrize(
    ("plugin", "name"),
    [("roughplastic", "alpha"), ("dielectric", "int_ior"), ("hair", "color")],
)
def test_textures_where_a_model_takes_a_constant(plugin: str, name: str, tmp_path: Path) -> None:
    body = SPHERE.format(f'<bsdf type="{plugin}"><texture name="{name}" type="{{}}"/></bsdf>')
    told = messages(description := read(tmp_path, body.format("checkerboard")), tmp_path)
    assert len(told) == 1
    assert f'"{name}" of bsdf "{plugin}" takes no texture; the default is used' in told[0]
    assert name not in description.core["bsdfs"][0]
    error_of(tmp_path, body.format("checkerboard"), strict=True)
    assert "<texture" not in convert(tmp_path / "scene.xml", tmp_path / "new.xml").text


@pytest.mark.parametrize(
    "body",
    ['<integrator type="adaptive"/>', '<integrator type="moment"><integrator type="adaptive"/></integrator>'],
)
def test_integrators_that_lack_the_one_inside(body: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="3.0.0"><sensor type="perspective"/>{body}</scene>')
    description = lajolla.scene.load_description(path)
    assert description.core["integrator"]["type"] == "path"
    assert 'unknown integrator "adaptive"; "path" is used' in messages(description, tmp_path)[0]


def test_a_constant_texture_is_a_number(tmp_path: Path) -> None:
    texture = '<texture name="alpha" type="uniform"><float name="value" value="0.25"/></texture>'
    path = write_scene(tmp_path, SPHERE.format(f'<bsdf type="roughplastic">{texture}</bsdf>'))
    assert lajolla.scene.load_description(path, strict=True).core["bsdfs"][0]["alpha"] == 0.25
    assert '<float name="alpha" value="0.25"' in convert(path, tmp_path / "new.xml").text


def test_other_plugins_properties_are_not_problem_one_by_one(tmp_path: Path) -> None:
    body = SPHERE.format('<bsdf type="irawan"><float name="metallic" value="1"/></bsdf>')
    assert len(messages(read(tmp_path, body), tmp_path)) == 1


def test_a_mesh_without_a_mesh_has_a_place(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="a mesh needs positions"):
        lajolla.load(write_scene(tmp_path, '<shape type="mesh"/>'))
