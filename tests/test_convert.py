"""`lajolla convert`: what it writes is a scene of Mitsuba 3 with the same mean."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracle import Setup, default_variant, differences, render_with_lajolla, render_with_mitsuba

from lajolla import _core, cli
from lajolla.scene import export

SHARED = Path(__file__).resolve().parents[2] / "shared" / "scenes"
SETUP = Setup(max_depth=8)

OLD_SCENE = """<scene version="0.6.0">
    <default name="grey" value="0.4"/>
    <sensor type="perspective">
        <string name="focalLength" value="40mm"/>
        <transform name="toWorld"><scale x="-2" y="2" z="2"/>
            <lookat origin="0, 2, 6" target="0, 0.5, 0" up="0, 1, 0"/></transform>
        <film type="ldrfilm"><integer name="width" value="32"/><integer name="height" value="24"/></film>
        <sampler type="halton"><integer name="sampleCount" value="16"/></sampler>
    </sensor>
    <bsdf type="mixturebsdf" id="mixed">
        <string name="weights" value="0.5, 0.3"/>
        <bsdf type="diffuse"><srgb name="reflectance" value="#80c020"/></bsdf>
        <bsdf type="roughconductor"><float name="alpha" value="0.3"/></bsdf>
    </bsdf>
    <shape type="sphere"><point name="center" x="-1.2" y="0.5" z="0"/><ref id="mixed"/></shape>
    <shape type="sphere"><transform name="toWorld"><scale x="0.5" y="1" z="1"/><translate x="1"/></transform>
        <ref id="mixed"/></shape>
    <shape type="obj"><string name="filename" value="floor.obj"/><float name="maxSmoothAngle" value="30"/>
        <bsdf type="twosided"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">
            <string name="filename" value="floor.png"/><float name="gamma" value="1.8"/>
            <string name="channel" value="g"/><string name="filterType" value="nearest"/>
            <float name="uscale" value="2"/><float name="voffset" value="0.3"/></texture></bsdf></bsdf>
        </shape>
    <emitter type="point"><point name="position" x="1" y="4" z="3"/><rgb name="intensity" value="30 25 20"/>
        </emitter>
    <emitter type="constant"><spectrum name="radiance" value="$grey"/></emitter>
</scene>"""


@pytest.fixture
def old_scene(tmp_path: Path) -> Path:
    """A scene full of what Mitsuba 3 does not read."""
    import OpenImageIO as oiio

    pixels = np.random.default_rng(0).integers(20, 255, (4, 4, 3), np.uint8)
    picture = oiio.ImageBuf(pixels)
    assert picture.write(str(tmp_path / "floor.png"))
    corners = "v -3 -1 -3\nv -3 -1 3\nv 3 -1 3\nv 3 -1 -3\nvt 0 0\nvt 0 1\nvt 1 1\nvt 1 0\n"
    (tmp_path / "floor.obj").write_text(corners + "f 1/1 2/2 3/3 4/4\n")
    path = tmp_path / "old.xml"
    path.write_text(OLD_SCENE)
    return path


def check_means(path: Path, target: Path, setup: Setup, spp: int) -> None:
    """lajolla on the scene, the mitsuba package on what `convert` makes of it."""
    assert cli.main(["convert", str(path), str(target)]) == 0
    pytest.importorskip("mitsuba")
    theirs = render_with_mitsuba(target, spp=spp, seed=1000, setup=setup, variant=default_variant())
    found = differences(render_with_lajolla(path, spp=spp, seed=1, setup=setup), theirs)
    assert not found, "\n".join(found)


def test_an_old_scene(old_scene: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    check_means(old_scene, tmp_path / "out" / "new.xml", SETUP, 1024)


@pytest.mark.parametrize(
    ("name", "size"),
    [("lajolla/cbox/cbox.xml", (64, 64)), ("velysian/layered_shoes/layered_shoes.xml", (64, 64))],
)
def test_real_scenes(name: str, size: tuple[int, int], shared_scenes: Path, tmp_path: Path) -> None:
    check_means(shared_scenes / name, tmp_path / "new.xml", Setup(*size), 512)


def test_every_scene_loads(shared_scenes: Path, tmp_path: Path) -> None:
    """The mitsuba package, which refuses properties that it does not know, opens every result."""
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    scenes = [
        p for p in sorted(shared_scenes.rglob("*.xml")) if p.parent.name not in ("include", "fragments")
    ]
    refused = []
    for path in scenes:
        if "_rand_" in path.name:  # differ from the scene beside them in numbers only
            continue
        assert cli.main(["convert", str(path), str(tmp_path / "scene.xml")]) == 0
        try:
            mitsuba.load_file(str(tmp_path / "scene.xml"))
        except RuntimeError as problem:
            refused.append(f"{path}: {problem}")
    assert refused == []


def test_packed_meshes_are_the_same(old_scene: Path, tmp_path: Path) -> None:
    result = export(old_scene, tmp_path / "new.xml", pack=True)
    meshes = {name: content for name, content in result.files.items() if name.endswith(".ply")}
    assert len(meshes) == 2 and "new-files/0.ply" in meshes  # the stretched sphere and the floor
    (tmp_path / "floor.ply").write_bytes(list(meshes.values())[-1])
    read = _core.load_ply(str(tmp_path / "floor.ply"))
    original = _core.load_obj(str(tmp_path / "floor.obj")).flip_uvs()
    assert np.array_equal(read.vertices[read.faces], original.vertices[original.faces])
    assert np.array_equal(read.uvs[read.faces], original.uvs[original.faces])


def test_what_cannot_be_written_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(
        """<scene version="3.0.0"><integrator type="path"/><sensor type="perspective"/>
        <shape type="sphere"><bsdf type="hk"/></shape></scene>"""
    )
    assert cli.main(["convert", str(path), str(tmp_path / "new.xml")]) == 0
    assert 'no bsdf "hk"; "diffuse" is' in capsys.readouterr().err
    assert cli.main(["convert", str(path), str(path)]) == 1
    assert "is the scene itself" in capsys.readouterr().err
    assert cli.main(["convert", str(path), str(tmp_path / "nowhere" / "new.xml")]) == 1
    assert "nowhere" in capsys.readouterr().err
