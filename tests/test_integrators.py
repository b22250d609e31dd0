"""The path tracer against answers known in closed form, and its strategies against each other.

Means are compared by t-tests; together with all other statistical tests they reject a correct renderer with
the probability that statistics_tools states.
"""

from __future__ import annotations

import numpy as np
import pytest
from emitter_tools import random_bitmap
from scatter_tools import MODELS
from scene_tools import (
    PINHOLE,
    Settings,
    area,
    batch_means,
    check_mean,
    check_same_mean,
    front_view,
    look_at,
    make_scene,
    picture,
    point_view,
    rotation,
    scaling,
    translation,
)
from statistics_tools import ROUNDING
from test_scatter import LOSSLESS

import lajolla
from lajolla import _core
from lajolla.limits import STRATEGIES
from lajolla.scene import core_schema

HEURISTICS = ["power", "balance", "maximum"]
each_strategy = pytest.mark.parametrize("strategy", STRATEGIES)

ALBEDO = 0.6
PLANE: Settings = {"type": "rectangle", "to_world": scaling(50), "material": 0}
GREY: Settings = {"type": "diffuse", "reflectance": ALBEDO}
FACING_DOWN = rotation((1, 0, 0), 180)


# Radiance of a diffuse plane under one light: the light, its shape, and the irradiance over pi.
def under_sphere(cosine: float, distance: float, radius: float) -> tuple[Settings, Settings, float]:
    """A sphere above the horizon: the irradiance of its solid angle, projected."""
    center = distance * np.array([np.sqrt(1 - cosine**2), 0, cosine])
    shape = {"type": "sphere", "center": center.tolist(), "radius": radius}
    return area(7), shape, 7 * cosine * (radius / distance) ** 2


def under_rectangle(a: float, b: float, height: float) -> tuple[Settings, Settings, float]:
    """A rectangle of sides 2 a, 2 b, parallel to the plane: four times the form factor of its quarter
    (Howell, catalogue of configuration factors, B-3)."""
    x, y = a / height, b / height
    quarter = (
        x / np.hypot(1, x) * np.arctan(y / np.hypot(1, x))
        + y / np.hypot(1, y) * np.arctan(x / np.hypot(1, y))
    ) / (2 * np.pi)
    shape = {"type": "rectangle", "to_world": translation(0, 0, height) @ FACING_DOWN @ scaling(a, b, 1)}
    return area(3), shape, 3 * 4 * quarter


def under_disk(radius: float, height: float) -> tuple[Settings, Settings, float]:
    shape = {"type": "disk", "to_world": translation(0, 0, height) @ FACING_DOWN @ scaling(radius)}
    return area(3), shape, 3 * radius**2 / (radius**2 + height**2)


def tilted_environment() -> tuple[Settings, None, float]:
    """Radiance 1 + cos(angle to z) / 2 from each side, as rows of a map: its cosine-weighted mean above."""
    rows = 257
    row = 1 + 0.5 * np.cos(np.pi * np.arange(rows) / (rows - 1))
    image = _core.Image(np.tile(row[:, None], (1, 4)).astype(np.float32))
    up = rotation((1, 0, 0), 90)  # +y of the map becomes +z
    return {"type": "envmap", "image": image, "to_world": up}, None, 1 + 1 / 3


LIT_PLANES: dict[str, tuple[Settings, Settings | None, float]] = {
    "sphere overhead": under_sphere(1, 3, 1),
    "sphere aslant": under_sphere(0.5, 2, 0.5),
    "sphere nearby": under_sphere(1, 1.05, 1),
    "small sphere": under_sphere(0.8, 4, 0.01),
    "rectangle": under_rectangle(1, 2, 1.5),
    "wide rectangle": under_rectangle(20, 10, 1),
    "disk": under_disk(1.5, 1),
    "constant": ({"type": "constant", "radiance": 2}, None, 2),
    "envmap": tilted_environment(),
    "point": (
        {"type": "point", "position": [1, 2, 2], "intensity": 5},
        None,
        5 * 2 / 3 / 9 / np.pi,
    ),
    "directional": (
        {"type": "directional", "direction": [-3, 0, -4], "irradiance": 5},
        None,
        5 * 0.8 / np.pi,
    ),
    "spot": (
        {"type": "spot", "intensity": 5, "to_world": look_at((1, 2, 2), (0, 0, 0)), "cutoff_angle": 10},
        None,
        5 * 2 / 3 / 9 / np.pi,
    ),
}


@pytest.mark.parametrize(
    "name, strategy",
    [
        (name, strategy)
        for name in LIT_PLANES
        for strategy in STRATEGIES
        if (name, strategy) != ("small sphere", "bsdf")  # which chance alone hardly ever finds
    ],
)
def test_diffuse_plane_under_a_light(name: str, strategy: str) -> None:
    emitter, shape, expected = LIT_PLANES[name]
    shapes = [PLANE] + ([{**shape, "emitter": 0}] if shape else [])
    scene = make_scene(
        shapes=shapes,
        emitters=[emitter],
        bsdfs=[GREY],
        sensor=point_view((3, -4, 0.5) if shape else (3, -4, 5)),
        max_depth=2,
        strategy=strategy,
    )
    check_mean(f"{name}, {strategy}", batch_means(scene, 256), ALBEDO * expected)


@each_strategy
@pytest.mark.parametrize("depth, total", [(0, 0), (1, 1), (2, 1.6), (3, 1.96), (6, 2.38336), (-1, 2.5)])
def test_depths_within_a_glowing_sphere(depth: int, total: float, strategy: str) -> None:
    """Every bounce adds the albedo once more: 1 shows the light itself, 2 direct light."""
    shape = {"type": "sphere", "flip_normals": True, "material": 0, "emitter": 0}
    scene = make_scene(
        shapes=[shape], emitters=[area()], bsdfs=[GREY], max_depth=depth, rr_depth=3, strategy=strategy
    )
    check_mean(f"depth {depth}, {strategy}", batch_means(scene, 64), total)


@pytest.mark.parametrize("rr_depth", [0, 1, 4, 12])
@pytest.mark.parametrize("inside", ["diffuse", "dielectric"])
def test_roulette_changes_no_mean(inside: str, rr_depth: int) -> None:
    """A body that absorbs nothing in a glowing sphere is invisible whenever paths may end."""
    shapes = [
        {"type": "sphere", "radius": 3, "flip_normals": True, "material": 0, "emitter": 0},
        {"type": "sphere", "radius": 1, "center": [0, 0, 1.5], "material": 1},
    ]
    bsdfs = [GREY, {"type": inside} | LOSSLESS[inside][0]]
    scene = make_scene(
        shapes=shapes,
        emitters=[area()],
        bsdfs=bsdfs,
        materials=[{"front": 0, "back": 0}, {"front": 1}],
        rr_depth=rr_depth,
        size=(12, 12),
    )
    check_mean(f"rr_depth {rr_depth}", batch_means(scene, 64), 2.5)


@pytest.mark.parametrize("strategy", ["mis", "bsdf"])
@pytest.mark.parametrize("name", LOSSLESS)
def test_white_furnace(name: str, strategy: str) -> None:
    """A lossless object is invisible in a white surrounding."""
    settings, precision, reason = LOSSLESS[name]
    scene = make_scene(
        shapes=[{"type": "sphere", "center": [0, 0, 3], "material": 0}],
        emitters=[{"type": "constant", "radiance": 1}],
        bsdfs=[{"type": name, **settings}],
        materials=[{"front": 0}],
        size=(16, 16),
        strategy=strategy,
    )
    bounces = 4  # as a rule, where light may go in and out
    check_mean(f"{name} ({reason})", batch_means(scene, 64), 1, bounces * precision + ROUNDING)


def show_room(bsdf: Settings, strategy: str, **integrator: object) -> _core.Scene:
    """A ball of a material on a diffuse floor, under a textured and a plain light, a point and the sky."""
    shapes = [
        {"type": "rectangle", "to_world": scaling(4), "material": 0},
        {"type": "sphere", "center": [0, 0, 1.1], "material": 1},
        {
            "type": "rectangle",
            "to_world": translation(0, 1, 4) @ FACING_DOWN @ scaling(1.5),
            "emitter": 0,
            "material": 0,
        },
        {"type": "sphere", "center": [2.5, 0, 1.5], "radius": 0.8, "emitter": 1, "material": 0},
    ]
    return make_scene(
        shapes=shapes,
        emitters=[
            area({"texture": 0}),
            area(2),
            {"type": "constant", "radiance": 0.3},
            {"type": "point", "position": [-2, -1, 3], "intensity": 4},
        ],
        textures=[random_bitmap(3, 3)],
        bsdfs=[GREY, bsdf],
        materials=[{"front": 0, "back": 0}, {"front": 1}],
        sensor={"type": "perspective", "to_world": look_at((-3, -5, 3), (0, 0, 1)), "fov": 35},
        size=(16, 16),
        strategy=strategy,
        **({"max_depth": 5} | integrator),
    )


GLOSSY = [{"type": "roughconductor", "alpha_u": 0.4, "alpha_v": 0.15, "distribution": "ggx"}]


@pytest.mark.parametrize(
    "bsdf", [{"type": name} for name in MODELS] + GLOSSY, ids=lambda b: " ".join(map(str, b.values()))
)
def test_strategies_agree(bsdf: Settings) -> None:
    means = {strategy: batch_means(show_room(bsdf, strategy), 64) for strategy in STRATEGIES}
    check_same_mean(f"{bsdf}: mis and bsdf", means["mis"], means["bsdf"])
    check_same_mean(f"{bsdf}: mis and light", means["mis"], means["light"])


def test_heuristics_agree() -> None:
    bsdf = {"type": "roughconductor", "alpha_u": 0.4, "alpha_v": 0.4}
    means = {name: batch_means(show_room(bsdf, "mis", heuristic=name), 64) for name in HEURISTICS}
    for name in HEURISTICS[1:]:
        check_same_mean(f"power and {name}", means["power"], means[name])
        assert (means["power"] != means[name]).all()  # it has an effect


def test_heuristics_have_their_weights() -> None:
    """Light sampling of a small lamp: each BSDF sample that misses it leaves the weight of the light sample.

    The density of light sampling is about 11 times that of BSDF sampling on the whole lamp, which one in
    12 BSDF samples hits.
    """

    def picture(**settings: str) -> np.ndarray:
        floor = {"type": "rectangle", "to_world": scaling(5)}
        lamp = {"type": "rectangle", "to_world": translation(0, 0, 1) @ scaling(0.28), "flip_normals": True}
        scene = lajolla.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "path", "max_depth": 2, **settings},
                "sensor": {"type": "perspective", "fov": 0.01, "to_world": look_at((3, 0, 1), (0, 0, 0))},
                "floor": floor,
                "lamp": {**lamp, "emitter": {"type": "area", "radiance": 1}},
            },
            size=(16, 16),
        )
        return scene.render(spp=1, seed=5).array[..., 0]

    light = picture(strategy="light")
    weights = {name: float(np.median(picture(heuristic=name) / light)) for name in HEURISTICS}
    assert weights["balance"] == pytest.approx(11 / 12, abs=0.015)
    assert weights["power"] == pytest.approx(121 / 122, abs=0.005)
    assert weights["maximum"] == 1


def test_names_of_options_are_those_of_the_core() -> None:
    fields = {field["name"]: field for field in core_schema()["integrator"]["path"]["fields"]}
    assert fields["strategy"]["choices"] == list(STRATEGIES)
    assert fields["heuristic"]["choices"] == HEURISTICS


@each_strategy
@pytest.mark.parametrize("layers", [1, 2])
def test_sheets_of_little_opacity(layers: int, strategy: str) -> None:
    """What is behind is seen through the sheet, and lit through it: both by 1 - opacity."""
    through = 0.7**layers
    sheets = [
        {"type": "rectangle", "to_world": translation(0, 0, 1 + 0.1 * i) @ scaling(30), "material": 1}
        for i in range(layers)
    ]
    emitter, shape, expected = under_rectangle(1, 2, 1.5)
    scene = make_scene(
        shapes=[PLANE, *sheets, {**shape, "emitter": 0}],
        emitters=[emitter],
        bsdfs=[GREY, {"type": "diffuse", "reflectance": 0}],
        adapters=[{"type": "mask", "opacity": 0.3, "child": 1}],
        materials=[{"front": 0}, {"front": {"adapter": 0}, "back": {"adapter": 0}}],
        sensor=point_view((3, -4, 1.3)),
        max_depth=2,
        strategy=strategy,
    )
    check_mean(f"{layers} sheets, {strategy}", batch_means(scene, 256), ALBEDO * expected * through**2)


@each_strategy
def test_a_sheet_is_the_blend_of_what_it_is_and_what_it_hides(strategy: str) -> None:
    scene = make_scene(
        shapes=[
            {"type": "rectangle", "to_world": scaling(30), "material": 0},
            {"type": "rectangle", "to_world": translation(0, 0, -1) @ scaling(30), "emitter": 0},
        ],
        emitters=[area(4), {"type": "constant", "radiance": 2}],
        bsdfs=[GREY],
        adapters=[{"type": "mask", "opacity": 0.3, "child": 0}],
        materials=[{"front": {"adapter": 0}}],
        sensor=point_view(),
        max_depth=2,
        strategy=strategy,
    )
    check_mean("sheet", batch_means(scene, 256), 0.3 * ALBEDO * 2 + 0.7 * 4)


@each_strategy
@pytest.mark.parametrize("sky", [False, True])
def test_null_surfaces_are_not_there(sky: bool, strategy: str) -> None:
    """Bubbles of nothing around the point, around the light and in between change nothing."""
    emitter, shape, expected = LIT_PLANES["constant" if sky else "sphere aslant"]
    bubbles = [
        {"type": "sphere", "radius": 0.7, "material": 1},
        {"type": "sphere", "center": [1.7, 0, 1], "radius": 0.6, "material": 1},
        {"type": "rectangle", "to_world": translation(0, 0, 0.45) @ scaling(9), "material": 1},
    ]
    scene = make_scene(
        shapes=[PLANE, *bubbles] + ([{**shape, "emitter": 0}] if shape else []),
        emitters=[emitter],
        bsdfs=[GREY, {"type": "null"}],
        materials=[{"front": 0}, {"front": 1}],
        sensor=point_view((3, -4, 2)),
        max_depth=2,
        strategy=strategy,
    )
    check_mean(f"null, {strategy}", batch_means(scene, 256), ALBEDO * expected)


def test_masks_by_texture_cut_holes() -> None:
    """A checkerboard of opacity in front of a glowing plane: half of it is seen."""
    scene = make_scene(
        shapes=[
            {"type": "rectangle", "material": 0},
            {"type": "rectangle", "to_world": translation(0, 0, -1) @ scaling(9), "emitter": 0},
        ],
        emitters=[area(4)],
        textures=[{"type": "checkerboard", "color0": 0, "color1": 1}],
        bsdfs=[{"type": "diffuse", "reflectance": 0}],
        adapters=[{"type": "mask", "opacity": {"texture": 0}, "child": 0}],
        materials=[{"front": {"adapter": 0}}],
        sensor=front_view(3, 2),
        rfilter=PINHOLE,
    )
    image = picture(scene, 1)[..., 0]
    assert set(np.unique(image)) == {0, 4}
    assert (image == 4).mean() == 0.5


@pytest.mark.parametrize(
    "sides, front, back",
    [({"front": 0}, 1, 0), ({"front": 0, "back": 0}, 1, 1), ({"back": 0}, 0, 1), ({}, 0, 0)],
)
def test_sides_of_a_material(sides: Settings, front: float, back: float) -> None:
    for flip in (False, True):
        for above in (True, False):
            scene = make_scene(
                shapes=[{**PLANE, "flip_normals": flip}],
                emitters=[{"type": "constant", "radiance": 1}],
                materials=[sides],
                sensor=point_view((0, 1, 2 if above else -2)),
                max_depth=2,
                strategy="bsdf",
            )
            expected = front if above != flip else back
            assert np.abs(picture(scene, 4) - expected).max() < 1e-5


def test_transmissive_materials_have_no_back() -> None:
    """A sheet of glass looks the same from both sides, whatever its back says."""
    for back in (-1, 1):
        for z in (2, -2):
            scene = make_scene(
                shapes=[PLANE],
                emitters=[{"type": "constant", "radiance": 1}],
                bsdfs=[{"type": "thindielectric"}, GREY],
                materials=[{"front": 0, "back": back}],
                sensor=point_view((0, 1, z)),
            )
            check_mean(f"glass from {z}", batch_means(scene, 16), 1)


def test_hidden_emitters() -> None:
    """The camera looks through lights, and they light what is behind them all the same."""
    emitter, shape, expected = under_rectangle(1, 2, 1.5)
    for hidden in (False, True):
        scene = make_scene(
            shapes=[PLANE, {**shape, "emitter": 0, "flip_normals": False, "material": 0}],
            emitters=[emitter],
            bsdfs=[GREY],
            sensor=point_view((0, 0.2, 5)),
            max_depth=2,
            hide_emitters=hidden,
        )
        check_mean(f"hidden {hidden}", batch_means(scene, 256), ALBEDO * expected if hidden else 0)
        sky = make_scene(emitters=[{"type": "constant", "radiance": 2}], hide_emitters=hidden)
        assert (picture(sky, 1) == (0 if hidden else 2)).all()
