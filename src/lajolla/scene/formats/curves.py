"""Files of curves: Mitsuba 3's text format, and the text and binary formats of Mitsuba 0.6's hair.

Curves are points (N, 3) or (N, 4) in one array, with the index of the first point of each curve.
"""

from __future__ import annotations

from itertools import chain
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..syntax.files import file_bytes

Points = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int64]

BINARY_HAIR = b"BINARY_HAIR"


def read_curves(path: Path, numbers: int) -> tuple[Points, Indices]:
    """Curves from text: a line of numbers for each point, an empty one between curves.

    Raises:
        ValueError: a line is not made of numbers, or there is no point at all.
    """
    lines = [line.split() for line in file_bytes(path).splitlines()]
    breaks = np.array([not line or line[0].startswith(b"#") for line in lines], bool)
    for i, line in enumerate(lines):
        if len(line) < numbers and not breaks[i]:
            raise ValueError(f"line {i + 1}: expected {numbers} numbers")
    given = np.flatnonzero(~breaks)
    points = _floats(lines, given, numbers)
    first = np.flatnonzero(np.diff(given, prepend=-2) > 1)
    return _checked(points, first)


def read_hair(path: Path) -> tuple[Points, Indices]:
    """Hair of Mitsuba 0.6, text or binary.

    Raises:
        ValueError: the file does not hold what it says.
    """
    data = file_bytes(path)
    return _binary_hair(data[len(BINARY_HAIR) :]) if data.startswith(BINARY_HAIR) else read_curves(path, 3)


def _floats(lines: list[list[bytes]], given: Indices, numbers: int) -> Points:
    try:
        flat = list(chain.from_iterable(lines[i][:numbers] for i in given))
        return np.array(flat, dtype=np.bytes_).astype(np.float32).reshape(-1, numbers)
    except ValueError:
        bad = next(i for i in given if not all(map(_is_number, lines[i][:numbers])))
        raise ValueError(f"line {bad + 1}: expected {numbers} numbers") from None


def _is_number(text: bytes) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _binary_hair(data: bytes) -> tuple[Points, Indices]:
    """A count of vertices, then their coordinates; an infinite number precedes the first one of a hair."""
    if len(data) < 4:
        raise ValueError("the file ends early")
    count = int(np.frombuffer(data, "<u4", 1)[0])
    values = np.frombuffer(data, "<f4", (len(data) - 4) // 4, 4).astype(np.float32)
    marks = np.flatnonzero(np.isinf(values))
    coordinates = np.delete(values, marks)
    before = marks - np.arange(len(marks))  # coordinates before each mark
    if len(coordinates) < 3 * count:
        raise ValueError(f"the file ends early: it has {len(coordinates) // 3} of {count} vertices")
    if np.any(before % 3):
        raise ValueError("a new hair begins within a vertex")
    starts = before[before < 3 * count] // 3
    return _checked(coordinates[: 3 * count].reshape(-1, 3), np.unique(np.append(0, starts)))


def _checked(points: Points, first: Indices) -> tuple[Points, Indices]:
    if len(points) == 0:
        raise ValueError("there are no points in it")
    if not np.all(np.isfinite(points)):
        raise ValueError(f"point {np.argmin(np.isfinite(points).all(axis=1)) + 1} is not finite")
    return points, first


def lengths(first: Indices, count: int) -> Indices:
    """The number of points of each curve."""
    return np.diff(np.append(first, count))


def segment_starts(first: Indices, count: int, needed: int) -> npt.NDArray[np.uint32]:
    """The first point of every run of `needed` points within a curve."""
    index = np.arange(count)
    ends = np.repeat(np.append(first, count)[1:], lengths(first, count))
    return index[index + needed <= ends].astype(np.uint32)


def thinned(points: Points, first: Indices, reduction: float) -> tuple[Points, Indices]:
    """A random part of the curves, always the same one."""
    kept = np.random.default_rng(0).random(len(first)) >= reduction
    size = lengths(first, len(points))
    return points[np.repeat(kept, size)], np.cumsum(np.append(0, size[kept]))[:-1]


def straightened(points: Points, first: Indices, degrees: float) -> tuple[Points, Indices]:
    """Hair without the points at which it turns by less than an angle, as Mitsuba 0.6 leaves them out.

    All hairs are walked at once, point by point.
    """
    size = lengths(first, len(points))
    kept = np.zeros(len(points), bool)
    kept[first] = True
    last, previous = first.copy(), first.copy()  # the points kept last and before
    walked = points[first].astype(float)  # the last point, kept or not
    tangent = np.zeros((len(first), 3))
    for step in range(1, int(size.max(initial=0))):
        hair = np.flatnonzero(size > step)
        here = first[hair] + step
        direction = points[here] - walked[hair]
        moved = np.any(direction != 0, axis=1)
        hair, here, direction = hair[moved], here[moved], _unit(direction[moved])
        cosine = np.einsum("ij,ij->i", direction, tangent[hair])
        straight = (cosine > np.cos(np.radians(degrees))) & np.any(tangent[hair] != 0, axis=1)
        kept[last[hair[straight]]] = False
        kept[here] = True
        previous[hair[~straight]] = last[hair[~straight]]
        last[hair] = here
        whole = _unit(points[here].astype(float) - points[previous[hair]])
        tangent[hair] = np.where(straight[:, None], whole, direction)
        walked[hair] = points[here]
    size = np.add.reduceat(kept, first, dtype=np.int64)
    return points[kept], np.cumsum(np.append(0, size))[:-1]


def _unit(v: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
    return v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-300)
