"""Arithmetic with pictures, pixel by pixel."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from lajolla.colour import FloatImage

if TYPE_CHECKING:
    from typing_extensions import Self

Operand: TypeAlias = "ArrayLike | Pixelwise"


class Pixelwise:
    """Operators for a picture, which has its pixels in `array`.

    Operands are pictures, arrays that NumPy broadcasts to (height, width, 3), colours (3,) and numbers.
    """

    array: FloatImage
    __array_priority__ = 1000.0  # array - picture is a picture

    def with_array(self, array: ArrayLike) -> Self:
        """A picture of these pixels that is written in the same way."""
        raise NotImplementedError

    def _combined(self, function: Callable[..., Any], *operands: Operand) -> Self:
        arrays = [item.array if isinstance(item, Pixelwise) else np.asarray(item) for item in operands]
        with np.errstate(all="ignore"):
            return self.with_array(function(*arrays))

    def __add__(self, other: Operand) -> Self:
        return self._combined(np.add, self, other)

    def __radd__(self, other: Operand) -> Self:
        return self._combined(np.add, other, self)

    def __sub__(self, other: Operand) -> Self:
        return self._combined(np.subtract, self, other)

    def __rsub__(self, other: Operand) -> Self:
        return self._combined(np.subtract, other, self)

    def __mul__(self, other: Operand) -> Self:
        return self._combined(np.multiply, self, other)

    def __rmul__(self, other: Operand) -> Self:
        return self._combined(np.multiply, other, self)

    def __truediv__(self, other: Operand) -> Self:
        return self._combined(np.divide, self, other)

    def __rtruediv__(self, other: Operand) -> Self:
        return self._combined(np.divide, other, self)

    def __pow__(self, exponent: Operand) -> Self:
        return self._combined(np.power, self, exponent)

    def __neg__(self) -> Self:
        return self._combined(np.negative, self)

    def __abs__(self) -> Self:
        return self._combined(np.abs, self)
