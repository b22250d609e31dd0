"""BSDFs as things under test: every model of the core's list with settings made from its fields.

Directions follow the BSDF contract: the normal is +z, `wo` is known, `wi` is generated, both point away.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from measured_tools import MEASUREMENTS
from quadrature_tools import sphere
from statistics_tools import Draws, Sampled, compare, generator, require, rounding_at, uniforms

from lajolla import _core

Settings = dict[str, object]

MODELS: dict[str, dict] = _core.schema()["bsdf"]
JOINT_SETTINGS = 4  # settings that change all fields at once, per model
MANY = 8  # scalar fields; models with more are tested with fewer values of each


@dataclass(frozen=True)
class Bsdf:
    """A BSDF with constant parameters: `sample(wo, u)` and `evaluate(wo, wi)` as the core answers them."""

    description: Settings
    sample: Callable[[np.ndarray, np.ndarray], Draws]
    evaluate: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
    transmissive: bool
    delta: bool

    @property
    def name(self) -> str:
        return label(self.description)


def label(description: Settings) -> str:
    def text(value: object) -> str:
        if isinstance(value, dict):
            return label(value)
        if isinstance(value, _core.Measurement):
            return next(name for name, known in MEASUREMENTS.items() if known is value)
        return str(value) if isinstance(value, str | bool) else str(np.round(value, 3).tolist())

    settings = (f"{key}={text(value)}" for key, value in description.items() if key != "type")
    return f"{description['type']}({', '.join(settings)})"


def rows(directions: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(np.atleast_2d(directions), dtype=np.float32)


def make_bsdf(description: Settings) -> Bsdf:
    bsdf = _core.Bsdf(description)

    def sample(wo: np.ndarray, u: np.ndarray) -> Draws:
        s = bsdf.sample_many(rows(wo), rows(u))
        return Draws(s["wi"], s["weight"], s["pdf"], s["valid"], s["delta"], s["eta"])

    def evaluate(wo: np.ndarray, wi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return bsdf.eval_many(rows(wo), rows(wi))

    return Bsdf(description, sample, evaluate, bsdf.transmissive, bsdf.delta)


def seen_from(bsdf: Bsdf, wo: np.ndarray) -> Sampled:
    """The distribution of wi given wo."""
    tangent = np.hypot(wo[0], wo[1])
    axis = (-wo[1] / tangent, wo[0] / tangent, 0) if tangent > 0 else (0, 1, 0)
    return Sampled(
        name=f"{bsdf.name} from {np.round(wo, 4).tolist()}",
        domain=sphere(axis),
        uniforms=3,
        sample=lambda u: bsdf.sample(wo, u),
        evaluate=lambda wi: bsdf.evaluate(wo, wi),
    )


def direction(cosine: float, azimuth: float) -> np.ndarray:
    sine = np.sqrt(1 - cosine**2)
    return np.array([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine])


def known_directions(bsdf: Bsdf, cosines: tuple[float, ...] = (1, 0.8, 0.4, 0.1)) -> list[np.ndarray]:
    """Directions wo from the normal to grazing, at various azimuths; on both sides of transmissive models."""
    above = [direction(c, 0.3 + 2 * i) for i, c in enumerate(cosines)]
    return above + [w * (1, 1, -1) for w in above] if bsdf.transmissive else above


def typical(field: dict) -> float:
    """The order of magnitude of an unbounded field."""
    return max(abs(float(np.mean(field["default"]))), 0.5)


def is_bounded(field: dict) -> bool:
    low, high = field["minimum"], field["maximum"]
    return low is not None and high is not None and high - low < 100 * typical(field)


def numbers_within(field: dict) -> list[float]:
    """Corners and typical values of a numeric field."""
    low, high = field["minimum"], field["maximum"]
    if is_bounded(field):
        return [low, low + 0.02 * (high - low), low + 0.4 * (high - low), high]
    corners = [0.6 * typical(field), 1.7 * typical(field)]
    return [low] * (low is not None) + corners + [high] * (high is not None)


def random_number(field: dict, rng: np.random.Generator) -> float:
    if is_bounded(field):
        return field["minimum"] + (field["maximum"] - field["minimum"]) * rng.random() ** 2
    return typical(field) * np.exp(rng.uniform(-0.7, 0.7))


def values_of(field: dict) -> list[object]:
    """What a field is tested with, one value at a time."""
    match field["type"]:
        case "choice":
            return list(field["choices"])
        case "boolean":
            return [False, True]
        case "float" | "texture_float":
            return list(numbers_within(field))
        case "spectrum" | "texture_spectrum":
            numbers = numbers_within(field)
            return [numbers[0], numbers[-1], [numbers[0], numbers[len(numbers) // 2], numbers[-1]]]
        case "bsdf":
            return [dict(base) for base in BASES]
        case "measurement":
            return list(MEASUREMENTS.values())
    raise NotImplementedError(f"no test values for fields of type {field['type']}")


# What a BSDF that holds another is tested with: a smooth base, a mirror, a rough one, and one of two parts.
BASES: tuple[Settings, ...] = (
    {"type": "diffuse", "reflectance": 0.8},
    {"type": "conductor"},
    {"type": "roughconductor", "alpha_u": 0.3, "alpha_v": 0.3},
    {"type": "plastic"},
)


def random_value(field: dict, rng: np.random.Generator) -> object:
    if field["type"] == "bsdf":
        return dict(BASES[rng.integers(len(BASES))])
    if field["type"] == "measurement":
        return list(MEASUREMENTS.values())[rng.integers(len(MEASUREMENTS))]
    if field["type"] in ("choice", "boolean"):
        return rng.choice(values_of(field)).item()
    if field["type"].endswith("spectrum"):
        return [random_number(field, rng) for _ in range(3)]
    return random_number(field, rng)


def is_accepted(description: Settings) -> bool:
    try:
        _core.Bsdf(description)
    except _core.DescriptionError:
        return False
    return True


def settings_of(name: str) -> list[Settings]:
    """Descriptions of one model: one field changed at a time, and all fields at once.

    Scalars are changed under all combinations of choices, colours, and scalars where there are many, under
    one combination each. Without choices, a value that is the field's default makes no setting of its own.
    Corners that the model refuses are left out; its defaults it must accept.
    """
    fields = MODELS[name]["fields"]
    switches = [f for f in fields if f["type"] in ("choice", "boolean")]
    colours = [f for f in fields if f["type"].endswith("spectrum") or f["type"] in ("bsdf", "measurement")]
    scalars = [f for f in fields if f not in switches and f not in colours]
    combinations = [
        {"type": name} | dict(zip((f["name"] for f in switches), values, strict=True))
        for values in itertools.product(*(values_of(f) for f in switches))
    ]
    result: list[Settings] = [{"type": name}]
    values = {f["name"]: values_of(f) for f in scalars}
    if len(scalars) > MANY:
        values = {key: [value for i, value in enumerate(all_) if i != 1] for key, all_ in values.items()}
    changes = [
        {f["name"]: value}
        for f in scalars
        for value in values[f["name"]]
        if switches or value != f["default"]
    ]
    if len(scalars) > MANY:
        result += in_turn(combinations, changes)
    else:
        result += [c | change for c in combinations for change in changes]
    coloured = [{f["name"]: value} for f in colours for value in values_of(f)]
    result += [c | colour for c, colour in zip(itertools.cycle(combinations), coloured, strict=False)]
    rng = generator("settings", name)
    result += [
        {"type": name} | {f["name"]: random_value(f, rng) for f in fields} for _ in range(JOINT_SETTINGS)
    ]
    return [d for i, d in enumerate(result) if i == 0 or (d not in result[:i] and is_accepted(d))]


def in_turn(combinations: list[Settings], changes: list[Settings]) -> list[Settings]:
    """Each change under the next combination that the model accepts with it.

    The turn skips one after each round, so that the values of a field do not always meet the same ones.
    """
    count = len(combinations)
    result = []
    for i, change in enumerate(changes):
        start = i + i // count
        candidates = [combinations[(start + j) % count] | change for j in range(count)]
        result.append(next((c for c in candidates if is_accepted(c)), candidates[0]))
    return result


def check_reciprocity(bsdf: Bsdf, wo: np.ndarray, count: int = 4000) -> None:
    """f(wo, wi) n_o^2 = f(wi, wo) n_i^2 with the indices of refraction on the sides of wo and wi.

    That is Helmholtz reciprocity (Walter et al. 2007, section 5) for lobes without radiance's eta^2: the
    energy that wo spreads arrives unscaled. A sample's eta is n_i / n_o. For delta directions it is the
    symmetry of the transmitted fraction, weight * pdf.
    """
    draws = bsdf.sample(wo, uniforms(generator("reciprocity", bsdf.name, wo.tolist()), count, 3))
    there = draws.where(draws.valid & ~draws.delta & (np.abs(draws.points[:, 2]) > 1e-3))
    if len(there.points):
        forward = bsdf.evaluate(wo, there.points)[0] / np.abs(there.points[:, 2:])
        back = bsdf.evaluate(there.points, np.broadcast_to(wo, there.points.shape))[0] / abs(wo[2])
        rounding = rounding_at(lambda wi: bsdf.evaluate(wo, wi), there.points, generator("nudge"))
        compare(f"{bsdf.name} from {wo}: both ways", forward, back * there.eta[:, None] ** 2, 3 * rounding)
    for wi in np.unique(draws.points[draws.valid & draws.delta], axis=0):
        back = delta_fraction(bsdf, wi, wo, count)
        forward = delta_fraction(bsdf, wo, wi, count)
        require(
            np.allclose(forward, back, rtol=1e-3, atol=1e-5),
            f"{bsdf.name}: delta {wo} -> {wi} carries {forward}, back {back}",
        )


def delta_fraction(bsdf: Bsdf, wo: np.ndarray, wi: np.ndarray, count: int) -> np.ndarray:
    """weight * pdf of the delta branch from wo to wi; zero where it is never drawn."""
    draws = bsdf.sample(wo, uniforms(generator("branch", bsdf.name), count, 3))
    chosen = draws.where(draws.valid & draws.delta & (np.abs(draws.points - wi).max(1) < 1e-4))
    if len(chosen.points) == 0:
        return np.zeros(3)
    return chosen.weight[0] * chosen.pdf[0]
