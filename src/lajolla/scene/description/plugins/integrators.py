"""Integrators with other names, and those with several outputs."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace

from ...schema import Field
from ...syntax.errors import SceneError, did_you_mean
from ...syntax.nodes import Node
from ..outputs import Channel, Picture, colours
from ..plugin import Context, Entry, Plugin, Values

# The letters of the channels of each variable, as in Mitsuba 3 if it has the variable.
VARIABLES = {
    "albedo": "RGB",
    "depth": "T",
    "position": "XYZ",
    "uv": "UV",
    "geo_normal": "XYZ",
    "sh_normal": "XYZ",
    "dp_du": "XYZ",
    "dp_dv": "XYZ",
    "duv_dx": "UV",
    "duv_dy": "UV",
    "prim_index": "I",
    "shape_index": "I",
    "rel_position": "XYZ",
    "mean_curvature": "C",
    "ray_cone": "RS",
    "mip_level": "L",
}


def _direct(context: Context, node: Node, values: Values) -> Entry:
    both = values.pop("shading_samples", None)
    if both is not None:
        other = node.find("emitter_samples") or node.find("bsdf_samples")
        if other is not None:
            raise SceneError(f'give either "shading_samples" or "{other.name}"', other.name_location)
        values |= {"emitter_samples": both, "bsdf_samples": both}
    return {"type": "direct", **values}


def _volpath(context: Context, node: Node, values: Values) -> Entry:
    return {"type": "volpath", **values}


def _parts(context: Context, node: Node) -> Iterator[tuple[str, Picture]]:
    """The integrators inside, with their names: those without are numbered as in Mitsuba 3."""
    unnamed = 0
    for prop, child in node.children("integrator"):
        name = prop.name
        if not name:
            name, unnamed = f"_arg_{unnamed}", unnamed + 1
        yield name, context.picture(child)


def _aov(context: Context, node: Node, values: Values) -> Picture:
    """Mitsuba 3's; where the film has no alpha channel, those of the integrators inside are 1."""
    channels: list[Channel] = []
    entries = []
    alpha = "alpha" if context.film.has_alpha else "one"
    for name, part in _parts(context, node):
        entries.append(part.entry)
        channels += [*colours(name, part.entry), Channel(f"{name}.A", part.entry, alpha)]
        channels += [channel.within(name) for channel in part.channels]
    for name, variable in _variables(node):
        entry = {"type": "field", "field": variable}
        entries.append(entry)
        letters = VARIABLES[variable]
        channels += [Channel(f"{name}.{letter}", entry, component=i) for i, letter in enumerate(letters)]
    if not entries:
        raise SceneError(f'{node} needs "aovs" or an integrator inside', node.location)
    return Picture(entries[0], tuple(channels))


def _variables(node: Node) -> Iterator[tuple[str, str]]:
    """Names and variables of `aovs`."""
    prop = node.find("aovs")
    if prop is None:
        return
    for item in re.split(r"[,\s]+", str(prop.value).strip(", \t\r\n")):
        name, colon, variable = item.partition(":")
        if not item:
            continue
        if not colon or not name:
            raise SceneError(f'"{item}" is not NAME:VARIABLE, such as "normals:sh_normal"', prop.location)
        if variable not in VARIABLES:
            hint = did_you_mean(variable, VARIABLES)
            raise SceneError(f'unknown variable "{variable}"{hint}', prop.location)
        yield name, variable


def _moment(context: Context, node: Node, values: Values) -> Picture:
    """Mitsuba 3's: mean X, Y and Z of each integrator, then the means of the squares of all channels."""
    channels: list[Channel] = []
    entries = []
    for name, part in _parts(context, node):
        entries.append(part.entry)
        channels += [channel.within(name) for channel in part.channels]
        channels += colours(name, part.entry, "xyz")
    if not entries:
        raise SceneError(f"{node} needs an integrator inside", node.location)
    squares = [replace(channel, label=f"m2_{channel.label}", squared=True) for channel in channels]
    return Picture(entries[0], (*channels, *squares))


def _multichannel(context: Context, node: Node, values: Values) -> Picture:
    """Mitsuba 0.6's: each integrator in the pixel format, and with the name, that the film has for it."""
    channels: list[Channel] = []
    entries = []
    for index, (name, part) in enumerate(_parts(context, node)):
        entries.append(part.entry)
        given = context.layers[index] if index < len(context.layers) else None
        names = "RGB" if given is None else given.film.names
        prefix = name if given is None else given.name
        channels += [_component(prefix, part.entry, letter) for letter in names]
        channels += [channel.within(prefix) for channel in part.channels]
    if not entries:
        raise SceneError(f"{node} needs an integrator inside", node.location)
    return Picture(entries[0], tuple(channels))


def _component(name: str, entry: Entry, letter: str) -> Channel:
    label = f"{name}.{letter}"
    if letter == "A":
        return Channel(label, entry, "alpha")
    recorded = "rgb" if letter in "RGB" else "xyz"
    return Channel(label, entry, recorded, "RGB".find(letter) if letter in "RGB" else "XYZ".find(letter))


def _view(variable: str) -> Callable[[Context, Node, Values], Entry]:
    return lambda context, node, values: {"type": "field", "field": variable}


VIEWS = (
    ("depth", "depth", "Distance from the camera; 0 without a hit."),
    ("shadingNormal", "sh_normal", "Shading normals in world space."),
    (
        "meanCurvature",
        "mean_curvature",
        "Mean curvature of the smooth surface that shading normals describe; 1/r on a sphere.",
    ),
    (
        "rayDifferential",
        "ray_cone",
        "Radius (red) and spread (green) of the pixel's ray cone where it meets a surface.",
    ),
    (
        "mipmapLevel",
        "mip_level",
        "MIP level at which the surface's bitmap would be read; 0 where it has none.",
    ),
)
INNER = ("integrator",)

PLUGINS = (
    Plugin(
        "integrator",
        "direct",
        "",
        (
            Field(
                "shading_samples", "integer", "instead of both: emitter_samples and bsdf_samples", 1, 1, 65536
            ),
        ),
        _direct,
        model="direct",
    ),
    *(Plugin("integrator", name, doc, (), _view(variable)) for name, variable, doc in VIEWS),
    Plugin(
        "integrator",
        "aov",
        "Variables of the first surface in channels of their own, beside the integrators inside.",
        (
            Field(
                "aovs",
                "string",
                f"NAME:VARIABLE, ... of {', '.join(VARIABLES)}; the picture is that of the first integrator "
                "inside, or shows the first variable",
                "",
            ),
        ),
        _aov,
        INNER,
    ),
    Plugin(
        "integrator",
        "moment",
        "The picture of the integrator inside; in more channels X, Y, Z and the means of their squares.",
        (),
        _moment,
        INNER,
    ),
    Plugin(
        "integrator",
        "multichannel",
        "Several integrators at once, in channels with the film's channel_names.",
        (),
        _multichannel,
        INNER,
    ),
    Plugin("integrator", "volpathmis", "The same as volpath.", (), _volpath, model="volpath"),
    Plugin("integrator", "volpath_simple", "The same as volpath.", (), _volpath, model="volpath"),
)
