"""The viewer and the files of a scene: saving, watching all of them, and several sensors."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from viewer_tools import SCENE, SENSORS, Client, finished, moved, viewer

import lajolla

pytestmark = pytest.mark.filterwarnings("ignore::lajolla.SceneWarning")
PARTS = SCENE.replace(
    '<rgb name="reflectance" value="0.6, 0.05, 0.05"/>',
    '<texture type="bitmap" name="reflectance"><string name="filename" value="skin.exr"/></texture>',
)
PARTS = PARTS.replace(
    '<shape type="sphere" id="ball"><ref id="red"/></shape>', '<include filename="ball.xml"/>'
)
BALL = """<scene version="3.0.0">
    <shape type="ply" id="ball"><string name="filename" value="ball.ply"/><ref id="red"/></shape>
</scene>
"""
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n{0} -1 0\n1 -1 0\n0 1 0\n3 0 1 2\n"
)


def skin(path: Path, green: float) -> None:
    lajolla.Image(np.full((2, 2, 3), (0.1, green, 0.1), np.float32)).save(path)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.xml"
    path.write_text(SCENE)
    return path


@pytest.fixture
def client(scene: Path) -> Iterator[Client]:
    with viewer(scene) as address, Client(address) as client:
        yield client


def as_shown(image: lajolla.Image) -> np.ndarray:
    return image.array.astype(np.float16).astype(np.float32)


# --- saving -------------------------------------------------------------------------------------------------


def test_the_edited_scene_is_saved_beside_its_file(client: Client, scene: Path) -> None:
    finished(client, 0)
    client.send("edit", values={**moved(0.4), "red.reflectance": [0.1, 0.2, 0.3]})
    shown = finished(client, 1)
    client.send("save", name="edited.xml")
    assert client.wait_for("noticed")["message"] == f"wrote {scene.with_name('edited.xml')}"
    np.testing.assert_array_equal(as_shown(lajolla.load(scene.with_name("edited.xml")).render(spp=32)), shown)
    assert scene.read_text() == SCENE


def test_no_file_is_replaced_and_none_is_written_elsewhere(client: Client, scene: Path) -> None:
    scene.with_name("link.xml").symlink_to(scene.with_name("out.xml"))
    before = sorted(scene.parent.rglob("*")), scene.read_text()
    for name in (
        "scene.xml",
        "link.xml",
        "../out.xml",
        "/tmp/out.xml",
        "out",
        ".xml",
        "a\\b.xml",
        "",
        "a\nb.xml",
    ):
        client.send("save", name=name)
        message = client.wait_for("refused")["message"]
        exists = name in ("scene.xml", "link.xml")
        assert ("exists" if exists else "is no name of a file beside the scene") in message
    assert (sorted(scene.parent.rglob("*")), scene.read_text()) == before
    assert not scene.parent.with_name("out.xml").exists()


# --- files --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("part", ["ball.xml", "skin.exr", "ball.ply"])
def test_every_file_of_a_scene_is_watched(scene: Path, part: str) -> None:
    """A texture or a mesh that changes keeps all edits of the page, a scene file those of the camera."""
    scene.write_text(PARTS)
    scene.with_name("ball.xml").write_text(BALL)
    scene.with_name("ball.ply").write_text(PLY.format(-1))
    skin(scene.with_name("skin.exr"), 0.5)
    with viewer(scene) as address, Client(address) as client:
        finished(client, 0)
        client.send("edit", values={**moved(0.25), "sky.radiance": [0.5, 0.5, 0.5]})
        before = finished(client, 1)
        if part == "ball.xml":
            scene.with_name(part).write_text(
                BALL.replace("<ref", '<boolean name="flip_normals" value="true"/><ref')
            )
        elif part == "ball.ply":
            scene.with_name(part).write_text(PLY.format(-0.25))
        else:
            skin(scene.with_name(part), 0.9)
        assert client.wait_for("viewed", view=2)["sensor"]["to_world"][0][3] == 0.25
        after = finished(client, 2)
        bright = 0.5 if part != "ball.xml" else 1.0
        assert after[0, 0, 0] == pytest.approx(bright, rel=1e-3)
        assert np.abs(after - before).mean() > 1e-3


def test_a_texture_that_was_missing(scene: Path) -> None:
    scene.write_text(
        PARTS.replace('<include filename="ball.xml"/>', '<shape type="sphere"><ref id="red"/></shape>')
    )
    with viewer(scene) as address, Client(address) as client:
        finished(client, 0)
        skin(scene.with_name("skin.exr"), 0.9)
        client.wait_for("viewed", view=1)
        red, green, _ = finished(client, 1)[32, 48]
        assert green > 4 * red


def test_the_files_that_a_scene_was_read_from(tmp_path: Path) -> None:
    scenes = Path(__file__).resolve().parent.parent / "scenes"
    shutil.copytree(scenes, tmp_path / "scenes")
    paths = lajolla.load(tmp_path / "scenes" / "smoke.xml", size=(4, 4)).paths
    assert all(path.is_file() for path in paths)
    assert {"smoke.xml", "smoke.vol"} <= {path.name for path in paths}


# --- sensors ------------------------------------------------------------------------------------------------


def test_sensors(scene: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """What was changed of a sensor stays with it; other changes are everywhere."""
    scene.write_text(SENSORS)
    with viewer(scene) as address, Client(address) as client:
        first = finished(client, 0)
        assert client.messages["opened"]["sensors"] == ["front", "side"]
        assert client.messages["viewed"]["camera"] == "front"
        client.send("edit", values={"sensor.fov": 30.0})
        finished(client, 1)
        client.send("look", sensor="side")
        found = client.wait_for("viewed", view=2)
        assert found["camera"] == "side" and found["sensor"]["fov"] == 60
        client.send("edit", values={"red.reflectance": [0.05, 0.05, 0.6]})
        shown = finished(client, 3)
        expected = lajolla.load(scene, sensor="side")
        expected["red.reflectance"] = (0.05, 0.05, 0.6)
        np.testing.assert_array_equal(shown, as_shown(expected.render(spp=32)))
        client.send("inspect", x=48, y=32)
        command = shlex.split(client.wait_for("inspected")["command"])[2]
        assert "sensor='side'" in command and "fov" not in command
        exec(command, {})
        numbers = [float(x) for x in capfd.readouterr().out.split()]
        np.testing.assert_allclose(numbers, client.messages["inspected"]["value"], rtol=1e-4)
        client.send("choose", integrator="direct")
        client.wait_for("viewed", view=4, camera="side", integrator="direct")
        client.send("look", sensor="front")
        assert client.wait_for("viewed", view=5)["sensor"]["fov"] == 30
        client.send("look", sensor="back")
        assert "unknown sensor 'back'" in client.wait_for("refused")["message"]
    assert np.abs(first - shown).mean() > 0.01


def test_a_file_that_changes_keeps_the_sensor(scene: Path) -> None:
    scene.write_text(SENSORS)
    with viewer(scene) as address, Client(address) as client:
        finished(client, 0)
        client.send("look", sensor="side")
        client.wait_for("viewed", view=1)
        client.send("edit", values={"sensor.fov": 50.0})
        client.wait_for("viewed", view=2)
        scene.write_text(SENSORS.replace("0.6, 0.05, 0.05", "0.05, 0.6, 0.05"))
        found = client.wait_for("viewed", view=3)
        assert found["camera"] == "side" and found["sensor"]["fov"] == 50
