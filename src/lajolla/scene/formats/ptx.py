"""Ptex files (`.ptx`): a picture for each face of a mesh, and which faces are neighbours.

The format is that of Disney's library (https://github.com/wdas/ptex, PtexIO.h), version 1. Reductions in
files are not read, because they follow from the pictures.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from lajolla.picture_files import MAX_PICTURE, MAX_RATIO, Budget, PictureError

from ..syntax.errors import Location, SceneError
from ..syntax.files import file_bytes
from .packing import inflated
from .voxels import VoxelError

Array = npt.NDArray[np.generic]
Faces = npt.NDArray[np.void]  # as `FACE` describes them

QUADS = 1  # the type of mesh
MAX_LOG_SIZE = 15  # of a face
CONSTANT, SUBFACE = 1, 8  # flags of faces
ENCODED_CONSTANT, ENCODED_ZIPPED, ENCODED_DIFFERENCES, ENCODED_TILES = range(4)

TYPES = ("<u1", "<u2", "<f2", "<f4")
FACE = np.dtype([("size", "u1", 2), ("edges", "u1"), ("flags", "u1"), ("neighbours", "<i4", 4)])
EXTENDED = struct.Struct("<HHHHIIQQQ")
LEVEL = struct.Struct("<QII")  # bytes, bytes of its headers, number of faces


class Header(NamedTuple):
    """The first bytes of a file."""

    magic: bytes
    format_version: int
    mesh_type: int
    data_type: int
    alpha: int
    channels: int
    levels: int
    faces: int
    extended_size: int
    face_info_size: int
    constants_size: int
    level_info_size: int
    minor_version: int
    level_data_size: int
    metadata_size: int
    metadata_unpacked: int


HEADER = struct.Struct("<4sIIIiHHIIIIIIQII")


class PtexFile(NamedTuple):
    """The pictures of all faces, as `_core.FaceImages` takes them, and whether they hold integers."""

    log_sizes: npt.NDArray[np.uint8]
    flags: npt.NDArray[np.uint8]
    neighbours: npt.NDArray[np.int32]
    edges: npt.NDArray[np.uint8]
    texels: Array
    is_integer: bool


def read_ptx(path: Path, location: Location, budget: Budget) -> PtexFile:
    """Reads a Ptex file of quads; alpha is dropped and not multiplied in.

    Args:
        path: the file.
        location: what to blame in the scene.
        budget: what all pictures of the scene share.

    Raises:
        SceneError: the file is none, is cut short or broken, has triangles or edits, or its channels are
            neither RGB nor grey; it is too large for its file, or all pictures together are.
    """
    try:
        return _Reader(file_bytes(path), budget).read()
    except (PictureError, VoxelError, OSError, MemoryError) as problem:
        raise SceneError(f'"{path}" cannot be used as a Ptex file: {problem}', location) from None


@dataclass
class _Reader:
    data: bytes
    budget: Budget

    def read(self) -> PtexFile:
        header = Header._make(self._unpacked(HEADER, 0))
        _check(header)
        extended = self._extended(header)
        at = HEADER.size + header.extended_size
        faces = np.frombuffer(self._zipped(at, header.face_info_size, FACE.itemsize * header.faces), FACE)
        at += header.face_info_size
        kind = np.dtype(TYPES[header.data_type])
        constants = self._zipped(at, header.constants_size, kind.itemsize * header.channels * header.faces)
        at += header.constants_size
        self._refuse_edits(header, extended, at)
        self._check_faces(faces, kind.itemsize * header.channels)
        level = self._unpacked(LEVEL, at) if header.levels else (0, 0, 0)
        wanted = _channels(header)
        texels = np.concatenate(
            [
                part[:, wanted]
                for part in self._pictures(header, kind, faces, constants, level, at + header.level_info_size)
            ]
            or [np.empty((0, len(wanted)), kind)]
        )
        is_integer = kind.kind == "u"
        if kind.itemsize == 2 and is_integer:
            texels = texels.astype(np.float32) * np.float32(1 / 65535)
        shifts = np.arange(0, 8, 2, dtype=np.uint8)
        is_constant = _is_constant(faces)
        return PtexFile(
            np.ascontiguousarray(faces["size"]),
            (is_constant * 1 + (faces["flags"] & SUBFACE > 0) * 2).astype(np.uint8),
            np.ascontiguousarray(faces["neighbours"], np.int32),
            (faces["edges"][:, None] >> shifts) & np.uint8(3),
            np.ascontiguousarray(texels.astype(texels.dtype.newbyteorder("="))),
            is_integer,
        )

    def _extended(self, header: Header) -> tuple[int, ...]:
        """The extended header, which older files have in part or not at all."""
        size = min(header.extended_size, EXTENDED.size)
        return EXTENDED.unpack(self._bytes(HEADER.size, size).ljust(EXTENDED.size, b"\0"))

    def _refuse_edits(self, header: Header, extended: tuple[int, ...], at: int) -> None:
        """Edits at the end of a file replace what is before them; older files do not say how many."""
        *_, large_headers, _, large_data, edit_size, edit_at = extended
        end = at + header.level_info_size + header.level_data_size + header.metadata_size
        end += 8 + large_headers + large_data
        edits = edit_size if edit_at else len(self.data) - end
        first = max(edit_at, end)
        if edits > 4 and any(self.data[first + 1 : first + 5]):
            raise PictureError("it has edits, which are not supported; write it anew with Disney's ptxutils")

    def _check_faces(self, faces: Faces, pixel: int) -> None:
        """Limits the pictures, before memory is reserved for them."""
        if (faces["size"] > MAX_LOG_SIZE).any():
            raise PictureError(f"a face has more than 2^{MAX_LOG_SIZE} texels along an edge")
        neighbours = faces["neighbours"]
        if ((neighbours < -1) | (neighbours >= len(faces))).any():
            raise PictureError("a face has a neighbour that is not there")
        sizes = np.where(_is_constant(faces), 0, faces["size"].sum(1, dtype=np.int64))
        texels = int(np.left_shift(np.int64(1), sizes).sum())
        if texels * pixel > MAX_PICTURE + MAX_RATIO * len(self.data):
            raise PictureError(f"{texels:,} texels are too many for a file of {len(self.data):,} bytes")
        self.budget.spend(texels * pixel, len(self.data))

    def _pictures(
        self,
        header: Header,
        kind: np.dtype[np.generic],
        faces: Faces,
        constants: bytes,
        level: tuple[int, ...],
        at: int,
    ) -> Iterator[Array]:
        """The texels of each face, (texels, channels); those of constant faces are one."""
        values = np.frombuffer(constants, kind).reshape(header.faces, header.channels)
        is_constant = _is_constant(faces)
        if is_constant.all():
            yield values
            return
        _, headers_size, count = level
        if count != header.faces:
            raise PictureError("its pictures are not those of its faces")
        blocks = np.frombuffer(self._zipped(at, headers_size, 4 * count), "<u4")
        starts = at + headers_size + np.concatenate([[0], np.cumsum(blocks & 0x3FFFFFFF, dtype=np.int64)])
        for face in range(header.faces):
            if is_constant[face]:
                yield values[face : face + 1]
            else:
                block = _Block(int(starts[face]), int(blocks[face]), kind, header.channels)
                size = tuple(int(n) for n in faces["size"][face])
                yield self._picture(block, size, tiles=True).reshape(-1, header.channels)

    def _picture(self, block: _Block, log_size: tuple[int, ...], *, tiles: bool) -> Array:
        """The texels of a block, (height, width, channels)."""
        width, height = 1 << log_size[0], 1 << log_size[1]
        if block.encoding == ENCODED_TILES:
            if not tiles:
                raise PictureError("a tile consists of tiles")
            return self._tiles(block, log_size)
        if block.encoding == ENCODED_CONSTANT:
            pixel = np.frombuffer(self._bytes(block.at, block.pixel), block.kind)
            return np.broadcast_to(pixel, (height, width, block.channels))
        planes = np.frombuffer(self._zipped(block.at, block.size, block.pixel * width * height), block.kind)
        if block.encoding == ENCODED_DIFFERENCES and block.kind.kind == "u":
            planes = np.cumsum(planes, dtype=block.kind)
        return planes.reshape(block.channels, height, width).transpose(1, 2, 0)

    def _tiles(self, block: _Block, log_size: tuple[int, ...]) -> Array:
        """Tiles of equal size, row by row."""
        log_width, log_height, headers_size = struct.unpack("<BBI", self._bytes(block.at, 6))
        if log_width > log_size[0] or log_height > log_size[1]:
            raise PictureError("a tile is larger than its face")
        columns, rows = 1 << log_size[0] - log_width, 1 << log_size[1] - log_height
        at = block.at + 6
        headers = np.frombuffer(self._zipped(at, headers_size, 4 * columns * rows), "<u4")
        at += headers_size
        result = np.empty((1 << log_size[1], 1 << log_size[0], block.channels), block.kind)
        for number, header in enumerate(headers.tolist()):
            tile = _Block(at, header, block.kind, block.channels)
            y, x = (number // columns) << log_height, (number % columns) << log_width
            picture = self._picture(tile, (log_width, log_height), tiles=False)
            result[y : y + (1 << log_height), x : x + (1 << log_width)] = picture
            at += tile.size
        return result

    def _unpacked(self, layout: struct.Struct, at: int) -> tuple[int, ...]:
        return layout.unpack(self._bytes(at, layout.size))

    def _bytes(self, at: int, size: int) -> bytes:
        part = self.data[at : at + size]
        if len(part) < size:
            raise PictureError("it is cut short")
        return part

    def _zipped(self, at: int, packed: int, size: int) -> bytes:
        """A compressed part of so many bytes in memory."""
        if size > MAX_PICTURE + MAX_RATIO * packed:
            raise PictureError(f"{size:,} bytes are too many for {packed:,} compressed ones")
        part = inflated(self._bytes(at, packed), size)
        if len(part) != size:
            raise PictureError("a part of it has not the size that it should have")
        return part


@dataclass(frozen=True)
class _Block:
    """The place of a compressed picture."""

    at: int
    header: int  # of the file
    kind: np.dtype[np.generic]
    channels: int

    @property
    def size(self) -> int:
        return self.header & 0x3FFFFFFF

    @property
    def encoding(self) -> int:
        return self.header >> 30

    @property
    def pixel(self) -> int:
        return self.kind.itemsize * self.channels


def _check(header: Header) -> None:
    if header.magic != b"Ptex":
        raise PictureError("it is none")
    if header.format_version != 1:
        raise PictureError(f"its version is {header.format_version}; only version 1 is supported")
    if header.mesh_type != QUADS:
        raise PictureError("it is for meshes of triangles; only those of quads are supported")
    if header.data_type >= len(TYPES):
        raise PictureError(f"its type of data, {header.data_type}, is unknown")
    if header.faces == 0:
        raise PictureError("it has no faces")
    if math.prod((header.faces, header.channels)) == 0 or header.channels > 64:
        raise PictureError(f"it has {header.channels} channels")


def _channels(header: Header) -> list[int]:
    """The channels of the colour, which are three or one."""
    colours = [c for c in range(header.channels) if c != header.alpha]
    if len(colours) == 4 and header.alpha < 0:
        colours = colours[:3]  # alpha, though it is not called so
    if len(colours) == 2 and header.alpha < 0:
        colours = colours[:1]
    if len(colours) not in (1, 3):
        raise PictureError(f"its {header.channels} channels are neither RGB nor grey")
    return colours


def _is_constant(faces: Faces) -> npt.NDArray[np.bool_]:
    return (faces["flags"] & CONSTANT > 0) | (faces["size"].sum(1) == 0)
