"""A small right file of every format that scenes name, a scene that needs it, and mistakes to make in it."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st
from measured_tools import synthetic, tensor_bytes
from mesh_files import samples_of
from plugin_tools import scene_with
from ptex_files import DIFFERENCES, TILES, cube_pictures, cube_with
from voxel_files import NANOVDB, first_grid, nvdb, vol

from lajolla import image

OBJ = b"mtllib a.mtl\nv 0 0 5\nv 1 0 5\nv 0 1 5\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n"
MTL = (
    b"newmtl a\nKd 0.5 0.25 1\nKs 0.2 0.2 0.2\nNs 50\nillum 2\nmap_Kd a.png\nbump -bm 0.2 a.png\n"
    b"newmtl b\nd 0.5\nillum 4\nmap_d a.png\n"
)
CURVES = (
    b"0 0 5 0.1\n0.5 0 5 0.1\n1 0.5 5 0.2\n1 1 5 0.1\n\n# a remark\n0 0 4 1\n0 1 4 1\n0 1 5 1\n1 1 5 .5\n"
)
SPECTRUM = b"# wavelength value\n400 0.5\n500.5 1e-1\n700 2\n"


def hair() -> bytes:
    """Two hairs in the binary format of Mitsuba 0.6."""
    points = np.array([[-1, 0, 5], [0, 0, 5], [1, 0, 5], [np.inf, 0, 1], [5, 0, 2]], "<f4")
    values = np.append(points.ravel()[:10], [0, 1, 5, 0, 2, 5])
    return b"BINARY_HAIR" + struct.pack("<I", 5) + values.astype("<f4").tobytes()


def grids() -> tuple[bytes, ...]:
    """.vol files of every kind of numbers and channels."""
    kinds: tuple[tuple[str, int, int], ...] = (("<f4", 1, 1), ("<f2", 2, 3), ("u1", 3, 1), ("<f4", 1, 6))
    box = (-1.0, -1.0, 4.0, 1.0, 1.0, 6.0)
    values = np.arange(144) % 3
    return tuple(
        vol(values[: 24 * channels].reshape(2, 3, 4, channels).astype(kind), encoding, box=box)
        for kind, encoding, channels in kinds
    )


def measurements() -> tuple[bytes, ...]:
    """Measured materials, in RGB and as spectra."""
    return tuple(tensor_bytes(synthetic(channels=channels, size=8)) for channels in (3, 5))


def pictures_of_faces() -> tuple[bytes, ...]:
    """Ptex files in several encodings."""
    files = [cube_pictures(kind) for kind in ("f4", "u1", "u2")]
    for file, encoding in zip(files, (TILES, DIFFERENCES, TILES), strict=True):
        for face in file.faces:
            face.encoding = encoding
            face.texels[0, 0] = 0.5
    return tuple(file.content() for file in files)


def picture(name: str, folder: Path, channels: int = 3) -> bytes:
    """A picture as our own writer makes it."""
    path = folder / name
    image.write(path, np.linspace(0, 1, 4 * 5 * 3).reshape(4, 5, 3).astype(np.float32))
    return path.read_bytes()


@dataclass(frozen=True)
class Format:
    """Where files of a format stand, and some of them."""

    ending: str
    uses: tuple[Callable[[str], dict[str, Any]], ...]  # scenes that need the file of a name
    samples: tuple[bytes, ...]
    beside: bytes = b""  # an OBJ file that names it


def shape(plugin: str, **more: Any) -> Callable[[str], dict[str, Any]]:  # noqa: ANN401
    return lambda name: scene_with("shape", {"type": plugin, "filename": name, **more})


def surface(plugin: str) -> Callable[[str], dict[str, Any]]:
    return shape(plugin, subdivision=True, subdivision_level=1)


def texture(**more: Any) -> Callable[[str], dict[str, Any]]:  # noqa: ANN401
    return lambda name: scene_with("texture", {"type": "bitmap", "filename": name, **more})


def sky(name: str) -> dict[str, Any]:
    return scene_with("emitter", {"type": "envmap", "filename": name})


def volume(name: str) -> dict[str, Any]:
    inside = {"type": "heterogeneous", "sigma_t": {"type": "gridvolume", "filename": name}}
    return {**scene_with("medium", inside), "light": {"type": "constant"}, "how": {"type": "volpath"}}


def spectrum(name: str) -> dict[str, Any]:
    return scene_with("texture", {"type": "spectrum", "filename": name})


def faces(name: str) -> dict[str, Any]:
    return scene_with("shape", cube_with(name))


def measured(name: str) -> dict[str, Any]:
    return scene_with("bsdf", {"type": "measured", "filename": name})


def formats(folder: Path) -> dict[str, Format]:
    """All formats, by name. The folder gets what some of the scenes need beside."""
    for name in ("a.png", "a.exr"):
        picture(name, folder)
    seen = (texture(), sky, shape("heightfield"))
    return {
        "obj": Format(".obj", (shape("obj", load_materials=True), surface("obj")), (OBJ, *samples_of("obj"))),
        "mtl": Format(".mtl", (lambda name: scene_with("shape", {"type": "obj", "filename": "beside.obj",
                      "load_materials": True}),), (MTL,), OBJ.replace(b"a.mtl", b"broken.mtl")),
        "ply": Format(".ply", (shape("ply"), surface("ply")), samples_of("ply")),
        "serialized": Format(".serialized", (shape("serialized"),), samples_of("serialized")),
        "curves": Format(".txt", (shape("linearcurve"), shape("bsplinecurve")), (CURVES,)),
        "hair": Format(".hair", (shape("hair", angle_threshold=5.0),), (hair(), CURVES)),
        "vol": Format(".vol", (volume, shape("sdfgrid")),
                      grids()),
        "nvdb": Format(".nvdb", (volume,), (nvdb(*first_grid()), NANOVDB.read_bytes())),
        "vdb": Format(".vdb", (volume,), (b" BDV\0\0\0\0" + bytes(200),)),
        "tensors": Format(".bsdf", (measured,), measurements()),
        "ptx": Format(".ptx", (faces,), pictures_of_faces()),
        "spectrum": Format(".spd", (spectrum,), (SPECTRUM,)),
        **{
            ending[1:]: Format(ending, seen, (picture("a" + ending, folder),))
            for ending in (".exr", ".hdr", ".pfm", ".png", ".jpg")
        },
    }  # fmt: skip


# What is put into files: numbers at the edges of their types, words, and line ends.
PIECES = (
    *(bytes(n) for n in (0, 1, 16)), *(b"\xff" * n for n in (1, 4, 8)), b"\x7f", b"\xff\xff\xff\x7f",
    b"\0\0\0\x80", b"\xff" * 7 + b"\x7f", b"\0\0\x80\x7f", b"\0\0\xc0\x7f", b"\1\0\0\0", b"\xc3", b"\n", b" ",
    *b"nan -inf 1e39 1e400 -1 0 4294967296 99999999999999999999 / \\ # <".split(),
)  # fmt: skip
EDITS = ("overwrite", "insert", "cut", "repeat", "move", "end")
LARGE = 1 << 16


@st.composite
def mistakes(draw: Any) -> list[tuple[str, int, int, bytes]]:  # noqa: ANN401
    """Up to six edits: what to do, where, with how many bytes, and what to write."""
    edit = st.tuples(
        st.sampled_from(EDITS), st.integers(0, LARGE), st.integers(1, 64), st.sampled_from(PIECES)
    )
    return draw(st.lists(edit, max_size=6))


def edited(data: bytes, edits: list[tuple[str, int, int, bytes]]) -> bytes:
    """A file with mistakes in it; half of them are in the first kilobyte, where headers are."""
    result = bytearray(data)
    for what, place, length, piece in edits:
        reach = min(len(result), 1024) if place % 2 else len(result)
        at = place * reach // (LARGE + 1)
        if what == "overwrite":
            result[at : at + len(piece)] = piece
        elif what == "insert":
            result[at:at] = piece
        elif what == "cut":
            del result[at : at + length]
        elif what == "repeat":
            result[at:at] = result[at : at + length]
        elif what == "move":
            result[at : at + length] = result[:length]
        elif place < LARGE // 8:
            del result[at:]
    return bytes(result)
