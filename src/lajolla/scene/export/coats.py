"""Coatings for Mitsuba 3, which has none: plastic, or a blend of a mirror and the base.

As here (`core/scatter/coating.h`), light that the layer reflects back to its base is lost. A mean share is
subtracted for all directions; around a rough base more is lost at grazing angles, hence BRIGHTER.
"""

from __future__ import annotations

import math

from ..syntax.nodes import Node, Property, Rgb, Value, below
from .plugins import having, holding, like, named
from .translation import Translation

ADAPTERS = ("twosided", "bumpmap", "normalmap", "mask", "blendbsdf")
# These stay without a coat.
CLEAR = (
    *("dielectric", "thindielectric", "roughdielectric", "null", "principledthin", "hair"),
    *("polarizer", "retarder", "circular"),
)
DIFFUSE = {"diffuse": "reflectance", "plastic": "diffuse_reflectance", "roughplastic": "diffuse_reflectance"}
SHARED = ("int_ior", "ext_ior", "specular_reflectance", "alpha", "distribution")  # with plastic
STEPS = 1024
# Roughness of mirrors in blends: if one component has a probability and the other a density, Mitsuba's
# blendbsdf adds the two up.
SMOOTH = 0.005
BRIGHTER = "too bright around rough metal: under an even sky by 8 % at roughness 0.1, by 30 % at 0.3"


def coating(translation: Translation, read: Node, node: Node) -> Node | None:
    """A coat on every bsdf inside. On diffuse ones it is plastic."""
    inner = next((child for _, child in node.children("bsdf")), None)
    if inner is None:
        translation.replaced(node, "it is ignored")
        return None
    coated = _coated(translation, node, inner)
    rough = any(base.plugin == "roughconductor" for base in (inner, *below([inner])))
    translation.replaced(node, f'"{coated.plugin}" is written' + (f", {BRIGHTER}" if rough else ""))
    return named(coated, node.id)


def _coated(translation: Translation, coat: Node, inner: Node) -> Node:
    if inner.plugin in ADAPTERS:
        result = like(inner, inner.plugin)
        result.id = ""  # another one than what is inside
        for prop in inner.properties:
            value = prop.value
            if isinstance(value, Node) and value.kind == "bsdf":
                value = _coated(translation, coat, value)
            holding(result, value, name=prop.name)
        return result
    if inner.plugin in CLEAR:
        return inner
    if inner.plugin in DIFFUSE:
        return _plastic(translation, coat, inner.find(DIFFUSE[inner.plugin]))
    if _absorbs(coat):
        translation.lose("sigma_a")
    reflected = _mean_reflectance(_eta(coat))
    if inner.plugin == "conductor":
        rough = Node("bsdf", "roughconductor", inner.location, inner.location)
        rough.properties = inner.properties
        inner = having(rough, alpha=SMOOTH)
    passed = _blend(coat, inner, _black(coat), reflected)  # on the way out
    return _blend(coat, passed, _mirror(coat), reflected)


def _plastic(translation: Translation, coat: Node, reflectance: Property | None) -> Node:
    """Without the interreflections inside the layer that Mitsuba's plastic adds."""
    kept = 1 - _mean_reflectance(1 / _eta(coat))  # what leaves of the diffuse light within
    colour: Value = Rgb((0.5,) * 3) if reflectance is None else reflectance.value
    if not isinstance(colour, Rgb):
        if _absorbs(coat):
            translation.lose("sigma_a")
        bare = having(_shiny(coat), diffuse_reflectance=Rgb((0.0,) * 3))
        return _blend(coat, having(_shiny(coat), diffuse_reflectance=colour), bare, 1 - kept)
    passed = _passed(translation, coat)
    red, green, blue = (kept * c * p for c, p in zip(colour.values, passed, strict=True))
    return having(_shiny(coat), diffuse_reflectance=Rgb((red, green, blue)))


def _shiny(coat: Node) -> Node:
    plugin = "roughplastic" if coat.plugin == "roughcoating" else "plastic"
    result = Node("bsdf", plugin, coat.location, coat.location)
    result.properties = [p for p in coat.properties if p.name in SHARED]
    return having(result, int_ior=_number(coat, "int_ior", 1.5046))


def _mirror(coat: Node) -> Node:
    mirror = Node("bsdf", "roughconductor", coat.location, coat.location)
    mirror.properties = [p for p in coat.properties if p.name in SHARED and not p.name.endswith("_ior")]
    if coat.plugin == "coating":
        mirror = having(mirror, alpha=SMOOTH)
    return having(mirror, material="none")


def _black(coat: Node) -> Node:
    return having(Node("bsdf", "diffuse", coat.location, coat.location), reflectance=Rgb((0.0,) * 3))


def _blend(coat: Node, first: Node, second: Node, weight: float) -> Node:
    blend = having(Node("bsdf", "blendbsdf", coat.location, coat.location), weight=weight)
    return holding(blend, first, second)


def _absorbs(coat: Node) -> bool:
    sigma = getattr(coat.find("sigma_a"), "value", None)
    return sigma is not None and not (isinstance(sigma, Rgb) and max(sigma.values) == 0)


def _passed(translation: Translation, coat: Node) -> tuple[float, ...]:
    """Transmittance of the layer along its normal, in both directions."""
    sigma, thickness = (
        getattr(coat.find("sigma_a"), "value", Rgb((0.0,) * 3)),
        _number(coat, "thickness", 1.0),
    )
    if isinstance(sigma, Rgb):
        return tuple(math.exp(-2 * thickness * s) for s in sigma.values)
    translation.lose("sigma_a")
    return (1.0,) * 3


def _eta(coat: Node) -> float:
    return _number(coat, "int_ior", 1.5046) / _number(coat, "ext_ior", 1.000277)


def _number(node: Node, name: str, default: float) -> float:
    value = getattr(node.find(name), "value", default)
    return float(value) if isinstance(value, int | float) else default


def _mean_reflectance(eta: float) -> float:
    """Fresnel reflectance for diffuse illumination, by the midpoint rule over the squared cosine."""
    return sum(_fresnel(math.sqrt((i + 0.5) / STEPS), eta) for i in range(STEPS)) / STEPS


def _fresnel(cosine: float, eta: float) -> float:
    inside = 1 - (1 - cosine * cosine) / (eta * eta)
    if inside <= 0:
        return 1.0
    refracted = math.sqrt(inside)
    across = (cosine - eta * refracted) / (cosine + eta * refracted)
    along = (eta * cosine - refracted) / (eta * cosine + refracted)
    return (across * across + along * along) / 2
