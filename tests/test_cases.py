"""Small scenes that were once read wrongly, against the means of Mitsuba's pictures of them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import lajolla

FOLDER = Path(__file__).resolve().parents[2] / "shared" / "cases"

# Red, green and blue; where Mitsuba does not open a scene, by reasoning (see the README beside them).
MEANS = {
    "03-area-emitter-by-ref": (0.5594, 1.1187, 1.6781),
    "01-constvolume-to_world": (0.9148, 0.9268, 0.9408),
    "01b-same-as-gridvolume": (0.9148, 0.9268, 0.9408),
    "06-polarizer-is-not-opaque": (0.5648, 0.5648, 0.5648),
    "07-retarder-circular": (0.7824, 0.7824, 0.7824),
    "09-roughplastic-beckmann-true": (0.3595, 0.5220, 0.8345),
    "batch": (0.8476, 0.8476, 0.8476),
    "blender42_tex": (0.5807, 0.5811, 0.5812),
    "chan_a_06": (1 - 64 / 255,) * 3,
    "old_grey": (0.2159, 0.2159, 0.2159),
    "concave_obj": (0.7378, 0.7378, 0.7378),
    "meshlab_wedge_tex": (0.5807, 0.5811, 0.5812),  # the same square
}


def case(name: str) -> Path:
    path = FOLDER / f"{name}.xml"
    if not path.is_file():
        pytest.fail(f"no {path}") if os.environ.get("CI") else pytest.skip(f"no {path}")
    return path


@pytest.mark.parametrize("name", MEANS)
def test_means(name: str) -> None:
    scene = lajolla.load(case(name))
    picture = scene.render(spp=max(256, 2**18 // (scene.width * scene.height)), seed=1).array
    assert np.allclose(picture.mean((0, 1)), MEANS[name], rtol=0.003, atol=0.001)
