"""Ray queries in bulk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lajolla import _core
from lajolla.colour import FloatImage
from lajolla.scene import Description, numbered

Ids = NDArray[np.int32]
RayRows = tuple[FloatImage, FloatImage, FloatImage]


@dataclass(frozen=True)
class Intersections:
    """Where N rays meet surfaces. Without a hit, distance is infinite, ids are -1, and all else is zero.

    Attributes:
        distance: (N,) in lengths of the ray's direction.
        position: (N, 3) in world space.
        normal: (N, 3) shading normal, of unit length, as vertices have it.
        geometric_normal: (N, 3) on the front side of the surface, of unit length.
        uv: (N, 2) texture coordinates.
        shape: (N,) the shape: a number for `shape_names`.
        primitive: (N,) the triangle, or the like, within it.
        instance: (N,) the instance that the shape is in, -1 for none.
    """

    distance: FloatImage
    position: FloatImage
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
    """Rows of float32, one or as many as there are rays. Raises ValueError."""
    rows = [_rows("origins", origins), _rows("directions", directions)]
    ends = np.ascontiguousarray(max_distance, np.float32).reshape(-1)
    counts = {len(rows[0]), len(rows[1]), len(ends)} - {1}
    if len(counts) > 1:
        lengths = f"{len(rows[0])}, {len(rows[1])} and {len(ends)}"
        raise ValueError(f"origins, directions and max_distance have {lengths} rows")
    if counts == {0}:  # of none, one is none
        return rows[0][:0], rows[1][:0], ends[:0]
    return rows[0], rows[1], ends


def _rows(name: str, values: ArrayLike) -> FloatImage:
    table = np.ascontiguousarray(values, np.float32)
    if table.ndim == 1:
        table = table[None]
    if table.ndim != 2 or table.shape[1] != 3:
        raise ValueError(f"{name} must have the shape (N, 3), not {np.shape(values)}")
    return table
