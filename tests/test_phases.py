"""Every phase function of the list, with settings made from its fields, against its contract."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from phase_tools import MATRICES, MODELS, PARTS, TABLES, Phase, make_phase, seen_from, settings_of
from scatter_tools import Settings, direction, label
from statistics_tools import (
    ONE_MINUS_ULP,
    TESTS,
    Draws,
    Rejected,
    check_consistency,
    check_density,
    check_energy,
    check_finite,
    compare,
    generator,
    require,
    rounding_at,
    study,
    uniforms,
)

from lajolla import _core

SETTINGS = [settings for name in MODELS for settings in settings_of(name)]
each_setting = pytest.mark.parametrize("settings", SETTINGS, ids=label)

DIRECTIONS = [direction(0.3, 2.0), np.array([0.0, 0.0, 1.0]), np.array([-1.0, 0.0, 0.0])]


def judge(phase: Phase, wo: np.ndarray) -> None:
    s = study(seen_from(phase, wo))
    check_finite(s.draws, s.thing.name)
    check_consistency(s)
    check_density(s)
    check_energy(s)
    require(abs(s.value[0] - 1) < 1e-4 + s.error, f"{s.thing.name}: integrates to {s.value[0]}")


def test_level_covers_the_number_of_tests() -> None:
    assert len(SETTINGS) * 2 * 4 < TESTS


@each_setting
def test_samples_density_and_normalisation(settings: Settings) -> None:
    phase = make_phase(settings)
    turn = SETTINGS.index(settings)
    for wo in DIRECTIONS if len(settings) == 1 else [DIRECTIONS[turn % len(DIRECTIONS)]]:
        judge(phase, wo)


@each_setting
def test_reciprocity(settings: Settings) -> None:
    """Light paths can be reversed, where particles scatter as much as they show of themselves."""
    phase = make_phase(settings)
    for wo in DIRECTIONS[:2]:
        wi = phase.sample(wo, uniforms(generator("reciprocity", phase.name), 2000, 3)).points
        there = np.broadcast_to(wo, wi.shape)
        forward = phase.area(wo) * phase.evaluate(wo, wi)[1]
        back = phase.area(wi) * phase.evaluate(wi, there)[1]
        rounding = rounding_at(lambda w, wo=wo: phase.evaluate(wo, w), wi, generator("nudge"))
        compare(f"{phase.name} from {wo}: both ways", forward, back, 3 * rounding)


@each_setting
def test_corners_are_finite(settings: Settings) -> None:
    phase = make_phase(settings)
    edge = (0, 2**-24, 0.5, ONE_MINUS_ULP)
    u = np.concatenate([list(itertools.product(edge, repeat=3)), uniforms(generator("corners"), 500, 3)])
    for wo in [*DIRECTIONS, direction(-1 + 1e-7, 0.0), np.array([0.0, 1.0, 0.0])]:
        draws = phase.sample(wo, u)
        check_finite(draws, f"{phase.name} from {wo}")
        for wi in (wo, -wo, direction(0.2, 1.0)):
            _, pdf = phase.evaluate(wo, wi[None])
            require(
                bool(np.isfinite(pdf).all() and (pdf >= 0).all()), f"{phase.name}: {pdf} from {wo} to {wi}"
            )
        area = phase.area(wo)
        require(bool(np.isfinite(area).all() and (area >= 0).all()), f"{phase.name}: area {area}")


@pytest.mark.parametrize("g", [-0.999, -0.5, 0.0, 0.3, 0.9, 0.999])
def test_hg_has_the_mean_cosine_g_forwards(g: float) -> None:
    phase, wo = make_phase({"type": "hg", "g": g}), DIRECTIONS[0]
    u = np.stack([np.zeros(1 << 14), (np.arange(1 << 14) + 0.5) / (1 << 14), np.zeros(1 << 14)], axis=1)
    cosine = -phase.sample(wo, u).points.astype(float) @ wo
    assert cosine.mean() == pytest.approx(g, abs=2e-4)


def test_tables_are_interpolated_over_the_cosine() -> None:
    wo = np.array([0.0, 0.0, 1.0])
    for table in TABLES:
        phase = make_phase({"type": "tabphase", "values": table})
        cosine = np.linspace(-1, 1, 101)
        _, pdf = phase.evaluate(wo, np.stack([direction(-c, 0.4) for c in cosine]))
        nodes = np.linspace(-1, 1, len(table))
        expected = np.interp(cosine, nodes, table) / (2 * np.pi * np.trapezoid(table, nodes))
        np.testing.assert_allclose(pdf, expected, rtol=2e-4, atol=1e-6)


def test_areas_are_those_of_the_ellipsoid() -> None:
    wo = np.stack(DIRECTIONS)
    for xx, yy, zz, xy, xz, yz in MATRICES:
        matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        area = make_phase({"type": "sggx", "S": (xx, yy, zz, xy, xz, yz)}).area(wo)
        np.testing.assert_allclose(area, np.sqrt(np.einsum("ni,ij,nj->n", wo, matrix, wo)), rtol=1e-5)


@pytest.mark.parametrize(
    "description, message",
    [
        ({"type": "hg", "g": 1}, "expected a number in"),
        ({"type": "tabphase", "values": [1]}, "two numbers or more"),
        ({"type": "tabphase", "values": [0, 0, 0]}, "must not all be zero"),
        ({"type": "tabphase", "values": [1, -1]}, "a list of numbers >= 0"),
        ({"type": "tabphase", "values": "1, 2"}, "a list of numbers"),
        ({"type": "sggx", "S": [1, 1, 1, 1, 0, 0]}, "positive definite"),
        ({"type": "sggx", "S": [0] * 6}, "positive definite"),
        ({"type": "sggx", "S": [1e30] * 3 + [0] * 3}, "positive definite"),
        ({"type": "sggx", "S": {"volume": 0}}, "there is no volume 0"),
        ({"type": "blendphase", "phase_0": 99}, "there is no phase function 99 before this"),
        ({"type": "blendphase", "phase_0": len(PARTS)}, "before this"),
    ],
)
def test_impossible_parameters_are_refused(description: Settings, message: str) -> None:
    with pytest.raises(_core.DescriptionError, match=message):
        make_phase(description)


def test_blends_have_four_parts_at_most() -> None:
    blends = [{"type": "blendphase", "phase_0": i - 1, "phase_1": i - 1} for i in range(3)]
    _core.Media({"phases": blends[:2]})
    with pytest.raises(_core.DescriptionError, match="more than four"):
        _core.Media({"phases": blends})


class Mutant(Phase):
    """Sampling that looks backwards where the value looks forwards."""

    def sample(self, wo: np.ndarray, u: np.ndarray) -> Draws:
        return super().sample(-wo, u)


def test_a_wrong_sign_is_rejected() -> None:
    phase = make_phase({"type": "hg", "g": 0.3})
    with pytest.raises(Rejected):
        judge(Mutant(phase.description, phase.media), DIRECTIONS[0])
