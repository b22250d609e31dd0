#!/usr/bin/env python3
"""How long do changes of a loaded scene take?

    python bench/editing.py SCENE.xml ...

For each scene, milliseconds (the least of several): to move the camera, to change a colour, a roughness and
the radiance of an area light (of the first object that has one), to move the vertices of the smallest and of
the largest mesh, and to build the whole scene anew from what was read. `render` is a call of `Scene.render`
for one sample of 16 x 16 pixels, and `loop` the same after a colour was changed: what a program that renders
many variants pays per picture.
"""

import argparse
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

import lajolla
from lajolla import _core

REPEATS = 7


def least(action: Callable[[int], object]) -> float:
    """Milliseconds of the fastest of several calls; each gets its number."""
    times = []
    for number in range(REPEATS):
        start = time.perf_counter()
        action(number)
        times.append(time.perf_counter() - start)
    return 1e3 * min(times)


def first(scene: lajolla.Scene, ending: str, kind: str) -> str | None:
    """The path of the first constant parameter with this name of an object of a kind."""
    params = scene.params
    found = (
        f"{name}.{ending}" for name, o in params.objects.items() if o.kind == kind and ending in o.fields
    )
    return next((path for path in found if not isinstance(params[path], str)), None)


def change(scene: lajolla.Scene, path: str | None) -> float:
    """Milliseconds to change a number or a colour, each time to another value."""
    if path is None:
        return np.nan
    value = np.asarray(scene[path])
    return least(lambda number: scene.with_params({path: value * (0.9 - 0.01 * number)}))


def meshes_by_size(scene: lajolla.Scene) -> list[str]:
    params = scene.params
    names = [name for name, found in params.objects.items() if "mesh" in found.fields]
    return sorted(names, key=lambda name: len(scene[f"{name}.triangles"]))


def move_vertices(scene: lajolla.Scene, name: str) -> float:
    positions = scene[f"{name}.positions"]
    return least(lambda number: scene.with_params({f"{name}.positions": positions * (1 + 1e-4 * number)}))


def measure(path: Path) -> dict[str, float]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene = lajolla.load(path, size=(16, 16))
    scene.params.objects  # noqa: B018, names are made once
    camera = scene["sensor.to_world"]
    meshes = meshes_by_size(scene)
    colour = first(scene, "reflectance", "bsdf") or first(scene, "base_color", "bsdf")
    turn = np.diag([1, 1, 1, 1.0])

    def moved(number: int) -> np.ndarray:
        turn[0, 3] = 1e-3 * number
        return camera @ turn

    def loop(number: int) -> None:
        if colour is not None:
            scene.with_params({colour: 0.3 + 0.01 * number}).render(spp=1)

    return {
        "camera": least(lambda number: scene.with_params({"sensor.to_world": moved(number)})),
        "colour": change(scene, colour),
        "rough": change(scene, first(scene, "alpha", "bsdf") or first(scene, "roughness", "bsdf")),
        "light": change(scene, first(scene, "radiance", "emitter")),
        "small mesh": move_vertices(scene, meshes[0]) if meshes else np.nan,
        "large mesh": move_vertices(scene, meshes[-1]) if meshes else np.nan,
        "build": least(lambda _: _core.Scene(scene.description.core)),
        "render": least(lambda _: scene.render(spp=1)),
        "loop": least(loop),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scenes", nargs="+", metavar="SCENE", type=Path)
    for path in parser.parse_args().scenes:
        figures = measure(path)
        name = path.stem if path.stem != "scene" else path.parent.name
        print(f"{name:20}", *(f"{key} {value:.3f}" for key, value in figures.items()), sep="  ", flush=True)


if __name__ == "__main__":
    sys.exit(main())
