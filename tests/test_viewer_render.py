"""`lajolla render --view`: a page that shows a render of the command line, and changes nothing of it."""

from __future__ import annotations

import socket
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from viewer_tools import SCENE, SIZE, Client, render
from websockets.exceptions import ConnectionClosed

import lajolla
from lajolla.cli import main


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.xml"
    path.write_text(SCENE)
    return path


def test_a_render_with_a_page_has_the_same_bits(scene: Path) -> None:
    for name, options in (("plain", []), ("shown", ["--view", "--no-browser"])):
        words = ["--spp", "8", "--aov", "albedo", "-o", str(scene.with_name(f"{name}.exr")), *SIZE, *options]
        assert main(["render", str(scene), *words]) == 0
    plain, shown = (lajolla.Image.open(scene.with_name(f"{name}.exr")) for name in ("plain", "shown"))
    np.testing.assert_array_equal(plain.array, shown.array)
    np.testing.assert_array_equal(plain.channels["albedo.R"], shown.channels["albedo.R"])


def test_pages_look_and_change_nothing(scene: Path) -> None:
    with render(scene, 1 << 16, "--aov", "albedo") as (address, process), Client(address) as client:
        assert client.wait_for("hello")["fixed"]
        client.wait_for_picture(0, whole=True)
        assert set(client.messages["opened"]["layers"]) == {"albedo", "samples"}
        for message in ({"type": "edit", "values": {"sensor.fov": 5.0}}, {"type": "show", "layer": "depth"}):
            client.send(**message)  # type: ignore[arg-type]
            assert "which stays as it is" in client.wait_for("refused")["message"]
        client.send("show", layer="albedo")
        while client.picture is None or client.picture.limits != (0, 1):
            client.receive()
        client.send("show", layer="")
        client.send("inspect", x=96, y=64)
        assert client.wait_for("inspected")["shape"] == "ball"
        process.terminate()  # ends as Ctrl-C does: the picture so far is written
        out = scene.with_name("out.exr")
        assert client.wait_for("ended")["message"] == f"The render has ended; wrote {out}."
        with suppress(ConnectionClosed):
            while True:
                client.receive()
        assert process.wait(timeout=20) == 143
    written = lajolla.Image.open(out).array
    np.testing.assert_array_equal(client.picture.pixels, written.astype(np.float16))


def test_the_page_names_the_picture_if_something_else_fails(scene: Path) -> None:
    with render(scene, 1 << 16, "--stats", "/dev/full") as (address, process), Client(address) as client:
        client.wait_for_picture(0, whole=True)
        process.terminate()
        out = scene.with_name("out.exr")
        assert client.wait_for("ended")["message"] == f"The render has ended; wrote {out}."
        client.socket.close()
        assert process.wait(timeout=20) == 1 and out.exists()


def test_options_that_do_not_fit(scene: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for options, reason in (
        (["--view", "--pixel", "1,1"], "--view cannot be combined with --pixel"),
        (["--view", "--frames", "1-2"], "--view shows one render"),
        (["--no-browser"], "--port and --no-browser need --view"),
    ):
        assert main(["render", str(scene), *options]) == 1
        assert reason in capfd.readouterr().err
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = str(other.getsockname()[1])
        assert main(["render", str(scene), "--view", "--no-browser", "--port", port]) == 1
    assert f"error: port {port} is taken" in capfd.readouterr().err
    assert not list(scene.parent.glob("*.exr"))
