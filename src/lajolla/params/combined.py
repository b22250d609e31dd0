"""Parameters of scene files and dicts that stand for several: alpha, material, sigma_t, albedo."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from lajolla.params.objects import SceneObject
from lajolla.scene import SceneError
from lajolla.scene.data.conductors import CONDUCTORS
from lajolla.scene.syntax.errors import did_you_mean

ALPHAS = ("alpha_u", "alpha_v")
INDEX = ("eta", "k")
SIGMAS = ("sigma_a", "sigma_s")

# The parameters that each of them stands for.
COMBINED = {"alpha": ALPHAS, "material": INDEX, "sigma_t": SIGMAS, "albedo": SIGMAS}


def parts_of(found: SceneObject, param: str) -> tuple[str, ...]:
    """The parameters of an object for which one of COMBINED stands; empty if it is none."""
    parts = COMBINED.get(param, ())
    return parts if param not in found.fields and all(part in found.fields for part in parts) else ()


def read(param: str, parts: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """The value of one of COMBINED, by those for which it stands. Raises ValueError if it has none."""
    if param == "alpha" and np.array_equal(parts["alpha_u"], parts["alpha_v"]):
        return parts["alpha_u"]
    if parts.keys() == set(SIGMAS):
        return _extinction(parts)[param == "albedo"]
    raise ValueError(f"it stands for {' and '.join(parts)}")


def _extinction(parts: Mapping[str, Any]) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Extinction and albedo."""
    total = parts["sigma_a"] + parts["sigma_s"]
    return total, np.divide(parts["sigma_s"], total, out=np.zeros(3), where=total > 0)


def written(given: Mapping[str, Any], parts: Mapping[str, Any]) -> dict[str, Any]:
    """What to set in place of some of COMBINED.

    Args:
        given: their values.
        parts: those of the parameters for which they stand.

    Raises:
        SceneError: a value does not fit.
    """
    result: dict[str, Any] = {}
    if "alpha" in given:
        result |= dict.fromkeys(ALPHAS, given["alpha"])
    if "material" in given:
        name = str(given["material"])
        metals = {"none": ((0.0,) * 3, (1.0,) * 3), **{k.lower(): pair for k, pair in CONDUCTORS.items()}}
        if name.lower() not in metals:
            raise SceneError(f'no conductor is called "{name}"{did_you_mean(name, [*CONDUCTORS, "none"])}')
        result |= dict(zip(INDEX, metals[name.lower()], strict=True))
    if given.keys() & {"sigma_t", "albedo"}:
        total, known = _extinction(parts)
        sigma_t = _colour("sigma_t", given.get("sigma_t", total))
        albedo = _colour("albedo", given.get("albedo", known))
        if not np.all((albedo >= 0) & (albedo <= 1)):
            raise SceneError(f"albedo must be between 0 and 1, not {given['albedo']!r}")
        result |= {"sigma_s": albedo * sigma_t, "sigma_a": sigma_t - albedo * sigma_t}
    return result


def _colour(name: str, value: object) -> npt.NDArray[np.float64]:
    try:
        return np.array(np.broadcast_to(np.asarray(value, np.float64), 3))
    except (TypeError, ValueError):
        raise SceneError(f"{name} is one number or three, not {value!r}") from None
