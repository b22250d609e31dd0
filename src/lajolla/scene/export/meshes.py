"""Decides which mesh files Mitsuba 3 reads identically."""

from __future__ import annotations

import re
from pathlib import Path

HEADER_END = re.compile(rb"\bend_header[ \t]*\r?\n")
MOST_OF_HEADER = 1 << 16
LIST = re.compile(r"property\s+list\s+\S+\s+\S+\s+(\S+)")
SCALAR = re.compile(r"property\s+(\S+)\s+(\S+)")
FLOATS = ("float", "float32", "double", "float64")
COORDINATES = ("x", "y", "z", "nx", "ny", "nz", "u", "v", "s", "t", "texture_u", "texture_v")
COLOURS = ("r", "g", "b", "red", "green", "blue")
# A byte order mark, negative indices, lines that go on in the next one, and single texture coordinates.
NOT_READ = re.compile(
    rb"\A\xef\xbb\xbf|^[ \t]*f[ \t][^\n]*-|\\[ \t]*\r?$|^[ \t]*vt[ \t]+\S+[ \t]*\r?$", re.MULTILINE
)


def reads_alike(path: Path, plugin: str, triangles: int) -> bool:
    """Whether Mitsuba 3 reads a file identically.

    Args:
        plugin: "obj", "ply" or "serialized".
        triangles: how many there are in it.
    """
    if plugin == "ply":
        with path.open("rb") as file:
            return _is_plain_ply(file.read(MOST_OF_HEADER), triangles)
    return plugin != "obj" or NOT_READ.search(path.read_bytes()) is None


def _is_plain_ply(start: bytes, triangles: int) -> bool:
    """Triangles as one list, floating-point numbers, and no words that Mitsuba does not know."""
    end = HEADER_END.search(start)
    if end is None:
        return False
    lines = [line.strip() for line in start[: end.start()].decode("latin-1").splitlines()]
    faces = [int(n) for n in re.findall(r"^element\s+face\s+(\d+)", "\n".join(lines), re.MULTILINE)]
    lists = [match[1] for line in lines if (match := LIST.match(line))]
    scalars = [
        (match[1], match[2]) for line in lines if not LIST.match(line) and (match := SCALAR.match(line))
    ]
    return (
        faces == [triangles]
        and lists in (["vertex_indices"], ["vertex_index"])
        and not any(line.startswith("obj_info") for line in lines)
        and not any(_is_value(name) and kind not in FLOATS for kind, name in scalars)
    )


def _is_value(name: str) -> bool:
    return name in COORDINATES + COLOURS or name.endswith(("_r", "_g", "_b", "_a"))
