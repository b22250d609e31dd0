"""Objects of every kind may be declared on top of a scene and used by reference, wherever one may stand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reader_tools import messages, write_scene

import lajolla
from lajolla import cli
from lajolla.scene import load_description

GREY = '<bsdf type="diffuse"/>'
CHECKS = '<texture type="checkerboard" {}/>'
FOG = '<medium type="heterogeneous" name="interior">{}</medium>'


def sphere(inner: str) -> str:
    return f'<shape type="sphere">{inner}</shape>'


def painted(inner: str) -> str:
    return sphere(f'<bsdf type="diffuse">{inner}</bsdf>')


def seen_by(inner: str) -> str:
    return f'<sensor type="perspective">{inner}</sensor>'


# What is around an object, and the object: "{}" is the place, and in the object that of id and name.
PLACES = {
    "bsdf in a shape": (sphere("{}"), '<bsdf type="plastic" {}/>'),
    "bsdf in an adapter": (sphere('<bsdf type="twosided">{}</bsdf>'), '<bsdf type="plastic" {}/>'),
    "bsdf in a blend": (sphere(f'<bsdf type="blendbsdf">{GREY}{{}}</bsdf>'), '<bsdf type="plastic" {}/>'),
    "bsdf in a coating": (sphere('<bsdf type="coating">{}</bsdf>'), '<bsdf type="plastic" {}/>'),
    "emitter in a shape": (
        sphere("{}"),
        '<emitter type="area" {}><rgb name="radiance" value="3"/></emitter>',
    ),
    "medium in a shape": (sphere("{interior}"), '<medium type="homogeneous" {}/>'),
    "medium around a shape": (sphere("{exterior}"), '<medium type="homogeneous" {}/>'),
    "medium of a camera": (seen_by("{}"), '<medium type="homogeneous" {}/>'),
    "film of a camera": (seen_by("{}"), '<film type="hdrfilm" {}><integer name="width" value="9"/></film>'),
    "sampler of a camera": (seen_by("{}"), '<sampler type="independent" {}/>'),
    "filter of a film": (seen_by('<film type="hdrfilm">{}</film>'), '<rfilter type="box" {}/>'),
    "phase in a medium": (sphere(FOG), '<phase type="rayleigh" {}/>'),
    "phase in a phase": (
        sphere(FOG.format('<phase type="blendphase"><phase type="isotropic"/>{}</phase>')),
        '<phase type="rayleigh" {}/>',
    ),
    "volume in a medium": (
        sphere(FOG.replace("{}", "{albedo}")),
        '<volume type="constvolume" {}><rgb name="value" value="0.1 0.2 0.3"/></volume>',
    ),
    "texture in a bsdf": (painted("{reflectance}"), CHECKS),
    "colour in a bsdf": (
        painted("{reflectance}"),
        '<spectrum type="srgb" {}><rgb name="color" value="1 0 0"/></spectrum>',
    ),
    "texture in a texture": (painted('<texture type="scale" name="reflectance">{}</texture>'), CHECKS),
    "texture in an adapter": (sphere(f'<bsdf type="mask">{GREY}{{opacity}}</bsdf>'), CHECKS),
    "texture in a light": (sphere('<emitter type="area">{radiance}</emitter>'), CHECKS),
    "group in an instance": (
        '<shape type="instance">{}</shape>',
        '<shape type="shapegroup" {}><shape type="cube"/></shape>',
    ),
    "integrator in an integrator": (
        '<integrator type="aov"><string name="aovs" value="d:depth"/>{}</integrator>',
        '<integrator type="direct" {}/>',
    ),
}
FRAME = {
    "integrator": '<integrator type="path"/>',
    "sensor": '<sensor type="perspective"/>',
    "emitter": '<emitter type="constant"/>',
}
ALONE = {
    "an area light": '<emitter type="area" id="x"/>',
    "a film": '<film type="hdrfilm" id="x"/>',
    "a filter": '<rfilter type="box" id="x"/>',
    "a sampler": '<sampler type="independent" id="x"/>',
    "a medium": '<medium type="homogeneous" id="x"/>',
    "a phase function": '<phase type="hg" id="x"/>',
    "a volume": '<volume type="constvolume" id="x"/>',
    "a texture": CHECKS.format('id="x"'),
    "a bsdf": '<bsdf type="plastic" id="x"/>',
    "a missing image": '<texture type="bitmap" id="x"><string name="filename" value="none.png"/></texture>',
    "a group": '<shape type="shapegroup" id="x"><shape type="cube"/></shape>',
}


def written(folder: Path, content: str) -> Path:
    """A scene file with the content, and what it lacks of a whole scene."""
    frame = "".join(text for kind, text in FRAME.items() if f"<{kind}" not in content.replace("{", ""))
    path = folder / "scene.xml"
    path.write_text(f'<scene version="3.0.0">{frame}{content}</scene>')
    return path


def plain(entry: Any) -> Any:  # noqa: ANN401
    """A description in lists, dicts and numbers, which can be compared."""
    if isinstance(entry, dict):
        return {key: plain(value) for key, value in entry.items()}
    if isinstance(entry, list | tuple):
        return [plain(value) for value in entry]
    if isinstance(entry, np.ndarray):
        return entry.tolist()
    return entry if isinstance(entry, str | int | float | bool | None) else type(entry).__name__


def placed(around: str, content: str) -> str:
    """The content in its place, which may be one with a name."""
    start = around.index("{")
    return around[:start] + content + around[around.index("}", start) + 1 :]


@pytest.mark.parametrize("order", ["before", "after"])
@pytest.mark.parametrize("case", PLACES)
def test_a_reference_is_as_good_as_the_object(case: str, order: str, tmp_path: Path) -> None:
    around, what = PLACES[case]
    name = around[around.index("{") + 1 : around.index("}")]
    given = f'name="{name}"' if name else ""
    nested = load_description(written(tmp_path, placed(around, what.format(given))))
    parts = [what.format('id="x"'), placed(around, f'<ref id="x" {given}/>')]
    path = written(tmp_path, "".join(parts if order == "before" else parts[::-1]))
    referred = load_description(path)
    assert plain(referred.core) == plain(nested.core)
    assert [w.message for w in referred.warnings] == [w.message for w in nested.warnings]


@pytest.mark.parametrize("case", PLACES)
def test_converted_references_open_in_mitsuba(case: str, tmp_path: Path) -> None:
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    around, what = PLACES[case]
    name = around[around.index("{") + 1 : around.index("}")]
    given = f'name="{name}"' if name else ""
    content = what.format('id="x"') + placed(around, f'<ref id="x" {given}/>')
    path = written(tmp_path, content)
    assert cli.main(["convert", str(path), str(tmp_path / "new.xml")]) == 0
    mitsuba.load_file(str(tmp_path / "new.xml"))


@pytest.mark.parametrize("case", ALONE)
def test_what_is_not_used_is_no_mistake(case: str, tmp_path: Path) -> None:
    body = ALONE[case] + '<shape type="cube"/><emitter type="constant"/>'
    path = write_scene(tmp_path, body)
    told = messages(load_description(path), tmp_path)
    expected = ["no shape refers to emitter"] if case == "an area light" else []
    assert len(told) == len(expected) and all(text in told[0] for text in expected)
    assert cli.main(["convert", str(path), str(tmp_path / "new.xml")]) == 0
    load_description(tmp_path / "new.xml")


def test_every_shape_has_its_own_light(tmp_path: Path) -> None:
    """Also where several refer to one that is declared on top."""
    light = '<emitter type="area" id="x"><rgb name="radiance" value="1 2 3"/></emitter>'
    used = light + sphere('<ref id="x"/>') + '<shape type="cube"><ref id="x"/></shape>'
    core = load_description(write_scene(tmp_path, used)).core
    assert [shape["emitter"] for shape in core["shapes"]] == [0, 1]
    inside = '<ref id="x"/><boolean name="flip_normals" value="true"/>'
    scene = lajolla.load(write_scene(tmp_path, light + sphere(inside)), size=(4, 4), spp=4)
    assert np.allclose(scene.render().array, [1, 2, 3])
