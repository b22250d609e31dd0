"""The operations of a <transform> as matrices (double precision, column vectors)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from .element import Element
from .errors import Location, SceneError, did_you_mean
from .expand import required
from .literals import Text, parse_float, parse_floats
from .members import Irregular, numbers_of
from .nodes import Array, Column

Number: TypeAlias = Any  # a float, or of all members of a run an array (count,)
Rows: TypeAlias = list[list[Number]]  # of a matrix
Truth: TypeAlias = bool | npt.NDArray[np.bool_]

LARGEST = 1e30  # sum of the numbers in a matrix
LAST_ROW = [0.0, 0.0, 0.0, 1.0]


def is_even(matrix: Array, tolerance: float) -> Truth:
    """Whether matrices, of shape (..., 4, 4), scale uniformly without shear, within a tolerance."""
    (a, b, c), (d, e, f), (g, h, i) = _linear(matrix)
    squares = (a * a + d * d + g * g, b * b + e * e + h * h, c * c + f * f + i * i)
    products = (a * b + d * e + g * h, a * c + d * f + g * i, b * c + e * f + h * i)
    size = (squares[0] + squares[1] + squares[2]) / 3
    result: Truth = True
    for off in (*(square - size for square in squares), *products):
        result = result & (abs(off) <= tolerance * size)
    return result


def turns_over(matrix: Array) -> Truth:
    """Whether matrices, of shape (..., 4, 4), have a negative determinant."""
    (a, b, c), (d, e, f), (g, h, i) = _linear(matrix)
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) < 0


def _linear(matrix: Array) -> Rows:
    """The nine numbers, or columns of numbers, that turn and scale."""
    if matrix.ndim == 2:
        return [row[:3] for row in matrix[:3].tolist()]
    return [[matrix[..., row, column] for column in range(3)] for row in range(3)]


def translate(offset: Array) -> Array:
    """Translation by a vector."""
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


def scale(factors: Array) -> Array:
    """Scaling along the axes."""
    return np.diag([*factors, 1.0])


def rotate(axis: Array, degrees: float) -> Array:
    """Rotation about an axis through the origin (Rodrigues)."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    matrix = np.eye(4)
    matrix[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return matrix


def look_at(origin: Array, target: Array, up: Array) -> Array:
    """Camera to world: at `origin`, +z towards `target`, +y as near to `up` as can be, +x to the left.

    Raises:
        ValueError: the three do not span a frame.
    """
    forward = target - origin
    left = np.cross(up, forward)
    if not np.any(forward) or np.linalg.norm(left) <= 1e-12 * np.linalg.norm(up) * np.linalg.norm(forward):
        raise ValueError
    forward = forward / np.linalg.norm(forward)
    left = left / np.linalg.norm(left)
    matrix = np.eye(4)
    matrix[:3] = np.stack([left, np.cross(forward, left), forward, origin], axis=1)
    return matrix


def any_perpendicular(direction: Array) -> Array:
    """Some vector at a right angle to `direction`."""
    return np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])


IDENTITY: Rows = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]


def parse_transform(element: Element) -> Array | Column:
    """The product of an element's operations; the first one applies first.

    Its numbers are multiplied one by one, so that a run has the same bits as its members alone.
    """
    rows = IDENTITY
    for operation in element.children:
        apply = OPERATIONS.get(operation.tag.lower())
        if apply is None:
            message = f"<{operation.tag}> is no transformation{did_you_mean(operation.tag, OPERATIONS)}"
            raise SceneError(message, operation.location)
        rows = apply(operation, rows)
    if any(isinstance(number, np.ndarray) for row in rows for number in row):
        stacked = stack_columns([number for row in rows for number in row])
        return checked_matrices(Column(stacked.reshape(-1, 4, 4)))
    return checked_matrix(np.array(rows), element.location)


def checked_matrix(matrix: Array, location: Location) -> Array:
    """The 4x4 matrix itself.

    Raises:
        SceneError: it is not finite, or no affine transformation.
    """
    first, second, third, last = matrix.tolist()
    if not sum(map(abs, (*first, *second, *third, *last))) <= LARGEST:
        raise SceneError("the transformation has numbers that are not finite", location)
    if last != LAST_ROW and max(abs(a - b) for a, b in zip(last, LAST_ROW, strict=True)) > 1e-6:
        raise SceneError("the last row of the transformation must be 0 0 0 1", location)
    return matrix


def checked_matrices(matrices: Column) -> Column:
    """The matrices of a run.

    Raises:
        Irregular: `checked_matrix` refuses one of them.
    """
    rows = matrices.rows
    if not np.all(np.sum(np.abs(rows), axis=(1, 2)) <= LARGEST) or np.any(
        np.abs(rows[:, 3] - LAST_ROW) > 1e-6
    ):
        raise Irregular
    return matrices


def stack_columns(numbers: Sequence[Number]) -> Array:
    """Numbers of which some are columns, side by side: (count, len(numbers))."""
    count = next(len(number) for number in numbers if isinstance(number, np.ndarray))
    result = np.empty((count, len(numbers)))
    for i, number in enumerate(numbers):
        result[:, i] = number
    return result


def parse_numbers_of(element: Element, attribute: str, counts: tuple[int, ...]) -> list[Number]:
    """The numbers of an attribute that must be there, as many as one of `counts`."""
    column = element.columns.get(attribute)
    if column is None:
        return list(parse_floats(Text(required(element, attribute), element.at(attribute)), counts))
    numbers = numbers_of(column)
    if numbers.shape[1] not in counts:
        raise Irregular
    return list(numbers.T)


def parse_xyz(element: Element, missing: float) -> list[Number]:
    """A vector from `x, y, z` or from `value` with one or three numbers."""
    if "value" in element.attributes:
        values = parse_numbers_of(element, "value", (1, 3))
        return values * 3 if len(values) == 1 else values
    return [
        parse_numbers_of(element, axis, (1,))[0] if axis in element.attributes else missing for axis in "xyz"
    ]


def _translated(element: Element, rows: Rows) -> Rows:
    offset = parse_xyz(element, 0.0)
    last = rows[3]
    moved = [
        [a + d * b for a, b in zip(row, last, strict=True)] for row, d in zip(rows[:3], offset, strict=True)
    ]
    return [*moved, last]


def _scaled(element: Element, rows: Rows) -> Rows:
    factors = parse_xyz(element, 1.0)
    return [*([a * factor for a in row] for row, factor in zip(rows[:3], factors, strict=True)), rows[3]]


def _rotated(element: Element, rows: Rows) -> Rows:
    """Rodrigues' formula, in numbers or columns."""
    axis = parse_xyz(element, 0.0)
    length = _each(math.sqrt, axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2])
    angle = parse_numbers_of(element, "angle", (1,))[0]
    if isinstance(length, np.ndarray):
        if not np.all(length > 0):
            raise Irregular
    elif not length > 0:
        raise SceneError("a rotation needs an axis that is not zero", element.location)
    x, y, z = (component / length for component in axis)
    sine, cosine = _each(_sine, angle), _each(_cosine, angle)
    rest = 1 - cosine
    turn: Rows = [
        [cosine + rest * x * x, rest * x * y - sine * z, rest * x * z + sine * y, 0.0],
        [rest * y * x + sine * z, cosine + rest * y * y, rest * y * z - sine * x, 0.0],
        [rest * z * x - sine * y, rest * z * y + sine * x, cosine + rest * z * z, 0.0],
        IDENTITY[3],
    ]
    return _product(turn, rows)


def _each(function: Callable[[float], float], numbers: Number) -> Number:
    """A function of a number or of each of a column; libraries of vectors may round otherwise."""
    if isinstance(numbers, np.ndarray):
        return np.array([function(number) for number in numbers.tolist()])
    return function(numbers)


def _sine(degrees: float) -> float:
    return math.sin(math.radians(degrees))


def _cosine(degrees: float) -> float:
    return math.cos(math.radians(degrees))


def _product(left: Rows, right: Rows) -> Rows:
    columns = list(zip(*right, strict=True))
    return [[a * p + b * q + c * r + d * s for p, q, r, s in columns] for a, b, c, d in left]


def _looking(element: Element, rows: Rows) -> Rows:
    is_oldest = "ox" in element.attributes  # before 0.3: nine attributes, and +x to the left

    def vector(name: str) -> Array:
        if is_oldest:
            names = [name[0] + axis for axis in "xyz"]
            return np.array([parse_float(Text(required(element, n), element.at(n))) for n in names])
        return np.array(parse_floats(Text(required(element, name), element.at(name)), (3,)))

    origin, target = vector("origin"), vector("target")
    has_up = "ux" in element.attributes or element.attributes.get("up", "").strip()
    up = vector("up") if has_up else np.zeros(3)
    try:
        matrix = look_at(origin, target, up if np.any(up) else any_perpendicular(target - origin))
    except ValueError:
        message = "origin and target are the same, or up points along the view"
        raise SceneError(message, element.location) from None
    if is_oldest:
        matrix = matrix @ np.diag([-1.0, 1.0, 1.0, 1.0])
    return _product(matrix.tolist(), rows)


def _multiplied(element: Element, rows: Rows) -> Rows:
    values = parse_numbers_of(element, "value", (9, 16))
    if len(values) == 9:
        values = [*values[:3], 0.0, *values[3:6], 0.0, *values[6:], 0.0, *IDENTITY[3]]
    return _product([values[i : i + 4] for i in range(0, 16, 4)], rows)


OPERATIONS: Mapping[str, Callable[[Element, Rows], Rows]] = {
    "translate": _translated,
    "scale": _scaled,
    "rotate": _rotated,
    "lookat": _looking,
    "matrix": _multiplied,
}
