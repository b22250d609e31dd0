"""Integrators that show the first hit, against what it must be."""

from __future__ import annotations

import numpy as np
import pytest
from scene_tools import PINHOLE, Settings, front_view, make_scene, picture, scaling, translation, uv_sphere

from lajolla import _core


def view_of_sphere(field: str, shape: Settings | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The picture, and the coordinates of its pixels' centres; rays that nearly miss are left out."""
    size = 32
    scene = make_scene(
        shapes=[{"type": "sphere", "material": 0, **(shape or {})}],
        sensor={"type": "orthographic", "to_world": translation(0, 0, -3)},
        size=(size, size),
        rfilter=PINHOLE,
        type="field",
        field=field,
    )
    centres = 1 - 2 * (np.arange(size) + 0.5) / size
    x, y = np.meshgrid(centres, centres)
    inner = x**2 + y**2 < 0.9
    return picture(scene, 1)[inner], x[inner], y[inner]


def test_depth() -> None:
    image, x, y = view_of_sphere("depth")
    np.testing.assert_allclose(image[:, 0], 3 - np.sqrt(1 - x**2 - y**2), atol=1e-3)
    assert (image == image[:, :1]).all()


def test_shading_normal() -> None:
    for flip in (1, -1):
        image, x, y = view_of_sphere("sh_normal", {"flip_normals": flip < 0})
        expected = flip * np.stack([x, y, -np.sqrt(1 - x**2 - y**2)], axis=1)
        np.testing.assert_allclose(image, expected, atol=1e-3)
    smooth = {"type": "mesh", "mesh": uv_sphere(96, 48, smooth=True)}
    image, x, y = view_of_sphere("sh_normal", smooth)
    np.testing.assert_allclose(image, np.stack([x, y, -np.sqrt(1 - x**2 - y**2)], axis=1), atol=1e-2)


def test_mean_curvature() -> None:
    image, _, _ = view_of_sphere("mean_curvature")
    np.testing.assert_allclose(image, 1, rtol=1e-5)
    image, _, _ = view_of_sphere("mean_curvature", {"type": "mesh", "mesh": uv_sphere(96, 48, smooth=True)})
    np.testing.assert_allclose(np.median(image), 1, rtol=1e-2)


def test_ray_cones() -> None:
    """Half a pixel wide where the ray meets a surface; cones of perspective cameras open with distance."""
    image, _, _ = view_of_sphere("ray_cone")
    np.testing.assert_allclose(image, np.tile([1 / 32, 0, 0], (len(image), 1)), rtol=1e-5)
    size, fov, distance = 24, 60, 5
    scene = make_scene(
        shapes=[{"type": "rectangle", "to_world": translation(0, 0, distance) @ scaling(50)}],
        sensor={"type": "perspective", "fov": fov},
        size=(size, size),
        rfilter=PINHOLE,
        type="field",
        field="ray_cone",
    )
    half_pixel = np.tan(np.radians(fov / 2)) / size
    image = picture(scene, 1)
    np.testing.assert_allclose(image[..., 0], half_pixel * distance, rtol=1e-4)
    centres = (2 * (np.arange(size) + 0.5) / size - 1) * np.tan(np.radians(fov / 2))
    lengths = np.sqrt(1 + centres[None] ** 2 + centres[:, None] ** 2)
    np.testing.assert_allclose(image[..., 1], half_pixel / lengths, rtol=1e-3)


@pytest.mark.parametrize("texels, repeats", [(64, 1), (64, 4), (256, 1), (2, 1)])
def test_mipmap_level(texels: int, repeats: int) -> None:
    """log2 of the texels across the radius of a pixel's footprint."""
    bitmap = {
        "type": "bitmap",
        "image": _core.Image(np.ones((texels, texels), np.float32)),
        "filter_type": "trilinear",
        "to_uv": scaling(repeats),
    }
    for width in (2, 0.5):
        scene = make_scene(
            shapes=[{"type": "rectangle", "to_world": scaling(20), "material": 0}],
            textures=[bitmap],
            bsdfs=[{"type": "diffuse", "reflectance": {"texture": 0}}],
            sensor=front_view(3, width),
            size=(16, 16),
            type="field",
            field="mip_level",
        )
        radius = width / 16 / 2
        np.testing.assert_allclose(picture(scene, 1), np.log2(texels * repeats * radius / 40), atol=1e-3)


def fields() -> list[str]:
    return next(f["choices"] for f in _core.schema()["integrator"]["field"]["fields"] if f["name"] == "field")


def test_fields_are_undefined_where_nothing_is() -> None:
    for field in fields():
        scene = make_scene(type="field", field=field, undefined=(1, 2, -3))
        assert (picture(scene, 1) == (1, 2, -3)).all()
