"""Small files that ask for much get an answer soon, and files that are no scenes are not shown to anybody."""

from __future__ import annotations

import os
import re
import struct
import time
import zlib
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hostile_cases import answer
from reader_tools import error, error_of, read, write_scene

import lajolla
from lajolla import picture_files
from lajolla.picture_files import Budget
from lajolla.scene import SceneError, load_description
from lajolla.scene.description.plugins import daylight
from lajolla.scene.syntax.files import file_bytes

SECONDS, MEMORY = 1.0, 200 * 10**6


def test_hostile_files(shared_cases: Path) -> None:
    """Every scene of the folder; there is a picture or one message."""
    scenes = sorted(p for p in (shared_cases / "hostile").rglob("*.xml") if p.name not in INNER)
    assert scenes
    for scene in scenes:
        result = answer(scene)
        assert result.seconds < SECONDS, scene
        assert result.memory < MEMORY, scene
        assert "Error:" not in result.error, scene  # the name of an exception is no reason


INNER = {f"i{i}.xml" for i in range(1, 16)}  # they are included by i0.xml


def doubled(tag: str, plugin: str, levels: int, inside: str) -> str:
    """Objects that each hold the one before twice, as `x0`, `x1`, ...; `inside` makes references."""
    made = [f'<{tag} type="{plugin}" id="x{i + 1}">{inside.format(i)}</{tag}>' for i in range(levels)]
    return "".join(made)


TWICE = '<ref name="a" id="x{0}"/><ref name="b" id="x{0}"/>'
INSTANCES = '<shape type="instance"><ref id="x{0}"/></shape>' * 2
SCALED = '<ref name="scale" id="x{0}"/><ref name="texture" id="x{0}"/>'
SHOWS_TEXTURE = '<shape type="sphere"><bsdf type="diffuse"><ref name="reflectance" id="x30"/></bsdf></shape>'

GROWING: dict[str, Callable[[], str]] = {
    "groups": lambda: (
        '<shape type="shapegroup" id="x0"><shape type="sphere"/></shape>'
        + doubled("shape", "shapegroup", 30, INSTANCES)
        + '<shape type="instance"><ref id="x30"/></shape>'
    ),
    "lights in groups": lambda: (
        '<shape type="shapegroup" id="x0"><shape type="sphere"><emitter type="area"/></shape></shape>'
        + doubled("shape", "shapegroup", 30, INSTANCES)
        + '<shape type="instance"><ref id="x30"/></shape>'
    ),
    "merged shapes": lambda: '<shape type="sphere" id="x0"/>' + doubled("shape", "merge", 30, TWICE),
    "textures": lambda: (
        '<texture type="checkerboard" id="x0"/>' + doubled("texture", "scale", 30, SCALED) + SHOWS_TEXTURE
    ),
    "parameters": lambda: (
        f'<default name="a" value="{"x" * 500_000}"/><string name="foo" value="{"$a " * 100_000}"/>'
    ),
    "aliases": lambda: (
        '<bsdf type="diffuse" id="x0"/>' + "".join(f'<alias id="x{i}" as="x{i + 1}"/>' for i in range(2000))
    ),
}


@pytest.mark.parametrize("name", GROWING)
def test_what_grows_beyond_all_bounds_is_refused(name: str, tmp_path: Path) -> None:
    result = answer(write_scene(tmp_path, GROWING[name]()))
    assert re.search("more than|longer than|the limit is", result.error)
    assert result.seconds < SECONDS
    assert result.memory < MEMORY


def test_integrators_that_double_their_channels(tmp_path: Path) -> None:
    inside = '<integrator type="path"/>'
    for _ in range(10):
        inside = f'<integrator type="moment">{inside}{inside}</integrator>'
    scene = tmp_path / "scene.xml"
    scene.write_text(f'<scene version="3.0.0"><sensor type="perspective"/>{inside}</scene>')
    assert "more than 1024 channels" in error(scene)


def test_files_that_include_each_other_twice(tmp_path: Path) -> None:
    for i in range(12):
        inside = f'<include filename="part{i + 1}.xml"/>' * 4 if i < 11 else '<shape type="sphere"/>'
        (tmp_path / f"part{i}.xml").write_text(f'<scene version="3.0.0">{inside}</scene>')
    assert "more than 1024 files" in error_of(tmp_path, '<include filename="part0.xml"/>')
    (tmp_path / "large.xml").write_text(f'<scene version="3.0.0">{" " * 1_000_000}</scene>')
    assert "included again have 21,000," in error_of(tmp_path, '<include filename="large.xml"/>' * 30)


def test_a_large_file_may_be_included_several_times(tmp_path: Path) -> None:
    tree = f'<scene version="3.0.0"><shape type="sphere"/>{" " * 1_000_000}</scene>'
    (tmp_path / "tree.xml").write_text(tree)
    assert len(read(tmp_path, '<include filename="tree.xml"/>' * 6).core["shapes"]) == 6


MANY = 20_000
REPEATED: dict[str, tuple[str, int]] = {  # and the number of warnings
    "alike": ('<shape type="sphere"><float name="girth" value="1"/></shape>' * 5000, 2),
    "different": (
        '<shape type="sphere">'
        + "".join(f'<float name="p{i}" value="1"/>' for i in range(5000))
        + "</shape>",
        1001,
    ),
    "parameters": (
        "".join(f'<default name="p{i}" value="{i + 1}"/>' for i in range(MANY))
        + "".join(f'<bsdf type="diffuse" id="$p{i}"/>' for i in range(2000)),
        1,
    ),
    "unknown parameters": (
        "".join(f'<default name="p{i}" value="{i}"/>' for i in range(MANY // 2))
        + "".join(f'<bsdf type="diffuse" id="$q{i}"/>' for i in range(5000)),
        1001,
    ),
}


@pytest.mark.parametrize("name", REPEATED)
def test_work_grows_with_the_file_and_no_faster(name: str, tmp_path: Path) -> None:
    body, warnings = REPEATED[name]
    result = answer(write_scene(tmp_path, body))
    assert (result.error, result.warnings) == ("", warnings)
    assert result.seconds < 4 * SECONDS  # a file of half a megabyte
    assert result.memory < MEMORY


@pytest.mark.parametrize("version", ["0.6.0", "3.0.0"])
def test_a_large_group_is_not_searched_for_every_instance(version: str, tmp_path: Path) -> None:
    inside = '<shape type="sphere"/>' * 1000
    body = f'<emitter type="area"/><shape type="shapegroup" id="group">{inside}</shape>'
    body += '<shape type="instance"><ref id="group"/></shape>' * MANY
    scene = write_scene(tmp_path, body, version)
    scene.write_text(scene.read_text().replace('<sensor type="perspective"/>', ""))
    start = time.process_time()
    with nullcontext() if version == "0.6.0" else pytest.raises(SceneError, match="has no sensor"):
        load_description(scene)
    assert time.process_time() - start < 4 * SECONDS  # a file of a megabyte


NAME = '<string name="filename" value="{0}"/>'
READERS = {
    **{
        shape: f'<shape type="{shape}">{NAME}</shape>'
        for shape in ("ply", "obj", "serialized", "linearcurve", "hair", "heightfield", "sdfgrid")
    },
    "envmap": f'<emitter type="envmap">{NAME}</emitter>',
    "spectrum": '<emitter type="constant"><spectrum name="radiance" filename="{0}"/></emitter>',
    "measured": f'<shape type="sphere"><bsdf type="measured">{NAME}</bsdf></shape>',
    "include": '<include filename="{0}"/>',
    "volume": '<shape type="sphere"><medium name="interior" type="heterogeneous">'
    f'<volume name="sigma_t" type="gridvolume">{NAME}</volume></medium></shape>',
}


@pytest.mark.parametrize("reader", READERS)
def test_files_without_an_end(reader: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name in ("zero.nvdb", "zero.png"):
        (tmp_path / name).symlink_to("/dev/zero")
    for name in ("/dev/zero", "pipe", "zero.nvdb", "zero.png"):
        assert error_of(tmp_path, READERS[reader].format(name))


SECRET = (
    "root:$6$saltsalt$hashhash:19000:0:99999:7:::\n-----BEGIN OPENSSH PRIVATE KEY-----\nb3BlbnNzaC1rZXk\n"
)


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("inside", [True, False], ids=["inside", "outside"])
def test_no_message_shows_what_is_in_a_file(reader: str, inside: bool, tmp_path: Path) -> None:
    folder = tmp_path / "scenes"
    folder.mkdir()
    (folder / "secret" if inside else tmp_path / "secret").write_text(SECRET)
    told = error_of(folder, READERS[reader].format("secret" if inside else "../secret"))
    assert not [word for word in ("root", "salt", "BEGIN", "b3Blb", "19000") if word in told]


def test_scenes_of_other_folders_are_read_but_not_shown(tmp_path: Path) -> None:
    folder = tmp_path / "scenes"
    folder.mkdir()
    (tmp_path / "other.xml").write_text(
        '<scene version="3.0.0">\n<shape type="sphere"><float name="radius" value="-1"/></shape></scene>'
    )
    told = error_of(folder, '<include filename="../other.xml"/>')
    assert "other.xml:2:50: error: " in told
    assert "<float" not in told
    (folder / "other.xml").write_bytes((tmp_path / "other.xml").read_bytes())
    assert "<float" in error_of(folder, '<include filename="other.xml"/>')


def test_lines_of_scenes_are_shown_through_links(tmp_path: Path) -> None:
    """Also of includes in a folder that the scene names with `<path>`; never of what is no scene."""
    for folder in ("kept", "linked", "shared"):
        (tmp_path / folder).mkdir()
    wrong = '<scene version="3.0.0"><shape type="sphere"><float name="radius" value="-1"/></shape></scene>'
    (tmp_path / "kept" / "scene.xml").write_text(wrong)
    (tmp_path / "shared" / "part.xml").write_text(wrong)
    (tmp_path / "shared" / "keys").write_text(SECRET)
    (tmp_path / "linked" / "scene.xml").symlink_to(tmp_path / "kept" / "scene.xml")
    assert "<float" in error(tmp_path / "linked" / "scene.xml")
    (tmp_path / "linked" / "part.xml").symlink_to(tmp_path / "shared" / "part.xml")
    (tmp_path / "linked" / "keys").symlink_to(tmp_path / "shared" / "keys")
    for place in ("", '<path value="../shared"/>'):
        assert "<float" in error_of(tmp_path / "linked", f'{place}<include filename="part.xml"/>')
        told = error_of(tmp_path / "linked", f'{place}<include filename="keys"/>')
        assert not [word for word in ("root", "salt", "BEGIN", "b3Blb", "19000") if word in told]
    (tmp_path / "linked" / "part.xml").unlink()
    assert "<float" in error_of(
        tmp_path / "linked", '<path value="../shared"/><include filename="part.xml"/>'
    )


def png(size: int, rows: int) -> bytes:
    """A square picture of black pixels, cut short after some rows."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", size, size, 8, 2, 0, 0, 0)
    data = zlib.compress(bytes(rows * (3 * size + 1)), 9)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


BITMAP = f'<texture type="bitmap" name="reflectance">{NAME}</texture>'
SHOWN = f'<shape type="sphere"><bsdf type="diffuse">{BITMAP}</bsdf></shape>'


@pytest.mark.parametrize("reader", [SHOWN, READERS["envmap"], READERS["heightfield"]])
def test_a_small_picture_does_not_ask_for_all_memory(reader: str, tmp_path: Path) -> None:
    """It may take 1 GiB, as large pictures of one colour do; it is refused before that is taken."""
    (tmp_path / "a.png").write_bytes(png(20_000, 10) + bytes(400_000))  # OpenImageIO refuses smaller ones
    result = answer(write_scene(tmp_path, reader.format("a.png")))
    assert "20000 x 20000 pixels are too many for a file of" in result.error
    assert result.seconds < SECONDS
    assert result.memory < MEMORY


def test_large_pictures_of_one_colour_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(png(8192, 8192))
    assert len(read(tmp_path, SHOWN.format("a.png")).core["textures"]) == 1
    budget = Budget()
    for _ in range(64):
        budget.spend(3 * 4096**2, (tmp_path / "a.png").stat().st_size)


def test_large_arrays_are_looked_at_by_their_shape(monkeypatch: pytest.MonkeyPatch) -> None:
    large = np.zeros((100, 100, 100), np.uint8)
    monkeypatch.setattr(np, "asarray", lambda *arguments, **settings: pytest.fail("it was converted"))
    scene = {"type": "scene", "ball": {"type": "sphere", "girth": large, "to_world": large}}
    with pytest.raises(SceneError, match="expects a transform"):
        lajolla.load_dict(scene)


def test_dicts_that_hold_the_same_dict_twice() -> None:
    shape: dict[str, Any] = {"type": "sphere"}
    for _ in range(40):
        shape = {"type": "merge", "a": shape, "b": shape}
    with pytest.raises(SceneError, match="more than 16,384 objects"):
        lajolla.load_dict({"type": "scene", "shapes": shape})


def test_secrets_in_the_scene_itself(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text(SECRET)
    assert "root" not in error(tmp_path / "scene.xml")
    for other in ("<config><password>salt</password></config>", "<config><password>salt</password>"):
        (tmp_path / "scene.xml").write_text(other)
        told = error(tmp_path / "scene.xml")
        (tmp_path / "other.xml").write_text(other)
        told += error_of(tmp_path, '<include filename="other.xml"/>')
        assert "salt" not in told
    with pytest.raises(SceneError, match="not valid XML") as caught:
        load_description(write_scene(tmp_path, "<shape"))
    assert "</scene>" in str(caught.value)  # it is a scene as far as it goes
    assert read(tmp_path, "").warnings


LONG = 300_000
SLOW_TEXTS = {
    "digits": f'<float name="radius" value="{"1" * LONG}x"/>',
    "temperature": f'<blackbody name="a" temperature="{" " * LONG}x"/>',
    "spectrum": f'<spectrum name="a" value="400:1{" " * LONG}500"/>',
    "name": f'<float name="{"x" * LONG}" value="1"/>',
    "attribute": f'<float {"x" * LONG}="1" name="a" value="1"/>',
    "element": f"<{'x' * LONG}/>",
    "spaces": f'<float name="a" {" " * LONG} value="b"/>',
}


@pytest.mark.parametrize("name", SLOW_TEXTS)
def test_long_texts_are_read_in_one_go(name: str, tmp_path: Path) -> None:
    result = answer(write_scene(tmp_path, f'<shape type="sphere">{SLOW_TEXTS[name]}</shape>'))
    assert result.error or result.warnings
    assert result.seconds < SECONDS


@pytest.mark.parametrize(
    "value", [np.zeros((1000, 1000, 3), np.uint8), np.zeros((1000, 3)), np.zeros((10**6, 2)), object()]
)
def test_spectra_that_are_none(value: object) -> None:
    spectrum = {"type": "spectrum", "value": value}
    with pytest.raises(SceneError, match=r'needs a "value"|cannot be part of a scene'):
        lajolla.load_dict({"type": "scene", "light": {"type": "constant", "radiance": spectrum}})


def test_a_scene_whose_type_is_no_text() -> None:
    with pytest.raises(SceneError, match="the dict must have"):
        lajolla.load_dict({"type": np.zeros(3)})


@pytest.mark.parametrize("reader", [SHOWN, READERS["envmap"], READERS["heightfield"]])
def test_many_small_pictures_do_not_ask_for_all_memory(
    reader: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(picture_files, "MAX_PICTURES", 1 << 20)
    for i in range(3):
        (tmp_path / f"{i}.png").write_bytes(png(800, 800))
    told = error_of(tmp_path, "".join(reader.format(f"{i}.png") for i in range(3)))
    assert re.search(r"the textures would take \d+ MiB decoded; the limit is \d+ MiB", told)


def test_skies_are_as_large_as_one_of_the_largest_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sky = '<emitter type="sky"><integer name="resolution" value="{0}"/></emitter>'
    assert "between 4 and 8192" in error_of(tmp_path, sky.format(8193))
    monkeypatch.setattr(daylight, "WIDEST", 64)
    assert read(tmp_path, sky.format(64)).core["emitters"]
    assert "more than 2,112 pixels" in error_of(tmp_path, sky.format(32) * 8)


def test_one_file_with_many_settings(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(png(2, 2))
    gammas = [NAME.format("a.png") + f'<float name="gamma" value="{1 + i / 8}"/>' for i in range(1, 40)]
    shapes = [SHOWN.replace(NAME, name) for name in gammas]
    assert "is used with more than 32 different settings" in error_of(tmp_path, "".join(shapes))


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="there is no such file")
def test_a_file_that_changes_while_it_is_read() -> None:
    with pytest.raises(OSError, match="changed while it was read"):
        file_bytes(Path("/proc/self/status"))
