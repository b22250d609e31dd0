"""Error measures between pictures."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lajolla.messages import names_checked
from lajolla.picture_files import ImageError


@dataclass(frozen=True)
class Comparison:
    """How far picture A is from the reference B: arrays of one value per channel (red, green, blue)."""

    mean_ratio: NDArray[np.float64]
    rmse: NDArray[np.float64]
    relative_mse: NDArray[np.float64]
    excluded: int  # pixels that are not finite in one of the pictures


@names_checked
def compare(a: ArrayLike, b: ArrayLike, *, epsilon: float = 1e-2) -> Comparison:
    """Compares A with the reference B, both linear RGB of one shape (height, width, 3).

    relative_mse is the mean of (A - B)^2 / (B^2 + epsilon). Raises ImageError for different sizes, or when
    no finite pixel is left.
    """
    x, y, finite = _comparable(a, b)
    if not finite.any():
        raise ImageError("no pixel is finite in both pictures")
    x, y = x[finite], y[finite]
    squared = (x - y) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = x.mean(axis=0) / y.mean(axis=0)
    return Comparison(
        mean_ratio=ratio,
        rmse=np.sqrt(squared.mean(axis=0)),
        relative_mse=(squared / (y**2 + epsilon)).mean(axis=0),
        excluded=int(finite.size - finite.sum()),
    )


@names_checked
def difference_picture(a: ArrayLike, b: ArrayLike, *, epsilon: float = 1e-2) -> NDArray[np.uint8]:
    """8-bit RGB of the relative difference: red where A is brighter than B, blue where darker.

    Full colour stands for a difference of half the reference; pixels that are not finite are yellow.
    """
    x, y, finite = _comparable(a, b)
    x, y = np.where(finite[..., None], x, 0).mean(axis=2), np.where(finite[..., None], y, 0).mean(axis=2)
    relative = np.clip(2 * (x - y) / np.sqrt(y**2 + epsilon), -1, 1)
    picture = np.zeros((*relative.shape, 3))
    picture[..., 0] = np.maximum(relative, 0)
    picture[..., 2] = np.maximum(-relative, 0)
    picture[~finite] = (1, 1, 0)
    return np.rint(255 * picture).astype(np.uint8)


def _comparable(
    a: ArrayLike, b: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    x, y = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if x.shape != y.shape:
        sizes = [f"{array.shape[1]} x {array.shape[0]}" for array in (x, y)]
        raise ImageError(f"the pictures differ in size: {sizes[0]} and {sizes[1]}")
    return x, y, np.asarray(np.isfinite(x).all(axis=2) & np.isfinite(y).all(axis=2))
