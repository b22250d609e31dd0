"""Light in media against answers known in closed form or by quadrature, and estimators against each other."""

from __future__ import annotations

import numpy as np
import pytest
from scene_tools import (
    BATCHES,
    PINHOLE,
    Settings,
    area,
    batch_means,
    box_mesh,
    check_mean,
    check_same_mean,
    look_at,
    picture,
    rotation,
    scaling,
    translation,
)
from statistics_tools import SEED, require

from lajolla import _core

STRATEGIES = ("mis", "bsdf", "light")
each_strategy = pytest.mark.parametrize("strategy", STRATEGIES)

CUBE: Settings = {"type": "mesh", "mesh": box_mesh(), "material": 0, "interior": 0}
BALL: Settings = {"type": "sphere", "material": 0, "interior": 0}
NULL: Settings = {"type": "null"}
GLASS: Settings = {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}
BRIGHT: Settings = {"type": "constant", "radiance": 1}


def homogeneous(absorbed: object, scattered: object, **more: object) -> Settings:
    return {"type": "homogeneous", "sigma_a": absorbed, "sigma_s": scattered, **more}


def grid(values: np.ndarray) -> Settings:
    """A grid that fills the cube from -1 to 1."""
    return {
        "type": "gridvolume",
        "grid": _core.Grid(values.astype(np.float32)),
        "to_world": translation(-1, -1, -1) @ scaling(2),
    }


def rough_grid(colours: object = (1, 1, 1)) -> Settings:
    """Densities from 0 to 8 without any order."""
    values = np.random.default_rng(SEED).random((6, 7, 8, 1)) ** 3 * 8 * np.reshape(colours, (1, 1, 1, -1))
    return grid(values)


def media_scene(
    medium: Settings,
    *,
    bsdf: Settings = NULL,
    shapes: tuple[Settings, ...] = (BALL,),
    emitters: tuple[Settings, ...] = (BRIGHT,),
    volumes: tuple[Settings, ...] = (),
    phases: tuple[Settings, ...] = (),
    sensor: Settings | None = None,
    size: int = 4,
    **integrator: object,
) -> _core.Scene:
    view = {"type": "orthographic", "to_world": look_at((0, 0, 4), (0, 0, 0)) @ scaling(0.8, 0.8, 1)}
    return _core.Scene(
        {
            "bsdfs": [bsdf, {"type": "diffuse", "reflectance": 0}],
            "materials": [{"front": 0, "back": 0}, {"front": 1, "back": 1}],
            "volumes": list(volumes),
            "phases": list(phases),
            "media": [medium],
            "emitters": list(emitters),
            "shapes": list(shapes),
            "sensor": sensor or view,
            "film": {"width": size, "height": size},
            "rfilter": {"type": "box"},
            "sampler": {"type": "independent"},
            "integrator": {"type": "volpath", **integrator},
        }
    )


def check_exact(scene: _core.Scene, expected: object, samples: int = 4, error: float = 1e-4) -> None:
    image = picture(scene, samples)
    require(
        bool(np.allclose(image, np.broadcast_to(expected, image.shape), rtol=error)),
        f"{image.mean((0, 1))} instead of {expected}",
    )


# ---- absorption


@pytest.mark.parametrize("bsdf", [NULL, {**GLASS, "int_ior": 1.0}], ids=["null", "index 1"])
def test_beer_lambert(bsdf: Settings) -> None:
    """A slab two units thick lets exp(-2 sigma_a) through, channel by channel, without noise."""
    sigma = np.array([0.1, 1, 3])
    scene = media_scene(homogeneous(sigma.tolist(), 0), shapes=(CUBE,), bsdf=bsdf)
    check_exact(scene, np.exp(-2 * sigma))


def test_absorption_between_surfaces_and_camera() -> None:
    """A camera within a medium, and a light at its end: version 1 leaves scattering out."""
    lamp = {"type": "rectangle", "material": 1, "emitter": 0, "exterior": 0}
    sensor = {
        "type": "orthographic",
        "to_world": look_at((0, 0, 2), (0, 0, 0)) @ scaling(0.5, 0.5, 1),
        "near_clip": 0.5,
        "medium": 0,
    }
    scene = media_scene(
        homogeneous([0.3, 0.6, 0.9], 5),
        shapes=(lamp,),
        emitters=(area(2),),
        sensor=sensor,
        version=1,
    )
    check_exact(scene, 2 * np.exp(-2 * np.array([0.3, 0.6, 0.9])))


def test_attenuation_of_heterogeneous_media() -> None:
    """The mean through a grid is the integral of exp(-optical depth), found by numerical quadrature."""
    density = np.random.default_rng(SEED).random((1, 1, 5)) * 3
    medium = {"type": "heterogeneous", "sigma_t": {"volume": 0}, "albedo": 0}
    scene = media_scene(
        medium,
        shapes=(CUBE,),
        volumes=(grid(density[..., None]),),
        sensor={"type": "orthographic", "to_world": look_at((0, 0, 4), (0, 0, 0)) @ scaling(1, 1, 1)},
    )
    x = (np.arange(20000) + 0.5) / 20000 * 5 - 0.5
    values = np.interp(x, np.arange(5), density[0, 0])
    check_mean("transmittance", batch_means(scene, 64), float(np.exp(-2 * values).mean()), 1e-4)


# ---- energy


@each_strategy
@pytest.mark.parametrize("bsdf", [NULL, GLASS], ids=["null", "glass"])
@pytest.mark.parametrize("sigma", [0.5, [0.5, 3, 8]], ids=["grey", "coloured"])
def test_white_furnace(strategy: str, bsdf: Settings, sigma: object) -> None:
    """What absorbs nothing cannot be seen where the same light comes from everywhere."""
    scene = media_scene(homogeneous(0, sigma), bsdf=bsdf, strategy=strategy)
    check_mean("furnace", batch_means(scene, 64), 1)


@each_strategy
@pytest.mark.parametrize("bsdf", [NULL, GLASS], ids=["null", "glass"])
def test_white_furnace_of_heterogeneous_media(strategy: str, bsdf: Settings) -> None:
    medium = {"type": "heterogeneous", "sigma_t": {"volume": 0}, "albedo": 1}
    scene = media_scene(
        medium, bsdf=bsdf, shapes=(CUBE,), volumes=(rough_grid((1, 0.5, 0.2)),), strategy=strategy
    )
    check_mean("furnace", batch_means(scene, 64), 1)


def test_a_white_medium_is_invisible_without_noise() -> None:
    """Phase sampling alone ends each path on the same light with the same weight, however long it is."""
    check_exact(media_scene(homogeneous(0, 10), strategy="bsdf"), 1, 16)


@pytest.mark.parametrize("bounding", [CUBE, BALL], ids=["cube", "sphere"])
def test_emission(bounding: Settings) -> None:
    """A medium as bright as its surroundings is invisible: what it absorbs it emits."""
    scene = media_scene(homogeneous([0.2, 1, 7], 0, emission=1), shapes=(bounding,))
    check_exact(scene, 1)
    scene = media_scene(homogeneous([0.2, 1, 7], [1, 2, 0.1], emission=1), shapes=(bounding,))
    check_mean("homogeneous", batch_means(scene, 64), 1)
    medium = {"type": "heterogeneous", "sigma_t": {"volume": 0}, "albedo": [0.9, 0.5, 0], "emission": 1}
    scene = media_scene(medium, shapes=(CUBE,), volumes=(rough_grid((1, 0.5, 0.2)),))
    check_mean("heterogeneous", batch_means(scene, 64), 1)


# ---- scattering


def single_scattering(sigma_t: float, sigma_s: float, g: float) -> float:
    """A cube of side 2 seen along -z under parallel light along -y of irradiance 1: what is scattered once,
    averaged over the square of side 1 that the camera sees."""
    steps = (np.arange(400) + 0.5) / 400
    y, s = np.meshgrid(steps - 0.5, 2 * steps)
    phase = (1 - g**2) / (1 + g**2) ** 1.5 / (4 * np.pi)  # at a right angle
    return float((2 * sigma_s * phase * np.exp(-sigma_t * (s + 1 - y))).mean())


@pytest.mark.parametrize("g", [0, 0.7])
def test_single_scattering(g: float) -> None:
    scene = media_scene(
        homogeneous(0.5, 1.5, phase=0),
        shapes=(CUBE,),
        emitters=({"type": "directional", "direction": [0, -1, 0], "irradiance": 1},),
        phases=({"type": "hg", "g": g},),
        sensor={"type": "orthographic", "to_world": look_at((0, 0, 4), (0, 0, 0)) @ scaling(0.5, 0.5, 1)},
        max_depth=2,
    )
    check_mean("single scattering", batch_means(scene, 256), single_scattering(2, 1.5, g))


LAMP: Settings = {
    "type": "rectangle",
    "to_world": translation(0, 3, 0) @ rotation((1, 0, 0), 90),
    "material": 1,
    "emitter": 0,
}


def under_lamp(medium: Settings, **more: object) -> np.ndarray:
    return batch_means(media_scene(medium, shapes=(CUBE, LAMP), emitters=(area(5),), **more), 256)


COLOURED = homogeneous([0.1, 0.5, 0.2], [1, 2, 4], phase=0)
FORWARD: tuple[Settings, ...] = ({"type": "hg", "g": 0.6},)


@pytest.mark.parametrize("max_depth", [2, 3, -1])
def test_strategies_agree(max_depth: int) -> None:
    means = [
        under_lamp(COLOURED, phases=FORWARD, strategy=strategy, max_depth=max_depth)
        for strategy in STRATEGIES
    ]
    check_same_mean("phase sampling and both", means[0], means[1])
    check_same_mean("light sampling and both", means[0], means[2])


def test_strategies_agree_in_heterogeneous_media() -> None:
    medium = {"type": "heterogeneous", "sigma_t": {"volume": 0}, "albedo": [0.9, 0.8, 0.5]}
    volumes = (rough_grid((1, 0.5, 0.2)),)
    means = [under_lamp(medium, volumes=volumes, strategy=strategy) for strategy in STRATEGIES]
    check_same_mean("phase sampling and both", means[0], means[1])
    check_same_mean("light sampling and both", means[0], means[2])


def test_a_constant_grid_is_homogeneous() -> None:
    extinction = np.array([1.1, 2.5, 4.2])
    albedo = [1 / 1.1, 2 / 2.5, 4 / 4.2]
    constant = np.broadcast_to(extinction, (4, 4, 4, 3))
    medium = {"type": "heterogeneous", "sigma_t": {"volume": 0}, "albedo": albedo, "phase": 0}
    gridded = under_lamp(medium, volumes=(grid(constant),), phases=FORWARD)
    plain = under_lamp(COLOURED, phases=FORWARD)
    check_same_mean("a grid and one number", gridded, plain)


def test_nested_null_boundaries_change_nothing() -> None:
    inner: Settings = {
        "type": "sphere",
        "radius": 0.5,
        "material": 0,
        "interior": 0,
        "exterior": 0,
    }
    outer = media_scene(COLOURED, shapes=(CUBE, LAMP), emitters=(area(5),), phases=FORWARD)
    both = media_scene(COLOURED, shapes=(CUBE, inner, LAMP), emitters=(area(5),), phases=FORWARD)
    check_same_mean("nested boundaries", batch_means(outer, 128), batch_means(both, 128))


# ---- the steps of volpath


def test_versions_that_see_the_same_agree() -> None:
    """Black surfaces, no light but what is scattered: steps 3 to 6 differ in how they find it."""
    means = [under_lamp(COLOURED, phases=FORWARD, version=version, max_depth=4) for version in (3, 4, 5, 6)]
    for mean in means[:-1]:
        check_same_mean("two versions", mean, means[-1])
    twice = under_lamp(COLOURED, phases=FORWARD, version=2)
    check_same_mean("scattered once", twice, under_lamp(COLOURED, phases=FORWARD, max_depth=2))


def test_without_media_volpath_is_path() -> None:
    def image(kind: str) -> np.ndarray:
        floor = {"type": "rectangle", "material": 0, "to_world": scaling(5)}
        return picture(
            _core.Scene(
                {
                    "bsdfs": [{"type": "diffuse", "reflectance": 0.5}],
                    "materials": [{"front": 0, "back": 0}],
                    "emitters": [BRIGHT],
                    "shapes": [floor],
                    "sensor": {"type": "perspective", "to_world": look_at((1, 2, 3), (0, 0, 0))},
                    "film": {"width": 8, "height": 8},
                    "rfilter": PINHOLE,
                    "integrator": {"type": kind},
                }
            ),
            4,
        )

    assert np.array_equal(image("path"), image("volpath"))


# ---- determinism and hostile input


def test_the_same_picture_on_any_number_of_threads() -> None:
    medium = {"type": "heterogeneous", "sigma_t": {"volume": 0}, "albedo": 0.8}
    scene = media_scene(medium, shapes=(CUBE, LAMP), emitters=(area(5),), volumes=(rough_grid(),), size=32)
    assert np.array_equal(picture(scene, 4, threads=1), picture(scene, 4, threads=2))


@pytest.mark.parametrize("sigma", [1e-30, 1e10, 1e30, [0, 1e-30, 1e30]])
def test_extreme_densities_end(sigma: object) -> None:
    for bsdf in (NULL, GLASS):
        image = picture(media_scene(homogeneous(sigma, sigma), bsdf=bsdf), 4)
        assert np.isfinite(image).all()
    values = np.zeros((4, 4, 4, 3))
    values[2, 2, 2] = sigma
    medium = {"type": "heterogeneous", "sigma_t": {"volume": 0}, "albedo": 0.5}
    assert np.isfinite(picture(media_scene(medium, volumes=(grid(values),)), 1)).all()


def test_batches_are_independent() -> None:
    """The means above come from different seeds."""
    assert len(np.unique(batch_means(media_scene(homogeneous(1, 1)), 1))) == BATCHES
