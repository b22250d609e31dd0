"""Linear sRGB, its encoding for displays, and CIE XYZ (IEC 61966-2-1).

Colours are in the last axis. Arrays of float32 stay so; all else is computed in double precision.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatImage = NDArray[np.float32]

# Mitsuba's digits, because its numbers are the goal; the middle row of the first is luminance.
RGB_TO_XYZ = np.array(
    [[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169], [0.019334, 0.119193, 0.950227]]
)
XYZ_TO_RGB = np.array(
    [[3.240479, -1.537150, -0.498535], [-0.969256, 1.875991, 0.041556], [0.055648, -0.204043, 1.057311]]
)


def rgb_to_xyz(rgb: ArrayLike) -> NDArray[Any]:
    """XYZ of linear sRGB."""
    return _transformed(rgb, RGB_TO_XYZ)


def xyz_to_rgb(xyz: ArrayLike) -> NDArray[Any]:
    """Linear sRGB, perhaps out of gamut, of XYZ."""
    return _transformed(xyz, XYZ_TO_RGB)


def luminance(rgb: ArrayLike) -> NDArray[Any]:
    """Luminance of linear sRGB; the last axis is kept with length one."""
    return _transformed(rgb, RGB_TO_XYZ[1:2])


def encode_srgb(linear: ArrayLike) -> NDArray[Any]:
    """The transfer function of sRGB, of values clamped to [0, 1]."""
    x = np.clip(_floating(linear), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055).astype(x.dtype)


def decode_srgb(encoded: ArrayLike) -> NDArray[Any]:
    """The inverse of `encode_srgb`, for values in [0, 1]."""
    x = _floating(encoded)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4).astype(x.dtype)


def _transformed(values: ArrayLike, matrix: NDArray[Any]) -> NDArray[Any]:
    x = _floating(values)
    return x @ matrix.T.astype(x.dtype)


def _floating(values: ArrayLike) -> NDArray[Any]:
    x = np.asarray(values)
    return x if x.dtype == np.float32 else x.astype(np.float64)
