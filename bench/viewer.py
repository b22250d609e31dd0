"""How quickly `lajolla view` answers: its first picture, and pictures while the camera is dragged.

Prints for each scene the time from the command to the first picture, and the part of it after Python has
started; the time from a new position of the camera to its picture, the median and the 95th percentile; and
pictures per second while positions come 60 times a second.
"""

from __future__ import annotations

import argparse
import json
import math
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from websockets.sync.client import ClientConnection, connect

from lajolla.viewer.protocol import HEADER

FRAME = 1 / 60  # seconds between two positions of a pointer


class Page:
    """What the viewer takes for a page of the browser."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.view = -1  # of the last picture
        self.announced: dict[str, object] = {}  # the last message "viewed"

    def receive(self, timeout: float | None = None) -> bool:
        """Takes a message; whether it completes a picture."""
        data = self.socket.recv(timeout)
        if isinstance(data, str):
            message = json.loads(data)
            if message["type"] == "viewed":
                self.announced = message
            return False
        number, self.view, _, _, _, _, _, height, first, rows, *_ = HEADER.unpack_from(data)
        if first + rows < height:
            return False
        self.socket.send(json.dumps({"type": "received", "picture": number}))
        return True

    def move(self, matrix: list[list[float]]) -> None:
        self.socket.send(json.dumps({"type": "edit", "values": {"sensor.to_world": matrix}}))


@contextmanager
def opened(scene: Path, options: list[str]) -> Iterator[tuple[Page, float]]:
    """A page with its first picture, and the time since the command."""
    command = [sys.executable, "-m", "lajolla", "view", str(scene), "--no-browser", *options]
    start = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        url, origin = address.replace("http", "ws", 1) + "socket", address.rsplit("/", 2)[0]
        with connect(url, origin=origin, compression=None, max_size=None) as socket:  # type: ignore[arg-type]
            page = Page(socket)
            while not page.receive():
                pass
            yield page, time.perf_counter() - start
        process.send_signal(signal.SIGINT)
        process.communicate()


def turned(matrix: list[list[float]], angle: float) -> list[list[float]]:
    """A placement that looks to the side."""
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]])
    return (np.array(matrix) @ turn).tolist()


def placement(page: Page) -> list[list[float]]:
    return page.announced["sensor"]["to_world"]  # type: ignore[index,no-any-return]


def responses(page: Page, count: int) -> list[float]:
    """Times from a position to its picture."""
    first, found = placement(page), []
    for step in range(count):
        view = page.view
        start = time.perf_counter()
        page.move(turned(first, 0.1 * math.sin(step / 5)))
        while not page.receive() or page.view == view:
            pass
        found.append(time.perf_counter() - start)
    return found


def rate_while_dragging(page: Page, seconds: float) -> float:
    """Pictures of different views per second, while there is a new position in each frame."""
    first, views = placement(page), set()
    start = sent = time.perf_counter()
    while (now := time.perf_counter()) - start < seconds:
        if now - sent >= FRAME:
            sent = now
            page.move(turned(first, 0.1 * math.sin(3 * (now - start))))
        try:
            if page.receive(max(sent + FRAME - time.perf_counter(), 0.001)):
                views.add(page.view)
        except TimeoutError:
            pass
    return len(views) / seconds


def python_start() -> float:
    """The time that Python takes without doing anything, the least of five."""
    times = []
    for _ in range(5):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", "pass"], check=True)
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", type=Path, nargs="+")
    parser.add_argument("--size", help="WxH of the pictures")
    parser.add_argument("--runs", type=int, default=3, help="of the command")
    arguments = parser.parse_args()
    options = ["--size", arguments.size] if arguments.size else []
    start = python_start()
    for scene in arguments.scenes:
        firsts = []
        for _ in range(arguments.runs):
            with opened(scene, options) as (page, first):
                firsts.append(first)
                times = responses(page, 60)
                rate = rate_while_dragging(page, 4)
        first, response, late = min(firsts), 1000 * np.median(times), 1000 * np.quantile(times, 0.95)
        print(f"{scene.name}: first picture after {first:.2f} s, {first - start:.2f} s after Python's start")
        print(
            f"  response {response:.0f} ms, 95 % within {late:.0f} ms, {rate:.0f} pictures/s while dragging"
        )


if __name__ == "__main__":
    main()
