"""Writers of mesh files for the tests, and what every mesh that was read must satisfy."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from lajolla import _core

Loader = Callable[..., _core.Mesh]

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)

PLY_TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "long": "i8",
    "int64": "i8",
    "ulong": "u8",
    "uint64": "u8",
    "half": "f2",
    "float16": "f2",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
PLY_FORMATS = ["ascii", "binary_little_endian", "binary_big_endian"]

# One element of a PLY file: its name, its properties, and rows of values (of lists for list properties).
Element = tuple[str, list[str], list[list]]


def encode(kind: str, values: list[float], file_format: str) -> bytes:
    """Values of one PLY type as they stand in the file."""
    if file_format == "ascii":
        return b"".join(b"%s " % str(value).encode() for value in values)
    order = "<" if file_format == "binary_little_endian" else ">"
    return np.array(values).astype(order + PLY_TYPES[kind]).tobytes()


def ply(file_format: str, *elements: Element) -> bytes:
    """A PLY file; properties are given as "float x" or "list uchar int vertex_indices"."""
    lines, body = ["ply", f"format {file_format} 1.0", "comment made by a test"], b""
    for name, properties, rows in elements:
        lines += [f"element {name} {len(rows)}", *(f"property {p}" for p in properties)]
        for row in rows:
            for declaration, value in zip(properties, row, strict=True):
                words = declaration.split()
                if words[0] == "list":
                    body += encode(words[1], [len(value)], file_format)
                    body += encode(words[2], value, file_format)
                else:
                    body += encode(words[0], [value], file_format)
            if file_format == "ascii":
                body += b"\n"
    return "\n".join([*lines, "end_header\n"]).encode() + body


def vertex_element(columns: list[str], extra: np.ndarray | None = None) -> Element:
    """The corners of the unit square with more columns beside x, y and z."""
    rows = SQUARE if extra is None else np.hstack([SQUARE, extra])
    return "vertex", ["float x", "float y", "float z", *columns], rows.tolist()


FACES: Element = ("face", ["list uchar int vertex_indices"], [[[0, 1, 2]], [[0, 2, 3]]])


def serialized_payload(
    vertices: np.ndarray,
    faces: np.ndarray,
    name: str | None = None,
    normals: np.ndarray | None = None,
    uvs: np.ndarray | None = None,
    colors: np.ndarray | None = None,
    face_normals: bool = False,
    dtype: str = "<f4",
) -> bytes:
    """One mesh of a .serialized file before compression; version 4 if it has a name."""
    flags = 0x1000 if dtype == "<f4" else 0x2000
    arrays = [vertices]
    for bit, array in ((1, normals), (2, uvs), (8, colors)):
        if array is not None:
            flags |= bit
            arrays.append(array)
    data = struct.pack("<I", flags | (0x10 if face_normals else 0))
    if name is not None:
        data += name.encode() + b"\0"
    data += struct.pack("<QQ", len(vertices), len(faces))
    return data + b"".join(a.astype(dtype).tobytes() for a in arrays) + faces.astype("<u4").tobytes()


def serialized(payloads: list[bytes], version: int) -> bytes:
    """A .serialized file with its dictionary."""
    file, offsets = b"", []
    for payload in payloads:
        offsets.append(len(file))
        file += struct.pack("<HH", 0x041C, version) + zlib.compress(payload)
    entry = "<I" if version == 3 else "<Q"
    return file + b"".join(struct.pack(entry, o) for o in offsets) + struct.pack("<I", len(offsets))


OBJ_SAMPLE = (
    "mtllib a.mtl\nv 0 0 0 1 .5 0\nv 1 0 0\nv 1 1 1e-3\nv 0 1 0\nvt 0 0\nvt 1 .5\nvn 0 0 1\n"
    "usemtl a\nf 1/1/1 2/2/1 3//1 \\\n -1\nusemtl b\nf 1 2/1 3\n"
)
PLY_ELEMENTS = (
    vertex_element(
        ["float nx", "float ny", "float nz", "uchar r", "uchar g", "uchar b"], np.ones((4, 6), int)
    ),
    ("junk", ["list ushort float a"], [[[1, 2]]]),
    ("face", ["list uchar int vertex_indices", "float w_0"], [[[0, 1, 2, 3], 1], [[2, 1, 0], 2]]),
)
SERIALIZED_SAMPLE = [
    serialized_payload(
        SQUARE, np.array([[0, 1, 2]]), "a", normals=SQUARE + 1, uvs=SQUARE[:, :2], colors=SQUARE
    ),
    serialized_payload(SQUARE, np.array([[0, 2, 3]]), "b", dtype="<f8"),
]
# A file of each kind: the reader's name, the bytes, and its arguments.
SAMPLES: dict[str, tuple[str, bytes, tuple[int, ...]]] = {
    "obj": ("obj", OBJ_SAMPLE.encode(), ()),
    **{f"ply {f}": ("ply", ply(f, *PLY_ELEMENTS), ()) for f in PLY_FORMATS},
    "serialized 3": ("serialized", serialized(SERIALIZED_SAMPLE, 3)[:-8], (0,)),
    "serialized 4": ("serialized", serialized(SERIALIZED_SAMPLE, 4), (1,)),
}


def samples_of(kind: str) -> tuple[bytes, ...]:
    """The sample files for one reader."""
    return tuple(data for reader, data, _ in SAMPLES.values() if reader == kind)


def loader(folder: Path) -> Loader:
    """A function load(kind, contents, ...) that writes a file into the folder and reads it back as a mesh."""

    def load(kind: str, data: bytes | str, *arguments: int) -> _core.Mesh:
        path = folder / f"mesh.{kind}"
        path.unlink(missing_ok=True)  # much faster than writing over the file
        path.write_bytes(data.encode() if isinstance(data, str) else data)
        return getattr(_core, f"load_{kind}")(path, *arguments)

    return load


def check(mesh: _core.Mesh) -> None:
    """What every mesh that comes out of a reader promises."""
    count = len(mesh.vertices)
    assert mesh.vertices.shape == (count, 3) and mesh.vertices.dtype == np.float32
    assert mesh.faces.shape == (len(mesh.faces), 3) and mesh.faces.dtype == np.uint32
    assert np.isfinite(mesh.vertices).all()
    assert not mesh.faces.size or mesh.faces.max() < count
    if mesh.normals is not None:
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
    if mesh.uvs is not None:
        assert mesh.uvs.shape == (count, 2) and np.isfinite(mesh.uvs).all()
    for name, values in mesh.attributes.items():
        assert len(values) == (len(mesh.faces) if name.startswith("face_") else count)
        assert np.isfinite(values).all()
    covered = 0
    for _, first, length in mesh.groups:
        assert first == covered and length > 0
        covered += length
    assert covered in (0, len(mesh.faces))
