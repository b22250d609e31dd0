"""Arrays of pictures in matplotlib, which is no part of the package's dependencies."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lajolla.messages import installing
from lajolla.picture_files import ImageError


def plotted(values: NDArray[Any], label: str, axes: Any = None) -> Any:  # noqa: ANN401
    """Draws an array: 8-bit colours as they are, vectors as (v + 1) / 2, numbers with a colour bar.

    Args:
        values: (height, width) or (height, width, channels).
        label: of the colour bar.
        axes: matplotlib's axes to draw in; None: new ones.

    Returns:
        The axes. Raises ImageError if matplotlib is not installed.
    """
    try:
        from matplotlib import pyplot
    except ImportError:
        raise ImageError(f"plot() needs matplotlib: {installing('matplotlib')}") from None
    shown = values if values.ndim == 2 or values.dtype == np.uint8 else _as_colours(values)
    axes = pyplot.figure().add_subplot() if axes is None else axes
    drawn = axes.imshow(shown, interpolation="nearest")
    axes.set_axis_off()
    if shown.ndim == 2:
        axes.figure.colorbar(drawn, ax=axes, label=label)
    return axes


def _as_colours(values: NDArray[Any]) -> NDArray[np.float32]:
    """Vectors and coordinates as red, green and blue."""
    count = min(values.shape[2], 3)
    colours = np.zeros((*values.shape[:2], 3), np.float32)
    colours[..., :count] = (values[..., :count] + 1) / 2 if count == 3 else values[..., :count]
    return np.clip(colours, 0, 1)
