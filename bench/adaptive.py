#!/usr/bin/env python3
"""Is adaptive sampling faster, and is it unbiased?

    python bench/adaptive.py SCENE.xml ... [--spp N] [--runs N] [--size WxH]

Renders each scene several times with and without adaptive sampling, with different seeds and the same mean
number of samples per pixel. The error is that of src/lajolla/adaptive.py, squared, against the mean of all
these pictures. (A reference would need far more samples than all of them not to be the noisier one where
light is rare.) `gain` is the ratio of error times processor time, without over with: how much sooner the same
error is reached, if it falls like 1 / samples; `per sample` is the ratio of errors alone. `bias` is the
difference of the means of the pictures in per cent, and `p` that of Welch's t-test.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from scipy import stats

import lajolla


def run(scene: lajolla.Scene, spp: int, seed: int, adaptive: bool) -> tuple[np.ndarray, float]:
    """The picture, and processor time in seconds."""
    rendering = scene.rendering(spp=spp, seed=seed, adaptive=adaptive)
    start = time.process_time()
    rendering.run()
    return rendering.image().array.astype(float), time.process_time() - start


def error(pictures: list[np.ndarray], reference: np.ndarray) -> float:
    """The mean of the pictures' squared relative errors."""
    scale = reference**2 + reference.mean() ** 2 / 100
    return float(np.mean([np.minimum((picture - reference) ** 2 / scale, 1) for picture in pictures]))


def measure(path: Path, options: argparse.Namespace) -> str:
    scene = lajolla.load(path, size=options.size)
    pictures: dict[bool, list[np.ndarray]] = {False: [], True: []}
    times: dict[bool, list[float]] = {False: [], True: []}
    for seed in range(options.runs):
        for adaptive in (False, True):
            picture, seconds = run(scene, options.spp, seed + 500 * adaptive, adaptive)
            pictures[adaptive].append(picture)
            times[adaptive].append(seconds)
    reference = np.mean(pictures[False] + pictures[True], axis=0)
    means = {adaptive: [picture.mean() for picture in pictures[adaptive]] for adaptive in pictures}
    per_sample = error(pictures[False], reference) / error(pictures[True], reference)
    gain = per_sample * np.median(times[False]) / np.median(times[True])
    bias = np.mean(means[True]) / np.mean(means[False]) - 1
    test = stats.ttest_ind(means[True], means[False], equal_var=False)
    name = path.stem if path.stem != "scene" else path.parent.name
    return f"{name:24} {gain:6.2f} {per_sample:10.2f} {100 * bias:9.3f} {test.pvalue:8.3f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scenes", nargs="+", metavar="SCENE", type=Path)
    parser.add_argument("--spp", type=int, default=128)
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--size", type=lambda text: tuple(map(int, text.split("x"))), default=(160, 120))
    options = parser.parse_args()
    print(f"{'scene':24} {'gain':>6} {'per sample':>10} {'bias (%)':>9} {'p':>8}")
    for path in options.scenes:
        print(measure(path, options))
        sys.stdout.flush()


if __name__ == "__main__":
    main()
