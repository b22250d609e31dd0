"""Adaptive quadrature over domains with coordinates, in cells that follow the samples of a density."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

LEAF = 48  # guide points of a cell
TOLERANCE = 1e-6  # of the integral over one box


@dataclass(frozen=True)
class Domain:
    """A set of points with coordinates in a box, chosen such that equal boxes have equal measure.

    `cuts` are coordinates, one list per dimension, where densities may jump.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    cuts: tuple[tuple[float, ...], ...]
    to_points: Callable[[np.ndarray], np.ndarray]
    to_coordinates: Callable[[np.ndarray], np.ndarray]


def sphere(axis: tuple[float, float, float] = (0, 1, 0)) -> Domain:
    """The unit sphere in cylindrical coordinates (cosine, angle) around an axis of the plane z = 0.

    Directions at right angles to the axis have the finest coordinates: lobes belong there. The angle counts
    from +z, so that both hemispheres are boxes.
    """
    a = np.asarray(axis, float)
    side = np.cross(a, (0, 0, 1))

    def to_points(coordinates: np.ndarray) -> np.ndarray:
        height, angle = coordinates[:, 0], coordinates[:, 1]
        radius = np.sqrt(np.maximum(1 - height**2, 0))
        across = radius * np.sin(angle)
        points = height[:, None] * a + across[:, None] * side
        points[:, 2] = radius * np.cos(angle)
        return points

    def to_coordinates(points: np.ndarray) -> np.ndarray:
        points = points.astype(float)
        return np.stack([points @ a, np.arctan2(points @ side, points[:, 2])], axis=1)

    return Domain((-1, -np.pi), (1, np.pi), ((), (-np.pi / 2, np.pi / 2)), to_points, to_coordinates)


def box(
    lower: tuple[float, ...], upper: tuple[float, ...], cuts: tuple[tuple[float, ...], ...] | None = None
) -> Domain:
    """A box of the line, the plane, ... whose points are their own coordinates."""
    return Domain(lower, upper, cuts or ((),) * len(lower), np.copy, lambda points: points.astype(float))


class Cells:
    """A k-d tree around guide points: its cells are compared by chi-square, its boxes are integrated.

    A cell holds LEAF guide points. It is divided further into boxes until the density at the guide points
    explains how many they are: a box much larger than that hides a narrow lobe from the nodes of a
    quadrature. Guide points count in all boxes within their reach, the distance to their neighbours, so that
    the flank of a lobe is seen.
    """

    def __init__(self, domain: Domain, guide: np.ndarray, density: np.ndarray, points: np.ndarray) -> None:
        self.lower: list[np.ndarray] = []
        self.upper: list[np.ndarray] = []
        self.owner: list[int] = []
        self.counts: list[int] = []
        self.total = max(len(guide), 1)
        density = np.maximum(density.astype(float), 1e-3)
        reach = (self.total * density) ** (-1 / guide.shape[1])
        for low, high in pieces(domain):
            near = np.all((guide + reach[:, None] >= low) & (guide - reach[:, None] < high), axis=1)
            inside = np.all((points >= low) & (points < high), axis=1)
            self.divide(low, high, Guide(guide[near], density[near], reach[near]), points[inside], 0)

    def boxes(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array(self.lower), np.array(self.upper)

    def divide(
        self, low: np.ndarray, high: np.ndarray, guide: Guide, points: np.ndarray | None, axis: int
    ) -> None:
        """Adds the cells of a part of the domain, or the boxes of one cell where `points` is None."""
        tiny = bool((high - low).max() < 1e-9)
        if points is not None and (tiny or guide.count_within(low, high) <= LEAF):
            self.counts.append(len(points))
            points = None
        if points is None and (tiny or guide.is_resolved(low, high, self.total)):
            for box_low, box_high in graded_boxes(low, high, guide):
                self.lower.append(box_low)
                self.upper.append(box_high)
                self.owner.append(len(self.counts) - 1)
            return
        split = guide.median(axis, low[axis], high[axis])
        for side in (0, 1):
            corner = (high if side == 0 else low).copy()
            corner[axis] = split
            inside = None if points is None else points[(points[:, axis] >= split) == side]
            bounds = (low, corner) if side == 0 else (corner, high)
            self.divide(*bounds, guide.beside(axis, split, side), inside, (axis + 1) % len(low))


@dataclass(frozen=True)
class Guide:
    """Points (N, d) that show where the density is, its value there and the distances to their neighbours."""

    points: np.ndarray
    density: np.ndarray
    reach: np.ndarray

    def count_within(self, low: np.ndarray, high: np.ndarray) -> int:
        return int(np.all((self.points >= low) & (self.points < high), axis=1).sum())

    def beside(self, axis: int, split: float, side: int) -> Guide:
        offset = self.points[:, axis] - split
        mine = offset + self.reach >= 0 if side else offset - self.reach < 0
        return Guide(self.points[mine], self.density[mine], self.reach[mine])

    def median(self, axis: int, low: float, high: float) -> float:
        """A coordinate in the midst of the points that is well within the box."""
        middle = len(self.points) // 2
        return float(
            np.clip(
                np.partition(self.points[:, axis], middle)[middle],
                0.9 * low + 0.1 * high,
                0.1 * low + 0.9 * high,
            )
        )

    def is_resolved(self, low: np.ndarray, high: np.ndarray, total: int) -> bool:
        if len(self.points) < 2:
            return True
        extent = np.ptp(np.clip(self.points, low, high), axis=0)
        return extent.prod() * self.density.mean() < 3 * len(self.points) / total


def pieces(domain: Domain) -> list[tuple[np.ndarray, np.ndarray]]:
    """The domain's box, divided at its cuts."""
    edges = [
        [low, *cuts, np.nextafter(high, np.inf)]
        for low, cuts, high in zip(domain.lower, domain.cuts, domain.upper, strict=True)
    ]
    return grid(edges)


def grid(edges: list[list[float]]) -> list[tuple[np.ndarray, np.ndarray]]:
    """The boxes between edges, one sorted list per dimension."""
    spans = [[(a, b) for a, b in itertools.pairwise(e) if b > a] for e in edges]
    return [
        tuple(np.array(side, float) for side in zip(*box, strict=True)) for box in itertools.product(*spans)
    ]


def graded_boxes(low: np.ndarray, high: np.ndarray, guide: Guide) -> list[tuple[np.ndarray, np.ndarray]]:
    """A box cut around its guide points, in steps that grow away from them: tails reach beyond samples."""
    if len(guide.points) == 0:
        return [(low, high)]
    points = np.clip(guide.points, low, high)
    first, last, smallest = points.min(0), points.max(0), 2 * guide.reach.min()
    return grid([graded_edges(*spans, smallest) for spans in zip(low, first, last, high, strict=True)])


def graded_edges(low: float, first: float, last: float, high: float, smallest: float) -> list[float]:
    steps = max(last - first, smallest) * 6.0 ** np.arange(12)
    before = first - steps[first - 3 * steps > low]
    after = last + steps[last + 3 * steps < high]
    return [low, *before[::-1], *after, high]


@cache
def gauss_legendre(order: int, dimensions: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (order^d, d) in the unit box and their weights."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    nodes, weights = (nodes + 1) / 2, weights / 2
    mesh = np.stack(np.meshgrid(*[nodes] * dimensions, indexing="ij"), -1).reshape(-1, dimensions)
    products = (
        np.stack(np.meshgrid(*[weights] * dimensions, indexing="ij"), -1).reshape(-1, dimensions).prod(1)
    )
    return mesh, products


def integrate(
    function: Callable[[np.ndarray], np.ndarray],
    lower: np.ndarray,
    upper: np.ndarray,
    tolerance: float = TOLERANCE,
    levels: int = 14,
) -> tuple[np.ndarray, float]:
    """Adaptive quadrature of a function (N, d) -> (N, C) over boxes (B, d): integrals (B, C) and an error
    bound.

    A box is divided in all directions until that changes its integral by less than the tolerance.
    """
    dimensions = lower.shape[1]
    nodes, weights = gauss_legendre(5, dimensions)
    corners = np.stack(np.meshgrid(*[[0, 0.5]] * dimensions, indexing="ij"), -1).reshape(-1, dimensions)

    def quadrature(low: np.ndarray, high: np.ndarray) -> np.ndarray:
        chunks = []
        for i in range(0, len(low), 4096):
            a, size = low[i : i + 4096, None], (high - low)[i : i + 4096, None]
            values = function((a + size * nodes).reshape(-1, dimensions)).astype(float)
            volumes = size.prod(2)
            chunks.append(np.einsum("bnc,n->bc", values.reshape(len(a), len(nodes), -1), weights) * volumes)
        return np.concatenate(chunks)

    owner = np.arange(len(lower))
    coarse = quadrature(lower, upper)
    result, error = np.zeros_like(coarse), 0.0
    for _ in range(levels):
        size = (upper - lower)[:, None]
        low = (lower[:, None] + size * corners).reshape(-1, dimensions)
        high = low + np.repeat(size[:, 0] / 2, len(corners), axis=0)
        fine = quadrature(low, high)
        total = fine.reshape(-1, len(corners), fine.shape[1]).sum(1)
        change = np.abs(total - coarse).max(1)
        done = ~(change > tolerance)
        np.add.at(result, owner[done], total[done])
        error += change[done].sum()
        if done.all():
            return result, error
        again = np.repeat(~done, len(corners))
        lower, upper, coarse = low[again], high[again], fine[again]
        owner = np.repeat(owner[~done], len(corners))
    np.add.at(result, owner, coarse)
    return result, error + change[~done].sum()
