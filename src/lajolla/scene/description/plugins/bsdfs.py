"""BSDFs: metals by name, and roughness."""

from __future__ import annotations

import math

from ...data.conductors import CONDUCTORS
from ...schema import Field
from ...syntax.errors import SceneError, did_you_mean
from ...syntax.nodes import Node
from ..plugin import Context, Entry, Plugin, Use, Values


def _roughness(context: Context, node: Node, values: Values) -> None:
    """Replaces `alpha`, or lajolla's `roughness` (its square root), by `alpha_u` and `alpha_v`."""
    roughness = _squared(context, node, values.pop("roughness", None))
    alpha = values.pop("alpha", roughness)
    if alpha is not None:
        values.setdefault("alpha_u", alpha)
        values.setdefault("alpha_v", alpha)


def _squared(context: Context, node: Node, roughness: Use | float | None) -> float | None:
    if isinstance(roughness, dict):
        context.diagnostics.unknown(f'{node} takes no texture as "roughness"; use "alpha"', node.location)
        return None
    if roughness is None:
        return None
    if roughness > MAX_ROUGHNESS:
        message = f'"roughness" must be at most {MAX_ROUGHNESS:g}, not {roughness:g}'
        raise SceneError(message, node.property_location("roughness"))
    return float(roughness) ** 2


def _rough_dielectric(context: Context, node: Node, values: Values) -> Entry:
    _roughness(context, node, values)
    return {"type": "roughdielectric", **values}


def _ward(context: Context, node: Node, values: Values) -> Entry:
    _roughness(context, node, values)
    return {"type": "ward", **values}


def _hair(context: Context, node: Node, values: Values) -> Entry:
    pigments = {name: values.pop(name) for name in ("eumelanin", "pheomelanin") if name in values}
    color = values.pop("color", None)
    if bool(pigments) + (color is not None) + ("sigma_a" in values) > 1:
        raise SceneError(f'{node} takes one of "sigma_a", "color" and pigments', node.location)
    if "sigma_a" not in values:
        values.pop("scale", None)  # it is a factor of that only
    if color is not None:
        values["sigma_a"] = absorption_of_hair(color, values.get("azimuthal_roughness", 0.3))
    elif pigments:
        dark, red = pigments.get("eumelanin", 1.3), pigments.get("pheomelanin", 0.2)
        # d'Eon et al. 2011, "An Energy-Conserving Hair Reflectance Model", table 1; per radius
        values["sigma_a"] = (0.419 * dark + 0.187 * red, 0.697 * dark + 0.4 * red, 1.37 * dark + 1.05 * red)
    return {"type": "hair", **values}


def absorption_of_hair(color: tuple[float, ...], roughness: float) -> tuple[float, ...]:
    """The absorption that gives much hair together its colour (Chiang et al. 2016, section 4.2)."""
    fit = (5.969, -0.215, 2.532, -10.73, 5.574, 0.245)
    divisor = sum(c * roughness**i for i, c in enumerate(fit))
    return tuple((math.log(max(c, 1e-3)) / divisor) ** 2 for c in color)


def _rough_diffuse(context: Context, node: Node, values: Values) -> Entry:
    if values.pop("use_fast_approx", False):
        values.setdefault("variant", "fast")
    return {"type": "roughdiffuse", **values}


def _rough_plastic(context: Context, node: Node, values: Values) -> Entry:
    alpha = _squared(context, node, values.pop("roughness", None))
    if alpha is not None:
        values.setdefault("alpha", alpha)
    return {"type": "roughplastic", **values}


def _conductor(context: Context, node: Node, values: Values) -> Entry:
    eta, k = _named_conductor(node, values.pop("material", "none"))
    ext_eta = values.pop("ext_eta", 1.0)
    if ext_eta <= 0:
        raise SceneError(f'"ext_eta" must be above zero, not {ext_eta:g}', node.property_location("ext_eta"))
    for name, value in (("eta", values.get("eta", eta)), ("k", values.get("k", k))):
        values[name] = value if isinstance(value, dict) else tuple(v / ext_eta for v in value)
        if isinstance(value, dict) and ext_eta != 1:
            message = f'"{name}" of {node} is a texture, which is not divided by "ext_eta"'
            context.diagnostics.warn(message, node.property_location(name))
    return {"type": "conductor", **values}


def _rough_conductor(context: Context, node: Node, values: Values) -> Entry:
    _roughness(context, node, values)
    return _conductor(context, node, values) | {"type": "roughconductor"}


def _named_conductor(node: Node, name: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """eta and k of a metal; those of "none" make a perfect mirror."""
    by_lower = {known.lower(): pair for known, pair in CONDUCTORS.items()}
    if name.lower() == "none":
        return ((0.0,) * 3, (1.0,) * 3)
    if name.lower() not in by_lower:
        hint = did_you_mean(name, [*CONDUCTORS, "none"])
        raise SceneError(f'no conductor is called "{name}"{hint}', node.property_location("material"))
    return by_lower[name.lower()]


MAX_ROUGHNESS = 1e9  # its square is a number to the core

MATERIAL = (
    Field("material", "string", "name of a metal, instead of eta and k; none is a perfect mirror", "none"),
    Field(
        "ext_eta", "float", "index of refraction outside, by which eta and k are divided; number or name", 1.0
    ),
)
ALPHA = (
    Field("alpha", "texture_float", "alpha_u and alpha_v at once", 0.1, 0.0),
    Field("roughness", "texture_float", "square root of alpha, as lajolla writes it", None, 0.0),
)
PIGMENTS = (
    Field("eumelanin", "float", "concentration of the pigment of dark hair", 1.3, 0.0),
    Field("pheomelanin", "float", "concentration of the pigment of red hair", 0.2, 0.0),
    Field(
        "color", "spectrum", "colour of much hair together, instead of pigments or sigma_a", None, 0.0, 1.0
    ),
)
FAST = Field("use_fast_approx", "boolean", 'the variant "fast", as Mitsuba 0.6 asks for it', False)

PLUGINS = (
    Plugin("bsdf", "conductor", "", MATERIAL, _conductor, model="conductor"),
    Plugin(
        "bsdf",
        "roughconductor",
        "",
        (*MATERIAL, *ALPHA),
        _rough_conductor,
        model="roughconductor",
    ),
    Plugin("bsdf", "roughdielectric", "", ALPHA, _rough_dielectric, model="roughdielectric"),
    Plugin("bsdf", "roughplastic", "", (ALPHA[1],), _rough_plastic, model="roughplastic"),
    Plugin("bsdf", "ward", "", ALPHA, _ward, model="ward"),
    Plugin("bsdf", "hair", "", PIGMENTS, _hair, model="hair"),
    Plugin("bsdf", "roughdiffuse", "", (FAST,), _rough_diffuse, model="roughdiffuse"),
)
