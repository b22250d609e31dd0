"""Transforms as 4 x 4 matrices of float64, for `to_world` of scene dicts and parameters.

They act on columns: `translate((0, 0, 5)) @ rotate((0, 1, 0), 30)` rotates first.

lajolla.load_dict({..., "sensor": {"type": "perspective", "to_world": look_at((0, 2, 5), (0, 0, 0))}})
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from lajolla.scene.syntax import transforms

Matrix = npt.NDArray[np.float64]
Triple = Sequence[float] | npt.NDArray[np.floating]


def _three(name: str, value: Triple) -> Matrix:
    try:
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be three finite numbers, not {value!r}") from None
    if array.shape != (3,) or not np.all(np.isfinite(array)):
        raise ValueError(f"{name} must be three finite numbers, not {value!r}")
    return array


def translate(offset: Triple) -> Matrix:
    """Moves by a vector. Raises ValueError unless it is three finite numbers."""
    return transforms.translate(_three("offset", offset))


def scale(factors: float | Triple) -> Matrix:
    """Scales by one factor, or by one along each axis. Raises ValueError for other values."""
    factor: Any = factors
    return transforms.scale(_three("factors", (factor,) * 3 if np.ndim(factor) == 0 else factor))


def rotate(axis: Triple, degrees: float) -> Matrix:
    """Rotates about an axis through the origin, counterclockwise if it points to the viewer.

    Raises ValueError if the axis has no length, or the angle is not finite.
    """
    vector = _three("axis", axis)
    if not np.any(vector):
        raise ValueError("the axis of a rotation has no length")
    if not math.isfinite(degrees):
        raise ValueError(f"the angle of a rotation must be finite, not {degrees}")
    _, exponent = np.frexp(np.max(np.abs(vector)))  # so that no square vanishes or overflows
    return transforms.rotate(np.ldexp(vector, -exponent), degrees)


def look_at(origin: Triple, target: Triple, up: Triple = (0.0, 1.0, 0.0)) -> Matrix:
    """Places a camera, or anything else that looks along +z, at `origin`, so that it looks at `target`.

    Its +y is as near to `up` as can be, and its +x points to the left.

    Raises:
        ValueError: origin and target are the same, or up points along the view.
    """
    points = [_three(name, value) for name, value in (("origin", origin), ("target", target), ("up", up))]
    try:
        return transforms.look_at(*points)
    except ValueError:
        raise ValueError("origin and target are the same, or up points along the view") from None
