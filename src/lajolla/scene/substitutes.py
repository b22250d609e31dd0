"""What stands in for plugins that the renderer does not have."""

from __future__ import annotations

from collections.abc import Iterable

from .errors import nearest
from .nodes import Node

DROPPED = "<dropped>"
NESTED = "<nested>"  # the first child of the same kind

# Plugin names of Mitsuba 0.4 to 3 and of lajolla, in lower case, with the nearest in effect. Where there is a
# plugin of that name, its row is not asked.
SUBSTITUTES = {
    "bsdf": {
        "hk": "diffuse",
        "irawan": "diffuse",
        "roughconductorggx": "roughconductor",
        "roughdielectricggx": "roughdielectric",
    },
    "integrator": {
        "adaptive": NESTED,
        "irrcache": NESTED,
    },
    "film": {"specfilm": "hdrfilm"},
    "sampler": {"independent": "independent"},
    "phase": {"kkay": "isotropic", "microflake": "isotropic", "mixturephase": NESTED},
    "volume": {"volcache": NESTED, "grid": "gridvolume", "const": "constvolume"},
    "shape": {"mesh": DROPPED, "ellipsoids": DROPPED, "ellipsoidsmesh": DROPPED, "deformable": DROPPED},
}

# For names that are nowhere, when none that is known looks alike.
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
    """The name that an unknown one is taken for; integrators and samplers have names that only look alike."""
    if not node.plugin or node.kind in ("integrator", "sampler"):
        return None
    return nearest(node.plugin, [*available, *SUBSTITUTES.get(node.kind, {})])


def substitute_for(node: Node, available: Iterable[str], nested: Node | None) -> str:
    """The name of an available plugin to use for an unknown one, or DROPPED, or NESTED if there is one."""
    rows = SUBSTITUTES.get(node.kind, {})
    default = OTHERWISE.get(node.kind, DROPPED)
    names = set(available)
    name = rows.get(node.plugin.lower()) or misspelt(node, names) or default
    name = rows.get(name, name)
    if name is DROPPED or name in names or (name is NESTED and nested is not None):
        return name
    return default if default in names else DROPPED
