"""lajolla against reference images made by another renderer.

Each reference comes with the variance of one sample per pixel. A render of n samples is tested against it by
z-tests: pixel by pixel (Sidak-corrected; a few pixels may fail, because the estimate of a pixel that rarely
sees a bright light is far from normal), by blocks of 8x8 pixels, and by channel means. The tests are made in
CIE XYZ, for the files hold the variances of X, Y and Z, multiplied by the matrix that turns XYZ into RGB.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from oracle import RELATIVE_ALLOWANCE, Estimate
from scipy import stats

FOLDER = Path(__file__).resolve().parents[2] / "shared" / "scenes" / "mitsuba-data" / "tests" / "scenes"
SAMPLE_BUDGET = 2_000_000
SIGNIFICANCE = 0.01
PIXELS_ALLOWED_TO_FAIL = 0.0025
# Below this variance of one sample, rounding counts for more than noise.
SMALLEST_VARIANCE = 1e-4

# Linear sRGB to XYZ (IEC 61966-2-1).
RGB_TO_XYZ = np.array(
    [[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169], [0.019334, 0.119193, 0.950227]]
)


def scene_files() -> list[Path]:
    """Every scene that has a reference image and its variance."""
    return [
        path for path in sorted(FOLDER.glob("*/*.xml")) if all(file.is_file() for file in references(path))
    ]


def references(scene: Path) -> tuple[Path, Path]:
    """The mean and the variance image of a scene; the last part of its name is the integrator."""
    stem = scene.stem.rsplit("_", 1)[0]
    return scene.parent / "refs" / f"{stem}_ref_rgb.exr", scene.parent / "refs" / f"{stem}_ref_rgb_var.exr"


def read_xyz(path: Path) -> np.ndarray:
    """Reads an RGB image, independently of lajolla's own reader, as XYZ in float64 (H, W, 3)."""
    import OpenImageIO as oiio

    buffer = oiio.ImageBuf(str(path))
    return np.asarray(buffer.get_pixels(oiio.FLOAT), dtype=np.float64)[..., :3] @ RGB_TO_XYZ.T


def disagreements(image: np.ndarray, samples: int, mean: np.ndarray, variance: np.ndarray) -> list[str]:
    """What speaks against `image` having the reference's mean, one line per test."""
    found = []
    error = np.sqrt(np.maximum(variance, SMALLEST_VARIANCE) / samples)
    excess = np.maximum(np.abs(image - mean) - RELATIVE_ALLOWANCE * mean, 0)
    failed = 2 * stats.norm.sf(excess / error) < sidak(image.size)
    if failed.mean() > PIXELS_ALLOWED_TO_FAIL:
        found.append(f"{failed.sum()} of {failed.size} pixel values differ")
    a, b, squares = (Estimate(x[None]).blocks(8)[0] for x in (image, mean, error**2))
    excess = np.maximum(np.abs(a - b) - RELATIVE_ALLOWANCE * b, 0)
    failed = 2 * stats.norm.sf(excess / np.sqrt(squares / 64)) < sidak(a.size)
    if failed.any():
        worst = np.unravel_index(np.argmax(excess / np.sqrt(squares)), a.shape)
        at = (8 * int(worst[1]), 8 * int(worst[0]))
        found.append(f"{failed.sum()} of {a.size} blocks differ: at {at} {a[worst]:.6g}, not {b[worst]:.6g}")
    for channel in range(3):
        x, y = image[..., channel].mean(), mean[..., channel].mean()
        deviation = np.sqrt((error[..., channel] ** 2).sum()) / error[..., channel].size
        if abs(x - y) > 3 * deviation + RELATIVE_ALLOWANCE * y:
            found.append(f"channel {'XYZ'[channel]}: {x:.6g}, not {y:.6g} (standard error {deviation:.2g})")
    return found


def sidak(count: int) -> float:
    """The level of one of `count` tests that together err with probability `SIGNIFICANCE`."""
    return -np.expm1(np.log1p(-SIGNIFICANCE) / count)


def test_the_reference_images_are_here() -> None:
    if not scene_files():
        message = f"no reference images in {FOLDER}"
        pytest.fail(message) if os.environ.get("CI") else pytest.skip(message)


@pytest.mark.parametrize("scene", scene_files(), ids=lambda scene: scene.stem)
def test_reference(scene: Path) -> None:
    import lajolla

    mean, variance = (read_xyz(file) for file in references(scene))
    samples = SAMPLE_BUDGET // (mean.shape[0] * mean.shape[1])
    image = lajolla.load(scene).render(spp=samples, seed=0, threads=os.cpu_count()).array
    assert image.shape == mean.shape
    found = disagreements(np.asarray(image, dtype=np.float64) @ RGB_TO_XYZ.T, samples, mean, variance)
    assert not found, "\n".join(found)
