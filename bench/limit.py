#!/usr/bin/env python3
"""How far is a render from its limit: Embree tracing the same rays, and nothing else?

    python bench/limit.py SCENE.xml ... [--spp N] [--runs N] [--threads N] [--size WxH] [--max-depth N]

Every ray of a render is recorded, in the order in which each tile asked for it, and traced again through
Embree alone on the same threads. Renders and replays alternate; the table shows the median of the ratios of
neighbours, so that a machine whose speed drifts does not matter much. Replays need 36 bytes per ray: choose
--spp accordingly.
"""

import argparse
import statistics
import sys
import time

import lajolla
from lajolla import _core, _core_testing


def render_seconds(scene: _core.Scene, spp: int, threads: int) -> float:
    render = _core.Render(scene)
    start = time.perf_counter()
    render.advance(spp, threads)
    return time.perf_counter() - start


def measure(path: str, options: argparse.Namespace) -> str:
    overrides = {"size": options.size} if options.size else {}
    overrides |= {"spp": options.spp, "integrator": "path", "max_depth": options.max_depth}
    scene = lajolla.load(path, **overrides).core
    rays = _core_testing.record_rays(scene, options.spp, options.threads)
    renders, replays = [], []
    for _ in range(options.runs + 1):  # the first pair warms up
        renders.append(render_seconds(scene, options.spp, options.threads))
        replays.append(rays.replay(options.threads))
    ratios = [a / b for a, b in zip(renders[1:], replays[1:], strict=True)]
    million = len(rays) / 1e6
    return (
        f"{path.split('/')[-1]:28} {million:8.1f} {million / statistics.median(renders[1:]):8.2f} "
        f"{million / statistics.median(replays[1:]):8.2f} {statistics.median(ratios):6.2f}  "
        f"({min(ratios):.2f} to {max(ratios):.2f})"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scenes", nargs="+", metavar="SCENE")
    parser.add_argument("--spp", type=int, default=4)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--size", type=lambda text: tuple(map(int, text.split("x"))), help="WxH")
    parser.add_argument("--max-depth", type=int, default=8)
    options = parser.parse_args()
    print(f"{'scene':28} {'M rays':>8} {'render':>8} {'replay':>8} {'ratio':>6}   (M rays/s; time / time)")
    for path in options.scenes:
        print(measure(path, options))
        sys.stdout.flush()


if __name__ == "__main__":
    main()
