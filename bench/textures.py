#!/usr/bin/env python3
"""What filters and footprints of textures are worth, and what they cost.

    python bench/textures.py [--reference N] [--runs N] [--sponza FILE]

The first two tables have the relative mean squared error of scenes/book/checkerboard.xml without light from
the sky, by what the camera sees: the mean of (A - B)^2 / (B^2 + 0.01) over all pixels of one object and
several seeds, B being a picture without a filter. The third has the CPU time of a scene with many textures
relative to the filter `bilinear`: the median of the ratios of neighbours in renders that alternate, on one
thread.
"""

import argparse
import statistics
import sys
import time
from itertools import product
from pathlib import Path

import numpy as np

import lajolla

ROOT = Path(__file__).resolve().parent.parent
BOARD = ROOT / "scenes" / "book" / "checkerboard.xml"
SPONZA = ROOT.parent / "shared" / "scenes" / "lajolla" / "sponza" / "sponza.xml"
OBJECTS = ("plane", "mirror", "glass")
FOOTPRINTS = ("differentials", "cone")
FILTERS = ("trilinear", "ewa")
NO_FILTER = ("differentials", "bilinear")
SEEDS = range(1, 5)  # the reference has seed 0


def row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def board(footprint: str, filter_type: str) -> lajolla.Scene:
    parameters = {"filter": filter_type, "footprint": footprint, "sky": "0, 0, 0"}
    return lajolla.load(BOARD, parameters=parameters, size=(180, 120))


def picture(scene: lajolla.Scene, spp: int, seed: int) -> np.ndarray:
    return np.asarray(scene.render(spp=spp, seed=seed).array, float)[..., :3]


def masks() -> dict[str, np.ndarray]:
    """The pixels in which the camera sees nothing but one object."""
    scene = board(*NO_FILTER)
    seen = scene.render(spp=64, aovs=["shape"]).arrays()["shape"]
    return {name: seen.squeeze() == 1 + index for index, name in enumerate(OBJECTS)}


def errors(
    scene: lajolla.Scene, spp: int, reference: np.ndarray, objects: dict[str, np.ndarray]
) -> list[float]:
    squares = [(picture(scene, spp, seed) - reference) ** 2 / (reference**2 + 0.01) for seed in SEEDS]
    mean = np.mean(squares, axis=0)
    return [float(mean[mask].mean()) for mask in objects.values()]


def print_quality(reference_spp: int) -> None:
    objects = masks()
    reference = picture(board(*NO_FILTER), reference_spp, 0)
    for spp in (1, 256):
        print(f"\n{spp} samples per pixel\n{row('Footprint', 'Filter', *OBJECTS)}\n{row(*['---'] * 5)}")
        for way in (NO_FILTER, *product(FOOTPRINTS, FILTERS)):
            name = "any" if way == NO_FILTER else f"`{way[0]}`"
            found = errors(board(*way), spp, reference, objects)
            print(row(name, f"`{way[1]}`", *(f"{error:.3g}" for error in found)), flush=True)


def seconds(scene: lajolla.Scene) -> float:
    start = time.process_time()
    scene.render(threads=1)
    return time.process_time() - start


def print_cost(path: Path, runs: int) -> None:
    def with_filter(footprint: str, filter_type: str) -> lajolla.Scene:
        scene = lajolla.load(path, footprint=footprint, size=(320, 240), spp=4)
        filters = {key: filter_type for key in scene.params if key.endswith(".filter_type")}
        return scene.with_params(filters)

    plain = with_filter(*NO_FILTER)
    ways = {way: with_filter(*way) for way in product(FOOTPRINTS, FILTERS)}
    ratios: dict[tuple[str, str], list[float]] = {way: [] for way in ways}
    for _ in range(runs + 1):  # the first one warms up
        for way, scene in ways.items():
            before, filtered, after = seconds(plain), seconds(scene), seconds(plain)
            ratios[way].append(2 * filtered / (before + after))
    print(f"\n{path.name}\n{row('Footprint', *(f'`{name}`' for name in FILTERS))}\n{row(*['---'] * 3)}")
    for footprint in FOOTPRINTS:
        medians = [statistics.median(ratios[footprint, name][1:]) for name in FILTERS]
        print(row(f"`{footprint}`", *(f"{ratio:.2f}" for ratio in medians)), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--reference", type=int, default=4096, help="its samples per pixel (%(default)s)")
    parser.add_argument("--runs", type=int, default=7, help="counted renders of each (%(default)s)")
    parser.add_argument("--sponza", type=Path, default=SPONZA, help="scene for the times (%(default)s)")
    options = parser.parse_args()
    print_quality(options.reference)
    sys.stdout.flush()
    print_cost(options.sponza, options.runs)


if __name__ == "__main__":
    main()
