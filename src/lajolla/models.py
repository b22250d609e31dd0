"""BSDFs, phase functions and lights by themselves: to plot lobes, test estimators, and teach.

gold = Bsdf({"type": "roughconductor", "material": "Au", "alpha": 0.2})
values = gold.eval((0.6, 0, 0.8), directions)       # (N, 3), times the cosine
samples = gold.sample((0.6, 0, 0.8), 1000, seed=1)  # samples.wi, .weight, .pdf

All directions point away from the surface or the particle, and have unit length; others are normalised.
Light comes from `wi` and goes to `wo`. The normal of a surface is +z.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lajolla import _core
from lajolla.colour import FloatImage
from lajolla.limits import OptionError, check, check_mapping, whole
from lajolla.loading import load_dict
from lajolla.messages import warn
from lajolla.scene import SceneError, SceneWarning, describe, plugins_by_kind

Truths = NDArray[np.bool_]
Sides = tuple[dict[str, Any], dict[str, Any] | None]  # descriptions of front and back

CAMERA = {"type": "perspective", "film": {"type": "hdrfilm", "width": 1, "height": 1}}
FRAME = {"type": "scene", "integrator": {"type": "volpath"}, "sensor": CAMERA}
SKY = {"sky": {"type": "constant"}}  # so that there is no warning of a dark scene


@dataclass(frozen=True, eq=False)
class BsdfSamples:
    """N sampled directions.

    Attributes:
        wi: (N, 3) directions; zero where the sample is not valid.
        weight: (N, 3) value times cosine over density: the mean of weights is the albedo.
        pdf: (N,) density per solid angle; of specular reflection and refraction, the probability.
        valid: (N,) whether light comes from there; the weight of the others is zero.
        delta: (N,) whether it is specular.
        eta: (N,) relative index of refraction, 1 for reflection. Weights lack the factor 1 / eta^2, by which
            radiance changes.
    """

    wi: FloatImage
    weight: FloatImage
    pdf: FloatImage
    valid: Truths
    delta: Truths
    eta: FloatImage


class Bsdf:
    """A BSDF of constant parameters.

    Args:
        description: as in a scene dict: {"type": "plastic", "diffuse_reflectance": [0.1, 0.2, 0.3]}. Of a
            "twosided", the second bsdf, or the only one, is seen where wo is below the surface.

    Raises:
        SceneError: it is none, or contains textures, blends, masks or maps of normals.
    """

    def __init__(self, description: Mapping[str, Any]) -> None:
        core = _described("bsdf", description, {"type": "sphere", "bsdf": description})
        material = core["materials"][0]
        front, back = material["front"], material["back"]
        if not isinstance(front, int) or not isinstance(back, int) or front < 0:
            raise SceneError("a Bsdf is a single one: no blend, mask or map of normals")
        self.__setstate__((core["bsdfs"][front], core["bsdfs"][back] if back >= 0 else None))

    def __repr__(self) -> str:
        front, back = self._described
        return f"<lajolla.Bsdf, {front['type']}{', and one behind' if back else ''}>"

    def __getstate__(self) -> Sides:
        return self._described

    def __setstate__(self, described: Sides) -> None:
        self._described = described
        front, back = described
        self.front = _core_bsdf(front)
        self.back = None if back is None else _core_bsdf(back)

    def eval(self, wo: ArrayLike, wi: ArrayLike) -> FloatImage:
        """Values times the cosine of wi: (N, 3), for (N, 3) or (3,) directions; 0 for specular parts.

        Where wi is zero, as of samples that are not valid, values are 0."""
        return np.asarray(self._evaluated(wo, wi)[0])

    def pdf(self, wo: ArrayLike, wi: ArrayLike) -> FloatImage:
        """Densities (N,), per solid angle, with which `sample` returns wi; 0 for specular parts."""
        return np.asarray(self._evaluated(wo, wi)[1])

    def sample(self, wo: ArrayLike, count: int, seed: int = 0) -> BsdfSamples:
        """Samples `count` directions wi for wo, which is (3,) or (count, 3)."""
        rows, numbers = _one_or(count, wo), _numbers(count, seed)
        found = self.front.sample_many(rows, numbers)
        if self.back is not None and (below := rows[:, 2] < 0).any():
            other = self.back.sample_many(rows * TURN, numbers)
            other["wi"] *= TURN
            for name in BsdfSamples.__dataclass_fields__:
                found[name] = _chosen(below, other[name], found[name])
        return BsdfSamples(**{name: found[name] for name in BsdfSamples.__dataclass_fields__})

    def _evaluated(self, wo: ArrayLike, wi: ArrayLike) -> tuple[FloatImage, FloatImage]:
        outgoing, incoming, absent = _pairs(wo, wi)
        values, density = self._evaluated_present(outgoing, incoming)
        values[absent], density[absent] = 0, 0
        return values, density

    def _evaluated_present(self, wo: FloatImage, wi: FloatImage) -> tuple[FloatImage, FloatImage]:
        values, density = self.front.eval_many(wo, wi)
        if self.back is not None and (below := wo[:, 2] < 0).any():
            others, other_density = self.back.eval_many(wo * TURN, wi * TURN)
            return _chosen(below, others, values), _chosen(below, other_density, density)
        return values, density


# The frame of a back: its normal is the other way round, its tangent the same.
TURN = np.array([1, -1, -1], np.float32)


def _core_bsdf(entry: Mapping[str, Any]) -> _core.Bsdf:
    try:
        return _core.Bsdf(dict(entry))
    except _core.DescriptionError as problem:
        raise SceneError(str(problem).removeprefix("bsdf: ")) from None


def _chosen(condition: Truths, values: FloatImage, others: FloatImage) -> FloatImage:
    """Rows of `values` where the condition holds, else of `others`; the condition has N rows, or one."""
    return np.where(condition.reshape(-1, *(1,) * (values.ndim - 1)), values, others)


class Phase:
    """A phase function of constant parameters.

    Args:
        description: as in a scene dict: {"type": "hg", "g": 0.8}.

    Raises:
        SceneError: it is none, or its parameters do not fit.
    """

    def __init__(self, description: Mapping[str, Any]) -> None:
        medium = {"type": "homogeneous", "phase": description}
        around = {"type": "sphere", "center": [0, 0, 9], "bsdf": {"type": "null"}, "interior": medium}
        core = _described("phase", description, around)
        self.__setstate__(({name: core[name] for name in ("volumes", "phases")}, core["media"][0]["phase"]))

    def __repr__(self) -> str:
        return f"<lajolla.Phase, {self._described['phases'][self._index]['type']}>"

    def __getstate__(self) -> tuple[dict[str, Any], int]:
        return self._described, self._index

    def __setstate__(self, state: tuple[dict[str, Any], int]) -> None:
        self._described, self._index = state
        self.core = _core.Media(self._described)

    def eval(self, wo: ArrayLike, wi: ArrayLike) -> FloatImage:
        """Values (N,) per solid angle, which are also the densities of `sample`. Light that is not deflected
        has wi = -wo."""
        outgoing, incoming, absent = _pairs(wo, wi)
        values = np.array(self.core.phase_eval_many(self._index, outgoing, incoming, ORIGIN))
        values[absent] = 0
        return values

    def pdf(self, wo: ArrayLike, wi: ArrayLike) -> FloatImage:
        """The same as `eval`."""
        return self.eval(wo, wi)

    def sample(self, wo: ArrayLike, count: int, seed: int = 0) -> tuple[FloatImage, FloatImage]:
        """Samples `count` directions wi (count, 3) for wo, (3,) or (count, 3), and their densities."""
        wi, density = self.core.phase_sample_many(
            self._index, _one_or(count, wo), _numbers(count, seed), ORIGIN
        )
        return wi, density


@dataclass(frozen=True, eq=False)
class LightSamples:
    """N sampled directions from a point to a light.

    Attributes:
        wi: (N, 3) directions.
        distance: (N,) to the light; infinite for light from far away.
        radiance: (N, 3) that comes from there; of lights without area, the irradiance.
        pdf: (N,) density per solid angle, or the probability if `delta`; 0: there is no sample.
        delta: (N,) whether the light has no area, so that no ray can hit it.
        visible: (N,) whether nothing is in between.
    """

    wi: FloatImage
    distance: FloatImage
    radiance: FloatImage
    pdf: FloatImage
    delta: Truths
    visible: Truths


class Light:
    """A light by itself.

    Args:
        description: an emitter as in a scene dict, {"type": "envmap", "data": array}, or a shape that emits:
            {"type": "sphere", "center": [0, 3, 0], "emitter": {"type": "area", "radiance": 2}}.

    Raises:
        SceneError: it is no light.
    """

    def __init__(self, description: Mapping[str, Any]) -> None:
        check_mapping("description", description)
        self.scene = load_dict({**FRAME, "light": description}, strict=True)
        if not self.scene.description.core["emitters"]:
            raise SceneError("a Light is an emitter, or a shape with an emitter inside")

    def __repr__(self) -> str:
        kinds = dict.fromkeys(entry["type"] for entry in self.scene.description.core["emitters"])
        return f"<lajolla.Light, {', '.join(kinds)}>"

    def eval(self, point: ArrayLike, wi: ArrayLike) -> FloatImage:
        """Radiance (N, 3) that comes to a point (3,) from directions wi (N, 3)."""
        return self._evaluated(point, wi)[0]

    def pdf(self, point: ArrayLike, wi: ArrayLike) -> FloatImage:
        """Densities (N,), per solid angle, with which `sample` returns directions wi (N, 3)."""
        return self._evaluated(point, wi)[1]

    def _evaluated(self, point: ArrayLike, wi: ArrayLike) -> tuple[FloatImage, FloatImage]:
        rows, absent = _directions_or_none(wi)
        radiance, density = map(np.array, _core.eval_emitters(self.scene.core, _point(point), rows))
        radiance[absent], density[absent] = 0, 0
        return radiance, density

    def sample(self, point: ArrayLike, count: int, seed: int = 0) -> LightSamples:
        """Samples `count` directions to the light from a point (3,)."""
        found = _core.sample_emitters(self.scene.core, _point(point), _numbers(count, seed))
        return LightSamples(**{name: found[name] for name in LightSamples.__dataclass_fields__})


def _described(kind: str, description: Mapping[str, Any], shape: Mapping[str, Any]) -> dict[str, Any]:
    """The entries of a scene with this shape; warns as scenes do. Raises SceneError."""
    check_mapping("description", description)
    name = description.get("type")
    table = plugins_by_kind()
    if isinstance(name, str) and name.lower() not in table[kind]:
        kinds = [other for other, plugins in table.items() if name.lower() in plugins]
        if kinds:
            raise SceneError(f'expected a {kind}, got the {kinds[0]} "{name}"')
    found = describe({**FRAME, **SKY, "own": shape}, strict=True)
    for warning in found.warnings:
        warn(SceneWarning(warning.message))
    return found.core


ORIGIN = np.zeros((1, 3), np.float32)
FARTHEST = 1e18  # coordinate of a point: squares of distances are float32


def _numbers(count: int, seed: int) -> FloatImage:
    if seed is None:
        raise OptionError("seed must be a whole number, not None")
    number = whole(count)
    if number is None or number < 0:
        raise OptionError(f"the number of samples must be a whole number, not {count!r}")
    return np.random.default_rng(check("seed", seed)).random((number, 3), dtype=np.float32)


def _directions(given: ArrayLike) -> FloatImage:
    rows = np.atleast_2d(np.asarray(given, np.float64))
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ValueError(f"directions must have the shape (N, 3) or (3,), not {np.shape(given)}")
    if not np.all(np.isfinite(rows)):
        raise ValueError("a direction is not finite")
    largest = np.max(np.abs(rows), axis=1, keepdims=True)
    if not np.all(largest > 0):
        raise ValueError("a direction has no length")
    rows = rows / largest  # so that no square is too small or too large
    return np.ascontiguousarray(rows / np.linalg.norm(rows, axis=1, keepdims=True), np.float32)


def _one_or(count: int, wo: ArrayLike) -> FloatImage:
    """Directions: one for all samples, or as many as there are."""
    rows = _directions(wo)
    if len(rows) not in (1, count):
        raise ValueError(f"wo has {len(rows)} rows, not 1 or as many as samples, {count}")
    return rows


def _directions_or_none(given: ArrayLike) -> tuple[FloatImage, Truths]:
    """Directions, and which of them are none: zero, as those of samples that are not valid."""
    rows = np.atleast_2d(np.asarray(given, np.float64))
    absent = np.all(rows == 0, axis=-1)
    return _directions(np.where(absent[..., None], (0.0, 0.0, 1.0), rows) if absent.any() else given), absent


def _pairs(wo: ArrayLike, wi: ArrayLike) -> tuple[FloatImage, FloatImage, Truths]:
    """Directions, as many of one as of the other, and where wi is none."""
    incoming, absent = _directions_or_none(wi)
    rows = _directions(wo), incoming
    counts = {len(rows[0]), len(rows[1])} - {1}
    if len(counts) > 1:
        raise ValueError(f"wo and wi have {len(rows[0])} and {len(rows[1])} rows")
    shape = (counts.pop() if counts else 1, 3)
    return (
        np.ascontiguousarray(np.broadcast_to(rows[0], shape)),
        np.ascontiguousarray(np.broadcast_to(rows[1], shape)),
        np.broadcast_to(absent, shape[:1]),
    )


def _point(given: ArrayLike) -> NDArray[np.float64]:
    point = np.ascontiguousarray(given, np.float64)
    if point.shape != (3,) or not np.all(np.abs(point) <= FARTHEST):
        raise ValueError(f"a point is three numbers, of at most {FARTHEST:g}, not {given!r}")
    return point
