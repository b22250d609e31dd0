"""AOVs ("arbitrary output variables"): what can be rendered beside the picture. Does not import the renderer.

Channels are named LAYER.LETTER, and the letters decide how programs show a layer. Nuke, Blender and tev take
R, G, B as a colour, x, y, z as a vector, U, V as coordinates and Z as depth. The letters of vectors are small
because OpenEXR's DWA compression takes every channel whose name ends in R, G, B or Y for a colour, and is
not exact there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lajolla.limits import OptionError
from lajolla.messages import suggestion

CRYPTOMATTE = "crypto_"
RANKS = 6  # objects per pixel in a Cryptomatte; two make a layer of four channels


@dataclass(frozen=True)
class Variable:
    """A variable: its documentation, and how it is computed.

    It is a `field` of the core's integrator of that name, with the channels `letters`; or it belongs to
    objects of a `kind`.
    """

    doc: str
    field: str = ""
    letters: str = ""
    kind: str = ""


AOVS: dict[str, Variable] = {
    "albedo": Variable("diffuse colour, or the brightness of other materials", "albedo", "RGB"),
    "normal": Variable("shading normal in world space, with bump and normal maps", "sh_normal", "xyz"),
    "geo_normal": Variable("geometric normal in world space", "geo_normal", "xyz"),
    "depth": Variable("distance from the camera along the ray, in scene units", "depth", "Z"),
    "position": Variable("position in world space", "position", "xyz"),
    "rel_position": Variable("position in the camera's space; z is the planar depth", "rel_position", "xyz"),
    "uv": Variable("texture coordinates", "uv", "UV"),
    "dp_du": Variable("derivative of the position by u", "dp_du", "xyz"),
    "dp_dv": Variable("derivative of the position by v", "dp_dv", "xyz"),
    "duv_dx": Variable("change of uv from one pixel to the next on the right", "duv_dx", "UV"),
    "duv_dy": Variable("change of uv from one pixel to the next below", "duv_dy", "UV"),
    "mean_curvature": Variable("mean curvature of the smooth surface", "mean_curvature", "C"),
    "alpha": Variable("alpha channel of the picture"),
    "samples": Variable("number of samples of the pixel"),
    "variance": Variable("variance of the pixel's mean, for red, green and blue"),
    "lightgroups": Variable("light by the lightgroup of emitters: a layer for each, and one for the rest"),
    "shape": Variable("number of the shape at the pixel's centre, from 1; 0 for none", kind="shape"),
    "material": Variable("number of its material, from 1; 0 for none", kind="material"),
    "instance": Variable("number of the instance that it is in, from 1; 0 for none", kind="instance"),
    "primitive": Variable("number of the triangle, face, or the like, in its shape, from 0; -1 for none"),
    "crypto_shape": Variable("Cryptomatte of the shapes", kind="shape"),
    "crypto_material": Variable("Cryptomatte of the materials", kind="material"),
    "crypto_instance": Variable("Cryptomatte of the instances", kind="instance"),
}
ALPHA, SAMPLES, VARIANCE = "alpha", "samples", "variance"
LIGHTGROUPS, PRIMITIVE = "lightgroups", "primitive"
WITH_GROUPS = ("path", "volpath", "direct")  # integrators that know which light they see
IDS = ("shape", "material", "instance", PRIMITIVE)


def is_matte(aov: str) -> bool:
    return aov.startswith(CRYPTOMATTE)


def check_aovs(aovs: object) -> tuple[str, ...]:
    """The names of variables without duplicates. Raises OptionError for unknown ones."""
    if isinstance(aovs, str) or not isinstance(aovs, Iterable):
        raise OptionError(f'aovs is a list of names, such as ["albedo", "normal"], not {aovs!r}')
    names = list(dict.fromkeys(aovs))
    for name in names:
        if name not in AOVS:
            raise OptionError(f"unknown aov {name!r}{suggestion(str(name), AOVS)}")
    return tuple(names)


def object_layers(aovs: Sequence[str]) -> list[str]:
    """Those that are not rendered by samples, but afterwards: ids and mattes."""
    return [aov for aov in aovs if is_matte(aov) or aov in IDS]


def object_channels(aovs: Sequence[str]) -> int:
    """The number of their channels."""
    return sum(2 * RANKS if is_matte(aov) else 1 for aov in object_layers(aovs))


def with_aovs(
    core: Mapping[str, Any], aovs: Sequence[str], light_groups: Sequence[str] = ()
) -> dict[str, Any]:
    """A description that also renders these variables.

    Raises OptionError if the scene has such channels, or has no light groups (or its integrator does not).
    """
    others, channels = list(core.get("other_integrators", ())), list(core.get("channels", ()))
    through_lights = core["integrator"].get("hide_emitters", False)
    for aov in aovs:
        variable = AOVS[aov]
        if aov == ALPHA and all(channel["label"] != "A" for channel in channels):
            channels.insert(0, {"label": "A", "recorded": "alpha"})
        elif aov == VARIANCE:
            channels += _components(aov, "RGB", source=0, squared=True, weighted=True)
        elif aov == LIGHTGROUPS:
            _check_groups(core, light_groups)
            for number, name in enumerate(("rest", *light_groups)):
                channels += _components(f"lightgroup_{name}", "RGB", source=0, light_group=number)
        elif variable.field:
            entry = {"type": "field", "field": variable.field, "see_through": True}
            others.append(entry | {"through_lights": through_lights})
            channels += _components(aov, variable.letters, source=len(others))
    labels = [channel["label"] for channel in channels]
    for label in labels:
        if labels.count(label) > 1:
            raise OptionError(f"the scene has a channel {label!r} itself; it cannot be an aov too")
    return {**core, "other_integrators": others, "channels": channels}


def _check_groups(core: Mapping[str, Any], light_groups: Sequence[str]) -> None:
    if not light_groups:
        raise OptionError("no emitter of the scene has a lightgroup")
    if core["integrator"]["type"] not in WITH_GROUPS:
        raise OptionError(f"the integrator {core['integrator']['type']!r} has no light groups")


def _components(name: str, letters: str, **values: object) -> list[dict[str, Any]]:
    return [{"label": f"{name}.{letter}", "component": i, **values} for i, letter in enumerate(letters)]
