"""What is used for plugins that are not there: the nearest in effect, and one warning that hides nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reader_tools import messages, read

import lajolla
from lajolla.scene import Description, load_description

SPHERE = '<shape type="sphere">{}</shape>'


def told(folder: Path, body: str, version: str = "3.0.0") -> tuple[Description, list[str]]:
    """A description and its warnings without their places."""
    description = read(folder, body, version)
    return description, [line.split("warning: ")[-1] for line in messages(description, folder)]


PLATES = {
    "polarizer": (0.5, '<float name="theta" value="20"/><boolean name="polarizing" value="false"/>'),
    "circular": (0.5, '<boolean name="left_handed" value="true"/>'),
    "retarder": (1.0, '<float name="theta" value="20"/><float name="delta" value="45"/>'),
}


def through(plate: str, folder: Path, integrator: str = "path") -> np.ndarray:
    """White light through a plate that fills the view."""
    path = folder / "plate.xml"
    path.write_text(
        f"""<scene version="3.0.0"><integrator type="{integrator}"/><emitter type="constant"/>
        <sensor type="perspective"><float name="fov" value="10"/><transform name="to_world">
            <lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
            <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/></film>
        </sensor><shape type="rectangle">{plate}</shape></scene>"""
    )
    scene = lajolla.load(path)
    assert scene.warnings == []
    return scene.render(spp=4).array


@pytest.mark.parametrize("name", PLATES)
def test_plates_are_clear_as_in_mitsuba(name: str, tmp_path: Path) -> None:
    share, others = PLATES[name]
    assert np.allclose(through(f'<bsdf type="{name}">{others}</bsdf>', tmp_path), share)
    tint = '<rgb name="transmittance" value="0.6 0.4 0.2"/>'
    plate = f'<bsdf type="{name}">{tint}</bsdf>'
    found = through(plate, tmp_path)
    assert np.allclose(found, np.multiply(share, (0.6, 0.4, 0.2)), rtol=1e-4)
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    theirs = np.array(mitsuba.render(mitsuba.load_file(str(tmp_path / "plate.xml")), spp=4))
    assert np.allclose(theirs, found, rtol=1e-4)


def test_plates_take_textures(tmp_path: Path) -> None:
    checks = '<texture type="checkerboard" name="transmittance"><rgb name="color1" value="0.4"/></texture>'
    assert np.allclose(through(f'<bsdf type="retarder">{checks}</bsdf>', tmp_path), 0.4, rtol=1e-4)
    half = through(f'<bsdf type="circular">{checks}</bsdf>', tmp_path)
    assert np.all(half <= 0.41) and half.mean() > 0


GGX = '<float name="alphaU" value="0.3"/><float name="alphaV" value="0.3"/>{}'
GGX += '<rgb name="R0" value="0.9 0.6 0.3"/>'


@pytest.mark.parametrize("version", ["0.5.0", "3.0.0"])
def test_the_colour_of_a_metal_is_kept(version: str, tmp_path: Path) -> None:
    body = GGX.format("") if version == "0.5.0" else GGX.format("").replace("alphaU", "alpha_u")
    body = body if version == "0.5.0" else body.replace("alphaV", "alpha_v")
    description, lines = told(
        tmp_path, SPHERE.format(f'<bsdf type="roughconductorGGX">{body}</bsdf>'), version
    )
    entry = description.core["bsdfs"][0]
    assert entry["specular_reflectance"] == (0.9, 0.6, 0.3)
    assert (entry["eta"], entry["k"], entry["multiscatter"]) == ((0.0,) * 3, (1.0,) * 3, True)
    assert lines == ['unknown bsdf "roughconductorGGX"; "roughconductor" is used']


def test_scattering_once_is_without_what_comes_after(tmp_path: Path) -> None:
    once = GGX.format('<integer name="scatteringOrderMax" value="1"/>')
    description, lines = told(
        tmp_path, SPHERE.format(f'<bsdf type="roughconductorGGX">{once}</bsdf>'), "0.5.0"
    )
    assert "multiscatter" not in description.core["bsdfs"][0] and len(lines) == 1


# Where an object stands, its name there, and what is inside of an unknown one.
FOG = SPHERE.format('<medium name="interior" type="homogeneous">{}</medium>')
INNER = {
    "integrator": ("{}", "", '<integrator type="direct"/>'),
    "bsdf": (SPHERE, "", '<bsdf type="plastic"/>'),
    "phase": (FOG, "", '<phase type="rayleigh"/>'),
    "texture": (
        SPHERE.format('<bsdf type="diffuse">{}</bsdf>'),
        'name="reflectance"',
        '<texture type="checkerboard"/>',
    ),
    "shape": ("{}", "", '<shape type="sphere"/><shape type="cube"/>'),
    "emitter": ("{}", "", '<emitter type="point"/>'),
}


@pytest.mark.parametrize("kind", INNER)
def test_a_container_is_never_replaced_by_something_unrelated(kind: str, tmp_path: Path) -> None:
    place, name, inner = INNER[kind]
    path = tmp_path / "scene.xml"
    frame = '<sensor type="perspective"/>' + ('<integrator type="path"/>' if kind != "integrator" else "")
    cores: list[dict[str, Any]] = []
    for content in (f'<{kind} type="surround" {name}>{inner}</{kind}>', inner.replace("/>", f" {name}/>")):
        path.write_text(f'<scene version="3.0.0">{frame}{place.format(content)}</scene>')
        cores.append(load_description(path).core)
    assert [shape["type"] for shape in cores[0]["shapes"]] == [shape["type"] for shape in cores[1]["shapes"]]
    for entries in ("bsdfs", "phases", "textures", "emitters", "integrator"):
        assert cores[0][entries] == cores[1][entries]


@pytest.mark.parametrize(
    "body, expected",
    [
        (
            SPHERE.format(
                '<bsdf type="hk"><float name="thickness" value="2"/><boolean name="sample_visible" '
                'value="true"/><medium type="homogeneous" name="interior"/></bsdf>'
            ),
            'unknown bsdf "hk"; "diffuse" is used, without "thickness", "interior"',
        ),
        (
            SPHERE.format('<bsdf type="pplastic"><float name="alpha" value="0.2"/></bsdf>'),
            'unknown bsdf "pplastic"; "roughplastic" is used',
        ),
        (
            '<emitter type="surround"><float name="power" value="2"/><emitter type="point"/></emitter>',
            'unknown emitter "surround"; the emitter "point" inside it is used, without "power"',
        ),
    ],
)
def test_one_warning_tells_what_is_lost(body: str, expected: str, tmp_path: Path) -> None:
    assert told(tmp_path, body)[1] == [expected]


@pytest.mark.parametrize(
    "asked, used, depth",
    [
        ("prb", "path", 6),
        ("prb_projective", "path", 6),
        ("prbvolpath", "volpath", 6),
        ("guided_path", "path", None),
    ],
)
def test_integrators_for_derivatives(asked: str, used: str, depth: int | None, tmp_path: Path) -> None:
    """They show the same picture, and end at their own depth."""
    path = tmp_path / "scene.xml"
    path.write_text(
        f'<scene version="3.0.0"><integrator type="{asked}"/><sensor type="perspective"/></scene>'
    )
    entry = load_description(path).core["integrator"]
    assert (entry["type"], entry.get("max_depth")) == (used, depth)


def test_direct_light_projected_is_direct_light(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    inner = '<integer name="sppi" value="16"/>'
    path.write_text(
        '<scene version="3.0.0"><integrator type="direct_projective">'
        f'{inner}</integrator><sensor type="perspective"/><emitter type="constant"/></scene>'
    )
    description = load_description(path)
    assert description.core["integrator"]["type"] == "direct"
    assert [w.message for w in description.warnings] == [
        'unknown integrator "direct_projective"; "direct" is used'
    ]


@pytest.mark.parametrize(
    ("name", "used"),
    [("mirror", "conductor"), ("glass", "dielectric"), ("roughglass", "roughdielectric")],
)
def test_common_names_of_other_programs(name: str, used: str, tmp_path: Path) -> None:
    description, lines = told(tmp_path, SPHERE.format(f'<bsdf type="{name}"/>'))
    assert description.core["bsdfs"][0]["type"] == used
    assert lines[0] == f'unknown bsdf "{name}"; "{used}" is used'


def test_guesses_are_harmless(tmp_path: Path) -> None:
    """No name that looks alike makes a surface invisible, or an error of an unknown plugin."""
    learned = '<bsdf type="neural"><string name="filename" value="weights.bin"/></bsdf>'
    description, lines = told(tmp_path, SPHERE.format(learned))
    assert description.core["bsdfs"][0]["type"] == "diffuse" and '"filename"' in lines[0]
    inside = '<bsdf type="plastic"/><bsdf type="diffuse"/>'
    description, lines = told(tmp_path, SPHERE.format(f'<bsdf type="mixture">{inside}</bsdf>'))
    assert 'the bsdf "plastic" inside it is used, without the bsdf "diffuse"' in lines[0]
    weights = f'<string name="weights" value="0.5, 0.5"/>{inside}'
    _, lines = told(tmp_path, SPHERE.format(f'<bsdf type="mixturebdsf">{weights}</bsdf>'))
    assert '"mixturebsdf" is used' in lines[0]
    description, lines = told(tmp_path, SPHERE.format('<bsdf type="nul"/>'))
    assert description.core["bsdfs"][0]["type"] == "null"


def test_plastic_has_one_roughness(tmp_path: Path) -> None:
    widths = '<float name="alpha_u" value="0.1"/><float name="alpha_v" value="0.4"/>'
    description, lines = told(tmp_path, SPHERE.format(f'<bsdf type="pplastic">{widths}</bsdf>'))
    assert description.core["bsdfs"][0]["alpha"] == pytest.approx(0.2)
    assert lines[0] == 'unknown bsdf "pplastic"; "roughplastic" is used'
