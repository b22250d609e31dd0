"""Phase functions as things under test: every model of the core's list with settings made from its fields."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from quadrature_tools import sphere
from scatter_tools import Settings, label, numbers_within, random_number, rows
from statistics_tools import Draws, Sampled, generator

from lajolla import _core

MODELS: dict[str, dict] = _core.schema()["phase"]
JOINT_SETTINGS = 3  # settings that change all fields at once, per model

MATRICES = (
    (1, 1, 1, 0, 0, 0),
    (1, 1, 1e-2, 0, 0, 0),  # like a surface across z
    (2e-2, 0.7, 1, 0.05, -0.03, 0.5),
    (0.3, 0.2, 0.1, 0.1, -0.05, 0.08),
)
TABLES = ((0, 1), (1, 0, 0, 3), (0.2, 0, 0.1, 0.3, 4), tuple(np.linspace(0, 1, 40) ** 6))

# What blends are made of: indices of PARTS, which stand before every phase function under test.
PARTS: tuple[Settings, ...] = (
    {"type": "hg", "g": 0.7},
    {"type": "rayleigh"},
    {"type": "sggx", "S": MATRICES[1]},
    {"type": "blendphase", "phase_0": 0, "phase_1": 2, "weight": 0.3},
)


@dataclass(frozen=True)
class Phase:
    """A phase function at the origin: `pdf` is its value, `area` the factor of the extinction."""

    description: Settings
    media: _core.Media

    @property
    def name(self) -> str:
        return label(self.description)

    def sample(self, wo: np.ndarray, u: np.ndarray) -> Draws:
        wi, pdf = self.media.phase_sample_many(len(PARTS), rows(wo), rows(u), ORIGIN)
        count = len(pdf)
        no, yes = np.zeros(count, bool), np.ones(count, bool)
        return Draws(wi, np.ones((count, 1)), pdf, yes, no, np.ones(count))

    def evaluate(self, wo: np.ndarray, wi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        pdf = self.media.phase_eval_many(len(PARTS), rows(wo), rows(wi), ORIGIN)
        return pdf[:, None], pdf

    def area(self, wo: np.ndarray) -> np.ndarray:
        return self.media.phase_area_many(len(PARTS), rows(wo), ORIGIN)


ORIGIN = np.zeros((1, 3), np.float32)


def make_phase(description: Settings) -> Phase:
    return Phase(description, _core.Media({"phases": [*PARTS, description]}))


def seen_from(phase: Phase, wo: np.ndarray) -> Sampled:
    """The distribution of wi given wo, which lies on the equator of the domain's coordinates."""
    tangent = np.hypot(wo[0], wo[1])
    axis = (-wo[1] / tangent, wo[0] / tangent, 0) if tangent > 0 else (0, 1, 0)
    return Sampled(
        name=f"{phase.name} from {np.round(wo, 4).tolist()}",
        domain=sphere(axis),
        uniforms=3,
        sample=lambda u: phase.sample(wo, u),
        evaluate=lambda wi: phase.evaluate(wo, wi),
    )


def values_of(field: dict) -> list[object]:
    """What a field is tested with, one value at a time."""
    match field["type"]:
        case "float" | "volume_float":
            return list(numbers_within(field))
        case "volume_matrix":
            return list(MATRICES)
        case "floats":
            return list(TABLES)
        case "phase":
            return [-1, *range(len(PARTS))]
    raise NotImplementedError(f"no test values for fields of type {field['type']}")


def random_value(field: dict, rng: np.random.Generator) -> object:
    if field["type"] in ("float", "volume_float"):
        return random_number(field, rng)
    values = values_of(field)
    return values[rng.integers(len(values))]


def settings_of(name: str) -> list[Settings]:
    """Descriptions of one model: one field changed at a time, and all fields at once."""
    fields = MODELS[name]["fields"]
    result: list[Settings] = [{"type": name}]
    result += [{"type": name, f["name"]: value} for f in fields for value in values_of(f)]
    rng = generator("settings", name)
    joint = [{f["name"]: random_value(f, rng) for f in fields} for _ in range(JOINT_SETTINGS)]
    result += [{"type": name} | settings for settings in joint if settings]
    return [d for i, d in enumerate(result) if d not in result[:i]]
