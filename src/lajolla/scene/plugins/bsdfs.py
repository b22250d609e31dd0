"""BSDFs: metals by name, and roughness."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..conductors import CONDUCTORS
from ..errors import SceneError, did_you_mean
from ..nodes import Node
from ..schema import Content, Field, Plugin

if TYPE_CHECKING:
    from ..build import Builder


def _roughness(builder: Builder, node: Node, values: dict[str, Any]) -> None:
    """Replaces `alpha`, or lajolla's `roughness` (its square root), by `alpha_u` and `alpha_v`."""
    roughness = _squared(builder, node, values.pop("roughness", None))
    alpha = values.pop("alpha", roughness)
    if alpha is not None:
        values.setdefault("alpha_u", alpha)
        values.setdefault("alpha_v", alpha)


def _squared(builder: Builder, node: Node, roughness: Content) -> float | None:
    if isinstance(roughness, dict):
        builder.diagnostics.unknown(f'{node} takes no texture as "roughness"; use "alpha"', node.location)
        return None
    return None if roughness is None else float(roughness) ** 2


def _rough_dielectric(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    _roughness(builder, node, values)
    return {"type": "roughdielectric", **values}


def _ward(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    _roughness(builder, node, values)
    return {"type": "ward", **values}


def _rough_diffuse(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    if values.pop("use_fast_approx", False):
        values.setdefault("variant", "fast")
    return {"type": "roughdiffuse", **values}


def _rough_plastic(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    alpha = _squared(builder, node, values.pop("roughness", None))
    if alpha is not None:
        values.setdefault("alpha", alpha)
    return {"type": "roughplastic", **values}


def _conductor(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    eta, k = _named_conductor(node, values.pop("material", "none"))
    ext_eta = values.pop("ext_eta", 1.0)
    if ext_eta <= 0:
        raise SceneError(f'"ext_eta" must be above zero, not {ext_eta:g}', node.property_location("ext_eta"))
    for name, value in (("eta", values.get("eta", eta)), ("k", values.get("k", k))):
        values[name] = value if isinstance(value, dict) else tuple(v / ext_eta for v in value)
        if isinstance(value, dict) and ext_eta != 1:
            message = f'"{name}" of {node} is a texture, which is not divided by "ext_eta"'
            builder.diagnostics.warn(message, node.property_location(name))
    return {"type": "conductor", **values}


def _rough_conductor(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    _roughness(builder, node, values)
    return _conductor(builder, node, values) | {"type": "roughconductor"}


def _named_conductor(node: Node, name: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """eta and k of a metal; those of "none" make a perfect mirror."""
    by_lower = {known.lower(): pair for known, pair in CONDUCTORS.items()}
    if name.lower() == "none":
        return ((0.0,) * 3, (1.0,) * 3)
    if name.lower() not in by_lower:
        hint = did_you_mean(name, [*CONDUCTORS, "none"])
        raise SceneError(f'no conductor is called "{name}"{hint}', node.property_location("material"))
    return by_lower[name.lower()]


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
    Plugin("bsdf", "roughdiffuse", "", (FAST,), _rough_diffuse, model="roughdiffuse"),
)
