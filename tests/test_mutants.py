"""The checks reject broken BSDFs: each mutant makes one mistake that renderers are known for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from emitter_tools import STUDIED
from scatter_tools import Bsdf, check_reciprocity, direction, make_bsdf, seen_from
from statistics_tools import (
    Draws,
    Rejected,
    Sampled,
    check_consistency,
    check_density,
    check_energy,
    check_finite,
    study,
)

WO = direction(0.7, 0.5)
GLASS_ETA = 1.5046 / 1.000277  # the defaults of the dielectrics
Evaluation = tuple[np.ndarray, np.ndarray]


def judge(bsdf: Bsdf) -> None:
    s = study(seen_from(bsdf, WO))
    check_finite(s.draws, s.thing.name)
    check_consistency(s)
    check_density(s)
    check_energy(s)
    check_reciprocity(bsdf, WO)


def changing(
    bsdf: Bsdf,
    draws: Callable[[Draws], Draws] = lambda d: d,
    evaluation: Callable[[np.ndarray, np.ndarray, Evaluation], Evaluation] = lambda wo, wi, e: e,
    numbers: Callable[[np.ndarray], np.ndarray] = lambda u: u,
) -> Bsdf:
    """The BSDF with its samples, its evaluations or its random numbers changed."""
    return replace(
        bsdf,
        sample=lambda wo, u: draws(bsdf.sample(wo, numbers(u))),
        evaluate=lambda wo, wi: evaluation(wo, wi, bsdf.evaluate(wo, wi)),
    )


def scaled_density(bsdf: Bsdf) -> Bsdf:
    """Sample and evaluate agree on a density 5 % too large, and on weights to match."""
    return changing(
        bsdf,
        lambda d: replace(d, pdf=d.pdf * 1.05, weight=d.weight / 1.05),
        lambda wo, wi, e: (e[0], e[1] * 1.05),
    )


def scaled_weight(bsdf: Bsdf) -> Bsdf:
    return changing(bsdf, lambda d: replace(d, weight=d.weight * 1.02))


def scaled_weight_and_value(bsdf: Bsdf) -> Bsdf:
    """A gain of energy that is consistent everywhere."""
    return changing(bsdf, lambda d: replace(d, weight=d.weight * 1.02), lambda wo, wi, e: (e[0] * 1.02, e[1]))


def missing_jacobian(bsdf: Bsdf) -> Bsdf:
    """The density of the half vector taken for that of the direction: the factor 1 / (4 wo.m) is lost."""

    def jacobian(wo: np.ndarray, wi: np.ndarray) -> np.ndarray:
        half = np.asarray(wo) + wi
        half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-6)
        return 4 * np.abs((half * wo).sum(1))

    def sample(wo: np.ndarray, u: np.ndarray) -> Draws:
        draws = bsdf.sample(wo, u)
        factor = np.where(draws.valid, jacobian(wo, draws.points), 1)
        return replace(draws, pdf=draws.pdf * factor, weight=draws.weight / factor[:, None])

    def evaluate(wo: np.ndarray, wi: np.ndarray) -> Evaluation:
        value, pdf = bsdf.evaluate(wo, wi)
        return value, pdf * jacobian(wo, wi)

    return replace(bsdf, sample=sample, evaluate=evaluate)


def swapped_sides(bsdf: Bsdf) -> Bsdf:
    """Samples end up on the other side of the surface than evaluate expects."""
    return changing(bsdf, lambda d: replace(d, points=d.points * np.float32([1, 1, -1])))


def swapped_arguments(bsdf: Bsdf) -> Bsdf:
    """evaluate gives the density of the reverse direction."""
    return replace(
        bsdf,
        evaluate=lambda wo, wi: (
            bsdf.evaluate(wo, wi)[0],
            bsdf.evaluate(wi, np.broadcast_to(wo, wi.shape))[1],
        ),
    )


def dropped_lobe(bsdf: Bsdf) -> Bsdf:
    """The lobe that small numbers choose is never sampled."""
    return changing(bsdf, numbers=lambda u: np.column_stack([0.5 + 0.5 * u[:, 0], u[:, 1:]]))


def biased_numbers(bsdf: Bsdf) -> Bsdf:
    """Random numbers that are squared by accident fall short."""
    return changing(bsdf, numbers=lambda u: np.column_stack([u[:, 0], u[:, 1] ** 1.1, u[:, 2]]))


def missing_cosine(bsdf: Bsdf) -> Bsdf:
    """evaluate forgets |cos wi|, and sample with it."""
    return replace(
        bsdf,
        sample=lambda wo, u: (
            (d := bsdf.sample(wo, u))
            and replace(d, weight=d.weight / np.maximum(np.abs(d.points[:, 2:]), 1e-6))
        ),
        evaluate=lambda wo, wi: (
            (e := bsdf.evaluate(wo, wi)) and (e[0] / np.maximum(np.abs(wi[:, 2:]), 1e-6), e[1])
        ),
    )


def rotated_tangent(bsdf: Bsdf) -> Bsdf:
    """Anisotropy along the wrong tangent when evaluated."""
    turn = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    return replace(bsdf, evaluate=lambda wo, wi: bsdf.evaluate(np.asarray(wo) @ turn, wi @ turn))


def included_eta(bsdf: Bsdf) -> Bsdf:
    """Transmission carries radiance's eta^2, which transport would apply again."""

    def scaled(wo: np.ndarray, wi: np.ndarray, e: Evaluation) -> Evaluation:
        crossing = (np.atleast_2d(wo)[:, 2] * wi[:, 2] < 0)[:, None]
        inward = (np.atleast_2d(wo)[:, 2] > 0)[:, None]
        return np.where(crossing, e[0] * np.where(inward, GLASS_ETA**-2, GLASS_ETA**2), e[0]), e[1]

    return changing(
        bsdf, lambda d: replace(d, weight=d.weight / np.where(d.valid, d.eta, 1)[:, None] ** 2), scaled
    )


def wrong_branch_probability(bsdf: Bsdf) -> Bsdf:
    """A delta branch reports another probability than it is drawn with; its weight makes up for it."""
    return changing(bsdf, lambda d: replace(d, pdf=np.where(d.delta, d.pdf * 0.9, d.pdf)))


def long_directions(bsdf: Bsdf) -> Bsdf:
    return changing(bsdf, lambda d: replace(d, points=d.points * np.float32(1.001)))


DIFFUSE = {"type": "diffuse", "reflectance": [1, 0.5, 0.2]}
CONDUCTOR = {"type": "roughconductor", "alpha_u": 0.3, "alpha_v": 0.15, "distribution": "ggx"}
NARROW = {"type": "roughconductor", "alpha_u": 0.01, "alpha_v": 0.01, "distribution": "beckmann"}
GLASS = {"type": "roughdielectric", "alpha_u": 0.2, "alpha_v": 0.2, "distribution": "ggx"}
PLASTIC = {"type": "roughplastic", "alpha": 0.1}
COATED = {"type": "plastic"}
MIRROR_GLASS = {"type": "dielectric"}

MUTANTS = [
    *((scaled_density, d) for d in (DIFFUSE, CONDUCTOR, NARROW, GLASS, PLASTIC, COATED)),
    *((scaled_weight, d) for d in (DIFFUSE, CONDUCTOR, NARROW, GLASS, PLASTIC, COATED)),
    *((scaled_weight_and_value, d) for d in (DIFFUSE, NARROW)),
    *((missing_jacobian, d) for d in (CONDUCTOR, NARROW)),
    *((swapped_sides, d) for d in (DIFFUSE, CONDUCTOR, GLASS, PLASTIC)),
    *((swapped_arguments, d) for d in (DIFFUSE, CONDUCTOR, GLASS)),
    *((dropped_lobe, d) for d in (GLASS, PLASTIC, COATED, MIRROR_GLASS)),
    *((biased_numbers, d) for d in (DIFFUSE, CONDUCTOR, NARROW, GLASS, PLASTIC, COATED)),
    *((missing_cosine, d) for d in (DIFFUSE, CONDUCTOR)),
    (rotated_tangent, CONDUCTOR),
    (included_eta, GLASS),
    (included_eta, MIRROR_GLASS),
    *((wrong_branch_probability, d) for d in (COATED, MIRROR_GLASS)),
    *((long_directions, d) for d in (DIFFUSE, CONDUCTOR, GLASS)),
]


@pytest.mark.parametrize(
    "mutate, description", MUTANTS, ids=lambda v: v["type"] if isinstance(v, dict) else v.__name__
)
def test_mutants_are_rejected(mutate: Callable[[Bsdf], Bsdf], description: dict) -> None:
    with pytest.raises(Rejected):
        judge(mutate(make_bsdf(description)))


@pytest.mark.parametrize(
    "description",
    [DIFFUSE, CONDUCTOR, NARROW, GLASS, PLASTIC, COATED, MIRROR_GLASS],
    ids=lambda d: d["type"],
)
def test_the_originals_are_not(description: dict) -> None:
    judge(make_bsdf(description))


Mutant = Callable[[Sampled], Sampled]


def of_light(
    draws: Callable[[Draws], Draws] = lambda d: d,
    evaluation: Callable[[np.ndarray, Evaluation], Evaluation] = lambda wi, e: e,
    numbers: Callable[[np.ndarray], np.ndarray] = lambda u: u,
) -> Mutant:
    """Lights with their samples, their evaluations or their random numbers changed."""
    return lambda light: replace(
        light,
        sample=lambda u: draws(light.sample(numbers(u))),
        evaluate=lambda wi: evaluation(wi, light.evaluate(wi)),
    )


LIGHT_MUTANTS: dict[str, Mutant] = {
    "density 5 % too large everywhere": of_light(
        lambda d: replace(d, pdf=d.pdf * 1.05, weight=d.weight / 1.05), lambda wi, e: (e[0], e[1] * 1.05)
    ),
    "radiance 2 % too large in samples": of_light(lambda d: replace(d, weight=d.weight * 1.02)),
    "density of hits 2 % too large": of_light(evaluation=lambda wi, e: (e[0], e[1] * 1.02)),
    "numbers that fall short": of_light(numbers=lambda u: u ** np.float32(1.1)),
    "a part that is never sampled": of_light(numbers=lambda u: np.concatenate([u[:, :1], u[:, 1:] * 0.9], 1)),
    "directions to the other side": of_light(lambda d: replace(d, points=-d.points)),
    "an area taken for a solid angle": of_light(
        lambda d: replace(d, pdf=d.pdf * (1 + d.points[:, 0])),
        lambda wi, e: (e[0], e[1] * (1 + wi[:, 0])),
    ),
}
LIGHTS = {
    lit.name: lit.seen_from(lit.points[0])
    for lit in STUDIED
    if lit.name in ("area on rectangle", "area on mesh", "area on sphere", "envmap random", "constant")
}


def judge_light(light: Sampled) -> None:
    s = study(light)
    check_finite(s.draws, light.name)
    check_consistency(s)
    check_density(s)
    check_energy(s, most=np.inf)


@pytest.mark.parametrize(
    "mutant, light",
    [
        (mutant, light)
        for mutant in LIGHT_MUTANTS
        for light in LIGHTS
        if (mutant, light) != ("directions to the other side", "constant")  # which looks the same there
    ],
)
def test_mutants_of_lights_are_rejected(mutant: str, light: str) -> None:
    with pytest.raises(Rejected):
        judge_light(LIGHT_MUTANTS[mutant](LIGHTS[light]))


@pytest.mark.parametrize("light", LIGHTS)
def test_the_original_lights_are_not(light: str) -> None:
    judge_light(LIGHTS[light])
