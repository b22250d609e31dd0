"""What Sobol' points are worth: the error of independent points over theirs, for the same number of samples.

Pairs of dimensions are well spread each by itself, and independent of one another (docs/sampling.md): where a
picture depends on one pair, the error falls much faster than with independent points; where it depends on
several together, or on numbers that are not of the sequence, little is left of that. `python
tests/test_points.py` prints the table of that page.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scene_tools import look_at

import lajolla

Settings = dict[str, Any]
SIZE = 16
FLOOR = [[4, 0, 0, 0], [0, 0, 1, 0], [0, -4, 0, 0], [0, 0, 0, 1]]  # a rectangle that looks up
BLACK = {"type": "diffuse", "reflectance": 0.0}


def seen(depth: int, sensor: Settings | None = None, integrator: str = "path", **objects: object) -> Settings:
    view = {"type": "perspective", "fov": 40, "to_world": look_at((0, 3, 6), (0, 0, 0)), **(sensor or {})}
    film = {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}}
    floor = {"type": "rectangle", "to_world": FLOOR}
    settings = {"type": integrator, "max_depth": depth, "rr_depth": 100}
    return {
        "type": "scene",
        "integrator": settings,
        "view": {**view, "film": film},
        "floor": floor,
        **objects,
    }


def lamp(x: float, z: float, height: float, half: float, radiance: float) -> Settings:
    """A square that shines downwards."""
    matrix = [[half, 0, 0, x], [0, 0, -1, height], [0, half, 0, z], [0, 0, 0, 1]]
    light = {"type": "area", "radiance": {"type": "rgb", "value": radiance}}
    return {"type": "rectangle", "to_world": matrix, "bsdf": BLACK, "emitter": light}


def board(sensor: Settings | None = None, radius: float = 0.5) -> Settings:
    """A floor that shines in a pattern, seen with a filter of this radius in pixels."""
    scaled = np.diag([8.0, 8, 1, 1])
    light = {"type": "area", "radiance": {"type": "checkerboard", "to_uv": scaled}}
    shining = {"type": "rectangle", "to_world": FLOOR, "bsdf": BLACK, "emitter": light}
    scene = seen(1, sensor, floor=shining)
    scene["view"]["film"]["rfilter"]["radius"] = radius
    return scene


def under_a_sky(bsdf: Settings) -> Settings:
    """A ball on the floor, both of which see parts of the sky."""
    ball = {"type": "sphere", "center": [0, 1, 0], "bsdf": bsdf}
    floor = {"type": "rectangle", "to_world": FLOOR, "bsdf": bsdf}
    return seen(2, ball=ball, floor=floor, sky={"type": "constant"})


def room() -> Settings:
    """A box of six walls, a lamp at its ceiling."""
    box = {"type": "cube", "to_world": np.diag([4.0, 4, 7, 1]), "flip_normals": True}
    ball = {"type": "sphere", "bsdf": {"type": "principled", "roughness": 0.3}}
    sensor = {"to_world": look_at((0, 1, 6), (0, 0, 0))}
    grey = {"type": "diffuse", "reflectance": 0.7}
    return seen(8, sensor, box={**box, "bsdf": grey}, ball=ball, lamp=lamp(0, 0, 3.9, 0.5, 20))


def smoke() -> Settings:
    medium = {"type": "homogeneous", "sigma_t": 1.0, "albedo": 0.8}
    cube = {"type": "cube", "bsdf": {"type": "null"}, "interior": medium}
    return seen(8, integrator="volpath", cube=cube, lamp=lamp(0, 0, 3.9, 0.5, 20))


def lamps() -> dict[str, Settings]:
    return {f"lamp{i}": lamp(-2 + i % 3 * 2, -2 + i // 3 * 2, 2, 0.3, 1 + i) for i in range(9)}


LENS = {"type": "thinlens", "aperture_radius": 0.3, "focus_distance": 4.0}
# The scene, and the least that the points must be worth with 64 samples: below what was measured by a tenth,
# which is more than five standard errors.
SCENES: dict[str, tuple[Callable[[], Settings], float]] = {
    "a point in the pixel": (board, 3.4),
    "a point on the lens": (lambda: board(LENS, 1e-3), 2.3),
    "a point in the pixel and on the lens": (lambda: board(LENS), 1.07),
    "a point on one lamp": (lambda: seen(2, lamp=lamp(0, 0, 2, 1, 3)), 3.8),
    "one of nine lamps, and a point on it": (lambda: seen(2, **lamps()), 3.4),
    "a direction from a diffuse surface": (lambda: under_a_sky({"type": "diffuse"}), 2.2),
    "a lobe, and a direction from it": (lambda: under_a_sky({"type": "roughplastic", "alpha": 0.2}), 1.65),
    "paths of eight segments": (room, 1.15),
    "smoke": (smoke, 1.2),
}


def error(scene: Settings, sampler: str, samples: int, renders: int) -> float:
    """The root of the mean variance of a pixel."""
    opened = lajolla.load_dict(scene, sampler=sampler)
    pictures = [opened.render(spp=samples, seed=seed).array for seed in range(renders)]
    return float(np.sqrt(np.var(np.array(pictures, float), axis=0, ddof=1).mean()))


def worth(scene: Settings, samples: int, renders: int) -> float:
    independent, sobol = (error(scene, name, samples, renders) for name in ("independent", "sobol"))
    return independent / sobol


@pytest.mark.parametrize("name", SCENES)
def test_points_are_better_than_independent_ones(name: str) -> None:
    make, least = SCENES[name]
    assert worth(make(), 64, 12) > least


if __name__ == "__main__":
    counts = (4, 16, 64, 256)
    print("| The picture depends on | " + " | ".join(map(str, counts)) + " |")
    for name, (make, _) in SCENES.items():
        ratios = [f"{worth(make(), count, 24):.1f}" for count in counts]
        print(f"| {name} | " + " | ".join(ratios) + " |", flush=True)
