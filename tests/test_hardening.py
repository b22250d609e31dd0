"""What broken or extreme input must not do to the core: crash, hang, or lose samples silently."""

import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lajolla import _core

MATTE = {"bsdfs": [{"type": "diffuse"}], "materials": [{"front": 0}], "film": {"width": 16, "height": 16}}
BALL = {"type": "sphere", "center": (0, 0, 5), "material": 0}


def render(description: dict[str, Any], spp: int = 4) -> _core.Render:
    result = _core.Render(_core.Scene(description))
    assert result.advance(spp)
    return result


def test_a_light_without_triangles_is_dark() -> None:
    empty = _core.Mesh(np.zeros((3, 3), np.float32), np.zeros((0, 3), np.uint32))
    light = {"type": "mesh", "mesh": empty, "emitter": 0}
    result = render({**MATTE, "shapes": [light, BALL], "emitters": [{"type": "area"}]})
    assert not result.image().any()


@pytest.mark.parametrize("rr_depth", [0, 5])
def test_every_nan_is_counted(rr_depth: int) -> None:
    """In a closed sphere whose texture is NaN, whether or not roulette looks at the throughput."""
    broken = _core.Image(np.full((2, 2, 3), np.nan, np.float32))
    result = render(
        {
            "textures": [{"type": "bitmap", "image": broken}],
            "bsdfs": [{"type": "diffuse", "reflectance": {"texture": 0}}],
            "materials": [{"front": 0}],
            "shapes": [{"type": "sphere", "material": 0, "flip_normals": True}],
            "emitters": [{"type": "constant"}],
            "film": {"width": 16, "height": 16},
            "integrator": {"type": "path", "rr_depth": rr_depth},
        }
    )
    assert result.nonfinite == 16 * 16 * 4


def test_absurd_distances_do_not_reach_the_ray_tracer() -> None:
    lights = [{"type": "constant"}, {"type": "point", "position": (0, 0, 1e19)}]
    assert render({**MATTE, "shapes": [BALL], "emitters": lights}).image().mean() > 0.5
    far = np.diag([1, 1, 1, 1.0])
    far[2, 3] = 1e19
    render(
        {
            **MATTE,
            "shapes": [BALL],
            "emitters": lights[:1],
            "sensor": {"type": "perspective", "to_world": far},
        }
    )


def test_a_path_ends_although_roulette_may_not_end_it() -> None:
    description = {
        "bsdfs": [{"type": "diffuse", "reflectance": 1}],
        "materials": [{"front": 0}],
        "shapes": [{"type": "sphere", "material": 0, "flip_normals": True}],
        "film": {"width": 2, "height": 2},
        "integrator": {"type": "path", "rr_depth": 2_000_000_000},
    }
    render(description, spp=1)


def test_cancelling_spoils_nothing_that_follows() -> None:
    result = render({**MATTE, "shapes": [BALL], "emitters": [{"type": "constant"}]})
    result.cancel()
    assert not result.advance(8)
    assert result.advance(8)
    assert result.samples == 8


def test_a_picture_can_be_taken_while_samples_are_added() -> None:
    result = render({**MATTE, "shapes": [BALL], "emitters": [{"type": "constant"}]})
    adders = [threading.Thread(target=result.advance, args=(samples,)) for samples in (64, 128)]
    for adder in adders:
        adder.start()
    while any(adder.is_alive() for adder in adders):
        assert np.isfinite(result.image()).all()
    assert result.samples == 128


def test_a_folder_is_no_mesh(tmp_path: Path) -> None:
    with pytest.raises(_core.MeshError, match="not a file"):
        _core.load_ply(tmp_path)


def striped_mirror(bsdf: dict[str, Any], filter_type: str) -> float:
    """Contrast of a striped emitter's texture seen in a flat mirror."""
    stripes = np.zeros((4, 64, 3), np.uint8)
    stripes[:, ::2] = 255
    turned = np.diag([4.0, 4.0, -1.0, 1.0])  # faces the mirror from behind the camera
    turned[2, 3] = -6
    mirror = np.diag([4.0, 4.0, -1.0, 1.0])
    mirror[2, 3] = 6
    description = {
        "textures": [
            {
                "type": "bitmap",
                "image": _core.Image(stripes),
                "filter_type": filter_type,
                "wrap_mode": "clamp",
            }
        ],
        "bsdfs": [bsdf, {"type": "diffuse", "reflectance": {"texture": 0}}],
        "materials": [{"front": 0, "back": 0}, {"front": 1, "back": 1}],
        "shapes": [
            {"type": "rectangle", "to_world": mirror, "material": 0},
            {"type": "rectangle", "to_world": turned, "material": 1},
        ],
        "emitters": [{"type": "constant"}],
        "sensor": {"type": "perspective", "fov": 20},
        "film": {"width": 64, "height": 64},
        "integrator": {"type": "path", "max_depth": 3},
    }
    picture = render(description, spp=16).image()
    columns = picture.mean(axis=(0, 2))
    return float(columns.std() / columns.mean())


@pytest.mark.parametrize(
    "bsdf",
    [
        {"type": "conductor"},
        {"type": "plastic", "diffuse_reflectance": 0},
        {"type": "roughplastic", "diffuse_reflectance": 0, "alpha": 0.001},
    ],
    ids=lambda bsdf: bsdf["type"],
)
def test_mip_maps_do_not_blur_what_a_mirror_shows(bsdf: dict[str, Any]) -> None:
    sharp = striped_mirror(bsdf, "bilinear")
    assert sharp > 0.2
    assert striped_mirror(bsdf, "trilinear") > 0.8 * sharp
