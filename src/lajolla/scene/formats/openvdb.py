"""OpenVDB files as dense grids.

A file contains grids, each with a transform and a tree (Museth 2013, "VDB: High-Resolution Sparse Volumes
with Dynamic Topology"): a root, nodes with 32^3 children, nodes with 16^3, and leaves with 8^3 voxels. The
topology is stored first, with the values of constant regions (tiles), then the voxels of all leaves in the
same order.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..syntax.files import file_bytes
from ..syntax.nodes import Array
from .packing import inflated, unpacked_by_blosc
from .voxels import VoxelError, Voxels, box_transform, checked_shape, most_sparse

Mask = npt.NDArray[np.bool_]
Numbers = npt.NDArray[Any]  # of the type stated in the file

MAGIC = 0x56444220
OLDEST = 222  # the format of OpenVDB 2.0
TYPES = {  # number type and number of channels
    "float": ("<f4", 1),
    "double": ("<f8", 1),
    "half": ("<f2", 1),
    "int32": ("<i4", 1),
    "int64": ("<i8", 1),
    "vec3s": ("<f4", 3),
    "vec3d": ("<f8", 3),
}
LEVELS = ((32, 4096), (16, 128))  # nodes below the root: children along an axis, voxels along an axis
LEAF = 8
ZIP, ACTIVE_MASK, BLOSC = 1, 2, 4  # flags of a grid
MAPS = {  # from index space to the world: count of stored vectors, indices of the translation and the scale
    "TranslationMap": (1, 0, None),
    "ScaleMap": (5, None, 0),
    "UniformScaleMap": (5, None, 0),
    "ScaleTranslateMap": (6, 0, 1),
    "UniformScaleTranslateMap": (6, 0, 1),
}
# How inactive values are stored. In the first case they equal the background; in the last all values are
# stored. If there are two inactive values, a mask selects between them.
BACKGROUND, MINUS, OTHER, BACKGROUND_OR_MINUS, BACKGROUND_OR_OTHER, TWO_OTHERS, ALL_STORED = range(7)


class _Stream:
    """Bytes that are read from front to back."""

    def __init__(self, data: bytes, at: int = 0) -> None:
        self.data = data
        self.at = at

    def take(self, count: int) -> bytes:
        if not 0 <= count <= len(self.data) - self.at or self.at < 0:
            raise VoxelError("it is cut short")
        self.at += count
        return self.data[self.at - count : self.at]

    def numbers(self, form: str) -> tuple[int, ...]:
        return struct.unpack(f"<{form}", self.take(struct.calcsize(f"<{form}")))

    def array(self, kind: str, count: int) -> Numbers:
        return np.frombuffer(self.take(np.dtype(kind).itemsize * count), kind)

    def text(self) -> str:
        return self.take(*self.numbers("I")).decode("utf-8", "replace")

    def mask(self, count: int) -> Mask:
        return np.unpackbits(self.array("u1", count // 8), bitorder="little").astype(bool)

    def metadata(self) -> dict[str, bytes]:
        """Values by their names, as they are stored."""
        result = {}
        for _ in range(*self.numbers("I")):
            name, _type = self.text(), self.text()
            result[name] = self.take(*self.numbers("I"))
        return result


@dataclass
class _Entry:
    """A grid in the table of contents: its type, the grid whose tree it shares or "", its byte offset."""

    type: str
    parent: str
    at: int


def read_vdb(path: Path, grid_name: str) -> Voxels:
    """Reads a grid of an OpenVDB file. If the file has only one grid, its name does not matter.

    Raises:
        VoxelError: the file, or the kind of grid, cannot be read.
    """
    data = file_bytes(path)
    entries = _contents(_Stream(data))
    named = {name.partition("\x1e")[0]: name for name in reversed(entries)}  # the first of equal names
    if not named:
        raise VoxelError("it holds no grid")
    if grid_name not in named and len(named) > 1:
        raise VoxelError(f'it has no grid "{grid_name}", only {", ".join(sorted(named))}')
    entry = entries[named.get(grid_name, next(iter(named.values())))]
    tree, to_world = _opened(data, entry)
    if entry.parent:
        if entry.parent not in entries or entries[entry.parent].parent:
            raise VoxelError("its tree is broken")
        tree, _ = _opened(data, entries[entry.parent])
    tree.read()
    low, high = tree.bounds()
    shape = checked_shape(tuple(high - low + 1)[::-1], tree.channels, most_sparse(len(data)))
    values = tree.dense(low, high).transpose(2, 1, 0, 3).reshape(shape)
    return Voxels(values, to_world @ box_transform(low - 0.5, high + 0.5))


def _contents(stream: _Stream) -> dict[str, _Entry]:
    """The grids of a file by their names."""
    if len(stream.data) < 8 or stream.numbers("q") != (MAGIC,):
        raise VoxelError("it is not an OpenVDB file")
    version, *_, has_offsets = stream.numbers("IIIB")
    if version < OLDEST:
        raise VoxelError(f"its format {version} is older than {OLDEST}, that of OpenVDB 2.0")
    if not has_offsets:
        raise VoxelError("it was written to a stream, without the offsets of its grids")
    stream.take(36)  # its identifier
    stream.metadata()
    entries: dict[str, _Entry] = {}
    for _ in range(*stream.numbers("I")):
        name, kind, parent = stream.text(), stream.text(), stream.text()
        at, _, stream.at = stream.numbers("qqq")  # the next entry is behind the grid
        entries.setdefault(name, _Entry(kind, parent, at))
    return entries


def _opened(data: bytes, entry: _Entry) -> tuple[_Tree, Array]:
    """A grid's tree, not read yet, and its transform from index space to the world."""
    found = re.fullmatch(r"Tree_(\w+?)_5_4_3(_HalfFloat)?", entry.type)
    if found is None or found[1] not in TYPES:
        raise VoxelError(f'its grid is a "{entry.type}"; supported are trees of {", ".join(TYPES)}')
    if not 0 <= entry.at < len(data):
        raise VoxelError("it is cut short")
    stream = _Stream(data, entry.at)
    (flags,) = stream.numbers("I")
    half = any(stream.metadata().get("is_saved_as_half_float", b"")) or bool(found[2])
    to_world = _transform(stream)
    kind, channels = TYPES[found[1]]
    return _Tree(stream, flags, kind, channels, "<f2" if half else kind), to_world


def _transform(stream: _Stream) -> Array:
    kind = stream.text()
    matrix = np.eye(4)
    if kind in ("AffineMap", "UnitaryMap"):
        matrix = stream.array("<f8", 16).reshape(4, 4).T  # files store it for row vectors
    elif kind in MAPS:
        count, translation, scale = MAPS[kind]
        vectors = stream.array("<f8", 3 * count).reshape(count, 3)
        if scale is not None:
            matrix[:3, :3] = np.diag(vectors[scale])
        if translation is not None:
            matrix[:3, 3] = vectors[translation]
    else:
        raise VoxelError(f'its transform is a "{kind}"; only linear ones are supported')
    if not np.all(np.isfinite(matrix)):
        raise VoxelError("its transform is not finite")
    return matrix


@dataclass
class _Tree:
    """A tree that is read from a stream."""

    stream: _Stream
    flags: int  # how values are compressed
    kind: str  # type of the numbers in the topology
    channels: int
    stored: str  # type of the numbers in compressed arrays
    background: Numbers = field(default_factory=lambda: np.zeros(1))
    tiles: list[tuple[Array, int, Numbers]] = field(default_factory=list)  # corners, size, values
    boxes: list[tuple[Array, int]] = field(default_factory=list)  # corners and size of active tiles
    leaves: list[tuple[Array, Mask]] = field(default_factory=list)  # corners, and which voxels are active
    met: set[tuple[int, ...]] = field(default_factory=set)  # corners below the root

    def read(self) -> None:
        """Reads the topology; the voxels are next in the stream."""
        self.stream.numbers("I")  # number of buffers: always one
        self.background = self.stream.array(self.kind, self.channels)
        tiles, children = self.stream.numbers("II")
        for _ in range(tiles):
            corner = self._root_corner()[None]
            value = self.stream.array(self.kind, self.channels)
            (active,) = self.stream.numbers("B")
            self._add_tiles(corner, LEVELS[0][1], value[None], np.array([bool(active)]))
        for _ in range(children):
            self._node(self._root_corner(), 0)

    def _root_corner(self) -> Array:
        """The corner of a tile or a node of the root. Duplicates are errors, so that small files are fast."""
        corner = self.stream.numbers("iii")
        if corner in self.met or any(value % LEVELS[0][1] for value in corner):
            raise VoxelError("its tree is broken")
        self.met.add(corner)
        return np.array(corner, np.int64)

    def _node(self, origin: Array, depth: int) -> None:
        """Reads a node: masks of its children and of active values, all values, and then the children."""
        width, reach = LEVELS[depth]
        has_child, active = self.stream.mask(width**3), self.stream.mask(width**3)
        values = self._values(active)
        step = reach // width
        corners = origin + step * np.stack(np.unravel_index(np.arange(width**3), (width,) * 3), axis=1)
        stored = ~has_child & (active | np.any(values != self.background, axis=1))
        self._add_tiles(corners[stored], step, values[stored], active[stored])
        for corner in corners[has_child]:
            if depth + 1 < len(LEVELS):
                self._node(corner, depth + 1)
            else:
                self.leaves.append((corner, self.stream.mask(LEAF**3)))

    def _add_tiles(self, corners: Array, size: int, values: Numbers, active: Mask) -> None:
        if len(corners):
            self.tiles.append((corners, size, values))
        if np.any(active):
            self.boxes.append((corners[active], size))

    def _values(self, active: Mask) -> Numbers:
        """Reads a value for each entry of the mask; inactive ones may not be stored."""
        (case,) = self.stream.numbers("B")
        if case > ALL_STORED:
            raise VoxelError("its tree is broken")
        first, second = self.background, self.background
        if case in (MINUS, BACKGROUND_OR_MINUS):
            first = -self.background
        if case in (OTHER, BACKGROUND_OR_OTHER, TWO_OTHERS):
            first = self.stream.array(self.kind, self.channels)
        if case == TWO_OTHERS:
            second = self.stream.array(self.kind, self.channels)
        is_second = np.zeros(active.shape, bool)
        if case in (BACKGROUND_OR_MINUS, BACKGROUND_OR_OTHER, TWO_OTHERS):
            is_second = self.stream.mask(len(active))
        if case == ALL_STORED or not self.flags & ACTIVE_MASK:
            return self._numbers(len(active))
        values = np.where(is_second[:, None], second, first).astype(self.stored)
        values[active] = self._numbers(int(active.sum()))
        return values

    def _numbers(self, count: int) -> Numbers:
        """Reads and decompresses values, of shape (count, channels)."""
        size = count * self.channels * np.dtype(self.stored).itemsize
        plain = not self.flags & (ZIP | BLOSC) or (count == 0 and self.stored != self.kind)
        if plain:  # empty arrays of halves are not preceded by their size
            data = self.stream.take(size)
        else:
            (packed,) = self.stream.numbers("q")  # negative if not compressed
            block = self.stream.take(abs(packed))
            if packed <= 0:
                data = block
            else:
                data = unpacked_by_blosc(block) if self.flags & BLOSC else inflated(block, size)
        if len(data) != size:
            raise VoxelError("its data does not have the size stated in the header")
        return np.frombuffer(data, self.stored).reshape(count, self.channels)

    def bounds(self) -> tuple[Array, Array]:
        """The lowest and the highest index of active voxels along each axis."""
        lows, highs = [], []
        for corners, size in self.boxes:
            lows.append(corners.min(axis=0))
            highs.append(corners.max(axis=0) + size - 1)
        for corner, active in self.leaves:
            where = np.flatnonzero(active)
            if len(where):
                inside = np.stack(np.unravel_index(where, (LEAF,) * 3), axis=1)
                lows.append(corner + inside.min(axis=0))
                highs.append(corner + inside.max(axis=0))
        if not lows:
            raise VoxelError("its grid has no active voxels")
        return np.min(lows, axis=0), np.max(highs, axis=0)

    def dense(self, low: Array, high: Array) -> npt.NDArray[np.float32]:
        """The voxels from low to high, of shape (x, y, z, channels); reads those of the leaves."""
        result = np.empty((*(high - low + 1), self.channels), np.float32)
        result[:] = self.background
        for corners, size, values in self.tiles:
            seen = np.all((corners + size > low) & (corners <= high), axis=1)
            for corner, value in zip(corners[seen], values[seen], strict=True):
                a, b = (np.clip(end - low, 0, result.shape[:3]) for end in (corner, corner + size))
                result[a[0] : b[0], a[1] : b[1], a[2] : b[2]] = value
        for corner, _ in self.leaves:
            voxels = self._values(self.stream.mask(LEAF**3)).reshape(LEAF, LEAF, LEAF, self.channels)
            a, b = (np.clip(end - low, 0, result.shape[:3]) for end in (corner, corner + LEAF))
            c, d = a + low - corner, b + low - corner
            result[a[0] : b[0], a[1] : b[1], a[2] : b[2]] = voxels[c[0] : d[0], c[1] : d[1], c[2] : d[2]]
        return result
