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

ELSEWHERE = ("10-convert-orthographic-scale", "20-convert-normalmap-empty")  # in test_convert_scenes.py


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


def test_the_sky_ends_at_the_horizon() -> None:
    """Between rows 39 and 40 of 80: 0.145 above it, as in Mitsuba, and black below."""
    picture = lajolla.load(case("15-sky-horizon")).render(spp=64, seed=1).array
    assert np.allclose(picture[39, :, 0], 0.145, rtol=0.005)
    assert not picture[40:].any()


def test_r0_is_the_colour_of_the_metal() -> None:
    """In the middle of the ball, where it is seen at normal incidence."""
    picture = lajolla.load(case("19-roughconductorGGX-R0")).render(spp=4096, seed=1).array
    assert np.allclose(picture[11:13, 11:13].mean((0, 1)), (0.88627, 0.61176, 0.27059), rtol=0.005)


def test_every_case_has_a_test() -> None:
    tested = {*MEANS, *ELSEWHERE, "15-sky-horizon", "19-roughconductorGGX-R0"}
    assert {path.stem for path in case("batch").parent.glob("*.xml")} == tested
