"""Writes Ptex files in every encoding, for tests."""

import itertools
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

HEADER = struct.Struct("<4sIIIiHHIIIIIIQII")
EXTENDED = struct.Struct("<HHHHIIQQQ")
TYPES = {"u1": 0, "u2": 1, "f2": 2, "f4": 3}
CONSTANT, ZIPPED, DIFFERENCES, TILES = range(4)

CUBE = np.array(list(itertools.product([-1, 1], repeat=3)), np.float32)
CUBE_FACES = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]], np.uint32
)


@dataclass
class Face:
    """The picture of a face, (height, width, channels) from the bottom row up, and its neighbours."""

    texels: np.ndarray
    neighbours: Sequence[int] = (-1, -1, -1, -1)
    edges: Sequence[int] = (0, 0, 0, 0)
    encoding: int = ZIPPED
    is_constant: bool = False  # one value in the file for all texels
    is_part: bool = False


@dataclass
class Ptx:
    """A file."""

    faces: Sequence[Face]
    kind: str = "u1"
    alpha: int = -1
    changes: Mapping[str, int] = field(default_factory=dict)  # of fields of the header
    edits: bytes = b""

    def content(self) -> bytes:
        """The bytes of the file."""
        channels = self.faces[0].texels.shape[2]
        infos = zlib.compress(b"".join(map(self._info, self.faces)))
        constants = b"".join(
            f.texels.astype("<f8").mean((0, 1)).astype(f"<{self.kind}").tobytes() for f in self.faces
        )
        constants = zlib.compress(constants)
        blocks = [(CONSTANT, b"") if f.is_constant else self._block(f.texels, f.encoding) for f in self.faces]
        headers = zlib.compress(b"".join(struct.pack("<I", len(b) | e << 30) for e, b in blocks))
        level = headers + b"".join(block for _, block in blocks)
        info = struct.pack("<QII", len(level), len(headers), len(self.faces))
        values = {
            "magic": b"Ptex", "version": 1, "mesh_type": 1, "data_type": TYPES[self.kind],
            "alpha": self.alpha, "channels": channels, "levels": 1, "faces": len(self.faces),
            "extended_size": EXTENDED.size, "face_info_size": len(infos), "constants_size": len(constants),
            "level_info_size": len(info), "minor_version": 4, "level_data_size": len(level),
            "metadata_size": 0, "metadata_unpacked": 0,
        } | dict(self.changes)  # fmt: skip
        body = infos + constants + info + level
        at = HEADER.size + EXTENDED.size + len(body) + 8
        extended = EXTENDED.pack(0, 0, 0, 0, 0, 0, 0, len(self.edits), at)
        return HEADER.pack(*values.values()) + extended + body + bytes(8) + self.edits

    @staticmethod
    def _info(face: Face) -> bytes:
        height, width, _ = face.texels.shape
        edges = sum(edge << 2 * i for i, edge in enumerate(face.edges))
        flags = face.is_constant * 1 + face.is_part * 8
        return struct.pack(
            "<4B4i", width.bit_length() - 1, height.bit_length() - 1, edges, flags, *face.neighbours
        )

    def _block(self, texels: np.ndarray, encoding: int) -> tuple[int, bytes]:
        height, width, _ = texels.shape
        texels = texels.astype(f"<{self.kind}")
        if encoding == CONSTANT:
            return encoding, texels[0, 0].tobytes()
        if encoding == TILES:
            return encoding, self._tiles(texels, max(height // 2, 1), max(width // 2, 1))
        planes = np.ascontiguousarray(texels.transpose(2, 0, 1)).ravel()
        if encoding == DIFFERENCES and self.kind[0] == "u":
            planes = np.diff(planes, prepend=planes.dtype.type(0))
        return encoding, zlib.compress(planes.astype(f"<{self.kind}").tobytes())

    def _tiles(self, texels: np.ndarray, height: int, width: int) -> bytes:
        """Tiles in other encodings, in turn; those with one value are constant."""
        tiles = []
        for y in range(0, texels.shape[0], height):
            for x in range(0, texels.shape[1], width):
                part = texels[y : y + height, x : x + width]
                same = (part == part[0, 0]).all()
                tiles.append(self._block(part, CONSTANT if same else (ZIPPED, DIFFERENCES)[len(tiles) % 2]))
        headers = zlib.compress(b"".join(struct.pack("<I", len(b) | e << 30) for e, b in tiles))
        sizes = struct.pack("<BBI", width.bit_length() - 1, height.bit_length() - 1, len(headers))
        return sizes + headers + b"".join(block for _, block in tiles)


def neighbours_of(faces: Sequence[Sequence[int]]) -> list[tuple[list[int], list[int]]]:
    """The neighbours of each face of a mesh of quads, and their edges."""
    sides = {(f[e], f[(e + 1) % 4]): (i, e) for i, f in enumerate(faces) for e in range(4)}
    found = [[sides.get((f[(e + 1) % 4], f[e]), (-1, 0)) for e in range(4)] for f in faces]
    return [([face for face, _ in around], [edge for _, edge in around]) for around in found]


def cube_pictures(kind: str = "f4", size: int = 4) -> Ptx:
    """A grey of its own for each face of a cube."""
    values = np.linspace(0.1, 0.9, 6)
    around = neighbours_of(CUBE_FACES.tolist())
    return Ptx([Face(np.full((size, size, 1), v), *a) for v, a in zip(values, around, strict=True)], kind)


def cube_with(filename: str, **texture: Any) -> dict[str, Any]:  # noqa: ANN401
    """The cube, with a texture of a file."""
    reflectance = {"type": "ptex", "filename": filename, **texture}
    bsdf = {"type": "diffuse", "reflectance": reflectance}
    return {"type": "mesh", "positions": CUBE, "faces": CUBE_FACES, "bsdf": bsdf}
