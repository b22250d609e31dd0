"""Voxel grids from files, as NumPy arrays with the place they have in the world."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..syntax.nodes import Array

MAX_VALUES = 1 << 30
# The values of a sparse grid that becomes dense: SMALL_SPARSE_VALUES plus SPARSE_VALUES_PER_BYTE per byte of
# its file, at most MAX_SPARSE_VALUES.
SMALL_SPARSE_VALUES = 1 << 22
SPARSE_VALUES_PER_BYTE = 32
MAX_SPARSE_VALUES = 1 << 29


class VoxelError(ValueError):
    """A file that cannot be read as a voxel grid."""


@dataclass(frozen=True)
class Voxels:
    """A dense grid: values (depth, height, width, channels), and the transform from the unit cube to it."""

    values: npt.NDArray[np.generic]  # uint8, float16 or float32
    box: Array


def box_transform(low: Array, high: Array) -> Array:
    """The transform from the unit cube to a box.

    Raises:
        VoxelError: the box is empty.
    """
    size = high - low
    if not np.all(np.isfinite(size)) or not np.all(size > 0):
        raise VoxelError(f"its box from {low} to {high} is empty")
    matrix = np.diag([*size, 1.0])
    matrix[:3, 3] = low
    return matrix


# Encodings of .vol files.
ENCODINGS: dict[int, np.dtype[np.generic]] = {1: np.dtype("<f4"), 2: np.dtype("<f2"), 3: np.dtype("u1")}
HEADER = struct.Struct("<3sB5i6f")


def read_vol(path: Path) -> Voxels:
    """Reads a volume in the format of Mitsuba: a header of 48 bytes, then values, the channel running first.

    Raises:
        VoxelError: the file is none of these, or cut short.
    """
    if not path.is_file():
        raise VoxelError("it is not a file")
    with path.open("rb") as file:
        head = file.read(HEADER.size)
        if len(head) < HEADER.size or head[:3] != b"VOL":
            raise VoxelError("it is not a .vol file")
        _, version, encoding, width, height, depth, channels, *box = HEADER.unpack(head)
        if version != 3:
            raise VoxelError(f"its version is {version}; only 3 is known")
        if encoding not in ENCODINGS:
            raise VoxelError(f"its encoding is {encoding}; 1 (float32), 2 (float16) and 3 (uint8) are known")
        shape = checked_shape((depth, height, width), channels)
        count = math.prod(shape)
        if path.stat().st_size < HEADER.size + count * ENCODINGS[encoding].itemsize:
            raise VoxelError("it is cut short")
        values = np.frombuffer(file.read(count * ENCODINGS[encoding].itemsize), np.uint8)
    box_values = np.asarray(box, float)
    return Voxels(values.view(ENCODINGS[encoding]).reshape(shape), _box_or_unit(box_values))


def vol_bytes(values: npt.NDArray[np.generic]) -> bytes:
    """The bytes of a .vol file of 32-bit numbers in the unit cube; integers become fractions of one.

    Args:
        values: (depth, height, width, channels).
    """
    depth, height, width, channels = values.shape
    top = 255 if values.dtype == np.uint8 else 1
    head = HEADER.pack(b"VOL", 3, 1, width, height, depth, channels, 0, 0, 0, 1, 1, 1)
    return head + (values.astype("<f4") / np.float32(top)).astype("<f4").tobytes()


def _box_or_unit(box: Array) -> Array:
    """The header's box; the unit cube if it is empty, as some programs write it."""
    return box_transform(box[:3], box[3:]) if np.any(box) else np.eye(4)


def most_sparse(size: int) -> int:
    """The maximum number of dense values of a sparse grid, for the size of its file in bytes."""
    return min(SMALL_SPARSE_VALUES + SPARSE_VALUES_PER_BYTE * size, MAX_SPARSE_VALUES)


def checked_shape(
    size: tuple[int, int, int], channels: int, most: int = MAX_VALUES
) -> tuple[int, int, int, int]:
    """The shape of an array of voxels.

    Raises:
        VoxelError: no voxels, too many, or a number of channels that means nothing.
    """
    if min(size) < 1 or channels not in (1, 3, 6):
        raise VoxelError(f"{size[2]} x {size[1]} x {size[0]} voxels of {channels} channels make no volume")
    if size[0] * size[1] * size[2] * channels > most:
        raise VoxelError(f"{size[2]} x {size[1]} x {size[0]} voxels are too many")
    return (*size, channels)
