"""Measures how much noise `--denoise` removes, and how long it takes.

    python bench/denoising.py [--scenes FOLDER] [--spp 1024] [--references FOLDER]

prints the table in docs/denoising.md and writes its picture. Relative MSEs are those of `lajolla compare`,
averaged over the three channels. The reference of each scene is the mean of two renders with other seeds, of
`--spp` samples per pixel each. Its own error, a quarter of their relative MSE to each other, is subtracted.
"""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import lajolla
from lajolla.comparison import compare
from lajolla.image import Image, read

ROOT = Path(__file__).resolve().parent.parent
SEED = 12345  # of the references; pictures have the scenes' own
COUNTS = (4, 16, 64)  # samples per pixel
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
PICTURE = Example("interior", "scenes/interior.xml", (480, 300))


@dataclass
class Reference:
    """Two independent renders."""

    halves: list[np.ndarray]

    def error_of(self, picture: np.ndarray) -> float:
        """The relative MSE of a picture, without that of the reference."""
        own = compare(*self.halves).relative_mse.mean() / 4
        return float(compare(picture, np.mean(self.halves, axis=0)).relative_mse.mean() - own)


def reference_of(example: Example, scene: lajolla.Scene, spp: int, folder: Path | None) -> Reference:
    """Rendered, or read from a folder that keeps it."""
    halves = []
    for half in (0, 1):
        kept = folder and folder / f"{example.name.replace('/', '-')}-{spp}-{half}.exr"
        if kept is None or not kept.exists():
            image = scene.render(spp=spp, seed=SEED + half)
            halves.append(image.array)
            if kept is not None:
                image.save(kept)
        else:
            halves.append(read(kept))
    return Reference(halves)


def measured(example: Example, scene: lajolla.Scene, reference: Reference) -> list[str]:
    """The rows of one scene."""
    features, feature_seconds = timed(scene.features)
    rows = []
    for spp in COUNTS:
        noisy, seconds = timed(lambda spp=spp: scene.render(spp=spp))
        clean, denoise_seconds = timed(lambda noisy=noisy: noisy.denoise(features))
        errors = [reference.error_of(image.array) for image in (noisy, noisy.denoise({}), clean)]
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
    parser.add_argument("--spp", type=int, default=1024, help="of each half of the references")
    parser.add_argument("--references", type=Path, help="folder that keeps the references")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", lajolla.LajollaWarning)
    columns = ("scene", "spp", "rendered", "no features", "denoised", "ratio", *SECONDS)
    print("| " + " | ".join(columns) + " |")
    print("|---" * len(columns) + "|")
    for example in EXAMPLES:
        scene = example.load(arguments.scenes)
        reference = reference_of(example, scene, arguments.spp, arguments.references)
        for row in measured(example, scene, reference):
            print(row, flush=True)
    write_picture(arguments.scenes, ROOT / "docs" / "images" / "denoising.jpg")


if __name__ == "__main__":
    main()
