"""Measures how much noise `--denoise` removes, and how long it takes.

    python bench/denoising.py [--scenes FOLDER] [--references FOLDER]

prints the table in docs/denoising.md and writes its picture. The relative MSE of a picture A is that of
`lajolla compare`, but to two references B and C with other seeds: the mean of (A - B) (A - C) / (R^2 + 0.01),
where R is their mean. Its expectation has no part of the references' own noise.
"""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import lajolla
from lajolla.image import Image, read

ROOT = Path(__file__).resolve().parent.parent
SEED = 12345  # of the references; pictures have the scenes' own
COUNTS = (4, 16, 64)  # samples per pixel
REFERENCES = (1024, 256)
SECONDS = ("render s", "features s", "denoise s")


@dataclass(frozen=True)
class Example:
    """A scene in a small size: in the checkout, or of the public scenes."""

    name: str
    path: str
    size: tuple[int, int]

    def load(self, public: Path) -> lajolla.Scene:
        folder = ROOT if self.path.startswith("scenes/") else public
        return lajolla.load(folder / self.path, size=self.size)


EXAMPLES = (
    Example("cornell-box", "scenes/cornell-box.xml", (256, 256)),
    Example("interior", "scenes/interior.xml", (320, 200)),
    Example("materials", "scenes/materials.xml", (320, 147)),
    Example("bitterli/coffee", "bitterli/coffee/scene.xml", (200, 250)),
    Example("bitterli/staircase2", "bitterli/staircase2/scene.xml", (320, 180)),
)
PICTURE = Example("interior", "scenes/interior.xml", (432, 270))


def error_of(picture: np.ndarray, references: list[np.ndarray]) -> float:
    """The relative MSE of a picture, without the noise of the references."""
    weights = np.divide(REFERENCES, sum(REFERENCES))
    mean = np.tensordot(weights, references, 1)
    first, second = (picture - reference for reference in references)
    return float(np.mean(first * second / (mean**2 + 1e-2)))


def references_of(example: Example, scene: lajolla.Scene, folder: Path | None) -> list[np.ndarray]:
    """Two independent renders, or those that a folder keeps."""
    result = []
    for index, spp in enumerate(REFERENCES):
        kept = folder and folder / f"{example.name.replace('/', '-')}-{spp}.exr"
        if kept is not None and kept.exists():
            result.append(read(kept))
            continue
        image = scene.render(spp=spp, seed=SEED + index)
        result.append(image.array)
        if kept is not None:
            image.save(kept)
    return result


def measured(example: Example, scene: lajolla.Scene, references: list[np.ndarray]) -> list[str]:
    """The rows of one scene."""
    features, feature_seconds = timed(scene.features)
    rows = []
    for spp in COUNTS:
        noisy, seconds = timed(lambda spp=spp: scene.render(spp=spp))
        clean, denoise_seconds = timed(lambda noisy=noisy: noisy.denoise(features))
        errors = [error_of(image.array, references) for image in (noisy, noisy.denoise({}), clean)]
        times = [seconds, feature_seconds, denoise_seconds]
        cells = [*(f"{error:.5f}" for error in errors), f"{errors[0] / errors[2]:.0f}"]
        cells += [f"{value:.1f}" for value in times]
        rows.append(f"| {example.name} | {spp} | " + " | ".join(cells) + " |")
    return rows


def timed(action):  # noqa: ANN001, ANN201
    start = time.perf_counter()
    result = action()
    return result, time.perf_counter() - start


def write_picture(public: Path, target: Path) -> None:
    """Before and after, side by side."""
    image = PICTURE.load(public).render(spp=8, denoise=True)
    noisy = np.dstack([image.channels[name] for name in lajolla.denoising.NOISY])
    pair = np.hstack([noisy, image.array])
    Image(pair, film=image.film).save(target)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=Path, default=ROOT.parent / "shared" / "scenes")
    parser.add_argument("--references", type=Path, help="folder that keeps the references")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", lajolla.LajollaWarning)
    columns = ("scene", "spp", "rendered", "no features", "denoised", "ratio", *SECONDS)
    print("| " + " | ".join(columns) + " |")
    print("|---" * len(columns) + "|")
    for example in EXAMPLES:
        scene = example.load(arguments.scenes)
        references = references_of(example, scene, arguments.references)
        for row in measured(example, scene, references):
            print(row, flush=True)
    write_picture(arguments.scenes, ROOT / "docs" / "images" / "denoising.jpg")


if __name__ == "__main__":
    main()
