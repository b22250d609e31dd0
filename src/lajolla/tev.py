"""Shows pictures in tev (https://github.com/Tom94/tev) while they are rendered, by its protocol over TCP.

Two of its packets are enough (its `include/tev/Ipc.h`): one makes an image, the other one fills a rectangle
of it. Each begins with its length, 4 bytes, and its type, 1 byte; texts end with a zero byte, and all numbers
are little-endian.
"""

from __future__ import annotations

import math
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from lajolla.colour import FloatImage
from lajolla.image import Image

CREATE, UPDATE = 4, 6  # types of packets
BAND_BYTES = 1 << 20  # of pixels in a packet, about
SECONDS = 10.0  # that a packet may take, and all of them at the end, before tev counts as gone
INTERVAL = 0.25  # seconds between two pictures, at least

Channels: TypeAlias = Mapping[str, FloatImage]  # (height, width) each, all of the same size


class TevError(ConnectionError):
    """There is no tev at an address; the message names it."""


def channels_of(image: Image) -> dict[str, FloatImage]:
    """The channels of a picture and of its layers by their names; tev shows NAME.R, NAME.G, NAME.B as one."""
    result = {name: image.array[..., index] for index, name in enumerate("RGB")}
    result |= image.channels
    for name, layer in image.layers.items():
        result |= layer.channels(name)
    return result


class Tev:
    """A connection to tev. Pictures are sent in a thread of its own, so that a render does not wait for them.

    Args:
        address: host and port.
        warn: called once, in that thread, if tev goes away; nothing is sent then.

    Raises:
        TevError: it does not answer.
    """

    def __init__(self, address: tuple[str, int], warn: Callable[[str], None]) -> None:
        self.name = "{}:{}".format(*address)
        self._warn = warn
        try:
            self._socket = socket.create_connection(address, timeout=SECONDS)
        except OSError as problem:
            reason = problem.strerror or str(problem)
            message = f"no tev answers at {self.name} ({reason}); start it, or see its option --host"
            raise TevError(message) from None
        self._made: dict[str, object] = {}  # the size and the channels of each image that is there
        self._changed = threading.Condition()
        self._waiting: tuple[str, Callable[[], Channels]] | None = None
        self._end = math.inf  # by the clock, when all has to be sent; finite after `close`
        self._thread = threading.Thread(target=self._run, name="tev", daemon=True)
        self._thread.start()

    def offer(self, name: str, make: Callable[[], Channels]) -> None:
        """Shows a picture when the last one is sent, unless a later one comes before.

        Args:
            name: of the image in tev.
            make: returns the channels when they are needed, in another thread.
        """
        with self._changed:
            self._waiting = (name, make)
            self._changed.notify()

    def close(self) -> None:
        """Waits until the last picture is sent, up to SECONDS, and ends the connection."""
        with self._changed:
            self._end = time.monotonic() + SECONDS
            self._changed.notify()
        self._thread.join()
        self._socket.close()

    def _is_closed(self) -> bool:
        return self._end < math.inf

    def _run(self) -> None:
        pause = 0.0
        while True:
            with self._changed:
                self._changed.wait_for(self._is_closed, timeout=pause)
                self._changed.wait_for(lambda: self._is_closed() or self._waiting)
                waiting, self._waiting = self._waiting, None
            if waiting is None:
                return
            start = time.perf_counter()
            try:
                self._send(waiting[0], waiting[1]())
            except OSError as problem:
                reason = problem.strerror or str(problem)
                rest = "the last picture is not complete there" if self._is_closed() else "the render goes on"
                self._warn(f"tev at {self.name} shows nothing more ({reason}); {rest}")
                return
            pause = max(INTERVAL, 3 * (time.perf_counter() - start))

    def _send(self, name: str, channels: Channels) -> None:
        height, width = next(iter(channels.values())).shape
        made = (width, height, list(channels))
        if self._made.get(name) != made:
            self._send_packet(create_packet(name, *made))
            self._made[name] = made
        for packet in update_packets(name, channels):
            self._send_packet(packet)

    def _send_packet(self, packet: bytes) -> None:
        """Raises OSError, also if it takes too long."""
        left = self._end - time.monotonic()
        self._socket.settimeout(min(SECONDS, max(left, 0.001)))
        self._socket.sendall(packet)


def create_packet(name: str, width: int, height: int, channels: Sequence[str]) -> bytes:
    """Makes an image, in place of one of the same name, and shows it."""
    size = struct.pack("<3i", width, height, len(channels))
    return _packet(CREATE, True, name, size, *map(_text, channels))


def update_packets(name: str, channels: Channels) -> Iterator[bytes]:
    """Fills an image, some rows at a time; the numbers of one channel follow each other."""
    names, arrays = list(channels), list(channels.values())
    height, width = arrays[0].shape
    rows = max(1, BAND_BYTES // (4 * width * len(names)))
    head = struct.pack("<i", len(names)) + b"".join(map(_text, names))
    for top in range(0, height, rows):
        band = np.stack([array[top : top + rows] for array in arrays]).astype("<f4")
        count = band.shape[1] * width
        window = struct.pack("<4i", 0, top, width, band.shape[1])
        offsets = np.arange(len(names), dtype="<i8") * count
        strides = np.ones(len(names), "<i8")
        yield _packet(UPDATE, False, name, head, window, offsets.tobytes(), strides.tobytes(), band.tobytes())


def _packet(kind: int, focus: bool, name: str, *parts: bytes) -> bytes:
    body = struct.pack("<b?", kind, focus) + _text(name) + b"".join(parts)
    return struct.pack("<I", 4 + len(body)) + body


def _text(text: str) -> bytes:
    return text.encode("utf-8", "replace").replace(b"\0", b"") + b"\0"
