"""Grids within a grid, as Mitsuba 0.6 keeps large volumes: a list of blocks, and a .vol file for each."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..syntax.files import file_bytes
from .voxels import VoxelError, Voxels, box_transform, checked_shape, most_sparse, read_vol

HEADER = struct.Struct("<6f3i")  # the box of all, and how many blocks fit along x, y and z
BLOCK = struct.Struct("<3i")  # which of them is there


def read_hierarchical(path: Path, file_of: Callable[[int, int, int], Path]) -> Voxels:
    """Reads all blocks as one dense grid, which is zero outside of them.

    Neighbours share the samples on their common side, as the outermost ones of a block lie on its sides.

    Args:
        path: the list of blocks.
        file_of: the .vol file of the block at (x, y, z).

    Raises:
        VoxelError: a file cannot be read as that, or blocks differ in size.
        OSError: a file cannot be read.
    """
    data = file_bytes(path)
    if len(data) < HEADER.size + BLOCK.size or (len(data) - HEADER.size) % BLOCK.size:
        raise VoxelError("it is no list of the blocks of a grid")
    *corners, width, height, depth = HEADER.unpack_from(data)
    size = np.array([width, height, depth])
    blocks = np.unique(np.frombuffer(data, "<i4", offset=HEADER.size).reshape(-1, 3), axis=0)
    if np.any(blocks < 0) or np.any(blocks >= size):
        raise VoxelError(f"it has a block outside of its {width} x {height} x {depth} blocks")
    values, steps = None, np.zeros(3, int)
    for x, y, z in blocks.tolist():
        file = file_of(x, y, z)
        block = read_vol(file).values
        if values is None:
            steps = np.array(block.shape[:3]) - 1
            if np.any(steps < 1):
                raise VoxelError("a block needs two voxels or more along each side")
            whole = [int(n) for n in steps * size[::-1] + 1]
            most = most_sparse(len(data) + len(blocks) * file.stat().st_size)
            shape = checked_shape((whole[0], whole[1], whole[2]), block.shape[3], most)
            values, first = np.zeros(shape, block.dtype), block
        if block.shape != first.shape or block.dtype != first.dtype:
            raise VoxelError("its blocks differ in their numbers of voxels or channels, or in their type")
        low = steps * (z, y, x)
        high = low + block.shape[:3]
        values[low[0] : high[0], low[1] : high[1], low[2] : high[2]] = block
    assert values is not None  # there is a block
    return Voxels(values, box_transform(np.array(corners[:3]), np.array(corners[3:])))
