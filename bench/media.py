"""What a picture of a medium costs: lajolla's volpath beside volpath and volpathmis of the mitsuba package.

    python bench/media.py [--spp N] [--runs N] [--threads N] [--size WxH] [--reference N] [--scenes FOLDER]

Variance falls as time is spent, so that time times error is the price of any quality.
The error of a run is the mean of (A - B)^2 / (B^2 + 0.01) over all values but the largest thousandth, B being
a converged picture of lajolla; without these few, whose sum is chance, runs agree. Mitsuba gets the scene as
`lajolla convert` writes it, and its variant `llvm_ad_rgb` where an LLVM library is found, else `scalar_rgb`.
Runs alternate, medians count, and a first run of each, which compiles Mitsuba's kernels, does not. The means
of all pictures stand beside, for errors only compare where the pictures are the same.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import lajolla
from lajolla import cli

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from oracle import Setup, default_variant, load_with_mitsuba, restate, upgrade  # noqa: E402

SCENE = "lajolla/volpath_test/hetvol.xml"
KEPT = 0.999

Render = Callable[[int], np.ndarray]


@dataclass
class Contender:
    """A way to render the scene, and what its runs have shown."""

    name: str
    render: Render  # from a seed to linear RGB
    seconds: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    means: list[float] = field(default_factory=list)

    def run(self, seed: int, reference: np.ndarray | None) -> None:
        """One render; without a reference it does not count."""
        start = time.perf_counter()
        image = self.render(seed)
        elapsed = time.perf_counter() - start
        if reference is not None:
            self.seconds.append(elapsed)
            self.errors.append(trimmed_error(image, reference))
            self.means.append(float(image.mean()))

    def cost(self) -> float:
        """Median seconds times median error."""
        return statistics.median(self.seconds) * statistics.median(self.errors)


def trimmed_error(image: np.ndarray, reference: np.ndarray) -> float:
    """Relative mean square error without the largest values."""
    errors = np.sort(((image - reference) ** 2 / (reference**2 + 1e-2)).ravel())
    return float(errors[: int(KEPT * errors.size)].mean())


def lajolla_render(path: Path, spp: int, threads: int) -> Render:
    """lajolla's renders of a scene."""
    scene = lajolla.load(path)

    def render(seed: int) -> np.ndarray:
        return np.asarray(scene.render(spp=spp, seed=seed, threads=threads).array, np.float64)[..., :3]

    return render


def mitsuba_render(path: Path, folder: Path, integrator: str, spp: int, variant: str) -> Render:
    """Mitsuba's renders of a scene that was written for it."""
    changed = folder / f"{integrator}.xml"
    changed.write_text(path.read_text().replace('type="volpath"', f'type="{integrator}"'))
    as_it_is = Setup(max_depth=None, rfilter=None, sampler=None)
    scene = load_with_mitsuba(upgrade(changed, folder / f"{integrator}-3.xml", as_it_is), variant)
    import mitsuba as mi

    def render(seed: int) -> np.ndarray:
        return np.array(mi.render(scene, spp=spp, seed=seed), np.float64)[..., :3]

    return render


def contenders(path: Path, folder: Path, options: argparse.Namespace, variant: str) -> list[Contender]:
    """lajolla first."""
    written = folder / "mitsuba.xml"
    if cli.main(["convert", str(path), str(written)]) != 0:
        raise SystemExit("the scene cannot be written for Mitsuba")
    result = [Contender("lajolla volpath", lajolla_render(path, options.spp, options.threads))]
    for integrator in ("volpath", "volpathmis"):
        render = mitsuba_render(written, folder, integrator, options.spp, variant)
        result.append(Contender(f"mitsuba {integrator}", render))
    return result


def size_of(text: str) -> tuple[int, int]:
    """WxH."""
    width, height = text.split("x")
    return int(width), int(height)


def main() -> int:
    """Parses the command line, prints the table and returns the exit code."""
    parser = argparse.ArgumentParser(description="What a picture of a medium costs lajolla and mitsuba.")
    parser.add_argument("--spp", type=int, default=16, help="samples per pixel of a run (%(default)s)")
    parser.add_argument("--runs", type=int, default=5, help="counted runs of each (%(default)s)")
    parser.add_argument("--threads", type=int, default=os.cpu_count(), help="threads of each (all cores)")
    parser.add_argument("--size", type=size_of, default=(384, 288), metavar="WxH", help="film size (384x288)")
    parser.add_argument("--reference", type=int, default=2048, help="its samples per pixel (%(default)s)")
    parser.add_argument("--scenes", type=Path, default=ROOT.parent / "shared" / "scenes", help="scene folder")
    options = parser.parse_args()
    if min(options.spp, options.runs, options.threads, options.reference, *options.size) < 1:
        parser.error("numbers must be positive")
    if not (options.scenes / SCENE).is_file():
        parser.error(f"no scene {options.scenes / SCENE}; name the folder with --scenes")
    variant = default_variant()
    import drjit as dr
    import mitsuba as mi

    mi.set_variant(variant)
    dr.set_thread_count(options.threads)
    with tempfile.TemporaryDirectory() as folder:
        width, height = options.size
        setup = Setup(width=width, height=height, max_depth=None)
        path = restate(options.scenes / SCENE, Path(folder) / "scene.xml", setup)
        entries = contenders(path, Path(folder), options, variant)
        reference = lajolla_render(path, options.reference, options.threads)(10**6)
        for run in range(options.runs + 1):
            for entry in entries:
                entry.run(run, reference if run > 0 else None)
    print(f"mitsuba {mi.__version__} ({variant}), {options.threads} threads, {options.spp} samples per pixel")
    print("\n| | seconds | relative MSE | seconds x error | over lajolla | mean / reference |")
    print("|---|---|---|---|---|---|")
    for entry in entries:
        print(
            f"| {entry.name} | {statistics.median(entry.seconds):.2f} "
            f"| {statistics.median(entry.errors):.3g} | {entry.cost():.3g} "
            f"| {entry.cost() / entries[0].cost():.2f} | {np.mean(entry.means) / reference.mean():.4f} |"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
