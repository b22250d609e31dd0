"""Starts `lajolla view` for tests, and talks to it as a page does."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from websockets.sync.client import connect
from websockets.typing import Origin

from lajolla.viewer.protocol import HEADER, Picture, readable

SCENE = """<scene version="3.0.0">
    <integrator type="path"><integer name="max_depth" value="4"/></integrator>
    <sensor type="perspective">
        <float name="fov" value="40"/>
        <transform name="to_world"><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="96"/><integer name="height" value="64"/></film>
        <sampler type="independent"><integer name="sample_count" value="32"/></sampler>
    </sensor>
    <bsdf type="diffuse" id="red"><rgb name="reflectance" value="0.6, 0.05, 0.05"/></bsdf>
    <shape type="sphere" id="ball"><ref id="red"/></shape>
    <emitter type="constant" id="sky"/>
</scene>
"""
FRONT = SCENE[SCENE.index("    <sensor") : SCENE.index("    <bsdf")].replace(">", ' id="front">', 1)
SIDE = FRONT.replace("front", "side").replace("0, 0, 4", "4, 0, 0").replace('"40"', '"60"')
SENSORS = SCENE.replace("    <bsdf", f"{FRONT}{SIDE}    <bsdf", 1).replace(
    FRONT.replace(' id="front"', ""), "", 1
)


@contextmanager
def viewer(scene: Path, *options: str) -> Iterator[str]:
    """The address of a running viewer, which is ended afterwards."""
    command = [sys.executable, "-m", "lajolla", "view", str(scene), "--no-browser", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.terminate()  # Ctrl-C is ignored by tests that run in the background of a shell
            process.communicate(timeout=20)
    assert process.returncode == 128 + signal.SIGTERM


SIZE = ("--size", "192x128", "--seed", "3")


@contextmanager
def render(scene: Path, spp: int, *options: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The address of the page of a render, and its process, which is ended afterwards."""
    words = ["render", str(scene), "--spp", str(spp), "-o", str(scene.with_name("out.exr")), *SIZE]
    command = [sys.executable, "-m", "lajolla", *words, "--view", "--no-browser", "--quiet", *options]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        try:
            yield process.stderr.readline().strip().removeprefix("lajolla: the page is "), process
        finally:
            process.kill()


def origin_of(address: str) -> str:
    return "{0.scheme}://{0.netloc}".format(urlsplit(address))


class Client:
    """A page without a picture on a screen."""

    def __init__(self, address: str) -> None:
        url = address.replace("http:", "ws:") + "socket"
        origin = Origin(origin_of(address))
        self._connection = connect(url, origin=origin, compression=None, max_size=None)
        self.socket = self._connection.__enter__()
        self.picture: Picture | None = None
        self.pictures = 0
        self.messages: dict[str, dict[str, Any]] = {}  # the last of each type
        self._bands: list[bytes] = []

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *problem: object) -> None:
        self._connection.__exit__(None, None, None)

    def send(self, type: str, **fields: object) -> None:
        self.socket.send(json.dumps({"type": type, **fields}))

    def receive(self, timeout: float = 20) -> str:
        """Takes one message, or one picture; returns its type."""
        data = self.socket.recv(timeout=timeout)
        if isinstance(data, str):
            message = json.loads(data)
            self.messages[message["type"]] = message
            return message["type"]
        self._bands.append(data)
        _, _, _, _, _, _, _, height, first, rows, *_ = HEADER.unpack_from(data)
        if first + rows < height:
            return self.receive(timeout)
        self.picture, self._bands = readable(self._bands), []
        self.pictures += 1
        self.send("received", picture=self.picture.number)
        return "picture"

    def wait_for(self, type: str, seconds: float = 20, **fields: object) -> dict[str, Any]:
        """The next message of a type that has these fields."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if self.receive(max(end - time.monotonic(), 0.01)) == type:
                message = self.messages[type]
                if all(message[name] == value for name, value in fields.items()):
                    return message
        raise TimeoutError(f"no message {type} {fields}")

    def wait_for_picture(self, view: int, *, whole: bool = False, seconds: float = 20) -> Picture:
        """A picture of a view, or of a later one; with `whole`, not a preview."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            picture = self.picture
            if picture is not None and picture.view >= view and (not whole or picture.is_whole):
                return picture
            self.receive(max(end - time.monotonic(), 0.01))
        raise TimeoutError(f"no picture of view {view}")


def moved(x: float) -> dict[str, object]:
    """The camera at another place."""
    return {"sensor.to_world": [[-1, 0, 0, x], [0, 1, 0, 0], [0, 0, -1, 4], [0, 0, 0, 1]]}


def finished(client: Client, view: int) -> np.ndarray:
    """The last picture of a view."""
    while client.messages.get("viewed", {}).get("view", -1) < view:
        client.receive()
    last = client.wait_for("progress", state="finished")["picture"]
    while client.picture is None or client.picture.number < last:
        client.receive()
    assert client.picture.view >= view
    return client.picture.pixels
