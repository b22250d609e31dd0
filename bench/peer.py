"""Render times of lajolla and of the mitsuba package, side by side.

    python bench/peer.py [--runs 5] [--threads N] [--variant NAME] [--scenes FOLDER] [NAME ...]

Both render the same scene files at the file's own film size, with 16 samples per pixel and paths of at most
8 segments. Runs alternate, so that a busy machine slows both; the table gives medians of the render time. A
first run of each, which compiles Mitsuba's kernels, is not counted. Mitsuba runs its variant `llvm_ad_rgb`
where an LLVM library is found, else `scalar_rgb`, with its `independent` sampler; lajolla runs its default.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from oracle import Setup, default_variant, load_with_mitsuba, restate, upgrade  # noqa: E402

SCENES = {
    "cbox": "lajolla/cbox/cbox.xml",
    "sponza": "lajolla/sponza/sponza.xml",
    "matpreview": "lajolla/matpreview/matpreview.xml",
    "veach_mi": "lajolla/veach_mi/mi.xml",
    "veach-ajar": "bitterli/veach-ajar/scene.xml",
    "staircase2": "bitterli/staircase2/scene.xml",
    "coffee": "bitterli/coffee/scene.xml",
    "spaceship": "bitterli/spaceship/scene.xml",
}
SAMPLES = 16

Render = Callable[[int], None]


def mitsuba_render(path: Path, folder: Path, variant: str) -> Render:
    """A function that renders the scene with a given seed and returns when the image is there."""
    setup = Setup(max_depth=8, rr_depth=5, rfilter=None)
    scene = load_with_mitsuba(upgrade(path, folder / "mitsuba.xml", setup), variant)
    import drjit as dr
    import mitsuba as mi

    def render(seed: int) -> None:
        dr.eval(mi.render(scene, spp=SAMPLES, seed=seed))
        dr.sync_thread()

    return render


def lajolla_render(path: Path, folder: Path, threads: int) -> Render:
    """The same for lajolla."""
    import lajolla

    setup = Setup(max_depth=8, rr_depth=5, rfilter=None, sampler=None)
    scene = lajolla.load(restate(path, folder / "lajolla.xml", setup))
    return lambda seed: scene.render(spp=SAMPLES, seed=seed, threads=threads)


def seconds(render: Render, seed: int) -> float:
    """Wall-clock time of one render."""
    start = time.perf_counter()
    render(seed)
    return time.perf_counter() - start


def compare(path: Path, runs: int, threads: int, variant: str) -> tuple[float, float]:
    """Median seconds of lajolla and of Mitsuba on one scene."""
    with tempfile.TemporaryDirectory() as folder:
        ours = lajolla_render(path, Path(folder), threads)
        theirs = mitsuba_render(path, Path(folder), variant)
    times: tuple[list[float], list[float]] = ([], [])
    for run in range(runs + 1):
        for render, taken in zip((ours, theirs), times, strict=True):
            elapsed = seconds(render, run)
            if run > 0:
                taken.append(elapsed)
    return statistics.median(times[0]), statistics.median(times[1])


def main() -> int:
    """Parses the command line, prints one row per scene and returns the exit code."""
    parser = argparse.ArgumentParser(description="Times lajolla against the mitsuba package.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(SCENES)} (all)")
    parser.add_argument("--runs", type=int, default=5, help="counted runs of each renderer (%(default)s)")
    parser.add_argument("--threads", type=int, default=os.cpu_count(), help="threads of each (all cores)")
    parser.add_argument("--variant", help="of Mitsuba (llvm_ad_rgb where there is LLVM)")
    parser.add_argument("--scenes", type=Path, default=ROOT.parent / "shared" / "scenes", help="scene folder")
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in SCENES]
    if unknown or options.runs < 1 or options.threads < 1:
        parser.error(f"unknown scene {unknown[0]!r}" if unknown else "runs and threads must be positive")
    variant = options.variant or default_variant()
    import drjit as dr
    import mitsuba as mi

    mi.set_variant(variant)
    dr.set_thread_count(options.threads)
    print(f"mitsuba {mi.__version__} ({variant}), {options.threads} threads, medians of {options.runs} runs")
    print(f"{'scene':12} {'lajolla [s]':>12} {'mitsuba [s]':>12} {'mitsuba / lajolla':>18}")
    ratios = []
    for name in options.names or SCENES:
        path = options.scenes / SCENES[name]
        if not path.is_file():
            parser.error(f"no scene {path}; name the folder with --scenes")
        ours, theirs = compare(path, options.runs, options.threads, variant)
        print(f"{name:12} {ours:12.3f} {theirs:12.3f} {theirs / ours:18.2f}", flush=True)
        ratios.append(theirs / ours)
    print(f"geometric mean of the ratios: {statistics.geometric_mean(ratios):.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
