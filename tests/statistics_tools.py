"""Statistical checks of anything that can be sampled and evaluated: BSDFs, lights, filters, phase functions.

A `Sampled` offers `sample` (random numbers to points with weights) and `evaluate` (points to values and
densities) over a `Domain`. `study` draws samples and integrates values and densities over cells that follow
the samples; the checks compare the two sides and raise `Rejected`.

The checks are hypothesis tests. All of them together reject a correct renderer with a probability of at most
FAMILY_WISE_ERROR, as long as no more than TESTS of them are made. Numbers are drawn from SEED alone.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from quadrature_tools import Cells, Domain, integrate
from scipy import stats

SEED = 20260801
FAMILY_WISE_ERROR = 0.01
TESTS = 50_000
LEVEL = 1 - (1 - FAMILY_WISE_ERROR) ** (1 / TESTS)  # Sidak
Z = float(stats.norm.isf(LEVEL / 2))

ROUNDING = 1e-4  # relative precision that a few float32 operations leave
PILOT = 2048  # samples that shape the cells
SAMPLES = 20_000  # samples that are tested
MAXIMUM_ERROR = 2e-3  # estimated quadrature error beyond which a study is inconclusive
ONE_MINUS_ULP = np.nextafter(np.float32(1), np.float32(0))


class Rejected(AssertionError):
    """A statistical check failed."""


def require(condition: bool | np.bool_, message: str) -> None:
    if not condition:
        raise Rejected(message)


def generator(*key: object) -> np.random.Generator:
    """A generator of its own for each key, the same in every run."""
    return np.random.default_rng([SEED, zlib.crc32(repr(key).encode())])


@dataclass(frozen=True)
class Draws:
    """N samples. `weight` (N, C) is value / density; `delta` marks points of positive probability, whose
    `pdf` is it.

    Where `valid` is false there is no sample. `eta` is the relative index of refraction beyond a boundary.
    """

    points: np.ndarray
    weight: np.ndarray
    pdf: np.ndarray
    valid: np.ndarray
    delta: np.ndarray
    eta: np.ndarray

    def where(self, mask: np.ndarray) -> Draws:
        return Draws(*(getattr(self, name)[mask] for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class Sampled:
    """A thing under test.

    `sample` takes `uniforms` random numbers per sample, (N, uniforms) float32 in [0, 1); `evaluate` takes
    points and gives values (N, C) and densities (N,).
    """

    name: str
    domain: Domain
    uniforms: int
    sample: Callable[[np.ndarray], Draws]
    evaluate: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Branch:
    """One delta direction: how often it was drawn, how often it says it is, and its weight."""

    point: np.ndarray
    count: int
    probability: float
    weight: np.ndarray


@dataclass(frozen=True)
class Study:
    """Samples and integrals of one thing.

    `counts` and `density` are per cell, `value` (C,) is integrated over the whole domain, `error` estimates
    what the quadrature may be off by, `rounding` the relative precision of float32 densities.
    """

    thing: Sampled
    draws: Draws
    counts: np.ndarray
    density: np.ndarray
    value: np.ndarray
    error: float
    rounding: float
    branches: list[Branch]


def uniforms(rng: np.random.Generator, count: int, dimensions: int) -> np.ndarray:
    return rng.random((count, dimensions), dtype=np.float32)


def study(thing: Sampled, samples: int = SAMPLES) -> Study:
    """Draws samples of a thing and integrates its value and density where they fell and elsewhere."""
    rng = generator(thing.name)
    draws = thing.sample(uniforms(rng, samples, thing.uniforms))
    smooth = thing.domain.to_coordinates(draws.points[draws.valid & ~draws.delta])
    known = smooth_points(thing, rng, PILOT)
    cells, integrals, error = integrate_around(thing, known, smooth, rng)
    if error > MAXIMUM_ERROR / 10:
        cells, integrals, error = integrate_around(thing, smooth_points(thing, rng, 4 * PILOT), smooth, rng)
    require(error < MAXIMUM_ERROR, f"{thing.name}: the quadrature is inconclusive (off by {error:.1e})")
    density = np.bincount(cells.owner, integrals[:, 0], minlength=len(cells.counts))
    rounding = rounding_at(thing.evaluate, known, rng)
    counts, value = np.array(cells.counts), integrals[:, 1:].sum(0)
    return Study(thing, draws, counts, density, value, error, rounding, branches_of(draws))


def smooth_points(thing: Sampled, rng: np.random.Generator, count: int) -> np.ndarray:
    draws = thing.sample(uniforms(rng, count, thing.uniforms))
    return draws.points[draws.valid & ~draws.delta]


def integrate_around(
    thing: Sampled, known: np.ndarray, smooth: np.ndarray, rng: np.random.Generator
) -> tuple[Cells, np.ndarray, float]:
    """Cells around known points, and the integrals of density and value over their boxes (B, 1 + C)."""
    guide = np.concatenate([thing.domain.to_coordinates(known), probe_density(thing, rng)])
    density = thing.evaluate(thing.domain.to_points(guide))[1]
    cells = Cells(thing.domain, guide, density, smooth)

    def integrand(coordinates: np.ndarray) -> np.ndarray:
        value, pdf = thing.evaluate(thing.domain.to_points(coordinates))
        return np.column_stack([pdf, value])

    return cells, *integrate(integrand, *cells.boxes())


def rounding_at(
    evaluate: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    points: np.ndarray,
    rng: np.random.Generator,
) -> float:
    """The relative precision of densities: what a change of points in their last place does to them."""
    if len(points) == 0:
        return ROUNDING
    nudged = points * (1 + rng.choice([-1.2e-7, 1.2e-7], points.shape))
    before, after = evaluate(points)[1].astype(float), evaluate(nudged)[1].astype(float)
    return ROUNDING + 2 * float(np.median(np.abs(after - before) / np.maximum(before, 1e-6)))


def probe_density(thing: Sampled, rng: np.random.Generator) -> np.ndarray:
    """Coordinates drawn by the density that `evaluate` tells: what `sample` forgets is integrated too."""
    candidates = rng.uniform(thing.domain.lower, thing.domain.upper, (PILOT, len(thing.domain.lower)))
    density = np.nan_to_num(thing.evaluate(thing.domain.to_points(candidates))[1], posinf=0).astype(float)
    if density.sum() <= 0:
        return candidates[:0]
    return candidates[np.unique(rng.choice(PILOT, PILOT // 4, p=density / density.sum()))]


def branches_of(draws: Draws) -> list[Branch]:
    """The delta directions among the samples, told apart by four digits."""
    chosen = draws.where(draws.valid & draws.delta)
    if len(chosen.points) == 0:
        return []
    _, first, inverse, counts = np.unique(
        np.round(chosen.points, 4) + 0.0, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    branches = []
    for i, count in enumerate(counts):
        members = chosen.where(inverse.ravel() == i)
        spread = np.ptp(members.pdf) + np.ptp(members.weight, axis=0).max()
        require(spread < 1e-4, f"a delta direction reports different probabilities or weights ({spread:.1e})")
        branches.append(
            Branch(
                chosen.points[first[i]], int(count), float(members.pdf[0]), members.weight[0].astype(float)
            )
        )
    return branches


def check_density(s: Study) -> None:
    """Samples fall where the density says: chi-square over cells, branch frequencies, and a total of one."""
    n = len(s.draws.valid)
    for branch in s.branches:
        require(
            branch.probability <= 1 + 1e-6, f"{s.thing.name}: a branch has probability {branch.probability}"
        )
        p = stats.binomtest(branch.count, n, min(branch.probability, 1)).pvalue
        require(
            p > LEVEL,
            f"{s.thing.name}: a delta direction was drawn {branch.count} times of {n}, "
            f"but reports probability {branch.probability:.5f} (p = {p:.1e})",
        )
    failures = float(np.mean(~s.draws.valid))
    total = float(s.density.sum()) + sum(b.probability for b in s.branches)
    rare = max(failures * (1 - failures), (1 - total) * total, 1 / n)
    margin = Z * np.sqrt(rare / n) + s.error + s.rounding
    require(
        abs(total - (1 - failures)) < margin,
        f"{s.thing.name}: densities integrate to {total:.5f}, but {1 - failures:.5f} of the samples are "
        f"valid (margin {margin:.1e})",
    )
    p = chi_square(s.counts, n * s.density)
    require(p > LEVEL, f"{s.thing.name}: the samples do not follow their density (chi-square p = {p:.1e})")


def chi_square(counts: np.ndarray, expected: np.ndarray, smallest: float = 10) -> float:
    """The p-value of counts against independent expectations; cells that expect few are pooled."""
    few = expected < smallest
    counts = np.append(counts[~few], counts[few].sum())
    expected = np.append(expected[~few], expected[few].sum())
    if expected[-1] < smallest and len(counts) > 1:
        counts, expected = (
            np.append(counts[:-2], counts[-2:].sum()),
            np.append(expected[:-2], expected[-2:].sum()),
        )
    if expected.sum() < smallest:
        return 1.0 if counts.sum() < 100 else 0.0
    # Counts are multinomial with a further cell of what is not counted here: no degree of freedom is lost.
    return float(stats.chi2.sf(((counts - expected) ** 2 / np.maximum(expected, 1e-300)).sum(), len(counts)))


def check_consistency(s: Study) -> None:
    """`sample` and `evaluate` agree on density and weight at the samples."""
    chosen = s.draws.where(s.draws.valid & ~s.draws.delta)
    if len(chosen.points) == 0:
        return
    value, pdf = s.thing.evaluate(chosen.points)
    compare(f"{s.thing.name}: densities of sample and evaluate", chosen.pdf, pdf, s.rounding)
    compare(
        f"{s.thing.name}: weight * pdf and value",
        chosen.weight * chosen.pdf[:, None],
        value,
        s.rounding,
    )


def compare(what: str, a: np.ndarray, b: np.ndarray, rounding: float) -> None:
    """Equal numbers up to rounding: nearly all of them closely, all of them roughly."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    difference = np.abs(a - b) / np.maximum(np.maximum(np.abs(a), np.abs(b)), 1e-6)
    typical, rare = np.quantile(difference, [0.5, 0.995])
    require(
        typical < rounding and rare < 30 * rounding,
        f"{what} differ by {typical:.1e} typically and {rare:.1e} in bad cases (rounding {rounding:.1e})",
    )


def check_energy(s: Study, *, most: float = 1) -> None:
    """The mean weight is the integral of the value, and that is at most `most`."""
    n = len(s.draws.valid)
    weight = np.where(s.draws.valid[:, None], s.draws.weight, 0).astype(float)
    integral = s.value + sum((b.weight * b.probability for b in s.branches), np.zeros(weight.shape[1]))
    # A constant weight has no spread of its own; one rare sample more or less is the least uncertainty.
    deviation = np.maximum(weight.std(0), np.abs(weight).max(0) / np.sqrt(n))
    margin = Z * deviation / np.sqrt(n) + s.error + s.rounding
    require(
        np.all(np.abs(weight.mean(0) - integral) < margin),
        f"{s.thing.name}: the mean weight is {weight.mean(0)}, the integral {integral} (margin {margin})",
    )
    require(np.all(integral < most + s.error + s.rounding), f"{s.thing.name}: gains energy: {integral}")


def check_finite(draws: Draws, name: str, *, directions: bool = True) -> None:
    """No sample is infinite, negative or not a number, and directions are unit vectors."""
    chosen = draws.where(draws.valid)
    require(np.isfinite(chosen.points).all(), f"{name}: a point is not finite")
    require(np.isfinite(chosen.weight).all(), f"{name}: a weight is not finite")
    require((chosen.weight >= 0).all(), f"{name}: a weight is negative")
    require(
        np.isfinite(chosen.pdf).all() and (chosen.pdf > 0).all(),
        f"{name}: a density is not positive and finite",
    )
    if directions and len(chosen.points):
        deviation = np.abs(np.linalg.norm(chosen.points.astype(float), axis=1) - 1).max()
        require(deviation < 1e-5, f"{name}: a direction is not of unit length (off by {deviation:.1e})")
