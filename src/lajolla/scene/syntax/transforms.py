"""The operations of a <transform> as matrices (double precision, column vectors)."""

from __future__ import annotations

import numpy as np

from .elements import Element
from .errors import Location, SceneError, did_you_mean
from .expand import required
from .literals import Text, parse_float, parse_floats
from .nodes import Array


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


def parse_transform(element: Element) -> Array:
    """The product of an element's operations; the first one applies first."""
    matrix = np.eye(4)
    for operation in element.children:
        make = OPERATIONS.get(operation.tag.lower())
        if make is None:
            message = f"<{operation.tag}> is no transformation{did_you_mean(operation.tag, OPERATIONS)}"
            raise SceneError(message, operation.location)
        matrix = make(operation) @ matrix
    return checked_matrix(matrix, element.location)


def checked_matrix(matrix: Array, location: Location) -> Array:
    """The 4x4 matrix itself.

    Raises:
        SceneError: it is not finite, or no affine transformation.
    """
    if not np.all(np.isfinite(matrix)) or np.max(np.abs(matrix)) > 1e30:
        raise SceneError("the transformation has numbers that are not finite", location)
    if np.max(np.abs(matrix[3] - [0, 0, 0, 1])) > 1e-6:
        raise SceneError("the last row of the transformation must be 0 0 0 1", location)
    return matrix


def parse_xyz(element: Element, missing: float) -> Array:
    """A vector from `x, y, z` or from `value` with one or three numbers."""
    if "value" in element.attributes:
        values = parse_floats(Text(element.attributes["value"], element.at("value")), (1, 3))
        return np.array(values * 3 if len(values) == 1 else values)
    axes = [Text(element.attributes[a], element.at(a)) if a in element.attributes else None for a in "xyz"]
    return np.array([missing if text is None else parse_float(text) for text in axes])


def _parse_rotate(element: Element) -> Array:
    axis = parse_xyz(element, 0.0)
    if not np.any(axis):
        raise SceneError("a rotation needs an axis that is not zero", element.location)
    return rotate(axis, parse_float(Text(required(element, "angle"), element.at("angle"))))


def _parse_look_at(element: Element) -> Array:
    def vector(name: str) -> Array:
        return np.array(parse_floats(Text(required(element, name), element.at(name)), (3,)))

    origin, target = vector("origin"), vector("target")
    up = vector("up") if element.attributes.get("up", "").strip() else np.zeros(3)
    try:
        return look_at(origin, target, up if np.any(up) else any_perpendicular(target - origin))
    except ValueError:
        message = "origin and target are the same, or up points along the view"
        raise SceneError(message, element.location) from None


def _parse_matrix(element: Element) -> Array:
    values = parse_floats(Text(required(element, "value"), element.at("value")), (9, 16))
    if len(values) == 16:
        return np.array(values).reshape(4, 4)
    matrix = np.eye(4)
    matrix[:3, :3] = np.array(values).reshape(3, 3)
    return matrix


OPERATIONS = {
    "translate": lambda element: translate(parse_xyz(element, 0.0)),
    "scale": lambda element: scale(parse_xyz(element, 1.0)),
    "rotate": _parse_rotate,
    "lookat": _parse_look_at,
    "matrix": _parse_matrix,
}
