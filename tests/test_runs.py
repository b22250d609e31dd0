"""Shapes and BSDFs that are alike are read together: is that what they are one by one?"""

from __future__ import annotations

import gc
import random
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from reader_tools import entries

import lajolla
from lajolla import _core
from lajolla.scene import Description, SceneError, load_description, numbered
from lajolla.scene.syntax import runs as syntax_runs
from lajolla.scene.syntax.element import Element
from lajolla.scene.syntax.elements import parse_xml
from lajolla.scene.syntax.errors import Source

HEAD = """<scene version="{version}">
    <default name="width" value="8"/>
    <default name="small" value="0.3"/>
    <integrator type="path"/>
    <sensor type="perspective">
        <transform name="to_world"><lookat origin="0, 0, 9" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="$width"/><integer name="height" value="8"/></film>
    </sensor>
    <emitter type="constant"/>
    <bsdf type="diffuse" id="a"><rgb name="reflectance" value="0.5, 0.3, 0.2"/></bsdf>
    <bsdf type="roughconductor" id="b"/>
    <bsdf type="dielectric" id="c"/>
    <texture type="checkerboard" id="t"/>
    <shape type="shapegroup" id="g"><shape type="sphere"><ref id="a"/></shape></shape>
    <shape type="shapegroup" id="h"><shape type="cube"/></shape>
    <shape type="shapegroup" id="lit">
        <shape type="sphere"><emitter type="area"><rgb name="radiance" value="2"/></emitter></shape>
    </shape>
"""
INSIDE = """
    <emitter type="area" id="L"><rgb name="radiance" value="3"/></emitter>
    <emitter type="area" id="K"/>
    <medium type="homogeneous" id="M"><float name="sigma_t" value="2"/></medium>
    <medium type="homogeneous" id="N"/>
    <subsurface type="dipole" id="S"/>
"""


class Writer:
    """Makes shapes of random numbers; `kinds` are texts with a call in each pair of braces."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)

    def number(self, low: float = -2, high: float = 2) -> str:
        form = self.random.choice(["{:.3f}", "{:g}", "{:.17g}", "{:+.2e}"])
        return form.format(self.random.uniform(low, high))

    def triple(self, low: float = -2, high: float = 2) -> str:
        return self.random.choice([", ", " ", ","]).join(self.number(low, high) for _ in range(3))

    def shape(self, kind: str) -> str:
        values: dict[str, Callable[[], str]] = {
            "n": self.number,
            "p": lambda: self.number(0.1, 0.9),
            "v": self.triple,
            "c": lambda: self.triple(0, 1),
            "r": lambda: self.random.choice("ab"),
            "m": lambda: self.random.choice("abc"),
            "i": lambda: self.random.choice("gh"),
            "o": lambda: self.random.choice(["1", "-1"]),
            "x": lambda: self.random.choice(["0.5", "-0.0", "1.5"]),
            "d": lambda: self.random.choice(["0.25", "-0.0", "0.5"]),
            "l": lambda: self.random.choice(["g", "lit"]),
            "e": lambda: self.random.choice("KL"),
            "u": lambda: self.random.choice("MN"),
            "any": lambda: self.random.choice("aLMS"),
        }
        for name, value in values.items():
            while f"{{{name}}}" in kind:
                kind = kind.replace(f"{{{name}}}", value(), 1)
        return kind


PLACE = '<transform name="to_world"><translate x="{n}" y="{n}" z="{n}"/></transform>'
INNER = (  # what a shape may contain or refer to beside its material
    '<ref id="L"/>',
    '<ref id="{e}"/>',
    '<ref id="a"/><ref id="{e}"/>',
    '<ref name="shines" id="L"/>',
    '<ref id="M"/>',
    '<ref name="interior" id="M"/>',
    '<ref name="interior" id="{u}"/>',
    '<ref name="exterior" id="{u}"/><ref id="c"/>',
    '<ref id="S"/>',
    '<ref name="subsurface" id="S"/>',
    '<ref id="{any}"/>',
    '<subsurface type="dipole"/>',
)
KINDS = (
    f'<shape type="sphere"><float name="radius" value="{{p}}"/>{PLACE}<ref id="{{r}}"/></shape>',
    '<shape type="sphere"><point name="center" x="{n}" y="{n}" z="{n}"/><ref id="{m}"/></shape>',
    '<shape type="sphere"><point name="center" value="{v}"/><float name="radius" value="0.5"/></shape>',
    '<shape type="sphere"><transform name="to_world"><scale value="{p}"/><rotate x="1" y="{n}" angle="{n}"/>'
    '<translate value="{v}"/></transform><ref id="a"/></shape>',
    '<shape type="sphere"><float name="radius" value="{p}"/>'
    '<bsdf type="diffuse"><rgb name="reflectance" value="{c}"/></bsdf></shape>',
    '<shape type="sphere"><bsdf type="diffuse"><rgb name="reflectance" value="{d}"/></bsdf></shape>',
    '<shape type="sphere"><bsdf type="diffuse"><rgb name="reflectance" value="{x}"/></bsdf></shape>',
    '<shape type="sphere"><bsdf type="roughconductor"><float name="alpha" value="{p}"/></bsdf></shape>',
    '<shape type="sphere"><bsdf type="twosided"><ref id="{r}"/></bsdf></shape>',
    '<shape type="sphere"><bsdf type="twosided"><bsdf type="diffuse"/></bsdf>' + PLACE + "</shape>",
    '<shape type="sphere"><bsdf type="diffuse"><ref name="reflectance" id="t"/></bsdf>' + PLACE + "</shape>",
    '<shape type="sphere"><transform name="to_world"><scale x="{o}"/></transform></shape>',
    '<shape type="sphere"><transform name="to_world"><scale x="1.5"/><translate x="{n}"/></transform>'
    "</shape>",
    '<shape type="sphere"><float name="radius" value="{p}"/><string name="unknown" value="1"/></shape>',
    '<shape type="sphere"><float name="radius" value="{p}"/><emitter type="area"/></shape>',
    '<shape type="sphere"><point name="center" value="{v}"/><float name="radius" value="$small"/></shape>',
    '<shape type="sphere"><float name="radius" value="{p}"/><float name="radius" value="{p}"/></shape>',
    f'<shape type="rectangle">{PLACE}<ref id="{{m}}"/></shape>',
    f'<shape type="disk">{PLACE}<boolean name="flip_normals" value="true"/></shape>',
    f'<shape type="cube">{PLACE}<ref id="{{r}}"/></shape>',
    f'<shape type="cylinder"><float name="radius" value="{{p}}"/>{PLACE}</shape>',
    '<shape type="spere"><float name="radius" value="{p}"/></shape>',
    '<shape type="sphere"/>',
    '<shape type="sphere"><transform name="toWorld"><translate x="{n}"/></transform></shape>',
    '<shape type="instance"><transform name="to_world"><matrix value="1 0 0 {n} 0 1 0 {n} 0 0 1 0 0 0 0 1"/>'
    '</transform><ref id="g"/></shape>',
    f'<shape type="instance">{PLACE}<ref id="{{i}}"/></shape>',
    f'<shape type="instance">{PLACE}<ref id="{{l}}"/></shape>',
    f'<shape type="instance">{PLACE}<ref id="lit"/></shape>',
    *(f'<shape type="sphere">{PLACE}{inner}</shape>' for inner in INNER),
    '<shape type="sphere"><boolean name="flip_normals" value="true"/></shape>',
    '<shape type="cylinder"/>',
)


def scene_of(seed: int) -> str:
    writer = Writer(seed)
    parts = []
    for kind in writer.random.sample(KINDS, 9):
        gap = writer.random.choice(["", "\n", "\n    ", "<!-- a remark -->\n"])
        shapes = [writer.shape(kind) for _ in range(writer.random.choice([1, 2, 7, 30]))]
        if writer.random.random() < 0.3:
            shapes.insert(len(shapes) // 2, writer.shape(kind).replace("><", "> <"))
        parts.append(gap.join(shapes))
    version = writer.random.choice(["3.0.0", "0.6.0"])
    inner = '<shape type="shapegroup" id="e">' + writer.shape(KINDS[0]) * 3 + "</shape>"
    inner += 2 * writer.shape(f'<shape type="instance">{PLACE}<ref id="e"/></shape>')
    return HEAD.format(version=version) + INSIDE + "\n".join([*parts, inner]) + "\n</scene>\n"


def plain(value: Any) -> Any:  # noqa: ANN401
    """A part of a description as numbers, strings and lists of these."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(item) for item in value]
    if isinstance(value, _core.Mesh):
        return [value.vertices.tolist(), value.faces.tolist()]
    return value.item() if isinstance(value, np.generic) else value


def whole(description: Description) -> dict[str, Any]:
    return {k: plain(entries(v) if isinstance(v, list) else v) for k, v in description.core.items()}


def both(path: Path) -> tuple[Description, Description]:
    return load_description(path), load_description(path, runs=False)


@pytest.mark.parametrize("seed", range(12))
def test_a_run_is_what_its_members_are(seed: int, tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(scene_of(seed))
    together, one_by_one = both(path)
    assert whole(together) == whole(one_by_one)
    assert sorted(map(str, together.warnings)) == sorted(map(str, one_by_one.warnings))
    assert picture(together) == picture(one_by_one)


def same(path: Path) -> Description:
    """The description of a scene, which is the same bit for bit with runs and without."""
    together, one_by_one = both(path)
    assert repr(whole(together)) == repr(whole(one_by_one))
    assert sorted(map(str, together.warnings)) == sorted(map(str, one_by_one.warnings))
    return together


def write(path: Path, body: str, version: str = "3.0.0") -> Path:
    path.write_text(f"{HEAD.format(version=version)}{body}</scene>")
    return path


@pytest.mark.parametrize("inner", INNER)
def test_runs_keep_what_their_members_contain(inner: str, tmp_path: Path) -> None:
    writer = Writer(1)
    kind = f'<shape type="sphere">{PLACE}{inner}</shape>'
    same(write(tmp_path / "scene.xml", INSIDE + "".join(writer.shape(kind) for _ in range(5))))


@pytest.mark.parametrize("value", ["true", "false"])
def test_runs_of_equal_shapes_may_have_booleans(value: str, tmp_path: Path) -> None:
    shape = f'<shape type="sphere"><boolean name="flip_normals" value="{value}"/></shape>'
    together = same(write(tmp_path / "scene.xml", shape * 2))
    assert len(together.core["shapes"]) == 1


def picture(description: Description) -> bytes:
    render = _core.Render(_core.Scene(description.core), seed=1)
    render.advance(2)
    assert render.image().any()
    return render.image().tobytes()


def test_a_run_far_away_is_what_its_members_are(tmp_path: Path) -> None:
    """Scenes that are far from the origin are moved to it."""
    path, writer = tmp_path / "scene.xml", Writer(1)
    there = (
        HEAD.format(version="3.0.0").replace('"0, 0, 9"', '"1e7, 0, 9"').replace('"0, 0, 0"', '"1e7, 0, 0"')
    )
    spheres = "".join(
        f'<shape type="sphere"><point name="center" x="{1e7 + i % 7 - 3}" y="{i // 7 - 3}" z="0"/>'
        f'<float name="radius" value="{writer.number(0.2, 0.5)}"/><ref id="{"ab"[i % 2]}"/></shape>'
        for i in range(49)
    )
    path.write_text(f"{there}{spheres}</scene>")
    together, one_by_one = both(path)
    assert len(together.core["shapes"]) == 1
    assert picture(together) == picture(one_by_one)


@pytest.mark.parametrize("kind", [0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 17, 18, 19, 24, 25], ids=lambda i: KINDS[i])
def test_shapes_are_put_together(kind: int, tmp_path: Path) -> None:
    """What is usual is stored as a whole, beside the groups of instances."""
    path, writer = tmp_path / "scene.xml", Writer(1)
    shapes = "\n".join(writer.shape(KINDS[kind]) for _ in range(40))
    path.write_text(HEAD.format(version="3.0.0") + shapes + "</scene>")
    core = load_description(path).core
    where = "instances" if "instance" in KINDS[kind] else "shapes"
    assert len(core[where]) == 1
    assert len(entries(core[where])) == 40


def test_stretched_shapes_are_not_put_together(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(HEAD.format(version="3.0.0") + KINDS[12].replace("{n}", "1") * 40 + "</scene>")
    description = load_description(path)
    assert len(description.core["shapes"]) == 40
    assert [warning.count for warning in description.warnings] == [40]


MISTAKES = (
    ('"0.25"', '"abc"', "expected a number"),
    ('"0.25"', '"-1"', "must be at least 0"),
    ('"0.25"', '"1e-60"', "radius above zero"),  # the core refuses it
    ('id="a"', 'id="nowhere"', "no object has the id"),
    ('x="1"', 'x="1e300"', "not finite"),
    ('x="1"', 'x="1 2"', "1 number"),
    ("<translate", "<translte", "is no transformation"),
)


@pytest.mark.parametrize(("right", "wrong", "message"), MISTAKES)
def test_a_mistake_has_the_place_of_its_member(right: str, wrong: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    shape = KINDS[0].replace("{p}", "0.25").replace("{n}", "1").replace("{r}", "a") + "\n"
    mistaken = shape.replace(right, wrong, 1)
    path.write_text(HEAD.format(version="3.0.0") + shape * 50 + mistaken + shape * 50 + "</scene>")
    told = []
    for runs in (True, False):
        with pytest.raises(SceneError, match=message) as refusal:
            description = load_description(path, runs=runs)
            try:
                _core.Scene(description.core)
            except _core.DescriptionError as problem:
                raise description.refusal(problem) from None
        told.append(str(refusal.value))
    assert told[0] == told[1]
    line = path.read_text()[: path.read_text().index(mistaken)].count("\n") + 1
    assert told[0].startswith(f"{path}:{line}:")


def test_shapes_of_many_numbers_are_parsed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The time that a regular expression takes grows faster than its number of groups."""
    operations = '<translate x="1"/>' * 1000
    shape = f'<shape type="sphere"><transform name="to_world">{operations}</transform></shape>'
    source = Source("scene.xml", f"<scene>{shape * 4}</scene>".encode(), Path())
    compiled = []
    monkeypatch.setattr(syntax_runs, "re", SimpleNamespace(escape=re.escape, compile=compiled.append))
    (run,) = parse_xml(source).children
    assert run.run is not None and len(run.run) == 4
    assert compiled == []


MATERIALS = (  # bsdfs of a scene, which a run of shapes refers to
    '<bsdf type="diffuse" id="{id}"><rgb name="reflectance" value="{c}"/></bsdf>',
    '<bsdf type="diffuse" id="{id}"><rgb name="reflectance" value="{x}"/></bsdf>',
    '<bsdf type="diffuse" id="{id}"/>',
    '<bsdf type="roughconductor" id="{id}"><float name="alpha" value="{p}"/></bsdf>',
    '<bsdf type="twosided" id="{id}"><bsdf type="diffuse"><rgb name="reflectance" value="{c}"/></bsdf>'
    "</bsdf>",
    '<bsdf type="twosided" id="{id}"><ref id="{r}"/></bsdf>',
    '<bsdf type="mask" id="{id}"><float name="opacity" value="{d}"/><bsdf type="diffuse"/></bsdf>',
    '<bsdf type="dielectric" id="{id}"><rgb name="specular_reflectance" value="{c}"/></bsdf>',
    '<bsdf type="diffuse" id="{id}"><ref name="reflectance" id="t"/></bsdf>',
    '<bsdf type="diffuse" id="{id}"><texture name="reflectance" type="checkerboard"/></bsdf>',
    '<bsdf type="difuse" id="{id}"><rgb name="reflectance" value="{c}"/></bsdf>',
    '<bsdf type="diffuse" id="{id}"><rgb name="colour" value="{c}"/></bsdf>',
    '<bsdf type="diffuse" id="{id}"><rgb name="reflectance" value="$small"/></bsdf>',
    '<bsdf type="bumpmap" id="{id}"><bsdf type="diffuse"/><texture type="checkerboard"/></bsdf>',
)
USES = (
    '<shape type="sphere"><float name="radius" value="{p}"/><ref id="{q}"/></shape>',
    '<shape type="sphere"><float name="radius" value="{p}"/><bsdf type="twosided"><ref id="{q}"/></bsdf>'
    "</shape>",
    '<shape type="sphere"><float name="radius" value="{p}"/><ref id="{q}"/><ref id="L"/></shape>',
    '<shape type="cylinder"><float name="radius" value="{p}"/><ref id="{q}"/></shape>',
)


def materials_of(kind: str, count: int, writer: Writer) -> str:
    return "\n".join(writer.shape(kind.replace("{id}", f"m{i}")) for i in range(count))


def uses_of(kind: str, names: list[str], writer: Writer) -> str:
    return "".join(writer.shape(kind.replace("{q}", name)) for name in names)


@pytest.mark.parametrize("use", USES)
@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("version", ["3.0.0", "0.6.0"])
def test_bsdfs_of_a_run_are_what_they_are_alone(
    version: str, material: str, use: str, tmp_path: Path
) -> None:
    writer = Writer(1)
    names = [f"m{writer.random.randrange(9)}" for _ in range(20)]
    lone = '<alias id="m3" as="three"/><shape type="cube"><ref id="three"/></shape>'
    lone += '<shape type="disk"><ref id="m2"/></shape>'
    body = INSIDE + materials_of(material, 9, writer) + uses_of(use, names, writer) + lone
    same(write(tmp_path / "scene.xml", body + uses_of(USES[0], ["m1", "a", "m1"], writer), version))


def test_bsdfs_are_put_together(tmp_path: Path) -> None:
    writer = Writer(1)
    body = materials_of(MATERIALS[0], 1000, writer)
    body += uses_of(USES[0], [f"m{(7 * i) % 1000}" for i in range(2000)], writer)
    core = same(write(tmp_path / "scene.xml", body)).core
    assert [len(core[where]) for where in ("bsdfs", "materials", "shapes")] == [1, 1, 1]
    assert len(entries(core["bsdfs"])) == 1000


@pytest.mark.parametrize("use", USES)
def test_groups_may_use_bsdfs_of_a_run(use: str, tmp_path: Path) -> None:
    writer = Writer(1)
    shapes = uses_of(use, [f"m{i % 7}" for i in range(12)], writer)
    group = f'<shape type="shapegroup" id="q">{shapes}</shape>'
    instances = "".join(
        writer.shape(f'<shape type="instance">{PLACE}<ref id="q"/></shape>') for _ in range(3)
    )
    body = INSIDE + materials_of(MATERIALS[0], 9, writer) + group + instances
    assert picture(same(write(tmp_path / "scene.xml", body)))


@pytest.mark.parametrize("two_sided", [False, True])
def test_bsdfs_of_a_run_keep_their_names(two_sided: bool, tmp_path: Path) -> None:
    writer = Writer(1)
    body = materials_of(MATERIALS[2], 5, writer) + uses_of(USES[0], ["m4", "m1", "m1", "m0"], writer)
    path = write(tmp_path / "scene.xml", body)
    found = []
    for runs in (True, False):
        description = load_description(path, runs=runs, two_sided=two_sided)
        known = numbered(description.objects, description.core, "materials")
        found.append((whole(description), known.numbers.tolist(), list(known.names)))
    assert found[0] == found[1]
    assert found[0][2] == ["", "m4", "m1", "m0"]


WRONG_MATERIALS = (
    ('id="m5"', 'id="m7"', "used twice"),
    ('id="m5"', 'id="m0"', "used twice"),
    ('id="m1"', 'id="m0"', "used twice"),
    ('id="m5"', 'id="a"', "used twice"),
    ('<bsdf type="diffuse" id="m5">', '<bsdf type="diffuse">', "no object has the id"),
    ('value="0.5"', 'value="abc"', "expected a number"),
    ('value="0.5"', 'value="1, 2"', "numbers"),
)


@pytest.mark.parametrize(("right", "wrong", "message"), WRONG_MATERIALS)
def test_a_mistake_has_the_place_of_its_bsdf(right: str, wrong: str, message: str, tmp_path: Path) -> None:
    body = materials_of(MATERIALS[0].replace("{c}", "0.5"), 9, Writer(1)).replace(right, wrong, 1)
    path = write(tmp_path / "scene.xml", body + uses_of(USES[0], [f"m{i}" for i in range(9)], Writer(1)))
    told = []
    for runs in (True, False):
        with pytest.raises(SceneError, match=message) as refusal:
            load_description(path, runs=runs)
        told.append(str(refusal.value))
    assert told[0] == told[1]


SELF_CLOSED = (
    ('<shape type="cylinder"/><shape type="cylinder"/>', "</scene>"),
    ('<shape type="sphere"/>' * 3 + '<shape type="cube"/>', "</scene>"),
    ('<shape type="sphere"/>' * 3 + "<!-- > -->" + '<bsdf type="diffuse" id="z"/>', "</scene>"),
    ('<shape type="sphere"></shape>' * 3, "</scene>"),
    ('<shape type="sphere">/></shape>' * 3, "</scene>"),
    ('<shape type="spere"/>' * 3, "<!-- -->\n</scene>"),
    ('<shape type="merge">' + '<shape type="sphere"/>' * 3 + "</shape>", "</scene>\n"),
    ('<shape type="merge">' + '<shape type="obj"/>' * 3 + "</shape>", "</scene>\n"),
)


@pytest.mark.parametrize(("shapes", "rest"), SELF_CLOSED)
def test_runs_end_with_their_last_shape(shapes: str, rest: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(HEAD.format(version="3.0.0") + shapes + rest)
    results = []
    for runs in (True, False):
        try:
            description = load_description(path, runs=runs)
            results.append(repr((whole(description), sorted(map(str, description.warnings)))))
        except SceneError as problem:
            results.append(str(problem))
    assert results[0] == results[1]


def runs_of(element: Element) -> list[str]:
    """The texts of all members of the runs of an element."""
    own = [] if element.run is None else [element.run.span(i) for i in range(len(element.run))]
    texts = [element.source.data[first:stop].decode() for first, stop in own]
    return texts + [text for child in element.children for text in runs_of(child)]


@pytest.mark.parametrize("gap", ["", "\n", "<!-- /> -->"])
@pytest.mark.parametrize(
    "shape",
    [
        '<shape type="a"/>',
        '<shape type="a" />',
        "<shape type='a>'/>",
        '<shape type="a"></shape>',
        '<shape type="a">/></shape>',
        '<shape type="a"><!-- > /></shape> --></shape >',
        '<shape type="a"><float name="radius" value="1"/></shape>',
        '<shape type="a"><shape type="b"/></shape>',
    ],
)
@pytest.mark.parametrize("count", [2, 3, 2000])
def test_members_are_their_text(shape: str, gap: str, count: int) -> None:
    data = f"<scene>{gap.join([shape] * count)}{gap}<end/></scene>".encode()
    texts = runs_of(parse_xml(Source("scene.xml", data, Path())))
    assert texts == [shape + gap] * (count - 1) + [shape]


GROUPED = (  # shapes of a group that become lights
    '<shape type="sphere"><transform name="to_world"><scale value="{p}"/><translate value="{v}"/>'
    '</transform><ref id="L"/></shape>',
    '<shape type="sphere"><point name="center" value="{v}"/><ref id="L"/></shape>',
    '<shape type="sphere"><point name="center" value="{v}"/><ref id="{any}"/></shape>',
    '<shape type="cube">' + PLACE + '<ref id="a"/><ref id="{e}"/></shape>',
    '<shape type="rectangle">' + PLACE + '<ref id="{e}"/></shape>',
)


@pytest.mark.parametrize("kind", GROUPED)
@pytest.mark.parametrize("place", ['<scale x="-1"/>', '<translate y="1"/>'])
def test_lights_of_a_group_may_be_a_run(kind: str, place: str, tmp_path: Path) -> None:
    writer = Writer(1)
    shapes = "".join(writer.shape(kind) for _ in range(3))
    plain_spheres = "".join(writer.shape(KINDS[1]) for _ in range(3))
    instance = f'<shape type="instance"><transform name="to_world">{place}</transform><ref id="q"/></shape>'
    group = f'<shape type="shapegroup" id="q">{shapes}</shape>'
    together = same(write(tmp_path / "scene.xml", INSIDE + plain_spheres + group + instance))
    assert picture(together)


@pytest.mark.parametrize("kind", [0, 1, 2, 3, 17, 19, 24, 25, 26], ids=lambda i: KINDS[i])
def test_scenes_without_a_camera_may_have_runs(kind: int, tmp_path: Path) -> None:
    writer = Writer(1)
    path = write(tmp_path / "scene.xml", "".join(writer.shape(KINDS[kind]) for _ in range(5)), "0.6.0")
    text = path.read_text()
    path.write_text(text[: text.index("<sensor")] + text[text.index("</sensor>") + len("</sensor>") :])
    assert same(path).core["sensor"]["far_clip"] > 0


@pytest.mark.parametrize(
    "texts",
    [
        ("1;2", "3", "4"),
        ("1;2", "3;4", "1;4"),
        ("1;", "2", "3"),
        ("1", "2;", "3"),
        (";", ";1", ";2"),
        ("1;2", "3", ""),
    ],
)
@pytest.mark.parametrize("kind", ['<float name="radius" value="{}"/>', '<point name="center" value="{}"/>'])
def test_semicolons_are_no_separators_in_runs(texts: tuple[str, ...], kind: str, tmp_path: Path) -> None:
    shapes = "".join(f'<shape type="sphere">{kind.format(text)}</shape>' for text in texts)
    messages = []
    for runs in (True, False):
        with pytest.raises(SceneError) as refusal:
            load_description(write(tmp_path / "scene.xml", shapes), runs=runs)
        messages.append(str(refusal.value))
    assert messages[0] == messages[1]


def test_runs_of_instances_have_no_other_zeros(tmp_path: Path) -> None:
    place = '<transform name="to_world"><translate x="{}"/><scale value="-1"/></transform>'
    instances = (f'<shape type="instance">{place.format(x)}<ref id="g"/></shape>' for x in range(3))
    same(write(tmp_path / "scene.xml", "".join(instances)))


def test_broken_text_after_a_run_has_its_place(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    shape = KINDS[2].replace("{v}", "1, 2, 3") + "\n"
    path.write_text(HEAD.format(version="3.0.0") + shape * 1000 + "<shape></scene>")
    with pytest.raises(SceneError, match="mismatched tag") as refusal:
        load_description(path)
    assert f"{path}:{HEAD.count(chr(10)) + 1001}:" in str(refusal.value)


def test_reading_leaves_nothing_to_the_collector(tmp_path: Path) -> None:
    """It pauses meanwhile, so that what is left would add up: each member here is parsed on its own."""
    member = (
        '<shape type="sphere"><float name="radius" value="{}"/><float name="nonsense" value="1"/></shape>'
    )
    body = "".join(member.format(radius) for radius in range(1, 200))
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="3.0.0">{body}<sensor type="perspective"/></scene>')
    load_description(path)
    gc.collect()
    gc.disable()
    try:
        description = load_description(path)
        assert not gc.isenabled()
        assert gc.collect() == 0
    finally:
        gc.enable()
    assert max(warning.count for warning in description.warnings) == 199
    load_description(path)
    assert gc.isenabled()


def test_many_spheres_are_in_the_picture_as_few_are() -> None:
    """Up to eight spheres are tested by us, more by Embree."""
    ball = {"type": "sphere", "radius": 0.5, "bsdf": {"type": "diffuse", "reflectance": 0.7}}
    scene: dict[str, Any] = {
        "type": "scene",
        "light": {"type": "constant"},
        "sensor": {"type": "perspective", "to_world": np.diag([-1.0, 1, -1, 1])},
    }
    scene["sensor"]["to_world"][2, 3] = 6.0
    near = {f"near{i}": {**ball, "center": [i - 1.5, 0.0, 0.0]} for i in range(4)}
    far = {f"far{i}": {**ball, "center": [100.0 + i, 0.0, 500.0]} for i in range(20)}
    for field in ("shape_index", "position", "sh_normal"):
        shown = {**scene, "integrator": {"type": "field", "field": field}}
        few, many = (
            np.asarray(lajolla.load_dict(shown | shapes, spp=2, size=(16, 16)).render(seed=1))
            for shapes in (near, near | far)
        )
        assert few.any()
        np.testing.assert_array_equal(few, many)
