"""Dense media: what a half-space scatters back does not depend on its density."""

from __future__ import annotations

import numpy as np
import pytest
from scene_tools import Settings, batch_means, check_mean, look_at, rotation, scaling, translation
from statistics_tools import SEED
from test_media import BALL, CUBE, GLASS, NULL, grid, homogeneous, media_scene

ALBEDO = 0.95
DENSITIES = (1.0, 1e2, 1e4, 1e6, 1e8)


def plane_albedo(albedo: float, cosine: float) -> float:
    """What an isotropically scattering half-space reflects: 1 - H(mu) sqrt(1 - albedo) (Chandrasekhar 1960,
    section 38), with H from its integral equation."""
    mu, weight = np.polynomial.legendre.leggauss(64)
    mu, weight = (mu + 1) / 2, weight / 2

    def updated(at: np.ndarray, h: np.ndarray) -> np.ndarray:
        kernel = mu / (at[:, None] + mu)
        return 1 / (np.sqrt(1 - albedo) + albedo / 2 * (kernel * (weight * h)).sum(1))

    h = np.ones_like(mu)
    for _ in range(200):
        h = updated(mu, h)
    return float(1 - updated(np.array([cosine]), h)[0] * np.sqrt(1 - albedo))


def reflectance(cosine: np.ndarray, eta: float) -> np.ndarray:
    """Fresnel's, of a boundary beyond which the index is `eta` times as high."""
    beyond = np.sqrt(np.maximum(1 - (1 - cosine**2) / eta**2, 0))
    s = (cosine - eta * beyond) / (cosine + eta * beyond)
    p = (eta * cosine - beyond) / (eta * cosine + beyond)
    return np.where(beyond > 0, (s**2 + p**2) / 2, 1.0)


def light_of(albedo: float, eta: float = 1, thickness: float = np.inf, paths: int = 200_000) -> float:
    """What is seen of a layer with smooth boundaries from above, in light of radiance 1 from everywhere:
    paths in one dimension, in double precision. `thickness` is optical."""
    rng = np.random.default_rng(SEED)
    entering = 1 - float(reflectance(np.array(1.0), eta))
    depth, cosine, weight = np.zeros(paths), np.ones(paths), np.full(paths, entering)
    total = 0.0
    while len(depth):
        depth = depth + cosine * rng.exponential(size=len(depth))
        out = (depth < 0) | (depth > thickness)
        mirrored = reflectance(np.abs(cosine[out]), 1 / eta)
        total += float((weight[out] * (1 - mirrored)).sum())
        weight[out] *= mirrored
        cosine[out] = -cosine[out]
        depth[out] = np.clip(depth[out], 0, thickness)  # it flies on from the boundary
        weight = np.where(out, weight, weight * albedo)
        cosine = np.where(out, cosine, rng.uniform(-1, 1, len(depth)))
        survives = rng.random(len(depth)) < np.minimum(weight * 10, 1)
        weight = weight / np.minimum(np.maximum(weight * 10, 1e-300), 1)
        depth, cosine, weight = depth[survives], cosine[survives], weight[survives]
    return total / paths + 1 - entering


EXPECTED = {"null": plane_albedo(ALBEDO, 1), "glass": light_of(ALBEDO, 1.5)}


def half_space(density: float, bsdf: Settings, kind: str, shape: Settings = CUBE) -> np.ndarray:
    """A cube of at least a hundred mean free paths, seen from above in its middle."""
    size = max(1.0, 100 / density)
    volumes: tuple[Settings, ...] = ()
    medium = homogeneous((1 - ALBEDO) * density, ALBEDO * density)
    if kind == "heterogeneous":
        values = grid(np.full((3, 3, 3, 1), density))
        volumes = ({**values, "to_world": scaling(size) @ values["to_world"]},)
        medium = {"type": "heterogeneous", "sigma_t": {"volume": 0}, "albedo": ALBEDO}
    view = look_at((0, 0, 4 * size), (0, 0, 0)) @ scaling(0.05 * size, 0.05 * size, 1)
    scene = media_scene(
        medium,
        bsdf=bsdf,
        shapes=({**shape, "to_world": scaling(size)},),
        volumes=volumes,
        sensor={"type": "orthographic", "to_world": view, "far_clip": 1e4 * size},
        size=2,
    )
    return batch_means(scene, 128)


@pytest.mark.parametrize("density", DENSITIES)
@pytest.mark.parametrize("kind", ["homogeneous", "heterogeneous"])
@pytest.mark.parametrize("boundary", ["null", "glass"])
def test_a_half_space_reflects_alike_at_any_density(boundary: str, kind: str, density: float) -> None:
    bsdf = NULL if boundary == "null" else GLASS
    check_mean(boundary, half_space(density, bsdf, kind), EXPECTED[boundary], 2e-3)


@pytest.mark.parametrize("density", [1e4, 1e6, 1e8])
def test_a_dense_ball_reflects_as_a_half_space(density: float) -> None:
    check_mean("ball", half_space(density, NULL, "homogeneous", BALL), EXPECTED["null"], 3e-3)


@pytest.mark.parametrize("density", [1e3, 1e6, 1e8])
def test_strategies_agree_in_dense_media(density: float) -> None:
    """Light sampling finds the boundary above a vertex, however near; so do paths."""
    medium = homogeneous(0.5 * density, 0.5 * density)
    view = look_at((0, 0, 4), (0, 0, 0)) @ scaling(0.05, 0.05, 1)
    expected = plane_albedo(0.5, 1)
    for strategy in ("mis", "bsdf", "light"):
        scene = media_scene(
            medium,
            shapes=(CUBE,),
            sensor={"type": "orthographic", "to_world": view},
            size=2,
            strategy=strategy,
        )
        check_mean(strategy, batch_means(scene, 256), expected, 2e-3)


def test_the_oracles_agree() -> None:
    assert abs(light_of(ALBEDO) - plane_albedo(ALBEDO, 1)) < 5e-3


# ---- sheets

WIDTH = 10.0
CUBE_ERROR = WIDTH * 2.0**-18  # of a hit's position; rays start as far inside
RECTANGLE_ERROR = 2 * CUBE_ERROR


def sheet(kind: str, thickness: float) -> tuple[Settings, ...]:
    if kind == "cube":
        return ({**CUBE, "to_world": scaling(WIDTH, WIDTH, thickness / 2)},)
    side = {"type": "rectangle", "material": 0, "interior": 0}
    upper = translation(0, 0, thickness / 2) @ scaling(WIDTH, WIDTH, 1)
    return ({**side, "to_world": upper}, {**side, "to_world": rotation((1, 0, 0), 180) @ upper})


SHEETS = [(albedo, eta) for albedo in (0.0, 0.5) for eta in (1.0, 1.5)]
LIGHT_OF_SHEETS = {(albedo, eta): light_of(albedo, eta, 1) for albedo, eta in SHEETS if albedo}
for eta in (1.0, 1.5):  # the geometric series of what is mirrored within
    mirrored, passed = float(reflectance(np.array(1.0), eta)), np.exp(-1)
    LIGHT_OF_SHEETS[0.0, eta] = mirrored + (1 - mirrored) ** 2 * passed / (1 - mirrored * passed)


@pytest.mark.parametrize("errors", [100, 12, 8.1, 7.9, 4, 2, 1.3])
@pytest.mark.parametrize("kind", ["cube", "rectangles"])
@pytest.mark.parametrize("albedo, eta", SHEETS)
def test_a_sheet_looks_the_same_however_thin(albedo: float, eta: float, kind: str, errors: float) -> None:
    """A sheet of optical thickness 1, as thick as some rounding errors: around 8, paths within it stay
    near the surface they entered by."""
    thickness = errors * (CUBE_ERROR if kind == "cube" else RECTANGLE_ERROR)
    scene = media_scene(
        homogeneous((1 - albedo) / thickness, albedo / thickness),
        bsdf=NULL if eta == 1 else GLASS,
        shapes=sheet(kind, thickness),
        sensor={"type": "orthographic", "to_world": look_at((0, 0, 4), (0, 0, 0)) @ scaling(0.05, 0.05, 1)},
        size=2,
    )
    check_mean("sheet", batch_means(scene, 128), LIGHT_OF_SHEETS[albedo, eta], 3e-3)
