"""The scenes of lajolla's volumetric path tracer against renders by another implementation of it."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from oracle import Estimate

import lajolla

SHARED = Path(__file__).resolve().parents[2] / "shared" / "scenes"
BLOCK = 16
ALLOWANCE = 0.01  # of the mean: constants, filters and colours may differ so much
OUTLIERS = 0.01  # fraction of blocks that may be beyond four standard errors: fireflies of the references

# Not among these: vol_cbox, whose spectra the reference turns into other colours, and volpath_test5_2, where
# the mean free path is as short as the reference's (and, less so, Mitsuba's) offset of rays from surfaces.
SCENES = "test1 test2 test3 test4_2 test5 test6"
NAMES = [f"volpath_{name}" for name in SCENES.split()] + ["hetvol", "hetvol_colored"]


def read_reference(path: Path) -> np.ndarray:
    import OpenImageIO as oiio

    return np.asarray(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT), dtype=np.float64)[..., :3]


def block_errors(squares: np.ndarray) -> np.ndarray:
    """Standard errors of block means from estimates of the pixels' variances."""
    return np.sqrt(Estimate(squares[None]).blocks(BLOCK)[0]) / BLOCK


@pytest.mark.parametrize("name", NAMES)
def test_means_agree(name: str) -> None:
    """The whole picture's means within 1 % and three standard errors, and those of blocks within four."""
    scene, render = SHARED / "lajolla/volpath_test" / f"{name}.xml", SHARED / "lajolla-refs" / f"{name}.exr"
    if not (scene.is_file() and render.is_file()):
        pytest.fail(f"no {scene}") if os.environ.get("CI") else pytest.skip(f"no {scene}")
    theirs = read_reference(render)
    loaded = lajolla.load(scene)
    first, second = (loaded.render(spp=4, seed=seed).array.astype(np.float64) for seed in range(2))
    a, b = (Estimate(image[None]).blocks(BLOCK)[0] for image in ((first + second) / 2, theirs))
    between_neighbours = np.diff(theirs, axis=1, prepend=theirs[:, :1]) ** 2 / 2
    error = np.hypot(block_errors((first - second) ** 2 / 4), block_errors(between_neighbours)) + 1e-9
    beyond = np.maximum(np.abs(a - b) - ALLOWANCE * b, 0) > 4 * error
    assert beyond.mean() < OUTLIERS, f"{beyond.mean():.2%} of the blocks differ"
    ratio = a.mean((0, 1)) / b.mean((0, 1))
    noise = np.sqrt((error**2).sum((0, 1))) / error[..., 0].size / b.mean((0, 1))
    assert (np.abs(ratio - 1) < ALLOWANCE + 3 * noise).all(), f"means differ: {ratio}, noise {noise}"
