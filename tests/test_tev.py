"""Pictures in tev: a fake one decodes the packets and puts the pictures together."""

from __future__ import annotations

import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from viewer_tools import SCENE, Client, finished, viewer

import lajolla
from lajolla.cli import main
from lajolla.tev import Tev, create_packet, update_packets


class FakeTev:
    """Listens like tev, and keeps the pictures by their names."""

    def __init__(self, most_packets: int = 1 << 30) -> None:
        self.images: dict[str, dict[str, np.ndarray]] = {}
        self.created: list[str] = []
        self.left = most_packets  # it goes away then
        self.server = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self.server.getsockname()[1]}"
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self) -> None:
        connection, _ = self.server.accept()
        with connection, connection.makefile("rb") as stream:
            while self.left and (head := stream.read(4)):
                self._take(stream.read(struct.unpack("<I", head)[0] - 4))
                self.left -= 1
        self.server.close()

    def _take(self, body: bytes) -> None:
        kind, focus = struct.unpack_from("<b?", body)
        name, at = text_at(body, 2)
        if kind == 4:
            (width, height, count), at = struct.unpack_from("<3i", body, at), at + 12
            names, at = texts_at(body, at, count)
            assert focus and at == len(body)
            self.images[name] = {channel: np.zeros((height, width), np.float32) for channel in names}
            self.created.append(name)
        else:
            assert kind == 6 and not focus
            (count,), at = struct.unpack_from("<i", body, at), at + 4
            names, at = texts_at(body, at, count)
            (x, y, width, height), at = struct.unpack_from("<4i", body, at), at + 16
            offsets = np.frombuffer(body, "<i8", count, at)
            strides = np.frombuffer(body, "<i8", count, at + 8 * count)
            numbers = np.frombuffer(body, "<f4", offset=at + 16 * count)
            assert len(numbers) == width * height * count
            for channel, offset, stride in zip(names, offsets, strides, strict=True):
                pixels = numbers[offset : offset + stride * (width * height - 1) + 1 : stride]
                self.images[name][channel][y : y + height, x : x + width] = pixels.reshape(height, width)

    def wait_for(self, name: str) -> None:
        end = time.monotonic() + 20
        while name not in self.images:
            assert time.monotonic() < end
            time.sleep(0.02)


def text_at(body: bytes, at: int) -> tuple[str, int]:
    end = body.index(b"\0", at)
    return body[at:end].decode(), end + 1


def texts_at(body: bytes, at: int, count: int) -> tuple[list[str], int]:
    found = []
    for _ in range(count):
        text, at = text_at(body, at)
        found.append(text)
    return found, at


@pytest.fixture
def tev() -> Iterator[FakeTev]:
    fake = FakeTev()
    yield fake
    fake.thread.join(timeout=20)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.xml"
    path.write_text(SCENE)
    return path


def test_the_bytes_of_packets() -> None:
    """Written by hand from tev's description of its protocol."""
    made = create_packet("é", 2, 1, ["R", "a.X"])
    body = b"\x04\x01\xc3\xa9\0" + struct.pack("<3i", 2, 1, 2) + b"R\0a.X\0"
    assert made == struct.pack("<I", 4 + len(body)) + body
    (update,) = update_packets(
        "n", {"R": np.array([[1, 2]], np.float32), "G": np.array([[3, 4]], np.float32)}
    )
    body = b"\x06\0n\0" + struct.pack("<i", 2) + b"R\0G\0" + struct.pack("<4i4q", 0, 0, 2, 1, 0, 2, 1, 1)
    body += struct.pack("<4f", 1, 2, 3, 4)
    assert update == struct.pack("<I", 4 + len(body)) + body


def test_a_render_ends_in_tev_with_all_its_channels(tev: FakeTev, scene: Path, tmp_path: Path) -> None:
    out, plain = tmp_path / "out.exr", tmp_path / "plain.exr"
    options = [str(scene), "--spp", "4", "--aov", "albedo,depth,shape", "--quiet"]
    assert main(["render", *options, "-o", str(out), "--tev", tev.address]) == 0
    tev.thread.join(timeout=20)
    expected, found = lajolla.Image.open(out), tev.images[str(out)]
    assert found.keys() == {"R", "G", "B", *expected.channels}
    assert {"albedo.R", "albedo.G", "albedo.B", "depth.Z", "shape.I"} <= found.keys()
    np.testing.assert_array_equal(np.stack([found[name] for name in "RGB"], axis=2), expected.array)
    for name, channel in expected.channels.items():
        np.testing.assert_array_equal(found[name], channel)
    assert main(["render", *options, "-o", str(plain)]) == 0
    np.testing.assert_array_equal(lajolla.Image.open(plain).array, expected.array)


def test_the_command_line_finds_tev_by_itself(tev: FakeTev, scene: Path, tmp_path: Path) -> None:
    """In a process of its own: this one has imported `lajolla.tev`."""
    out = tmp_path / "out.exr"
    words = [str(scene), "--spp", "1", "-o", str(out), "--tev", tev.address, "--quiet"]
    subprocess.run([sys.executable, "-m", "lajolla", "render", *words], check=True)
    tev.thread.join(timeout=20)
    assert list(tev.images) == [str(out)]


def test_pictures_come_while_it_renders(tev: FakeTev, scene: Path, tmp_path: Path) -> None:
    """Large ones in several packets; those that tev does not take in time are left out."""
    sender = Tev(("127.0.0.1", int(tev.address.split(":")[1])), pytest.fail)
    pixels = np.random.default_rng(1).random((700, 600)).astype(np.float32)
    sender.offer("first", lambda: {"Y": pixels})
    tev.wait_for("first")
    sender.offer("lost", lambda: pytest.fail("it is replaced"))
    sender.offer("last", lambda: {"Y": 2 * pixels, "A": pixels})
    sender.close()
    tev.thread.join(timeout=20)
    assert tev.created == ["first", "last"]
    np.testing.assert_array_equal(tev.images["first"]["Y"], pixels)
    np.testing.assert_array_equal(tev.images["last"]["A"], pixels)


def test_the_viewer_shows_its_pictures_in_tev(scene: Path) -> None:
    tev = FakeTev()
    with viewer(scene, "--tev", tev.address, "--aov", "depth") as address, Client(address) as client:
        shown = finished(client, 0)
        end = time.monotonic() + 20
        while "scene.xml" not in tev.images or not np.array_equal(
            np.stack([tev.images["scene.xml"][name] for name in "RGB"], axis=2).astype(np.float16), shown
        ):
            assert time.monotonic() < end
            time.sleep(0.05)
        assert "depth.Z" in tev.images["scene.xml"]


def test_without_tev_nothing_is_rendered(
    scene: Path, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as unused:
        port = unused.getsockname()[1]
    for command in (["render", "-o", str(tmp_path / "out.exr")], ["view", "--no-browser"]):
        assert main([*command, str(scene), "--tev", f"127.0.0.1:{port}"]) == 1
        (line,) = capfd.readouterr().err.splitlines()
        assert line.startswith(f"lajolla: error: no tev answers at 127.0.0.1:{port} (Connection refused)")
    assert not (tmp_path / "out.exr").exists()
    assert main(["render", str(scene), "--tev", "localhost"]) == 1
    assert "'localhost' is not HOST:PORT, such as localhost:14158" in capfd.readouterr().err


@pytest.fixture
def stalled() -> Iterator[socket.socket]:
    """A tev that takes a connection, and reads nothing."""
    with socket.socket() as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        server.bind(("127.0.0.1", 0))
        server.listen()
        yield server


def address_of(server: socket.socket) -> str:
    return "{}:{}".format(*server.getsockname())


def test_closing_has_one_limit_for_all_packets(
    stalled: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of 128 packets takes about a fifth of a second."""
    monkeypatch.setattr("lajolla.tev.SECONDS", 1.0)
    warnings: list[str] = []
    sender = Tev(stalled.getsockname(), warnings.append)
    connection, _ = stalled.accept()
    ended = threading.Event()

    def read_slowly() -> None:
        while not ended.wait(0.01):
            connection.recv(1 << 16)

    reader = threading.Thread(target=read_slowly)
    reader.start()
    sender.offer("picture", lambda: {"Y": np.zeros((8192, 4096), np.float32)})
    start = time.monotonic()
    sender.close()
    assert time.monotonic() - start < 5
    ended.set()
    reader.join()
    connection.close()
    reason = "(timed out); the last picture is not complete there"
    assert warnings == [f"tev at {address_of(stalled)} shows nothing more {reason}"]


def test_an_interrupt_after_the_picture_is_written_says_so(
    scene: Path, stalled: socket.socket, tmp_path: Path
) -> None:
    out = tmp_path / "out.exr"
    words = [str(scene), "--spp", "1", "--size", "1500x1000", "-o", str(out), "--tev", address_of(stalled)]
    command = [sys.executable, "-m", "lajolla", "render", *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        told = next(line for line in process.stderr if "%" not in line)
        assert told.startswith(f"lajolla: wrote {out} (") and out.exists()
        process.terminate()
        assert process.stderr.read() == told.replace(" wrote", " interrupted; wrote")
    assert process.returncode == 143


def test_a_tev_that_goes_away_does_not_stop_the_render(
    scene: Path, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    tev, out = FakeTev(most_packets=1), tmp_path / "out.exr"
    options = ["--size", "256x256", "--spp", "64", "-o", str(out), "--tev", tev.address, "--quiet"]
    assert main(["render", str(scene), *options]) == 0
    assert out.exists()
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(f"lajolla: warning: tev at {tev.address} shows nothing more (")
