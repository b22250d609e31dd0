"""Media, phase functions and volumes in scene files of every age."""

from __future__ import annotations

import re
import struct
import tracemalloc
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from reader_tools import error_of, messages, read, write_scene
from scene_tools import torus, translation
from test_voxels import NANOVDB, vol

import lajolla
from lajolla import _core
from lajolla.scene import Description, SceneError, describe, load_description
from lajolla.scene.data.materials import JENSEN, NARASIMHAN
from lajolla.scene.description.inside import is_inside

SHAPE = '<shape type="sphere"><medium name="interior" {}</medium></shape>'


def medium(folder: Path, body: str, version: str = "3.0.0") -> tuple[dict[str, Any], Description]:
    """The first medium of a scene with one sphere, and the whole description."""
    description = read(folder, SHAPE.format(body), version)
    _core.Scene(description.core)  # it is accepted
    assert messages(description, folder) == []
    return description.core["media"][0], description


def homogeneous(folder: Path, body: str, version: str = "3.0.0") -> tuple[np.ndarray, np.ndarray]:
    entry, _ = medium(folder, f'type="homogeneous">{body}', version)
    assert entry["type"] == "homogeneous"
    return np.array(entry["sigma_a"]), np.array(entry["sigma_s"])


@pytest.mark.parametrize(
    "version, body, sigma_a, sigma_s",
    [
        ("3.0.0", "", 0.25, 0.75),
        ("3.0.0", '<float name="sigma_t" value="4"/><float name="scale" value="0.5"/>', 0.5, 1.5),
        (
            "3.0.0",
            '<rgb name="albedo" value="0 0.5 1"/><float name="sigma_t" value="2"/>',
            (2, 1, 0),
            (0, 1, 2),
        ),
        ("3.0.0", '<float name="sigma_a" value="2"/>', 2, 0),
        ("0.6.0", "", np.array(JENSEN["Skin1"][1]) * 100, np.array(JENSEN["Skin1"][0]) * 100),
        ("0.5.0", '<rgb name="sigmaA" value="1 2 3"/><rgb name="sigmaS" value="3"/>', (1, 2, 3), 3),
        ("0.5.0", '<rgb name="sigmaA" value="1"/>', 1, np.array(JENSEN["Skin1"][0]) * 100),
        ("0.6.0", '<rgb name="sigmaT" value="8"/><spectrum name="albedo" value="0.25"/>', 6, 2),
        ("0.4.0", '<float name="densityMultiplier" value="2"/><rgb name="sigmaA" value="1"/>', 2, None),
        ("0.6.0", '<string name="material" value="ketchup"/>', (6.1, 97, 145), (18, 7, 3)),
        (
            "3.0.0",
            '<string name="material" value="Head &amp; Shoulders Shampoo"/>',
            None,
            (26.747, 27.696, 29.574),
        ),
    ],
)
def test_coefficients_in_every_spelling(
    tmp_path: Path, version: str, body: str, sigma_a: object, sigma_s: object
) -> None:
    for found, expected in zip(homogeneous(tmp_path, body, version), (sigma_a, sigma_s), strict=True):
        if expected is not None:
            np.testing.assert_allclose(found, np.broadcast_to(expected, 3), rtol=1e-6)


def test_tables_of_measured_media_are_whole() -> None:
    assert (len(JENSEN), len(NARASIMHAN)) == (12, 35)


@pytest.mark.parametrize(
    "body, message",
    [
        ('<rgb name="sigma_a" value="1"/><rgb name="albedo" value="1"/>', "not both"),
        ('<string name="material" value="Skn1"/>', 'no medium is called "Skn1".*Skin1'),
        ('<float name="sigma_t" value="1"/><phase type="hg"><float name="g" value="x"/></phase>', "number"),
        ('<float name="scale" value="-1"/>', '"scale" must be at least 0'),
        ('<phase type="blendphase"><phase type="isotropic"/></phase>', "needs two phase functions"),
        ('<phase type="tabphase"><string name="values" value="1, x"/></phase>', "expected a number"),
        ('<phase type="tabphase"><string name="values" value="1, -1"/></phase>', "values"),
        ('<phase type="sggx"><string name="S" value="1, 1"/></phase>', "six numbers"),
        ('<phase type="sggx"><string name="S" value="1, 1, 1, 2, 0, 0"/></phase>', "positive definite"),
    ],
)
def test_impossible_media_are_refused(tmp_path: Path, body: str, message: str) -> None:
    text = SHAPE.format(f'type="homogeneous">{body}')
    with pytest.raises(SceneError) as caught:
        description = read(tmp_path, text)
        try:
            _core.Scene(description.core)
        except _core.DescriptionError as problem:
            raise description.refusal(problem) from None
    assert re.search(message, str(caught.value)) and "scene.xml:3" in str(caught.value)


def test_phase_functions(tmp_path: Path) -> None:
    def phases(body: str) -> list[dict[str, Any]]:
        entry, description = medium(tmp_path, f'type="homogeneous">{body}')
        assert entry["phase"] == len(description.core["phases"]) - 1
        return description.core["phases"]

    assert phases('<phase type="hg"/>') == [{"type": "hg"}]
    assert phases('<phase name="any" type="hg"><float name="g" value="-0.3"/></phase>') == [
        {"type": "hg", "g": -0.3}
    ]
    assert phases('<phase type="hg"><rgb name="g" value="0.3 0.6 0.9"/></phase>')[0]["g"] == pytest.approx(
        0.6
    )
    assert phases('<phase type="tabphase"><string name="values" value="1, 2 3"/></phase>') == [
        {"type": "tabphase", "values": (1, 2, 3)}
    ]
    assert phases('<phase type="sggx"><string name="S" value="1 1 1 0 0 0"/></phase>')[0]["S"] == (
        1, 1, 1, 0, 0, 0,
    )  # fmt: skip
    blend = '<phase type="blendphase"><float name="weight" value="0.2"/>{}{}</phase>'
    first, second = '<phase {}type="isotropic"/>', '<phase {}type="rayleigh"/>'
    expected = [
        {"type": "isotropic"},
        {"type": "rayleigh"},
        {"type": "blendphase", "weight": 0.2, "phase_0": 0, "phase_1": 1},
    ]
    assert phases(blend.format(first.format(""), second.format(""))) == expected
    named = second.format('name="phase_1" '), first.format('name="phase_0" ')
    entry = phases(blend.format(*named))[2]
    assert (entry["phase_0"], entry["phase_1"]) == (1, 0)


def test_a_blend_of_blends_of_blends_is_refused(tmp_path: Path) -> None:
    """Before anything looks at each of its parts, of which forty shared blends have 2^40."""
    pair = '<ref id="p{0}"/><ref id="p{0}"/>'
    blends = [f'<phase type="blendphase" id="p{i}">{pair.format(i - 1)}</phase>' for i in range(1, 41)]
    medium = SHAPE.format('type="homogeneous"><ref id="p40"/>')
    body = '<phase type="hg" id="p0"/>\n' + "\n".join([*blends, medium])
    message = error_of(tmp_path, body, "3.0.0")
    assert message.startswith('scene.xml:6:1: error: phase "blendphase" mixes more than four phase functions')


def test_unknown_phase_functions_are_isotropic(tmp_path: Path) -> None:
    body = SHAPE.format('type="homogeneous"><phase type="kkay"/>')
    description = read(tmp_path, body, "0.6.0")
    assert description.core["phases"] == [{"type": "isotropic"}]
    assert len(messages(description, tmp_path)) == 1


GRID = '<volume name="{}" type="gridvolume"><string name="filename" value="{}"/>{}</volume>'
ARRAY = np.linspace(0, 1, 24, dtype=np.float32).reshape(2, 3, 4, 1)
BOX = (-1.0, 0.0, 2.0, 3.0, 0.5, 2.25)


def test_grids_of_both_ages(tmp_path: Path) -> None:
    """Half a voxel apart: samples lie on the box's faces in files before version 2, within it later."""
    (tmp_path / "a.vol").write_bytes(vol(ARRAY, box=BOX))
    body = 'type="heterogeneous">' + GRID.format("density", "a.vol", "")
    entry, description = medium(tmp_path, body, "0.6.0")
    assert entry["sigma_t"] == {"volume": 0}
    old = description.core["volumes"][0]
    assert (old["align_corners"], old["wrap_mode"]) == (True, "zero")
    np.testing.assert_allclose(old["to_world"] @ (1, 1, 1, 1), [*BOX[3:], 1])

    new = medium(tmp_path, body)[1].core["volumes"][0]
    assert "align_corners" not in new and "wrap_mode" not in new
    np.testing.assert_array_equal(new["to_world"], np.eye(4))

    placed = '<boolean name="use_grid_bbox" value="true"/>'
    placed += '<transform name="to_world"><scale value="2"/></transform>'
    body = 'type="heterogeneous">' + GRID.format("sigma_t", "a.vol", placed)
    new = medium(tmp_path, body)[1].core["volumes"][0]
    np.testing.assert_allclose(new["to_world"] @ (0, 0, 0, 1), [-2, 0, 4, 1])

    corners = '<point name="min" x="0" y="0" z="0"/><point name="max" x="1" y="2" z="3"/>'
    body = 'type="heterogeneous">' + GRID.format("density", "a.vol", corners)
    old = medium(tmp_path, body, "0.6.0")[1].core["volumes"][0]
    np.testing.assert_allclose(old["to_world"] @ (1, 1, 1, 1), [1, 2, 3, 1])


def test_constants_are_volumes_too(tmp_path: Path) -> None:
    body = (
        'type="heterogeneous">'
        '<volume name="density" type="constvolume"><float name="value" value="3"/></volume>'
        '<volume name="albedo" type="constvolume"><rgb name="value" value="0.9 0.5 0.1"/></volume>'
        '<float name="scale" value="100"/><string name="method" value="woodcock"/>'
        '<float name="stepSize" value="0.1"/>'
    )
    entry, _ = medium(tmp_path, body, "0.5.0")
    expected = {"type": "heterogeneous", "sigma_t": (3, 3, 3), "albedo": (0.9, 0.5, 0.1), "scale": 100}
    assert entry == expected


def test_a_varying_albedo_makes_a_medium_heterogeneous(tmp_path: Path) -> None:
    (tmp_path / "a.vol").write_bytes(vol(ARRAY))
    body = 'type="homogeneous"><float name="sigma_t" value="2"/>' + GRID.format("albedo", "a.vol", "")
    entry, _ = medium(tmp_path, body)
    assert entry == {"type": "heterogeneous", "sigma_t": (2,) * 3, "albedo": {"volume": 0}, "scale": 1}


def test_a_medium_is_built_once_and_goes_where_it_is_named(tmp_path: Path) -> None:
    body = (
        '<medium type="homogeneous" id="fog"/><medium type="homogeneous" id="milk"/>'
        '<shape type="sphere"><ref name="interior" id="milk"/><ref name="exterior" id="fog"/></shape>'
        '<shape type="cube"><ref name="exterior" id="fog"/></shape><shape type="disk"><ref id="fog"/></shape>'
    )
    description = read(tmp_path, body)
    sides = [(s.get("interior", -1), s.get("exterior", -1)) for s in description.core["shapes"]]
    assert sides == [(0, 1), (-1, 1), (-1, -1)] and len(description.core["media"]) == 2
    (message,) = messages(description, tmp_path)
    assert 'must be named "interior" or "exterior"' in message
    assert _core.Scene(description.core).summary()["media"] == 2


def test_the_camera_has_a_medium() -> None:
    scene = {
        "type": "scene",
        "integrator": {"type": "path"},
        "fog": {"type": "homogeneous", "sigma_t": 2},
        "sensor": {"type": "perspective", "medium": {"type": "ref", "id": "fog"}},
    }
    core = describe(scene).core
    assert core["sensor"]["medium"] == 0 and core["media"][0]["sigma_a"] == (0.5,) * 3
    _core.Scene(core)


def test_volumes_from_python() -> None:
    scene = {
        "type": "scene",
        "integrator": {"type": "path"},
        "sensor": {"type": "perspective"},
        "ball": {
            "type": "sphere",
            "interior": {"type": "heterogeneous", "sigma_t": {"type": "gridvolume", "data": ARRAY}},
        },
    }
    volume = describe(scene).core["volumes"][0]
    assert (volume["grid"].width, volume["grid"].height, volume["grid"].depth) == (4, 3, 2)


def test_nanovdb_density_colour_and_fire(tmp_path: Path) -> None:
    """Grids by name, where the file puts them; temperatures become the colours of black bodies."""
    (tmp_path / "grids.nvdb").write_bytes(NANOVDB.read_bytes())
    grid_name = '<string name="grid_name" value="{}"/>'
    body = (
        'type="heterogeneous">'
        + GRID.format("sigma_t", "grids.nvdb", "")
        + GRID.format("albedo", "grids.nvdb", grid_name.format("color"))
        + '<volume name="emission" type="blackbodyvolume">'
        + '<string name="filename" value="grids.nvdb"/></volume>'
    )
    entry, description = medium(tmp_path, body)
    density, colour, fire = (
        description.core["volumes"][entry[k]["volume"]] for k in ("sigma_t", "albedo", "emission")
    )
    assert (density["grid"].channels, colour["grid"].channels, fire["grid"].channels) == (1, 3, 3)
    np.testing.assert_allclose(fire["to_world"] @ (0, 0, 0, 1), [1 - 0.125, 2 - 0.125, 3 - 0.125, 1])

    at = np.array([[1 + 0.25 * 3, 2 + 0.25 * 2, 3 + 0.25 * 5]], np.float32)  # voxel (3, 2, 5): 1325 K
    emitted = _core.Media({"volumes": [fire]}).volume_many(0, at)[0]
    body = '<emitter type="point"><blackbody name="intensity" temperature="1325k"/></emitter>'
    expected = read(tmp_path, body).core["emitters"][0]["intensity"]
    np.testing.assert_allclose(emitted, expected, rtol=2e-3, atol=1e-6)


@pytest.mark.parametrize(
    "volume, message",
    [
        ('<volume name="sigma_t" type="hgridvolume"/>', 'needs the string "filename"'),
        ('<volume name="sigma_t" type="gridvolume"/>', 'needs the string "filename"'),
        (GRID.format("sigma_t", "scene.xml", ""), "cannot be used as a volume: it is not a .vol file"),
    ],
)
def test_volumes_that_cannot_be_read(tmp_path: Path, volume: str, message: str) -> None:
    assert message in error_of(tmp_path, SHAPE.format('type="heterogeneous">' + volume))


def test_a_medium_without_its_file_is_left_out(tmp_path: Path) -> None:
    body = SHAPE.format('type="heterogeneous">' + GRID.format("sigma_t", "nowhere.vol", ""))
    description = read(tmp_path, body)
    assert description.core["media"] == [] and description.core["shapes"][0]["interior"] == -1
    assert any("nowhere.vol" in line and "is ignored" in line for line in messages(description, tmp_path))


def test_voxels_that_are_not_finite_are_zero(tmp_path: Path) -> None:
    array = ARRAY.copy()
    array[0, 0, 0] = np.nan
    (tmp_path / "a.vol").write_bytes(vol(array))
    description = read(tmp_path, SHAPE.format('type="heterogeneous">' + GRID.format("sigma_t", "a.vol", "")))
    assert len(messages(description, tmp_path)) == 1
    _core.Scene(description.core)


def boxed(folder: Path, extinction: str, version: str = "3.0.0") -> Any:  # noqa: ANN401
    """The place of the volume that a constant extinction becomes; None where it stays a constant."""
    entry, description = medium(folder, f'type="heterogeneous">{extinction}', version)
    if not isinstance(entry.get("sigma_t", {}), dict):
        return None
    return description.core["volumes"][entry["sigma_t"]["volume"]]["to_world"]


def test_a_constant_extinction_ends_at_its_box(tmp_path: Path) -> None:
    """Since version 2: that of a constvolume is placed, others fill the unit cube."""
    volume = '<volume name="sigma_t" type="constvolume"><float name="value" value="2"/>{}</volume>'
    placed = '<transform name="to_world"><scale value="2"/></transform>'
    assert np.allclose(boxed(tmp_path, volume.format(placed)), np.diag([2, 2, 2, 1]))
    for extinction in (volume.format(""), '<float name="sigma_t" value="2"/>', ""):
        assert np.allclose(boxed(tmp_path, extinction), np.eye(4))
    assert boxed(tmp_path, '<float name="density" value="2"/>', "0.6.0") is None


CLOUD = '<medium name="interior" type="homogeneous"/>'
VIEW = '<sensor type="perspective">{}<transform name="to_world"><translate x="3"/></transform></sensor>'


def told(folder: Path, body: str, integrator: str = "volpath", sensor: str = VIEW.format("")) -> list[str]:
    path = folder / "scene.xml"
    light = '<emitter type="constant"/>'
    path.write_text(f'<scene version="3.0.0"><integrator type="{integrator}"/>{sensor}{light}{body}</scene>')
    return [warning.message for warning in load_description(path).warnings]


@pytest.mark.parametrize("integrator", ["path", "direct"])
def test_integrators_that_see_no_media_are_problem_once(integrator: str, tmp_path: Path) -> None:
    ball = f'<shape type="sphere">{CLOUD}</shape>'
    message = f'the integrator "{integrator}" does not see the media of this scene; "volpath" does'
    assert told(tmp_path, ball * 2, integrator) == [message]
    assert told(tmp_path, ball) == told(tmp_path, '<shape type="sphere"/>', integrator) == []


AROUND = '<transform name="to_world"><scale value="2"/><translate x="3.5" y="0.4"/></transform>'
SHAPES = {"cube": AROUND, "sphere": '<point name="center" x="2.5" y="0" z="0"/>'}


@pytest.mark.parametrize("shape", ["cube", "sphere"])
def test_a_camera_in_a_medium_that_it_does_not_name(shape: str, tmp_path: Path) -> None:
    body = f'<shape type="{shape}">{SHAPES[shape]}{CLOUD}</shape>'
    expected = 'the camera is inside the medium of this shape, but sensor "perspective" does not name it'
    assert [line.split(", so")[0] for line in told(tmp_path, body)] == [expected]
    assert told(tmp_path, body, sensor=VIEW.format('<medium type="homogeneous"/>')) == []
    outside = f'<shape type="{shape}">{CLOUD}</shape>'
    assert told(tmp_path, outside) == []


def test_inside_of_a_mesh_is_between_its_faces() -> None:
    mesh = torus(24, 12)
    shape = {"type": "mesh", "mesh": mesh}
    ring = [(np.cos(a), np.sin(a), 0.1) for a in np.linspace(0.1, 6, 7)]
    assert all(is_inside(shape, np.array(p)) for p in ring)
    for outside in ((0, 0, 0), (0.3, 0.2, 0), (1.3, 1.3, 0.1), (1, 0, 0.5), (5, 0, 0)):
        assert not is_inside(shape, np.array(outside, float))
    moved = {**shape, "to_world": translation(5, 0, 0)}
    assert is_inside(moved, np.array([6, 0.01, 0.1])) and not is_inside(moved, np.array([1, 0.01, 0.1]))


def test_inside_of_a_large_mesh_takes_little_memory() -> None:
    small = torus(24, 12)
    faces = np.concatenate([small.faces, np.zeros((1_000_000, 3), small.faces.dtype)])
    shape = {"type": "mesh", "mesh": SimpleNamespace(vertices=small.vertices, faces=faces)}
    tracemalloc.start()
    try:
        assert is_inside(shape, np.array([1, 0.01, 0.1]))
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("shape", SHAPES)
def test_a_flat_shape_with_a_medium_is_refused_at_its_place(shape: str, tmp_path: Path) -> None:
    flat = '<transform name="to_world"><scale x="1" y="1" z="0"/></transform>'
    scene = write_scene(tmp_path, f'<shape type="{shape}">{flat}{CLOUD}</shape>')
    scene.write_text(scene.read_text().replace('"path"', '"volpath"'))
    with pytest.raises(SceneError, match="to_world is singular") as caught:
        lajolla.load(scene)
    assert "scene.xml:3:1: error: " in str(caught.value)


def hierarchical(folder: Path, array: np.ndarray, blocks: list[tuple[int, int, int]]) -> None:
    """Two blocks along each side, which share their borders."""
    steps = (np.array(array.shape[:3]) - 1) // 2
    listed = struct.pack("<6f3i", -1, -1, -1, 1, 1, 1, 2, 2, 2)
    for x, y, z in blocks:
        low = steps * (z, y, x)
        high = low + steps + 1
        part = np.ascontiguousarray(array[low[0] : high[0], low[1] : high[1], low[2] : high[2]])
        (folder / f"b_00{x}_00{y}_00{z}.vol").write_bytes(vol(part))
        listed += struct.pack("<3i", x, y, z)
    (folder / "list.bin").write_bytes(listed)


HIERARCHICAL = """type="heterogeneous"><volume name="density" type="{}"><string name="filename" value="{}"/>
    {}<transform name="toWorld"><scale value="2"/></transform></volume>"""
NAMED = '<string name="prefix" value="b_"/><string name="postfix" value=".vol"/>'


def test_blocks_of_a_hierarchical_grid_become_one(tmp_path: Path) -> None:
    """The same picture as of the whole; where a block is missing, nothing is."""
    array = np.random.default_rng(1).random((5, 3, 7, 1), np.float32)
    everywhere = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    hierarchical(tmp_path, array, everywhere)
    (tmp_path / "whole.vol").write_bytes(vol(array, box=(-1, -1, -1, 1, 1, 1)))
    pictures = []
    view = '<transform name="toWorld"><lookat origin="0, 0, 5" target="0, 0, 0"/></transform>'
    for plugin, file, names in (("hgridvolume", "list.bin", NAMED), ("gridvolume", "whole.vol", "")):
        content = SHAPE.format(HIERARCHICAL.format(plugin, file, names)).replace(
            "<medium", f"{NOTHING}<medium"
        )
        path = tmp_path / f"{plugin}.xml"
        path.write_text(
            f"""<scene version="0.6.0"><integrator type="volpath"/><emitter type="constant"/>{content}
            <sensor type="perspective">{view}<film type="hdrfilm"><integer name="width" value="8"/>
            <integer name="height" value="8"/></film></sensor></scene>"""
        )
        pictures.append(lajolla.load(path).render(spp=4).array)
    np.testing.assert_array_equal(*pictures)
    hierarchical(tmp_path, array, everywhere[1:])
    missing = lajolla.load(tmp_path / "hgridvolume.xml").render(spp=4).array
    assert not np.array_equal(missing, pictures[0])


NOTHING = '<bsdf type="null"/>'


@pytest.mark.parametrize(
    ("listed", "message"),
    [
        (b"", "no list of the blocks"),
        (struct.pack("<6f6i", -1, -1, -1, 1, 1, 1, 1, 1, 1, 1, 0, 0), "a block outside"),
        (struct.pack("<6f6i", -1, -1, -1, 1, 1, 1, 1 << 30, 1, 1, 0, 0, 0), "too many"),
        (struct.pack("<6f6i", 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0), "is empty"),
    ],
)
def test_broken_hierarchical_grids(listed: bytes, message: str, tmp_path: Path) -> None:
    hierarchical(tmp_path, np.ones((3, 3, 3, 1), np.float32), [(0, 0, 0)])
    (tmp_path / "list.bin").write_bytes(listed)
    body = SHAPE.format(HIERARCHICAL.format("hgridvolume", "list.bin", NAMED))
    assert message in error_of(tmp_path, body, "0.6.0")
