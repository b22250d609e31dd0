"""Panes of thin glass, which light passes straight through: shadow rays do as paths do.

How much light passes depends on the angle and on the channel, so that every strategy of finding it must know.
"""

from __future__ import annotations

import numpy as np
import pytest
from scene_tools import (
    Settings,
    area,
    batch_means,
    box_mesh,
    check_mean,
    check_same_mean,
    look_at,
    make_scene,
    point_view,
    scaling,
    translation,
    uv_sphere,
)
from statistics_tools import generator

from lajolla import _core

SKY: Settings = {"type": "constant", "radiance": 1}
PLANE: Settings = {"type": "rectangle", "to_world": scaling(50), "material": 0}
GREY: Settings = {"type": "diffuse", "reflectance": 0.6}
GLASS: Settings = {"type": "thindielectric"}
TINTED: Settings = {**GLASS, "int_ior": 1.8, "specular_transmittance": [0.9, 0.5, 0.05]}
ONE_WAY: Settings = {**GLASS, "specular_reflectance": [0.2, 0.9, 0]}
INTEGRATORS: dict[str, Settings] = {
    "mis": {"strategy": "mis"},
    "bsdf": {"strategy": "bsdf"},
    "light": {"strategy": "light"},
    "volpath": {"type": "volpath"},
    "direct": {"type": "direct"},
}
each_integrator = pytest.mark.parametrize("integrator", INTEGRATORS)


def transmittance(cosine: np.ndarray, glass: Settings) -> np.ndarray:
    """Of a sheet, one column for each channel: Fresnel's equations and all reflections within."""
    eta = glass.get("int_ior", 1.5046) / 1.000277
    inside = np.sqrt(1 - (1 - cosine**2) / eta**2)
    s, p = (
        (cosine - eta * inside) / (cosine + eta * inside),
        (eta * cosine - inside) / (eta * cosine + inside),
    )
    face = (s**2 + p**2) / 2
    tint = np.broadcast_to(glass.get("specular_transmittance", 1), 3)
    return (1 - 2 * face / (1 + face))[:, None] * tint


def means_by_channel(integrator: str, scene: Settings, samples: int) -> list[np.ndarray]:
    """Batches of the means of red, green and blue: each is a scene with a light of one channel."""
    settings = {"max_depth": 2, **INTEGRATORS[integrator]}
    if integrator == "direct":
        del settings["max_depth"]
    result = []
    for channel in range(3):
        colour = [0.0, 0.0, 0.0]
        colour[channel] = 3
        result.append(
            batch_means(make_scene(**scene, emitters=[{**SKY, "radiance": colour}], **settings), samples)
        )
    return result


@each_integrator
@pytest.mark.parametrize("glass", [GLASS, TINTED, ONE_WAY], ids=["clear", "tinted", "coloured mirror"])
@pytest.mark.parametrize("layers", [1, 2])
def test_a_plane_below_panes(integrator: str, glass: Settings, layers: int) -> None:
    """Under a white sky: the mean transmittance over the cosine-weighted hemisphere. Panes are no bounces."""
    sheets = [
        {"type": "rectangle", "to_world": translation(0, 0, 1 + i) @ scaling(1e5), "material": 1}
        for i in range(layers)
    ]
    scene = {
        "shapes": [PLANE, *sheets],
        "bsdfs": [GREY, glass],
        "materials": [{"front": 0}, {"front": 1}],
        "sensor": {**point_view((0, 0.1, 0.5)), "far_clip": 100},
    }
    cosine = np.sqrt((np.arange(20000) + 0.5) / 20000)  # the sine's square is uniform
    expected = 0.6 * (transmittance(cosine, glass) ** layers).mean(axis=0)
    for found, value in zip(means_by_channel(integrator, scene, 64), expected, strict=True):
        check_mean(f"{layers} sheets, {integrator}", found, value, slack=2e-4)


NOISE = generator("panes").integers(0, 256, (12, 16, 3)).astype(np.uint8)
MAPPED: Settings = {"type": "normalmap", "normalmap": {"texture": 1}, "use_shadowing_function": False}
ADAPTERS: list[Settings] = [
    {"type": "mask", "opacity": 0.6, "child": 1},  # sheets with holes
    {"type": "blendbsdf", "weight": 0.3, "first": {"adapter": 0}, "second": 0},  # and grey spots
    {"type": "bumpmap", "map": {"texture": 0}, "scale": 0.3, "child": {"adapter": 1}},
    {**MAPPED, "child": 1},
    {"type": "blendbsdf", "weight": {"texture": 0}, "first": {"adapter": 3}, "second": 2},  # two sheets
]
MATERIALS: dict[str, Settings] = {
    "sheet": {"front": 1},
    "holes": {"front": {"adapter": 0}},
    "dirty": {"front": {"adapter": 1}, "back": {"adapter": 1}},
    "dirty from outside": {"front": {"adapter": 1}, "back": {"adapter": 0}},
    "bumpy": {"front": {"adapter": 2}, "back": {"adapter": 2}},
    "two sheets": {"front": {"adapter": 4}},
}


def shell_scene(material: str, smooth: bool, **integrator: object) -> _core.Scene:
    """A lamp within a shell of few triangles above a plane; another lamp outside."""
    place = translation(0, 0, 1.2) @ scaling(1.1, 1, 0.9)
    mesh = uv_sphere(10, 6, smooth=smooth)
    return make_scene(
        shapes=[
            PLANE,
            {"type": "mesh", "mesh": mesh, "to_world": place, "material": 1},
            {"type": "sphere", "center": [0.1, 0, 1.2], "radius": 0.4, "emitter": 0, "material": 2},
            {"type": "sphere", "center": [3, 1, 2], "radius": 0.5, "emitter": 1, "material": 2},
        ],
        emitters=[area(5), area(9), {**SKY, "radiance": 0.2}],
        textures=[
            {"type": "bitmap", "image": _core.Image(np.ascontiguousarray(NOISE[..., i]), srgb=False)}
            for i in (slice(0, 1), slice(0, 3))
        ],
        bsdfs=[GREY, TINTED, GLASS],
        adapters=ADAPTERS,
        materials=[{"front": 0}, MATERIALS[material], {"front": 0}],
        sensor={"type": "perspective", "fov": 40, "to_world": look_at((0, -5, 2.5), (0, 0, 0.6)).tolist()},
        size=(6, 6),
        **{"max_depth": 4, **integrator},
    )


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("material", MATERIALS)
def test_strategies_agree_on_shells(material: str, smooth: bool) -> None:
    reference = batch_means(shell_scene(material, smooth, strategy="bsdf"), 400)
    for integrator in ("mis", "light", "volpath"):
        found = batch_means(shell_scene(material, smooth, **INTEGRATORS[integrator]), 150)
        check_same_mean(f"{material}, {integrator}", found, reference)


def stained_glass(filter_type: str) -> _core.Scene:
    """A sheet of black and clear squares under a white sky, many of them in each pixel."""
    squares = np.indices((64, 64)).sum(axis=0)[..., None] % 2
    image = _core.Image(squares.astype(np.float32), srgb=False)
    return make_scene(
        shapes=[PLANE],
        emitters=[SKY],
        textures=[{"type": "bitmap", "image": image, "filter_type": filter_type}],
        bsdfs=[{**GLASS, "specular_transmittance": {"texture": 0}}],
        materials=[{"front": 0, "back": 0}],
        sensor={"type": "perspective", "fov": 20, "to_world": look_at((0, 0, 200), (0, 0, 0)).tolist()},
        size=(4, 4),
        max_depth=4,
    )


@pytest.mark.parametrize("filter_type", ["trilinear", "ewa"])
def test_filtering_keeps_the_brightness_of_stained_glass(filter_type: str) -> None:
    """Whether light passes and what is reflected go by the same value of the texture."""
    reference = batch_means(stained_glass("nearest"), 1000)
    check_same_mean(filter_type, batch_means(stained_glass(filter_type), 1000), reference)


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("material", ["sheet", "holes", "two sheets"])
def test_clear_shells_are_white_under_a_white_sky(material: str, smooth: bool) -> None:
    """What is not reflected passes, whatever the normal, the maps and the mixture."""
    scene = make_scene(
        shapes=[{"type": "mesh", "mesh": uv_sphere(10, 6, smooth=smooth), "material": 0}],
        emitters=[SKY],
        textures=[
            {"type": "bitmap", "image": _core.Image(np.ascontiguousarray(NOISE[..., i]), srgb=False)}
            for i in (slice(0, 1), slice(0, 3))
        ],
        bsdfs=[GREY, GLASS, {**GLASS, "int_ior": 2.5}],
        adapters=ADAPTERS,
        materials=[MATERIALS[material]],
        sensor={"type": "perspective", "fov": 24, "to_world": translation(0, 0, -5).tolist()},
        max_depth=-1,
    )
    check_mean(material, batch_means(scene, 256), 1, slack=1e-4)


@pytest.mark.parametrize("sigma", [[0.5, 3, 8], 2], ids=["coloured", "grey"])
def test_strategies_agree_on_media_behind_panes(sigma: object) -> None:
    """A box of fog behind tinted glass, lit from within and from outside."""
    means = [
        batch_means(
            _core.Scene(
                {
                    "bsdfs": [TINTED, GREY],
                    "materials": [{"front": 0}, {"front": 1}],
                    "media": [{"type": "homogeneous", "sigma_a": 0.1, "sigma_s": sigma}],
                    "emitters": [area(4), area(9)],
                    "shapes": [
                        {"type": "mesh", "mesh": box_mesh(), "material": 0, "interior": 0},
                        {"type": "sphere", "radius": 0.4, "emitter": 0, "material": 1, "exterior": 0},
                        {"type": "sphere", "center": [3, 1, 2], "emitter": 1, "material": 1},
                    ],
                    "sensor": {
                        "type": "perspective",
                        "fov": 40,
                        "to_world": look_at((3, -4, 2.5), (0, 0, 0)).tolist(),
                    },
                    "film": {"width": 6, "height": 6},
                    "rfilter": {"type": "box"},
                    "sampler": {"type": "independent"},
                    "integrator": {"type": "volpath", "max_depth": depth, "strategy": strategy},
                }
            ),
            400 if strategy == "bsdf" else 150,
        )
        for depth in (2, 6)
        for strategy in ("bsdf", "mis", "light")
    ]
    for reference, *others in (means[:3], means[3:]):
        for found in others:
            check_same_mean("fog", found, reference)
