"""Compressed parts of volume files."""

from __future__ import annotations

import struct
import zlib

from lajolla.messages import installing

from .voxels import VoxelError

# Limit for decompressed data: a constant, and a number of bytes for each compressed byte.
SMALL_UNPACKED = 1 << 24
MOST_PACKING = 64
BLOSC_HEADER = struct.Struct("<4xI8x")  # of a chunk: flags, its size unpacked, sizes of its parts
BROKEN = "its compressed data is broken"


def check_packing(size: int, packed: int) -> None:
    """Raises VoxelError if `size` bytes are too many for `packed` compressed ones."""
    if size > SMALL_UNPACKED + MOST_PACKING * packed:
        wanted = f"its compressed data would take {size >> 20:,} MiB"
        raise VoxelError(f"{wanted}, more than {MOST_PACKING} times the file")


def inflated(block: bytes, size: int) -> bytes:
    """Decompresses data of zlib, at most `size` + 1 bytes. Raises VoxelError."""
    try:
        return zlib.decompressobj().decompress(block, size + 1)
    except zlib.error:
        raise VoxelError(BROKEN) from None


def unpacked_by_blosc(chunk: bytes) -> bytes:
    """A chunk of Blosc, whose header contains its size. Raises VoxelError."""
    try:
        import blosc  # needed by such files alone
    except ImportError:
        raise VoxelError(f"it is compressed with Blosc; to read it: {installing('blosc')}") from None
    if len(chunk) < BLOSC_HEADER.size:
        raise VoxelError(BROKEN)
    check_packing(BLOSC_HEADER.unpack_from(chunk)[0], len(chunk))
    try:
        return blosc.decompress(chunk)
    except Exception:  # any exception of the module means invalid data
        raise VoxelError(BROKEN) from None
