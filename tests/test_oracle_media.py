"""Phase functions and volumes against those of the mitsuba package, value by value."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from phase_tools import MATRICES
from statistics_tools import generator
from test_volumes import TO_WORLD, positions, voxels

from lajolla import _core
from lajolla.scene import describe

mitsuba = pytest.importorskip("mitsuba")

SCENE = {"type": "scene", "integrator": {"type": "path"}, "sensor": {"type": "perspective"}}
FLAKES = np.broadcast_to(np.array(MATRICES[2], np.float32), (2, 2, 2, 6)).copy()


@pytest.fixture(scope="module")
def mi() -> Iterator[ModuleType]:
    before = mitsuba.variant()
    mitsuba.set_variant("scalar_rgb")
    yield mitsuba
    if before:
        mitsuba.set_variant(before)


def ours(medium: dict[str, Any]) -> _core.Media:
    """The media of a scene whose one sphere has this medium inside, as the reader understands it."""
    ball = {"type": "sphere", "bsdf": {"type": "null"}, "interior": medium}
    core = describe({**SCENE, "ball": ball}).core
    return _core.Media({key: core[key] for key in ("volumes", "phases", "media")})


def directions(key: object, count: int) -> np.ndarray:
    w = generator(key).normal(size=(count, 3))
    return (w / np.linalg.norm(w, axis=1, keepdims=True)).astype(np.float32)


HG = {"type": "hg", "g": 0.4}
SGGX = {"type": "sggx", "S": {"type": "gridvolume", "data": FLAKES}}


@pytest.mark.parametrize(
    "phase",
    [
        {"type": "isotropic"},
        {"type": "hg"},
        {"type": "hg", "g": -0.7},
        {"type": "rayleigh"},
        {"type": "tabphase", "values": "0.5, 1, 0.2, 3"},
        SGGX,
        {"type": "blendphase", "weight": 0.3, "phase_0": HG, "phase_1": {"type": "rayleigh"}},
    ],
    ids=lambda phase: phase["type"],
)
def test_phase_functions(mi: ModuleType, phase: dict[str, Any]) -> None:
    wo, wi = directions("wo", 200), directions("wi", 200)
    media = ours({"type": "homogeneous", "phase": phase})
    last = 2 if phase["type"] == "blendphase" else 0
    values = media.phase_eval_many(last, wo, wi, np.full((1, 3), 0.5, np.float32))

    theirs = dict(phase)
    if phase is SGGX:
        theirs["S"] = {"type": "gridvolume", "data": mi.TensorXf(FLAKES), "raw": True}
    function = mi.load_dict(theirs)
    at = mi.MediumInteraction3f()
    at.p = [0.5, 0.5, 0.5]
    expected = []
    for known, generated in zip(wo, wi, strict=True):
        at.wi = known
        at.sh_frame = mi.Frame3f(at.wi)
        expected.append(function.eval_pdf(mi.PhaseFunctionContext(), at, generated)[1])
    np.testing.assert_allclose(values, expected, rtol=2e-3)


def values_of(mi: ModuleType, grid: dict[str, Any]) -> Callable[[np.ndarray], np.ndarray]:
    volume = mi.load_dict(grid)

    def look_up(points: np.ndarray) -> np.ndarray:
        at = mi.Interaction3f()
        result = []
        for p in points:
            at.p = p
            result.append(volume.eval(at))
        return np.array(result)

    return look_up


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("wrap_mode", ["clamp", "repeat", "mirror"])
@pytest.mark.parametrize("filter_type", ["trilinear", "nearest"])
def test_grids(mi: ModuleType, channels: int, wrap_mode: str, filter_type: str) -> None:
    array, points = voxels((4, 7, 5, channels)), positions("oracle", 400, beyond=0.6)
    grid = {"type": "gridvolume", "wrap_mode": wrap_mode, "filter_type": filter_type}
    found = ours(
        {"type": "heterogeneous", "sigma_t": {**grid, "data": array, "to_world": TO_WORLD}}
    ).volume_many(0, points)
    theirs = {**grid, "data": mi.TensorXf(array), "raw": True, "to_world": mi.ScalarTransform4f(TO_WORLD)}
    expected = values_of(mi, theirs)(points)
    differs = np.abs(found - expected).max(axis=1) > 1e-4
    assert differs.mean() < (0.01 if filter_type == "nearest" else 1e-9)  # walls between cells


def test_coefficients(mi: ModuleType) -> None:
    """Extinction and scattering of a heterogeneous medium, microflakes included."""
    array, points, wo = voxels((4, 7, 5, 1)), positions("coefficients", 100), directions("flakes", 100)
    medium = {"type": "heterogeneous", "albedo": 0.8, "scale": 3, "phase": SGGX}
    grid = {"type": "gridvolume", "to_world": TO_WORLD}
    found = ours({**medium, "sigma_t": {**grid, "data": array}}).coefficients_many(0, points, wo)
    theirs = mi.load_dict(
        {
            **medium,
            "phase": {"type": "sggx", "S": {"type": "gridvolume", "data": mi.TensorXf(FLAKES), "raw": True}},
            "sigma_t": {**grid, "data": mi.TensorXf(array), "to_world": mi.ScalarTransform4f(TO_WORLD)},
        }
    )
    at = mi.MediumInteraction3f()
    for i, (p, w) in enumerate(zip(points, wo, strict=True)):
        at.p, at.wi = p, w
        sigma_s, _, sigma_t = theirs.get_scattering_coefficients(at)
        np.testing.assert_allclose(found["sigma_s"][i], sigma_s, rtol=2e-3)
        np.testing.assert_allclose(
            found["sigma_a"][i], np.array(sigma_t) - np.array(sigma_s), rtol=2e-3, atol=1e-5
        )
