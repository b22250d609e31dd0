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
from lajolla.limits import OptionError
from lajolla.loading import load_dict
from lajolla.scene import SceneError, describe

Truths = NDArray[np.bool_]

CAMERA = {"type": "perspective", "film": {"type": "hdrfilm", "width": 1, "height": 1}}
FRAME = {"type": "scene", "integrator": {"type": "volpath"}, "sensor": CAMERA}


@dataclass(frozen=True)
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
        description: as in a scene dict: {"type": "plastic", "diffuse_reflectance": [0.1, 0.2, 0.3]}.

    Raises:
        SceneError: it is none, or contains textures or several bsdfs.
    """

    def __init__(self, description: Mapping[str, Any]) -> None:
        core = _described({"type": "sphere", "bsdf": description})
        front = core["materials"][0]["front"]
        if not isinstance(front, int) or front < 0:
            raise SceneError("a Bsdf is a single one: no blend, mask or map of normals")
        try:
            self.core = _core.Bsdf(core["bsdfs"][front])
        except _core.DescriptionError as problem:
            raise SceneError(str(problem).removeprefix("bsdf: ")) from None

    def eval(self, wo: ArrayLike, wi: ArrayLike) -> FloatImage:
        """Values times the cosine of wi: (N, 3), for (N, 3) or (3,) directions; 0 for specular parts."""
        return np.asarray(self._evaluated(wo, wi)[0])

    def pdf(self, wo: ArrayLike, wi: ArrayLike) -> FloatImage:
        """Densities (N,), per solid angle, with which `sample` returns wi; 0 for specular parts."""
        return np.asarray(self._evaluated(wo, wi)[1])

    def sample(self, wo: ArrayLike, count: int, seed: int = 0) -> BsdfSamples:
        """Samples `count` directions wi for wo, which is (3,) or (count, 3)."""
        found = self.core.sample_many(_directions(wo), _numbers(count, seed))
        return BsdfSamples(**{name: found[name] for name in BsdfSamples.__dataclass_fields__})

    def _evaluated(self, wo: ArrayLike, wi: ArrayLike) -> tuple[FloatImage, FloatImage]:
        rows = _directions(wo), _directions(wi)
        count = max(len(rows[0]), len(rows[1]))
        values, density = self.core.eval_many(rows[0], _repeated(rows[1], count))
        return values, density


class Phase:
    """A phase function of constant parameters.

    Args:
        description: as in a scene dict: {"type": "hg", "g": 0.8}.

    Raises:
        SceneError: it is none, or its parameters do not fit.
    """

    def __init__(self, description: Mapping[str, Any]) -> None:
        medium = {"type": "homogeneous", "phase": description}
        core = _described({"type": "sphere", "bsdf": {"type": "null"}, "interior": medium})
        self.core = _core.Media({name: core[name] for name in ("volumes", "phases")})
        self._index: int = core["media"][0]["phase"]

    def eval(self, wo: ArrayLike, wi: ArrayLike) -> FloatImage:
        """Values (N,) per solid angle, which are also the densities of `sample`. Light that is not deflected
        has wi = -wo."""
        rows = _directions(wo), _directions(wi)
        count = max(len(rows[0]), len(rows[1]))
        return np.asarray(self.core.phase_eval_many(self._index, rows[0], _repeated(rows[1], count), ORIGIN))

    def pdf(self, wo: ArrayLike, wi: ArrayLike) -> FloatImage:
        """The same as `eval`."""
        return self.eval(wo, wi)

    def sample(self, wo: ArrayLike, count: int, seed: int = 0) -> tuple[FloatImage, FloatImage]:
        """Samples `count` directions wi (count, 3) for wo, (3,) or (count, 3), and their densities."""
        wi, density = self.core.phase_sample_many(self._index, _directions(wo), _numbers(count, seed), ORIGIN)
        return wi, density


@dataclass(frozen=True)
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
        self.scene = load_dict({**FRAME, "light": description}, strict=True)
        if not self.scene.description.core["emitters"]:
            raise SceneError("a Light is an emitter, or a shape with an emitter inside")

    def eval(self, point: ArrayLike, wi: ArrayLike) -> FloatImage:
        """Radiance (N, 3) that comes to a point (3,) from directions wi (N, 3)."""
        return np.asarray(_core.eval_emitters(self.scene.core, _point(point), _directions(wi))[0])

    def pdf(self, point: ArrayLike, wi: ArrayLike) -> FloatImage:
        """Densities (N,), per solid angle, with which `sample` returns directions wi (N, 3)."""
        return np.asarray(_core.eval_emitters(self.scene.core, _point(point), _directions(wi))[1])

    def sample(self, point: ArrayLike, count: int, seed: int = 0) -> LightSamples:
        """Samples `count` directions to the light from a point (3,)."""
        found = _core.sample_emitters(self.scene.core, _point(point), _numbers(count, seed))
        return LightSamples(**{name: found[name] for name in LightSamples.__dataclass_fields__})


def _described(shape: Mapping[str, Any]) -> dict[str, Any]:
    return describe({**FRAME, "own": shape}, strict=True).core


ORIGIN = np.zeros((1, 3), np.float32)


def _numbers(count: int, seed: int) -> FloatImage:
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 0:
        raise OptionError(f"the number of samples must be a whole number, not {count!r}")
    return np.random.default_rng(seed).random((int(count), 3), dtype=np.float32)


def _directions(given: ArrayLike) -> FloatImage:
    rows = np.atleast_2d(np.asarray(given, np.float64))
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ValueError(f"directions must have the shape (N, 3) or (3,), not {np.shape(given)}")
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    if not np.all(np.isfinite(lengths) & (lengths > 0)):
        raise ValueError("a direction has no length")
    return np.ascontiguousarray(rows / lengths, np.float32)


def _repeated(rows: FloatImage, count: int) -> FloatImage:
    return np.ascontiguousarray(np.broadcast_to(rows, (count, 3))) if len(rows) == 1 else rows


def _point(given: ArrayLike) -> FloatImage:
    point = np.ascontiguousarray(given, np.float32)
    if point.shape != (3,):
        raise ValueError(f"a point is three numbers, not {given!r}")
    return point
