"""Replacements for unsupported plugins."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

from ..syntax.errors import nearest
from ..syntax.nodes import Node, Property, Value

DROPPED = "<dropped>"
NESTED = "<nested>"  # the first child of the same kind

# Plugin names of Mitsuba 0.4 to 3 and of lajolla, in lower case, with the nearest in effect. Where there is a
# plugin of that name, its row is not asked.
SUBSTITUTES = {
    "bsdf": {
        "glass": "dielectric",
        "hk": "diffuse",
        "irawan": "diffuse",
        "linear": "polarizer",
        "measured_polarized": "diffuse",
        "metal": "roughconductor",
        "mirror": "conductor",
        "pplastic": "roughplastic",
        "roughconductorggx": "roughconductor",
        "roughdielectricggx": "roughdielectric",
        "roughglass": "roughdielectric",
        "roughmetal": "roughconductor",
    },
    "integrator": {
        "adaptive": NESTED,
        "irrcache": NESTED,
        "stokes": NESTED,
        "direct_projective": "direct",
        "prbvolpath": "volpath",
    },
    "sensor": {"batch": NESTED},  # those of a scene are taken apart before
    "emitter": {"timed_sunsky": "sunsky"},
    "film": {"specfilm": "hdrfilm"},
    "sampler": {"independent": "independent"},
    "phase": {"kkay": "isotropic", "microflake": "isotropic", "mixturephase": NESTED},
    "volume": {"volcache": NESTED, "grid": "gridvolume", "const": "constvolume"},
    "shape": {"mesh": DROPPED, "ellipsoids": DROPPED, "ellipsoidsmesh": DROPPED, "deformable": DROPPED},
}

# Replacements for unknown names without a similar known one.
OTHERWISE = {
    "bsdf": "diffuse",
    "texture": DROPPED,
    "integrator": "path",
    "sampler": "sobol",
    "film": "hdrfilm",
    "rfilter": "gaussian",
    "sensor": "perspective",
    "phase": "isotropic",
    "volume": "constvolume",
}


def misspelt(node: Node, available: Iterable[str]) -> str | None:
    """The name that was misspelt; not for integrators and samplers, whose names are too similar."""
    if not node.plugin or node.kind in ("integrator", "sampler"):
        return None
    names = {*available, *SUBSTITUTES.get(node.kind, {})}
    if node.kind == "bsdf":  # no guess makes a surface with parameters invisible, or lacks what is needed
        names -= {"null"} if node.properties else set()
        names -= set() if node.find("weights") else {"mixturebsdf"}
    return nearest(node.plugin, sorted(names))


def substitute_for(node: Node, available: Iterable[str], nested: Node | None) -> str:
    """The name of an available plugin to use for an unknown one, or DROPPED, or NESTED if there is one."""
    rows = SUBSTITUTES.get(node.kind, {})
    default = OTHERWISE.get(node.kind, DROPPED)
    names = set(available)
    name = rows.get(node.plugin.lower()) or misspelt(node, names) or (NESTED if nested else default)
    name = rows.get(name, name)
    if name is NESTED and nested is not None:
        return "merge" if node.kind == "shape" else NESTED
    if name is DROPPED or name in names:
        return name
    return default if default in names else DROPPED


def for_substitute(node: Node) -> list[Property]:
    """The properties of a plugin that has a substitute, under the names that they have there."""
    plugin = node.plugin.lower()
    if plugin.startswith("prb"):
        return _with_default(node.properties, "max_depth", 6, node)
    if plugin == "pplastic":
        return _with_one_roughness(node)
    if plugin not in ("roughconductorggx", "roughdielectricggx"):
        return node.properties
    properties = node.without(["scattering_order_max"])  # how often light bounces between microfacets
    isotropic = plugin == "roughconductorggx" or node.find("alpha_u") is None
    if isotropic and getattr(node.find("scattering_order_max"), "value", None) != 1:
        properties = _with_default(properties, "multiscatter", True, node)
    colour = node.find("R0")  # of the metal, seen head-on
    if colour is None:
        return properties
    metal = ("R0", "material", "eta", "k", "ext_eta", "specular_reflectance")
    kept = [prop for prop in properties if prop.name not in metal]
    kept.append(replace(colour, name="specular_reflectance"))
    return _with_default(kept, "material", "none", node)


def _with_one_roughness(node: Node) -> list[Property]:
    """`alpha_u` and `alpha_v` as their geometric mean."""
    both = [node.find(name) for name in ("alpha_u", "alpha_v")]
    widths = [prop.value for prop in both if prop is not None and isinstance(prop.value, int | float)]
    if len(widths) < 2 or min(widths) < 0:
        return node.properties
    return _with_default(node.without(["alpha_u", "alpha_v"]), "alpha", math.sqrt(math.prod(widths)), node)


def _with_default(properties: list[Property], name: str, value: Value, node: Node) -> list[Property]:
    if any(prop.name == name for prop in properties):
        return properties
    return [*properties, Property(name, value, node.plugin_location, node.plugin_location)]
