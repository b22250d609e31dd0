"""Sun and sky as an environment map and a distant disk of the core."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from lajolla import _core
from lajolla.colour import luminance

from ...data.sky import (
    SUN_DIAMETER,
    Moment,
    hosek_sun,
    map_height,
    preetham_sun,
    sky_map,
    sun_angles,
)
from ...schema import Field
from ...syntax.errors import SceneError
from ...syntax.nodes import Array, Node, Rgb, Vector
from ..plugin import Context, Entry, Plugin, Values

WIDEST = 8192  # sky; all together have as many pixels as one of these
Entries = list[Entry]

# From an environment map's space, where +y is up, to that of a sky with +z up.
Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
MOMENT = tuple(field.name for field in dataclasses.fields(Moment))


def _sky(context: Context, node: Node, values: Values) -> Entries:
    to_world, sun = _place(context, node, values)
    return [] if sun is None else _sky_light(context, node, values, to_world, sun, values.get("scale", 1.0))


def _sun(context: Context, node: Node, values: Values) -> Entries:
    to_world, sun = _place(context, node, values)
    return [] if sun is None else _sun_light(values, to_world, sun, values.get("scale", 1.0))


def _sun_and_sky(context: Context, node: Node, values: Values) -> Entries:
    to_world, sun = _place(context, node, values)
    if sun is None:
        return []
    scale: float = values.get("scale", 1.0)
    return [
        *_sky_light(context, node, values, to_world, sun, values.get("sky_scale", scale)),
        *_sun_light(values, to_world, sun, values.get("sun_scale", scale)),
    ]


def _place(context: Context, node: Node, values: Values) -> tuple[Array, Array | None]:
    """The transform from the map's space to the world, and the map's direction of the sun; None at night."""
    z_up = values.get("up", "z") == "z"
    to_world = values.get("to_world", np.eye(4)) @ (Z_UP if z_up else np.eye(4))
    if "sun_direction" in values:
        if any(name in values for name in MOMENT):
            context.diagnostics.warn(
                '"sun_direction" and a time are both given; the direction is used',
                node.property_location("sun_direction"),
            )
        sun = np.linalg.pinv(to_world[:3, :3]) @ np.array(values["sun_direction"], float)
        if not np.linalg.norm(sun) > 0:
            raise SceneError(f"{node} has no direction to the sun", node.property_location("sun_direction"))
        sun /= np.linalg.norm(sun)
    else:
        zenith, azimuth = sun_angles(Moment(**{name: values[name] for name in MOMENT if name in values}))
        north = np.array([-1.0, 0, 0]) if z_up else np.array([0, 0, -1.0])
        east = np.array([0, 0, 1.0]) if z_up else np.array([1.0, 0, 0])
        around = math.cos(azimuth) * north + math.sin(azimuth) * east
        sun = math.sin(zenith) * around + np.array([0, math.cos(zenith), 0])
    if sun[1] < 0:
        context.diagnostics.warn("the sun is below the horizon, and emits no light", node.location)
        return to_world, None
    return to_world, sun


def _sky_light(
    context: Context, node: Node, values: Values, to_world: Array, sun: Array, scale: float
) -> Entries:
    if scale == 0:
        return []
    width = values.get("resolution", 512)
    context.sky_pixels += width * map_height(width)
    most = WIDEST * map_height(WIDEST)
    if context.sky_pixels > most:
        raise SceneError(f"the sky images of the scene have more than {most:,} pixels", node.location)
    pixels, end = sky_map(
        sun,
        values.get("turbidity", 3.0),
        np.array(values.get("albedo", (0.3,) * 3)),
        width,
        stretch=values.get("stretch", 1.0),
        extend=values.get("extend", False),
    )
    image = _core.Image(pixels, srgb=False)
    entry = {"type": "envmap", "image": image, "theta_max": end, "scale": scale, "to_world": to_world}
    return [entry | _visibility(values)]


def _sun_light(values: Values, to_world: Array, sun: Array, scale: float) -> Entries:
    """The sun as a light with the irradiance of the real sun, independent of the size of its disk."""
    model = preetham_sun if values.get("sun_model") == "preetham" else hosek_sun
    elevation, turbidity = math.asin(min(1.0, float(sun[1]))), values.get("turbidity", 3.0)
    solid_angle = 2 * math.pi * (1 - math.cos(math.radians(SUN_DIAMETER / 2)))
    flux = model(elevation, turbidity) * solid_angle * scale
    if not flux.any():
        return []
    drawn = min(math.pi / 2 - elevation, math.pi) * values.get("stretch", 1.0)  # the zenith angle shown
    level = np.array([sun[0], 0, sun[2]])
    length = np.linalg.norm(level)
    side = level / length if length > 0 else level
    towards = to_world[:3, :3] @ (math.sin(drawn) * side + np.array([0, math.cos(drawn), 0]))
    direction = tuple(float(-v) for v in towards)
    angle = min(_diameter(values), 179.0)
    if angle < 0.01:  # as good as parallel
        return [{"type": "directional", "direction": direction, "irradiance": tuple(map(float, flux))}]
    # Light from the rim arrives at a slant: the mean cosine over the disk.
    irradiance = flux * (1 + math.cos(math.radians(angle / 2))) / 2
    return [
        {
            "type": "distantdisk",
            "direction": direction,
            "irradiance": tuple(map(float, irradiance)),
            "angle": angle,
            **_visibility(values),
        }
    ]


def _visibility(values: Values) -> Entry:
    name = VISIBLE.name
    return {name: values[name]} if name in values else {}


def for_mitsuba3(context: Context, node: Node, values: Values) -> Entry | None:
    """The properties of the equivalent `sunsky` of Mitsuba 3; None at night."""
    to_world, sun = _place(context, node, values)
    if sun is None:
        return None
    scale: float = values.get("scale", 1.0)
    sun_scale: float = values.get("sun_scale", scale)
    turbidity, elevation = values.get("turbidity", 3.0), math.asin(sun[1])
    if values.get("sun_model") == "preetham":
        old, new = (model(elevation, turbidity) for model in (preetham_sun, hosek_sun))
        as_bright = float(luminance(old)[0] / max(luminance(new)[0], 1e-30))
        sun_scale *= as_bright
        if sun_scale > 0 and node.plugin != "sky":
            changes = (f"{v:+.0%}" for v in as_bright * new / np.maximum(old, 1e-30) - 1)
            more_red, more_green, more_blue = changes
            context.diagnostics.warn(
                f"Mitsuba 3 uses another model of the sun, scaled to the same luminance: "
                f"red {more_red}, green {more_green}, blue {more_blue}",
                node.location,
            )
    x, y, z = (to_world[:3, :3] @ sun).tolist()
    red, green, blue = values.get("albedo", (0.3,) * 3)
    return {
        "to_world": to_world @ np.linalg.inv(Z_UP),
        "sun_direction": Vector((x, y, z)),
        "turbidity": turbidity,
        "albedo": Rgb((red, green, blue)),
        "sun_scale": 0.0 if node.plugin == "sky" else sun_scale,
        "sky_scale": 0.0 if node.plugin == "sun" else values.get("sky_scale", scale),
        "sun_aperture": min(max(_diameter(values), 0.01), 179.0),
    }


def _diameter(values: Values) -> float:
    return float(values.get("sun_aperture", SUN_DIAMETER) * values.get("sun_radius_scale", 1.0))


VISIBLE = Field(
    "visible_to_camera", "boolean", "if not, it lights and is reflected, but is no background", True
)
COMMON = (
    Field("to_world", "transform", "orientation in the scene"),
    Field("turbidity", "float", "haze: 2 is an arctic day, 10 a humid one", 3.0, 1.0, 10.0),
    Field("sun_direction", "vector", "towards the sun, in the scene; otherwise its place is that of a time"),
    Field("year", "integer", "of the date", 2010, 1, 9999),
    Field("month", "integer", "of the date", 7, 1, 12),
    Field("day", "integer", "of the date", 10, 1, 31),
    Field("hour", "float", "on the clock", 15.0, 0.0, 24.0),
    Field("minute", "float", "on the clock", 0.0, 0.0, 60.0),
    Field("second", "float", "on the clock", 0.0, 0.0, 60.0),
    Field("latitude", "float", "north of the equator", 35.6894, -90.0, 90.0, "degrees"),
    Field("longitude", "float", "east of Greenwich", 139.6917, -360.0, 360.0, "degrees"),
    Field("timezone", "float", "by which the clock is ahead of universal time", 9.0, -24.0, 24.0, "hours"),
    Field(
        "stretch", "float", "stretches the sky below the horizon: 1 not at all, 2 to the nadir", 1.0, 1.0, 2.0
    ),
    Field("scale", "float", "factor on the light", 1.0, 0.0),
    Field("up", "choice", "the axis towards the zenith, before to_world", "z", choices=("y", "z")),
    VISIBLE,
)
SKY = (
    Field("albedo", "spectrum", "of the ground", 0.3, 0.0, 1.0),
    Field("resolution", "integer", "width of the image of the sky", 512, 4, WIDEST, "pixels"),
    Field("extend", "boolean", "extend the sky below the horizon", False),
)
SUN = (
    Field("sun_aperture", "float", "angle of the sun's diameter", SUN_DIAMETER, 0.0, 179.0, "degrees"),
    Field("sun_radius_scale", "float", "factor on the sun's size, not on its light", 1.0, 0.0, 1e4),
    Field("sun_model", "choice", "model of the sun's radiance", "hosek", choices=("hosek", "preetham")),
)
SCALES = (
    Field("sun_scale", "float", "factor on the sun, instead of scale", 1.0, 0.0),
    Field("sky_scale", "float", "factor on the sky, instead of scale", 1.0, 0.0),
)

PLUGINS = (
    Plugin("emitter", "sky", "A clear sky, without the sun.", (*COMMON, *SKY), _sky),
    Plugin("emitter", "sun", "The sun, without the sky.", (*COMMON, *SUN), _sun),
    Plugin("emitter", "sunsky", "Sun and sky.", (*COMMON, *SKY, *SUN, *SCALES), _sun_and_sky),
)
