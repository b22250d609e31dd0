"""NanoVDB files as dense grids.

NanoVDB (Museth 2021, "NanoVDB: A GPU-Friendly and Portable VDB Data Structure for Real-Time Rendering and
Simulation") keeps a tree in one block of memory, and its files hold that block: a root with a table of
32^3-ary nodes, these of 16^3-ary nodes, these of leaves with 8^3 voxels. Offsets below follow the layout of
the format's version 32, in which every structure is padded to 32 bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..syntax.files import file_bytes
from ..syntax.nodes import Array
from .packing import check_packing, inflated, unpacked_by_blosc
from .voxels import VoxelError, Voxels, box_transform, checked_shape, most_sparse

Bytes = npt.NDArray[np.uint8]
Values = npt.NDArray[np.float32]
Whole = npt.NDArray[np.int64]

MAGIC = (b"NanoVDB0", b"NanoVDB1", b"NanoVDB2")
FILE_HEADER = struct.Struct("<8sIHH")  # magic, version, grids, codec
META_SIZE, META_NAME_SIZE, META_GRID_SIZE = 176, 136, 0
NONE, ZIP, BLOSC = 0, 1, 2

# Grid types by number, and their names.
FLOAT, VEC3F, FP4, FP8, FP16, FPN = 1, 6, 13, 14, 15, 16
QUANTISED = {FP4: 4, FP8: 8, FP16: 16}  # bits of a voxel
KNOWN = {FLOAT: "float", VEC3F: "Vec3f", FP4: "Fp4", FP8: "Fp8", FP16: "Fp16", FPN: "FpN"}

GRID_HEADER, GRID_MAP, GRID_TYPE = 672, 296, 636  # size of the header; where its map and its type are
MAP_MATRIX, MAP_OFFSET = 88, 232  # within the map, in double precision
TREE_HEADER = 64
LEVELS = ((32, 4096), (16, 128))  # nodes below the root: children along an axis, voxels along an axis
LEAF = 8


def _padded(size: int) -> int:
    return (size + 31) // 32 * 32


def read_nvdb(path: Path, grid_name: str) -> Voxels:
    """Reads a grid of a NanoVDB file. If the file has only one grid, its name does not matter.

    Raises:
        VoxelError: the file, or the kind of grid, cannot be read.
    """
    data = file_bytes(path)
    names: dict[str, tuple[bytes, int, int]] = {}  # codec and place of each grid
    for name, place in _grids(data):
        names.setdefault(name, place)
    if not names:
        raise VoxelError("it holds no grid")
    if grid_name not in names and len(names) > 1:
        raise VoxelError(f'it has no grid "{grid_name}", only {", ".join(sorted(names))}')
    block, codec, size = names[grid_name] if grid_name in names else next(iter(names.values()))
    try:
        return _Grid(_unpacked(block, codec, size)).voxels()
    except (IndexError, ValueError, struct.error) as problem:
        if isinstance(problem, VoxelError):
            raise
        raise VoxelError("its tree is broken") from None


def _grids(data: bytes) -> Iterator[tuple[str, tuple[bytes, int, int]]]:
    """Name, and packed bytes, codec and unpacked size, of every grid in the segments of a file."""
    at = 0
    while at < len(data):
        try:
            magic, _, count, codec = FILE_HEADER.unpack_from(data, at)
            if magic not in MAGIC:
                raise VoxelError("it is not a NanoVDB file")
            at += FILE_HEADER.size
            entries = []
            for _ in range(count):
                size, packed = struct.unpack_from("<QQ", data, at + META_GRID_SIZE)
                (length,) = struct.unpack_from("<I", data, at + META_NAME_SIZE)
                name = data[at + META_SIZE : at + META_SIZE + length].rstrip(b"\0").decode("utf-8", "replace")
                entries.append((name, size, packed))
                at += META_SIZE + length
        except struct.error:
            raise VoxelError("it is cut short") from None
        for name, size, packed in entries:
            if at + packed > len(data):
                raise VoxelError("it is cut short")
            yield name, (data[at : at + packed], codec, size)
            at += packed


def _unpacked(block: bytes, codec: int, size: int) -> Bytes:
    if codec == NONE:
        data = block
    elif codec == ZIP:
        check_packing(size, len(block))
        data = inflated(block[8:], size)
    elif codec == BLOSC:
        data = b"".join(map(unpacked_by_blosc, _chunks(block)))
    else:
        raise VoxelError(f"its codec {codec} is not known")
    if len(data) != size:
        raise VoxelError("its data does not have the size stated in the header")
    return np.frombuffer(data, np.uint8)


def _chunks(block: bytes) -> Iterator[bytes]:
    """The parts of a grid, each of which has its size before it."""
    at = 0
    while at < len(block):
        (size,) = struct.unpack_from("<Q", block, at)
        yield block[at + 8 : at + 8 + size]
        at += 8 + size


@dataclass
class _Level:
    """Where things are in the nodes of one level: the child mask, the table and its entries."""

    width: int  # children along an axis
    reach: int  # voxels along an axis
    masks: int  # bytes of one mask
    table: int
    entry: int
    size: int


class _Grid:
    """A grid's block of memory."""

    def __init__(self, data: Bytes) -> None:
        self.data = data
        if len(data) < GRID_HEADER + TREE_HEADER:
            raise VoxelError("it is cut short")
        self.type = int(self.read(GRID_TYPE, "<u4"))
        if self.type not in KNOWN:
            known = ", ".join(KNOWN.values())
            raise VoxelError(f"its values are of type {self.type}; {known} can be read")
        self.channels = 3 if self.type == VEC3F else 1
        value = 4 * self.channels
        self.entry = 16 if self.channels == 3 else 8  # of a table: a value or the offset of a child
        statistics = 2 * value + 8  # least and largest value, mean and deviation
        self.levels = []
        for width, reach in LEVELS:
            mask = width**3 // 8
            table = _padded(32 + 2 * mask + statistics)
            self.levels.append(_Level(width, reach, mask, table, self.entry, table + width**3 * self.entry))
        self.root_header = _padded(28 + 3 * value + 8)
        self.tile = _padded(20 + value)
        self.keys: set[int] = set()  # of the root's tiles
        self.seen: set[int] = set()  # nodes, each of which has one place
        self.leaf_values = _padded(80 + statistics) if self.type in (FLOAT, VEC3F) else 96

    def read(self, at: int, kind: str, count: int = 1) -> Any:  # noqa: ANN401
        """Numbers at a byte offset; one of them is a scalar."""
        kind_of = np.dtype(kind)
        end = at + kind_of.itemsize * count
        if at < 0 or end > len(self.data):
            raise VoxelError("its tree is broken")
        values = self.data[at:end].view(kind_of)
        return values[0] if count == 1 else values

    def voxels(self) -> Voxels:
        tree = GRID_HEADER
        root = tree + int(self.read(tree + 24, "<i8"))
        low, high = self.read(root, "<i4", 6).reshape(2, 3).astype(np.int64)
        width, height, depth = (int(n) for n in high - low + 1)
        most = most_sparse(len(self.data))
        shape = checked_shape((depth, height, width), self.channels, most)
        background = self.read(root + 28, "<f4", self.channels)
        self.low = low
        self.dense = np.empty((width, height, depth, self.channels), np.float32)  # x first, as in the tree
        self.dense[:] = background
        for i in range(int(self.read(root + 24, "<u4"))):
            self._root_tile(root, root + self.root_header + i * self.tile)
        return Voxels(self.dense.transpose(2, 1, 0, 3).reshape(shape), self._box(low, high))

    def _box(self, low: Whole, high: Whole) -> Array:
        """Voxel centres are integers in index space, which a map transforms to the world."""
        to_world = np.eye(4)
        to_world[:3, :3] = self.read(GRID_MAP + MAP_MATRIX, "<f8", 9).reshape(3, 3)
        to_world[:3, 3] = self.read(GRID_MAP + MAP_OFFSET, "<f8", 3)
        if not np.all(np.isfinite(to_world)):
            raise VoxelError("its transform is not finite")
        return to_world @ box_transform(low.astype(float) - 0.5, high.astype(float) + 0.5)

    def _visit(self, at: int) -> int:
        """The place of a node, which no other one leads to: small files could be endless otherwise."""
        if at in self.seen:
            raise VoxelError("its tree is broken")
        self.seen.add(at)
        return at

    def _root_tile(self, root: int, at: int) -> None:
        key = int(self.read(at, "<u8"))
        parts = [(key >> shift) & 0x1FFFFF for shift in (42, 21, 0)]  # 21 bits each, in units of 4096
        origin = np.array([((p << 12) + 2**31) % 2**32 - 2**31 for p in parts], np.int64)
        if key in self.keys:
            raise VoxelError("its tree is broken")
        self.keys.add(key)
        child = int(self.read(at + 8, "<i8"))
        if child == 0:
            self._fill(origin, LEVELS[0][1], self.read(at + 20, "<f4", self.channels))
        else:
            self._node(self._visit(root + child), origin, 0)

    def _node(self, at: int, origin: Whole, depth: int) -> None:
        """An inner node: its table holds values of empty regions, and offsets of children."""
        level = self.levels[depth]
        mask = np.unpackbits(self.read(at + 32 + level.masks, "u1", level.masks), bitorder="little")
        table = self.read(at + level.table, "u1", level.entry * level.width**3).reshape(-1, level.entry)
        step = level.reach // level.width
        index = np.arange(level.width**3)
        w = level.width
        corners = origin + step * np.stack([index // (w * w), index // w % w, index % w], axis=1)
        touched = np.all((corners + step > self.low) & (corners < self.low + self.dense.shape[:3]), axis=1)
        offsets = table[:, :8].copy().view("<i8")[:, 0]
        values = table[:, : 4 * self.channels].copy().view("<f4")
        for i in np.flatnonzero(touched):
            if not mask[i]:
                self._fill(corners[i], step, values[i])
            elif depth + 1 < len(self.levels):
                self._node(self._visit(at + int(offsets[i])), corners[i], depth + 1)
            else:
                self._copy(corners[i], self._leaf(self._visit(at + int(offsets[i]))))

    def _leaf(self, at: int) -> Values:
        """The 8^3 values of a leaf, x first."""
        shape = (LEAF, LEAF, LEAF, self.channels)
        start = at + self.leaf_values
        if self.type in (FLOAT, VEC3F):
            return self.read(start, "<f4", LEAF**3 * self.channels).reshape(shape)
        bits = QUANTISED.get(self.type) or 1 << (int(self.read(at + 15, "u1")) >> 5)
        if bits > 16:
            raise VoxelError("its tree is broken")
        least, step = self.read(at + 80, "<f4", 2)
        packed = self.read(start, "u1", LEAF**3 * bits // 8)
        if bits == 16:
            codes = packed.view("<u2")
        elif bits == 8:
            codes = packed
        else:
            single = np.unpackbits(packed, bitorder="little").reshape(-1, bits)
            codes = single @ (1 << np.arange(bits))
        return (least + step * codes).astype(np.float32).reshape(shape)

    def _fill(self, corner: Whole, size: int, value: Values) -> None:
        low, high = self._clipped(corner, size)
        self.dense[low[0] : high[0], low[1] : high[1], low[2] : high[2]] = value

    def _copy(self, corner: Whole, values: Values) -> None:
        low, high = self._clipped(corner, LEAF)
        a, b = low + self.low - corner, high + self.low - corner
        part = values[a[0] : b[0], a[1] : b[1], a[2] : b[2]]
        self.dense[low[0] : high[0], low[1] : high[1], low[2] : high[2]] = part

    def _clipped(self, corner: Whole, size: int) -> tuple[Whole, Whole]:
        """A cube's corners in the dense array, cut off where that ends."""
        extent = np.array(self.dense.shape[:3])
        return np.clip(corner - self.low, 0, extent), np.clip(corner + size - self.low, 0, extent)
