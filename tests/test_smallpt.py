"""scenes/smallpt.xml against a path tracer of 60 lines, in double precision, that samples directions alone.

The scene is that of Kevin Beason's smallpt (2010); the code below is our own.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scene_tools import check_same_mean
from statistics_tools import SEED

import lajolla

Rows = NDArray[np.float64]  # (N, 3)
DIFFUSE, MIRROR, GLASS = range(3)
WIDTH, HEIGHT = 48, 36


class Sphere(NamedTuple):
    radius: float
    centre: tuple[float, float, float]
    colour: tuple[float, float, float]
    material: int = DIFFUSE
    emission: float = 0


GREY, WHITE, BLACK = (0.75, 0.75, 0.75), (0.999, 0.999, 0.999), (0.0, 0.0, 0.0)
# As float32 stores them: 0.0016 more or less changes the light, which is 0.27 high, by half a percent.
CEILING, LIGHT = float(np.float32(-99918.4)), float(np.float32(681.33))
SPHERES = [
    Sphere(1e5, (100001, 40.8, 81.6), (0.75, 0.25, 0.25)),
    Sphere(1e5, (-99901, 40.8, 81.6), (0.25, 0.25, 0.75)),
    Sphere(1e5, (50, 40.8, 1e5), GREY),
    Sphere(1e5, (50, 40.8, -99830), BLACK),
    Sphere(1e5, (50, 1e5, 81.6), GREY),
    Sphere(1e5, (50, CEILING, 81.6), GREY),
    Sphere(16.5, (27, 16.5, 47), WHITE, MIRROR),
    Sphere(16.5, (73, 16.5, 78), WHITE, GLASS),
    Sphere(600, (50, LIGHT, 81.6), BLACK, emission=12),
]
CENTRES, COLOURS = (np.array([getattr(s, name) for s in SPHERES], float) for name in ("centre", "colour"))
RADII, EMISSIONS, MATERIALS = (
    np.array([getattr(s, name) for s in SPHERES]) for name in ("radius", "emission", "material")
)


def dot(a: Rows, b: Rows) -> Rows:
    return np.sum(a * b, axis=1, keepdims=True)


def closest(origin: Rows, direction: Rows) -> tuple[Rows, NDArray[np.int64]]:
    """The distances (N, 1) of the next hits, and the spheres (N,)."""
    roots = []
    for centre, radius in zip(CENTRES, RADII, strict=True):
        middle = dot(centre - origin, direction)
        half = np.sqrt(np.maximum(middle**2 - dot(centre - origin, centre - origin) + radius**2, -1) + 0j)
        near, far = (middle - half), (middle + half)
        root = np.where(near.real > 1e-4, near.real, np.where(far.real > 1e-4, far.real, np.inf))
        roots.append(np.where(half.imag > 0, np.inf, root)[:, 0])
    which = np.argmin(roots, axis=0)
    return np.min(roots, axis=0)[:, None], which


def cosine_sampled(normal: Rows, u: Rows) -> Rows:
    s = np.cross(np.where(abs(normal[:, :1]) > 0.1, [[0, 1, 0]], [[1, 0, 0]]), normal)
    s /= np.linalg.norm(s, axis=1, keepdims=True)
    phi, r = 2 * np.pi * u[:, :1], np.sqrt(u[:, 1:2])
    return r * np.cos(phi) * s + r * np.sin(phi) * np.cross(normal, s) + np.sqrt(1 - r**2) * normal


def through_glass(direction: Rows, normal: Rows, enters: NDArray[np.bool_], u: Rows) -> Rows:
    """Reflected or refracted, with Fresnel's probabilities; the normal is on the side of the ray's origin."""
    n1, n2 = np.where(enters, 1, 1.5), np.where(enters, 1.5, 1)
    cos1 = -dot(direction, normal)
    cos2 = np.sqrt(np.maximum(1 - (n1 / n2) ** 2 * (1 - cos1**2), 0))  # 0: total internal reflection
    s, p = (
        (n1 * cos1 - n2 * cos2) / (n1 * cos1 + n2 * cos2),
        (n2 * cos1 - n1 * cos2) / (n2 * cos1 + n1 * cos2),
    )
    refracted = direction * (n1 / n2) + normal * (cos1 * n1 / n2 - cos2)
    return np.where(u[:, 2:] < (s**2 + p**2) / 2, direction + 2 * cos1 * normal, refracted)


def radiance(origin: Rows, direction: Rows, rng: np.random.Generator) -> Rows:
    result, throughput, paths = np.zeros_like(origin), np.ones_like(origin), np.arange(len(origin))
    for depth in range(100):
        distance, hit = closest(origin, direction)
        result[paths] += throughput * EMISSIONS[hit][:, None]
        colour = COLOURS[hit]
        survival = colour.max(axis=1) if depth >= 5 else (colour.max(axis=1) > 0).astype(float)
        lives = rng.random(len(paths)) < survival
        throughput = (throughput * colour)[lives] / survival[lives, None]
        paths, hit, direction = paths[lives], hit[lives], direction[lives]
        origin = origin[lives] + distance[lives] * direction
        outward = (origin - CENTRES[hit]) / RADII[hit][:, None]
        enters = dot(outward, direction) < 0
        normal, u = np.where(enters, outward, -outward), rng.random((len(paths), 3))
        mirrored = direction - 2 * dot(direction, normal) * normal
        choices = cosine_sampled(normal, u), mirrored, through_glass(direction, normal, enters, u)
        direction = np.choose(MATERIALS[hit][:, None], choices)
    return result


def reference(rng: np.random.Generator) -> NDArray[np.float64]:
    """A picture with one sample per pixel."""
    forward = np.array([0, -0.042612, -1]) / np.hypot(1, 0.042612)
    right = np.array([0.5135 * WIDTH / HEIGHT, 0, 0])
    up = np.cross(right, forward) / np.linalg.norm(right) * 0.5135
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + rng.random((2, HEIGHT, WIDTH))
    rays = (x[..., None] / WIDTH - 0.5) * right + (0.5 - y[..., None] / HEIGHT) * up + forward
    rays = rays.reshape(-1, 3)
    found = radiance(
        np.array([50, 52, 295.6]) + 140 * rays, rays / np.linalg.norm(rays, axis=1, keepdims=True), rng
    )
    return found.reshape(HEIGHT, WIDTH, 3)


def region_means(pictures: Iterable[NDArray[np.floating]]) -> NDArray[np.float64]:
    """(regions, pictures): green in three columns, without the rows on top, where the light is seen."""
    thirds = [np.split(picture[HEIGHT // 4 :, :, 1], 3, axis=1) for picture in pictures]
    return np.array([[part.mean() for part in parts] for parts in thirds]).T


@pytest.fixture(scope="module")
def expected() -> NDArray[np.float64]:
    rng = np.random.default_rng(SEED)
    return region_means(reference(rng) for _ in range(16))


@pytest.mark.parametrize("strategy", ["bsdf", "mis", "light"])
def test_the_nine_spheres(strategy: str, expected: NDArray[np.float64]) -> None:
    scene = lajolla.load("scenes/smallpt.xml", size=(WIDTH, HEIGHT), strategy=strategy)
    found = region_means(scene.render(spp=32, seed=seed).array for seed in range(8))
    for name, ours, theirs in zip(("left", "middle", "right"), found, expected, strict=True):
        check_same_mean(f"{name}, {strategy}", ours, theirs)


def test_walls_of_huge_spheres_are_where_they_belong() -> None:
    """Hits are exact to a few units in the last place of their own coordinates, not of the centre's."""
    scene = lajolla.load("scenes/smallpt.xml")
    rng = np.random.default_rng(SEED)
    directions = rng.normal(size=(100_000, 3))
    hits = scene.intersect((50, 40, 90), directions.astype(np.float32))
    assert hits.hit.all()  # no gaps at the seams
    found = hits.shape - 1
    offset = hits.position - CENTRES[found]
    assert np.abs(np.linalg.norm(offset, axis=1) - RADII[found]).max() < 3e-5
    _, which = closest(np.array([[50, 40, 90.0]]), directions / np.linalg.norm(directions, axis=1)[:, None])
    assert np.mean(which == found) > 0.9999  # all but those at the seams
