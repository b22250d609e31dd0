"""Ray queries in bulk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lajolla import _core
from lajolla.colour import FloatImage
from lajolla.messages import shortened
from lajolla.scene import Description, numbered

Ids = NDArray[np.int32]
Positions = NDArray[np.float64]
RayRows = tuple[NDArray[Any], FloatImage, FloatImage]  # origins of float32 or float64


@dataclass(frozen=True)
class Intersections:
    """Where N rays meet surfaces. Without a hit, distance is infinite, ids are -1, and all else is zero.

    Attributes:
        distance: (N,) in lengths of the ray's direction.
        position: (N, 3) in world space, float64: far from the origin, float32 does not suffice.
        normal: (N, 3) shading normal, of unit length, as vertices have it.
        geometric_normal: (N, 3) on the front side of the surface, of unit length.
        uv: (N, 2) texture coordinates.
        shape: (N,) the shape: a number for `shape_names`.
        primitive: (N,) the triangle, or the like, within it.
        instance: (N,) the instance that the shape is in, -1 for none.
    """

    distance: FloatImage
    position: Positions
    normal: FloatImage
    geometric_normal: FloatImage
    uv: FloatImage
    shape: Ids
    primitive: Ids
    instance: Ids
    _description: Description | None = field(default=None, repr=False)

    @property
    def hit(self) -> NDArray[np.bool_]:
        """(N,) whether the ray meets anything."""
        return self.shape >= 0

    @cached_property
    def shape_names(self) -> Sequence[str]:
        """The name of each number in `shape`: its id, or one made of its number, as in layers of ids."""
        if self._description is None:
            return ()
        known = numbered(self._description.objects, self._description.core, "shapes")
        return [known.names[number] for number in known.numbers]


def intersections_of(
    core: _core.Scene,
    description: Description,
    origins: ArrayLike,
    directions: ArrayLike,
    max_distance: ArrayLike,
    threads: int,
) -> Intersections:
    """See `Scene.intersect`."""
    found = _core.intersect(core, *_rays(origins, directions, max_distance), threads)
    return Intersections(**found, _description=description)


def occlusion_of(
    core: _core.Scene, origins: ArrayLike, directions: ArrayLike, max_distance: ArrayLike, threads: int
) -> NDArray[np.bool_]:
    """See `Scene.occluded`."""
    return np.asarray(_core.occluded(core, *_rays(origins, directions, max_distance), threads))


def _rays(origins: ArrayLike, directions: ArrayLike, max_distance: ArrayLike) -> RayRows:
    """Rows of the core's types, one or as many as there are rays. Raises ValueError."""
    starts = np.ascontiguousarray(_rows("origins", origins))
    if starts.dtype != np.float32:
        starts = starts.astype(np.float64, copy=False)
    along = _as_float32(_rows("directions", directions))
    ends = _as_float32(_ends(max_distance))
    counts = {len(starts), len(along), len(ends)} - {1}
    if len(counts) > 1:
        lengths = f"{len(starts)}, {len(along)} and {len(ends)}"
        raise ValueError(f"origins, directions and max_distance have {lengths} rows")
    if counts == {0}:  # of none, one is none
        return starts[:0], along[:0], ends[:0]
    return starts, along, ends


def _rows(name: str, values: ArrayLike) -> NDArray[Any]:
    table = _numbers(name, values)
    if table.ndim == 1:
        table = table[None]
    if table.ndim != 2 or table.shape[1] != 3:
        raise ValueError(f"{name} must have the shape (N, 3), not {np.shape(values)}")
    return table


def _ends(max_distance: ArrayLike) -> NDArray[Any]:
    ends = np.atleast_1d(_numbers("max_distance", max_distance))
    if ends.ndim != 1:
        raise ValueError(f"max_distance must be a number or have the shape (N,), not {ends.shape}")
    if np.isnan(ends).any():
        raise ValueError("max_distance must be numbers, not NaN; infinite where rays do not end")
    return ends


def _numbers(name: str, values: ArrayLike) -> NDArray[Any]:
    """An array of real numbers; also of a tensor, which has no dtype of NumPy before it is one."""
    table = np.asarray(values)
    if table.size and table.dtype.kind not in "fiub":
        raise ValueError(f"{name} must be numbers, not {shortened(repr(values))}")
    return table if table.dtype.kind == "f" else table.astype(np.float64)


def _as_float32(numbers: NDArray[Any]) -> FloatImage:
    with np.errstate(over="ignore"):  # what is too large is infinite
        return np.ascontiguousarray(numbers, np.float32)
