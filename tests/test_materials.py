"""Trees of materials: blends and masks against closed forms, and normals that make nothing black."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scene_tools import batch_means, check_mean, make_scene, picture, point_view, translation
from statistics_tools import generator

from lajolla import _core

Settings = dict[str, Any]
WHITE = {"type": "diffuse", "reflectance": 1}
SKY = {"type": "constant", "radiance": 1}
PLANE: Settings = {"type": "rectangle", "to_world": np.diag([30, 30, 1, 1]).tolist(), "material": 0}
each_strategy = pytest.mark.parametrize("strategy", ["mis", "bsdf", "light"])


def grey(value: float) -> Settings:
    return {"type": "diffuse", "reflectance": value}


@each_strategy
def test_a_blend_is_the_weighted_sum(strategy: str) -> None:
    """Nested: 0.4 (0.25 a + 0.75 b) + 0.6 c of the sky's light, and the textured weight's mean of it."""
    blends = [
        {"type": "blendbsdf", "weight": 0.75, "first": 0, "second": 1},
        {"type": "blendbsdf", "weight": {"texture": 0}, "first": {"adapter": 0}, "second": 2},
    ]
    scene = make_scene(
        shapes=[PLANE],
        emitters=[SKY],
        textures=[{"type": "checkerboard", "color0": 0.6, "color1": 0.6}],
        bsdfs=[grey(0.9), grey(0.2), {"type": "roughplastic", "diffuse_reflectance": 0}],
        adapters=blends,
        materials=[{"front": {"adapter": 1}}],
        sensor=point_view((0, 1, 2)),
        max_depth=2,
        strategy=strategy,
    )
    alone = make_scene(
        shapes=[PLANE],
        emitters=[SKY],
        bsdfs=[{"type": "roughplastic", "diffuse_reflectance": 0}],
        sensor=point_view((0, 1, 2)),
        max_depth=2,
    )
    plastic = batch_means(alone, 256).mean()
    expected = 0.4 * (0.25 * 0.9 + 0.75 * 0.2) + 0.6 * plastic
    check_mean(f"blend, {strategy}", batch_means(scene, 256), expected, slack=2e-3)


@each_strategy
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_blends_of_holes(order: tuple[int, int], strategy: str) -> None:
    """0.3 of a sheet that stops 0.2, 0.7 of one that stops 0.9, before a light of 4 and under a sky of 2."""
    first, second = order
    masks = [{"type": "mask", "opacity": 0.2, "child": 0}, {"type": "mask", "opacity": 0.9, "child": 1}]
    blend = {"weight": 0.7 if first == 0 else 0.3, "first": {"adapter": first}, "second": {"adapter": second}}
    scene = make_scene(
        shapes=[
            PLANE,
            {"type": "rectangle", "to_world": translation(0, 0, -1) @ np.diag([30, 30, 1, 1]), "emitter": 0},
        ],
        emitters=[{"type": "area", "radiance": 4}, {"type": "constant", "radiance": 2}],
        bsdfs=[grey(0.8), grey(0.5)],
        adapters=[*masks, {"type": "blendbsdf", **blend}],
        materials=[{"front": {"adapter": 2}}],
        sensor=point_view(),
        max_depth=2,
        strategy=strategy,
    )
    stopped = 0.3 * 0.2 + 0.7 * 0.9
    expected = 2 * (0.3 * 0.2 * 0.8 + 0.7 * 0.9 * 0.5) + 4 * (1 - stopped)
    check_mean(f"holes, {strategy}", batch_means(scene, 512), expected)


def test_what_lets_light_through_needs_no_back() -> None:
    """A blend of a grey sheet and nothing: from behind the grey part is black."""
    for back, expected in ((-1, 0.6), ({"adapter": 0}, 0.6 + 0.4 * 0.5)):
        scene = make_scene(
            shapes=[PLANE],
            emitters=[SKY],
            bsdfs=[{"type": "thindielectric"}, grey(0.5)],
            adapters=[{"type": "blendbsdf", "weight": 0.4, "first": 0, "second": 1}],
            materials=[{"front": {"adapter": 0}, "back": back}],
            sensor=point_view((0, 1, -2)),
        )
        check_mean(f"from behind, {back}", batch_means(scene, 512), expected)


SPHERE_VIEW = {"type": "perspective", "fov": 24, "to_world": translation(0, 0, -5).tolist()}
MAPS = {
    "normals": {"type": "normalmap", "normalmap": {"texture": 0}},
    "bumps": {"type": "bumpmap", "map": {"texture": 0}, "scale": 0.5},
    "both": {"type": "bumpmap", "map": {"texture": 0}, "scale": 0.5, "child": {"adapter": 0}},
    "none": {"type": "mask", "opacity": 1},
}


def rough_ball(bsdf: Settings, maps: str, shape: str, **rules: bool) -> _core.Scene:
    """A ball with normals that point anywhere, under a white sky."""
    noise = generator("noise").integers(0, 256, (16, 24, 3)).astype(np.uint8)
    first = {"type": "normalmap", "normalmap": {"texture": 0}, "child": 0, **rules}
    settings: Settings = {"child": 0, **MAPS[maps]} | (rules if maps != "none" else {})
    return make_scene(
        shapes=[{**ball(shape), "material": 0}],
        emitters=[SKY],
        textures=[{"type": "bitmap", "image": _core.Image(noise, srgb=False)}],
        bsdfs=[bsdf],
        adapters=[first, settings],
        materials=[{"front": {"adapter": 1}}],
        sensor=SPHERE_VIEW,
        size=(32, 32),
        max_depth=-1,
    )


def ball(shape: str) -> Settings:
    """A unit ball: true, or of few triangles with the ball's normals."""
    if shape == "sphere":
        return {"type": "sphere"}
    rows, columns = np.meshgrid(np.linspace(0, np.pi, 7), np.linspace(0, 2 * np.pi, 11), indexing="ij")
    points = np.stack([np.sin(rows) * np.cos(columns), np.sin(rows) * np.sin(columns), np.cos(rows)], -1)
    uv = np.stack([columns / (2 * np.pi), rows / np.pi], -1)
    corner = np.arange(66).reshape(6, 11)[:, :-1]
    faces = np.concatenate(
        [np.stack([corner, corner + 11, corner + 12], -1), np.stack([corner, corner + 12, corner + 1], -1)]
    )
    flat = points.reshape(-1, 3).astype(np.float32)
    mesh = _core.Mesh(
        flat, faces.reshape(-1, 3).astype(np.uint32), flat, uv.reshape(-1, 2).astype(np.float32)
    )
    return {"type": "mesh", "mesh": mesh}


def inside(image: np.ndarray) -> np.ndarray:
    """The pixels that see the ball, coarse as it may be, and not the sky."""
    y, x = np.indices(image.shape[:2]) - 15.5
    return image[np.hypot(x, y) < 13.5]


@pytest.mark.parametrize("shape", ["sphere", "coarse"])
@pytest.mark.parametrize("maps", MAPS)
@pytest.mark.parametrize("flip", [False, True])
def test_mirrors_with_any_normals_reflect_the_sky(maps: str, shape: str, flip: bool) -> None:
    """Whatever the normal, the mirror image of the viewer is above the convex surface: nothing is black."""
    rules = {"flip_invalid_normals": flip, "use_shadowing_function": False}
    scene = rough_ball({"type": "conductor"}, maps, shape, **rules)
    assert np.abs(picture(scene, 16) - 1).max() < 1e-4


@pytest.mark.parametrize("shape", ["sphere", "coarse"])
@pytest.mark.parametrize("maps", MAPS)
@pytest.mark.parametrize("flip", [False, True])
def test_matte_surfaces_with_any_normals_are_not_black(maps: str, shape: str, flip: bool) -> None:
    """At most half of a Lambertian lobe around a normal that faces the viewer is below the surface."""
    rules = {"flip_invalid_normals": flip, "use_shadowing_function": False}
    image = picture(rough_ball(WHITE, maps, shape, **rules), 256)
    assert inside(image).min() > 0.35 and image.max() < 1.2
    image = picture(rough_ball(WHITE, maps, shape, flip_invalid_normals=flip), 64)
    assert inside(image).min() > 0.05


@pytest.mark.parametrize("alpha", [0.05, 0.4])
def test_rough_metal_with_any_normals_is_not_black(alpha: float) -> None:
    metal = {"type": "roughconductor", "alpha_u": alpha, "alpha_v": alpha}
    for shape in ("sphere", "coarse"):
        plain = rough_ball(metal, "normals", shape, use_shadowing_function=False)
        assert inside(picture(plain, 64)).min() > 0.2
        assert inside(picture(rough_ball(metal, "normals", shape), 64)).min() > 0.02


@each_strategy
def test_no_light_through_tilted_normals(strategy: str) -> None:
    """A sheet whose vertex normals lean towards a light behind it is not lit from there."""
    corners = np.array([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], np.float32)
    normals = np.tile(np.array([0.8, 0, 0.6], np.float32), (4, 1))
    sheet = _core.Mesh(corners, np.array([(0, 1, 2), (0, 2, 3)], np.uint32), normals, None)
    lamp = {"type": "sphere", "center": [6, 0, -2], "radius": 0.5, "emitter": 0}
    for bsdf in (WHITE, {"type": "roughconductor", "alpha_u": 0.5, "alpha_v": 0.5}):
        scene = make_scene(
            shapes=[{"type": "mesh", "mesh": sheet, "material": 0}, lamp],
            emitters=[{"type": "area", "radiance": 100}],
            bsdfs=[bsdf],
            sensor=point_view((-3, 0, 2)),
            max_depth=2,
            strategy=strategy,
        )
        assert picture(scene, 64).max() == 0


@pytest.mark.parametrize(
    "adapters, message",
    [
        ([{"type": "mask", "child": {"adapter": 0}}], r"adapters\[0\].child: there is no adapter 0 before"),
        ([{"type": "mask", "child": 7}], r"adapters\[0\].child: there is no bsdf 7"),
        ([{"type": "mask", "opacity": {"texture": 1}}], r"adapters\[0\].opacity: there is no texture 1"),
        ([{"type": "mask", "opacity": 2}], r"in \[0, 1\], got 2"),
        ([{"type": "mask", "child": {"adapter": -1}}], r"expected an index or \{'adapter': index\}"),
        ([{"type": "mask", "first": 0}], r"unknown field 'first'"),
        (
            [{"type": "mask"}] + [{"type": "mask", "child": {"adapter": i}} for i in range(64)],
            "nested more than 64 deep",
        ),
        (
            [{"type": "mask"}]
            + [{"type": "blendbsdf", "first": {"adapter": i}, "second": {"adapter": i}} for i in range(13)],
            "mixture of more than 4096",
        ),
    ],
)
def test_trees_that_are_refused(adapters: list[Settings], message: str) -> None:
    with pytest.raises(_core.DescriptionError, match=message):
        make_scene(shapes=[PLANE], adapters=adapters)


def test_unknown_fields_of_a_material_are_refused() -> None:
    with pytest.raises(_core.DescriptionError, match=r"materials\[0\]: unknown field 'opacity'"):
        make_scene(shapes=[PLANE], materials=[{"front": 0, "opacity": 0.5}])
