"""Writers of voxel files for the tests; `volumes/grids.nvdb` was written by NanoVDB 32."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

NANOVDB = Path(__file__).parent / "volumes" / "grids.nvdb"
BOX = (-1.0, 0.0, 2.0, 3.0, 0.5, 2.25)


def vol(
    array: np.ndarray, encoding: int = 1, *, version: int = 3, box: tuple[float, ...] = BOX, cut: int = 0
) -> bytes:
    depth, height, width, channels = array.shape
    head = struct.pack("<3sB5i6f", b"VOL", version, encoding, width, height, depth, channels, *box)
    data = head + array.tobytes()
    return data[: len(data) - cut]


def first_grid() -> tuple[bytes, bytes]:
    """Metadata and unpacked memory of the first grid of the file."""
    data = NANOVDB.read_bytes()
    (count,) = struct.unpack_from("<H", data, 12)
    at, packed = 16, 0
    for i in range(count):
        (size,) = struct.unpack_from("<Q", data, at + 8)
        (length,) = struct.unpack_from("<I", data, at + 136)
        if i == 0:
            meta, packed = data[at : at + 176 + length], size
        at += 176 + length
    return meta, zlib.decompress(data[at + 8 : at + packed])


def nvdb(meta: bytes, grid: bytes, *, codec: int = 0, size: int | None = None) -> bytes:
    packed = grid if codec == 0 else struct.pack("<Q", len(grid)) + grid
    sizes = struct.pack("<QQ", len(grid) if size is None else size, len(packed))
    return struct.pack("<8sIHH", b"NanoVDB0", 0, 1, codec) + sizes + meta[16:] + packed
