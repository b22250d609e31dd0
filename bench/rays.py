#!/usr/bin/env python3
"""How fast are rays in bulk, compared with Embree alone?

    python bench/rays.py SCENE.xml ... [--count N] [--runs N] [--threads N]

Traces rays with `scene.intersect` and `scene.occluded`, and the same rays one by one through Embree without
any more work, on the same threads. `coherent` rays go through the pixels of the scene's camera, row by row;
`diffuse` ones leave the points that those hit into all directions. The table shows millions of rays per
second, and the median of the ratios of neighbouring runs: 1 is the speed of Embree alone.
"""

import argparse
import statistics
import sys
import time
import warnings
from collections.abc import Callable

import numpy as np

import lajolla
from lajolla import _core_testing

Rays = tuple[np.ndarray, np.ndarray]


def camera_rays(scene: lajolla.Scene, count: int) -> Rays:
    side = int(np.sqrt(count))
    y, x = np.mgrid[0:side, 0:side] / side * 2 - 1
    width = np.tan(np.radians(scene.params["sensor.fov"]) / 2)
    local = np.stack([x * width, -y * width, np.ones_like(x)], -1).reshape(-1, 3)
    to_world = scene["sensor.to_world"]
    directions = local @ to_world[:3, :3].T
    origins = np.broadcast_to(to_world[:3, 3], directions.shape)
    return np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(directions, np.float32)


def diffuse_rays(scene: lajolla.Scene, seen: Rays) -> Rays:
    hits = scene.intersect(*seen)
    rng = np.random.default_rng(1)
    normals = hits.geometric_normal[hits.hit]
    directions = rng.normal(size=normals.shape).astype(np.float32)
    directions *= np.sign(np.sum(directions * normals, axis=1, keepdims=True))
    return hits.position[hits.hit] + 1e-3 * normals, directions


def seconds(action: Callable[[], object]) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def measure(name: str, kind: str, scene: lajolla.Scene, rays: Rays, options: argparse.Namespace) -> None:
    for query, occlusion in ((scene.intersect, False), (scene.occluded, True)):
        ours, alone = [], []
        for _ in range(options.runs + 1):  # the first pair warms up
            ours.append(seconds(lambda: query(*rays, threads=options.threads)))  # noqa: B023
            traced = _core_testing.trace_seconds(scene.core, *rays, occlusion, options.threads or 0)
            alone.append(traced)
        ratio = statistics.median(b / a for a, b in zip(ours[1:], alone[1:], strict=True))
        million = len(rays[1]) / 1e6
        print(
            f"{name:20} {kind:10} {query.__name__:10} {million / statistics.median(ours[1:]):8.2f} "
            f"{million / statistics.median(alone[1:]):8.2f} {ratio:6.2f}",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scenes", nargs="+", metavar="SCENE")
    parser.add_argument("--count", type=int, default=1 << 20)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--threads", type=int)
    options = parser.parse_args()
    print(f"{'scene':20} {'rays':10} {'query':10} {'ours':>8} {'Embree':>8} {'ratio':>6}   (M rays/s)")
    for path in options.scenes:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            scene = lajolla.load(path)
        name = path.removesuffix("/scene.xml").removesuffix(".xml").split("/")[-1]
        seen = camera_rays(scene, options.count)
        measure(name, "coherent", scene, seen, options)
        measure(name, "diffuse", scene, diffuse_rays(scene, seen), options)


if __name__ == "__main__":
    sys.exit(main())
