"""What Mitsuba 3 has under its own name, what comes nearest to the rest, and what needs more than a name."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from ..description.plugins.daylight import for_mitsuba3
from ..description.plugins.volumes import hierarchical_voxels, load_voxels
from ..formats.voxels import vol_bytes
from ..syntax.nodes import Node, Property, Rgb, Value
from .translation import Translation

# The plugins that are written under their own name.
HAS = {
    "integrator": "path direct volpath volpathmis ptracer depth aov moment",
    "sensor": "perspective thinlens orthographic distant radiancemeter irradiancemeter",
    "film": "hdrfilm",
    "rfilter": "box tent gaussian mitchell catmullrom lanczos",
    "sampler": "independent stratified multijitter orthogonal ldsampler",
    "bsdf": "diffuse dielectric thindielectric roughdielectric conductor roughconductor plastic roughplastic "
    "twosided mask bumpmap normalmap blendbsdf null principled principledthin hair measured "
    "polarizer retarder circular",
    "texture": "bitmap checkerboard mesh_attribute",
    "emitter": "area point constant envmap spot directional projector sunsky",
    "shape": "obj ply serialized sphere rectangle disk cylinder cube shapegroup instance sdfgrid "
    "bsplinecurve linearcurve",
    "medium": "homogeneous heterogeneous",
    "phase": "isotropic hg rayleigh blendphase tabphase sggx",
    "volume": "constvolume gridvolume",
}
# What is written for those that it lacks; nothing for the rest.
NEAREST = {
    ("integrator", "volpath_simple"): "volpath",
    ("bsdf", "phong"): "roughplastic",
    ("bsdf", "ward"): "roughplastic",
    ("bsdf", "disneybsdf"): "principled",
    ("bsdf", "disneyglass"): "principled",
    ("bsdf", "disneymetal"): "principled",
    ("sensor", "telecentric"): "orthographic",
}
OTHERWISE = {
    "integrator": "path",
    "sampler": "independent",
    "sensor": "perspective",
    "film": "hdrfilm",
    "bsdf": "diffuse",
    "phase": "isotropic",
}
# What Mitsuba 3 insists on, and we have a default for.
REQUIRED = {
    ("sensor", "thinlens"): ("aperture_radius",),
    ("bsdf", "blendbsdf"): ("weight",),
    ("phase", "blendphase"): ("weight",),
    ("phase", "tabphase"): ("values",),
    ("texture", "mesh_attribute"): ("name",),
}


def like(node: Node, plugin: str) -> Node:
    return replace(node, plugin=plugin, properties=[])


def having(node: Node, **values: Value) -> Node:
    """The node with these properties in place of those of the same name."""
    properties = [
        *node.without(values),
        *(Property(name, value, node.location, node.location) for name, value in values.items()),
    ]
    return Node(node.kind, node.plugin, node.location, node.plugin_location, node.id, properties)


def having_bsdf(shape: Node, bsdf: Node | None) -> Node:
    """The shape with this bsdf alone."""
    kept = [p for p in shape.properties if not (isinstance(p.value, Node) and p.value.kind == "bsdf")]
    result = Node(shape.kind, shape.plugin, shape.location, shape.plugin_location, "", kept)
    return holding(result, bsdf) if bsdf else result


def with_boundary(shape: Node) -> Node:
    """A shape around a medium without a bsdf, with the one that the version of its file implies."""
    if shape.unsaid.boundary == "diffuse" or not any(shape.children("medium")) or any(shape.children("bsdf")):
        return shape
    return holding(shape, Node("bsdf", shape.unsaid.boundary, shape.location, shape.location))


def _renamed(node: Node, plugin: str, *without: str, **values: Value) -> Node:
    result = having(node, **values)
    result.plugin = plugin
    result.properties = result.without(without)
    return result


# What needs more than its own name: each takes the node as it was read and as
# translated property by property, and gives the one to write.


def _map(translation: Translation, read: Node, node: Node) -> Node | None:
    """The texture under Mitsuba's name; our reader accepts any name, or none."""
    name = "normalmap" if node.plugin == "normalmap" else "map"
    textures = [child for _, child in node.children("texture")]
    given = textures[0] if textures else getattr(node.find(name), "value", None)
    inner = next((child for _, child in node.children("bsdf")), None)
    if given is None or (name == "map" and not isinstance(given, Node)):
        return inner
    if name == "map" and given.plugin != "bitmap":
        translation.warn(node, f"Mitsuba 3 knows no slope of the {given} in {node}; its bumps are left out")
        return inner
    kept = [p for p in node.properties if not (isinstance(p.value, Node) and p.value.kind == "texture")]
    plain = Node(node.kind, node.plugin, node.location, node.plugin_location, node.id, kept)
    return having(plain, **{name: given})


def _two_sided(translation: Translation, read: Node, node: Node) -> Node | None:
    """Omits `twosided` around transmissive bsdfs."""
    builder = translation.builder
    slots = [builder.slot(child) for _, child in read.children("bsdf")]
    if any(slot and builder.lets_light_through(slot.front) for slot in slots[:2]):
        return next((child for _, child in node.children("bsdf")), None)
    return node


def _mixture(translation: Translation, read: Node, node: Node) -> Node | None:
    """A weighted sum of bsdfs as nested blends; the remaining weight is black."""
    weights = _numbers(node, "weights")
    parts = [part for _, part in node.children("bsdf")][: len(weights)]
    total = max(1.0, sum(weights))
    black = having(Node("bsdf", "diffuse", node.location, node.location), reflectance=Rgb((0.0,) * 3))
    result, covered = black, 1 - sum(weights[: len(parts)]) / total
    for part, weight in reversed(list(zip(parts, weights, strict=False))):
        covered += weight / total
        share = weight / total / covered if covered > 0 else 0.0
        pair = Node("bsdf", "blendbsdf", node.location, node.location)
        result = part if share > 1 - 1e-6 else holding(having(pair, weight=share), result, part)
    return named(result, node.id)


def _numbers(node: Node, name: str) -> list[float]:
    return [float(word) for word in str(getattr(node.find(name), "value", "")).replace(",", " ").split()]


def holding(node: Node, *children: Value, name: str = "") -> Node:
    """The node itself, with these children added to it."""
    node.properties += [Property(name, child, node.location, node.location) for child in children]
    return node


def named(node: Node, name: str) -> Node:
    """The node with this id, unless it already has one."""
    if node.id or not name:
        return node
    return Node(node.kind, node.plugin, node.location, node.plugin_location, name, node.properties)


def _inner(translation: Translation, read: Node, node: Node) -> Node | None:
    nested = next((child for _, child in node.children(node.kind)), None)
    translation.replaced(node, f"the {nested} inside it is written" if nested else "it is ignored")
    return nested


def _rough(translation: Translation, read: Node, node: Node) -> Node:
    """`roughness` is the square root of alpha; Mitsuba wants both of `alpha_u` and `alpha_v` or none."""
    roughness = node.find("roughness")
    if roughness is not None and isinstance(roughness.value, int | float):
        node = _renamed(node, node.plugin, "roughness", alpha=float(roughness.value) ** 2)
    elif roughness is not None:
        translation.lose("roughness")
        node = _renamed(node, node.plugin, "roughness")
    pair = [node.find(name) for name in ("alpha_u", "alpha_v")]
    if not any(pair):
        return node
    both = getattr(node.find("alpha"), "value", 0.1)
    u, v = (both if prop is None else prop.value for prop in pair)
    return _renamed(node, node.plugin, "alpha", alpha_u=u, alpha_v=v)


def _conductor(translation: Translation, read: Node, node: Node) -> Node:
    """Indices of refraction relative to what is around the metal."""
    node = _rough(translation, read, node)
    outside = getattr(node.find("ext_eta"), "value", 1.0)
    numbers = node.find("eta") or node.find("k")
    if outside == 1:
        return _renamed(node, node.plugin, "ext_eta", *(["material"] if numbers else []))
    entry = translation.entry(read)
    relative = {name: Rgb(entry[name]) for name in ("eta", "k") if isinstance(entry[name], tuple)}
    return _renamed(node, node.plugin, "ext_eta", "material", **relative)


def _phong(translation: Translation, read: Node, node: Node) -> Node | None:
    """The width of the lobe as Walter et al. 2007 relate the two, section 5.2."""
    exponent = getattr(node.find("exponent"), "value", 30.0)
    if not isinstance(exponent, int | float):
        return translation.nearest(having(node, alpha=0.25))
    return translation.nearest(_renamed(node, node.plugin, "exponent", alpha=math.sqrt(2 / (exponent + 2))))


def _ward(translation: Translation, read: Node, node: Node) -> Node | None:
    node = _rough(translation, read, node)
    both = getattr(node.find("alpha"), "value", 0.1)
    alphas = [getattr(node.find(name), "value", both) for name in ("alpha_u", "alpha_v")]
    known = [float(alpha) for alpha in alphas if isinstance(alpha, int | float)]
    width = float(np.mean(known or [0.1]))
    return translation.nearest(_renamed(node, node.plugin, "alpha_u", "alpha_v", alpha=width))


def _hair(translation: Translation, read: Node, node: Node) -> Node:
    """A colour as the absorption that makes it."""
    if node.find("color") is None:
        return node
    absorption = translation.entry(read)["sigma_a"]
    return _renamed(node, node.plugin, "color", sigma_a=Rgb(absorption))


DISNEY_NAMES = {
    "specular_transmission": "spec_trans",
    "specular_tint": "spec_tint",
    "subsurface": "flatness",
}


def _disney(translation: Translation, read: Node, node: Node) -> Node | None:
    """Mitsuba 3's model of the same family."""
    whole = {"disneymetal": {"metallic": 1.0}, "disneyglass": {"spec_trans": 1.0}}.get(node.plugin, {})
    eta = translation.entry(read).get("eta", 1.5)
    known = {DISNEY_NAMES.get(p.name, p.name): p.value for p in node.properties if p.name != "specular"}
    empty = Node(node.kind, node.plugin, node.location, node.plugin_location, node.id)
    return translation.nearest(having(empty, **(known | whole | {"eta": eta})))


def _disney_diffuse(translation: Translation, read: Node, node: Node) -> Node | None:
    color = node.find("base_color")
    if color is None:
        return translation.nearest(node)
    return translation.nearest(_renamed(node, node.plugin, "base_color", reflectance=color.value))


def _bitmap(translation: Translation, read: Node, node: Node) -> Node:
    """An image; encodings and channels that Mitsuba 3 does not know are written out as linear values."""
    filter_type = getattr(node.find("filter_type"), "value", "bilinear")
    result = having(node, filter_type="nearest" if filter_type == "nearest" else "bilinear")
    if getattr(node.find("wrap_mode"), "value", "") in ("zero", "one"):
        translation.warn(node, f"Mitsuba 3 does not support this wrap mode of {node}; its border is repeated")
        result = having(result, wrap_mode="clamp")
    gamma, channel = getattr(node.find("gamma"), "value", -1.0), getattr(node.find("channel"), "value", "")
    result.properties = result.without(("gamma", "channel", "max_anisotropy"))
    gamma = 1.0 if getattr(node.find("raw"), "value", False) else gamma
    if channel or (gamma > 0 and gamma != 1):
        return having(result, raw=False, filename=translation.linear_image(node, gamma, channel))
    return having(result, raw=True) if gamma == 1 else result


def _checkerboard(translation: Translation, read: Node, node: Node) -> Node:
    """Colours of textures end at one."""
    for name in ("color0", "color1"):
        value = getattr(node.find(name), "value", None)
        if isinstance(value, Rgb) and max(value.values) > 1:
            translation.warn(node, f'"{name}" of {node} is above 1, where Mitsuba 3 ends, and clamped')
            red, green, blue = (min(v, 1.0) for v in value.values)
            node = having(node, **{name: Rgb((red, green, blue))})
    return node


def _vertex_colors(translation: Translation, read: Node, node: Node) -> Node:
    return _renamed(node, "mesh_attribute", name="vertex_color")


def _sensor(translation: Translation, read: Node, node: Node) -> Node | None:
    """Mitsuba 3 takes no scale in a camera's placement, but for the size of a view without perspective."""
    place = node.find("to_world")
    if place is not None and node.plugin in ("perspective", "thinlens"):
        matrix = np.array(place.value, dtype=np.float64)
        sizes = np.linalg.norm(matrix[:3, :3], axis=0)
        if np.ptp(sizes) > 1e-3 * sizes.max():
            translation.warn(node, f"Mitsuba 3 does not stretch what a {node} sees: its scale is left out")
        matrix[:3, :3] /= sizes
        node = having(node, to_world=matrix)
    if node.find("fov") is None:
        node.properties = node.without(["fov_axis"])
    if node.plugin == "thinlens":
        node = _without(translation, node, "principal_point_offset_x", "principal_point_offset_y")
    return node if node.plugin in HAS["sensor"].split() else translation.nearest(node)


def _without(translation: Translation, node: Node, *names: str) -> Node:
    """The node without properties that Mitsuba 3 does not support, with a warning."""
    translation.lose(*(name for name in names if node.find(name) is not None))
    return _renamed(node, node.plugin, *names)


def _one_pixel(translation: Translation, read: Node, node: Node) -> Node:
    """Sensors that measure one value."""
    if node.plugin == "radiancemeter" and node.find("to_world") is None:
        node = _renamed(node, node.plugin, "origin", "direction", **_place(translation, read))
    films = [film for _, film in node.children("film")] or [
        Node("film", "hdrfilm", node.location, node.location)
    ]
    sizes = [getattr(film.find(name), "value", 1) for film in films for name in ("width", "height")]
    if any(size != 1 for size in sizes):
        translation.warn(node, f"the film of a {node} of Mitsuba 3 has one pixel; its size is left out")
    small = [having(like(film, film.plugin), width=1, height=1) for film in films]
    filters = [prop for film in films for prop, _ in film.children("rfilter")]
    small[0].properties += filters
    kept = [p for p in node.properties if not (isinstance(p.value, Node) and p.value.kind == "film")]
    return holding(Node("sensor", node.plugin, node.location, node.plugin_location, node.id, kept), *small)


def _place(translation: Translation, read: Node) -> dict[str, Value]:
    """`to_world`, of which Mitsuba takes no half."""
    entry = translation.entry(read)
    return {"to_world": entry["to_world"]} if "to_world" in entry else {}


SIZES = ("width", "height", "crop_offset_x", "crop_offset_y", "crop_width", "crop_height", "sample_border")
FORMATS = ("file_format", "component_format", "pixel_format")
LOOKS = ("tonemap_method", "gamma", "exposure", "key", "burn", "digits", "channel_names")


def _film(translation: Translation, read: Node, node: Node) -> Node:
    pixel_format = str(getattr(node.find("pixel_format"), "value", "")).strip().lower()
    own = node.plugin in ("hdrfilm", "tiledhdrfilm") and pixel_format in ("", *PIXEL_FORMATS)
    known = SIZES + (FORMATS if own else ())
    translation.lose(*(name for name in LOOKS if node.find(name) is not None))
    kept = [p for p in node.properties if p.name in known or isinstance(p.value, Node)]
    film = Node("film", "hdrfilm", node.location, node.plugin_location, node.id, kept)
    for size, begin, width in (
        ("crop_width", "crop_offset_x", "width"),
        ("crop_height", "crop_offset_y", "height"),
    ):
        offset, given = film.find(begin), getattr(film.find(size), "value", 0)
        if offset is not None and given == 0:
            whole = getattr(film.find(width), "value", DEFAULT_SIZE[width])
            film = having(film, **{size: whole - getattr(offset, "value", 0)})
    return film


DEFAULT_SIZE = {"width": 768, "height": 576}
PIXEL_FORMATS = ("luminance", "luminance_alpha", "rgb", "rgba", "xyz", "xyza")


def _box(translation: Translation, read: Node, node: Node) -> Node:
    return _without(translation, node, "radius")


def _projector(translation: Translation, read: Node, node: Node) -> Node:
    if node.find("fov") is None:
        node.properties = node.without(["fov_axis"])
    return node


def _spot(translation: Translation, read: Node, node: Node) -> Node:
    """A texture of one colour is part of the intensity."""
    texture, intensity = node.find("texture"), node.find("intensity")
    if texture is None or isinstance(texture.value, Node):
        return node
    light = intensity.value.values if intensity and isinstance(intensity.value, Rgb) else (1.0,) * 3
    tint = texture.value.values if isinstance(texture.value, Rgb) else (1.0,) * 3
    red, green, blue = (a * b for a, b in zip(light, tint, strict=True))
    return _renamed(node, node.plugin, "texture", intensity=Rgb((red, green, blue)))


def _sampler(translation: Translation, read: Node, node: Node) -> Node | None:
    node.properties = [p for p in node.properties if p.name in ("sample_count", "seed")]
    return node if node.plugin in HAS["sampler"].split() else translation.nearest(node)


def _path(translation: Translation, read: Node, node: Node) -> Node | None:
    mine = {
        "strategy": ("mis",),
        "heuristic": ("power",),
        "footprint": (),
        "version": (5, 6),
    }  # names that only we have, and what Mitsuba does
    lost = [name for name, values in mine.items() if (p := node.find(name)) and p.value not in values]
    translation.lose(*lost)
    node = _renamed(node, node.plugin, *mine)
    if getattr(node.find("rr_depth"), "value", None) == 0:
        node = having(node, rr_depth=1)
    return node if node.plugin in HAS["integrator"].split() else translation.nearest(node)


def _sggx(translation: Translation, read: Node, node: Node) -> Node:
    """The matrix as a volume, which is all that Mitsuba 3 takes."""
    matrix = translation.entry(read).get("S", (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    if not isinstance(matrix, tuple):
        return node
    name = translation.pack(".vol", vol_bytes(np.array(matrix, np.float32).reshape(1, 1, 1, 6)))
    volume = having(Node("volume", "gridvolume", node.location, node.location), filename=name)
    return having(node, S=volume)


def _homogeneous(translation: Translation, read: Node, node: Node) -> Node | None:
    """Extinction and albedo, which are all that Mitsuba 3 takes."""
    node = _without(translation, node, "emission")
    entry = translation.entry(read)
    kept = [p for p in node.properties if isinstance(p.value, Node) and p.value.kind == "phase"]
    result = Node("medium", "homogeneous", node.location, node.plugin_location, node.id, kept)
    if entry["type"] == "heterogeneous":  # the albedo is a volume
        albedo, scale = node.find("albedo"), entry["scale"]
        value = albedo.value if albedo and isinstance(entry["albedo"], dict) else Rgb(entry["albedo"])
        return having(result, albedo=value, sigma_t=_constant_volume(node, entry["sigma_t"]), scale=scale)
    sigma_a, sigma_s = np.array(entry["sigma_a"]), np.array(entry["sigma_s"])
    sigma_t = sigma_a + sigma_s
    red, green, blue = np.divide(sigma_s, sigma_t, out=np.zeros(3), where=sigma_t > 0).tolist()
    extinction = _constant_volume(node, tuple(sigma_t.tolist()))
    return having(result, albedo=Rgb((red, green, blue)), sigma_t=extinction)


def _constant_volume(node: Node, value: tuple[float, float, float]) -> Node:
    """A volume, because a plain colour could not exceed one."""
    return having(Node("volume", "constvolume", node.location, node.location), value=Rgb(value))


def _heterogeneous(translation: Translation, read: Node, node: Node) -> Node | None:
    node = _without(translation, node, "emission")
    density = node.find("density")
    volumes = {"sigma_t": density.value} if density else {}
    for name in ("sigma_t", "albedo"):
        value = volumes.get(name, getattr(node.find(name), "value", None))
        if isinstance(value, Rgb):
            volumes[name] = _constant_volume(node, value.values)
    # Before version 2, a constant extinction has no box to end at, which Mitsuba 3 gives to all but this one.
    endless = not isinstance(translation.entry(read).get("sigma_t"), dict)
    plugin = "homogeneous" if endless else "heterogeneous"
    return _renamed(node, plugin, "density", "emission", **volumes)


def _grid_volume(translation: Translation, read: Node, node: Node) -> Node | None:
    """A grid of 32-bit numbers in the unit cube, placed by one matrix."""
    entry = translation.entry(read)
    known = ("filter_type", "wrap_mode", "filename")
    beyond = getattr(node.find("wrap_mode"), "value", "clamp")
    kept = [p for p in node.properties if p.name in known and (p.name != "wrap_mode" or beyond != "zero")]
    if beyond == "zero":
        translation.warn(node, f"Mitsuba 3 does not end {node} at its box, but repeats its border")
    result = Node("volume", "gridvolume", node.location, node.plugin_location, node.id, kept)
    result = having(result, to_world=entry["to_world"])
    path, _ = translation.builder.find(read)
    voxels, _ = load_voxels(translation.builder, read, dict(translation.builder.construction(read).values))
    if path.suffix.lower() == ".vol" and voxels.values.dtype == np.float32:
        return result
    return having(result, filename=translation.pack(".vol", vol_bytes(voxels.values)))


def _hierarchical_volume(translation: Translation, read: Node, node: Node) -> Node | None:
    """One grid of all blocks."""
    entry = translation.entry(read)
    translation.replaced(node, '"gridvolume" is written, which repeats its border beyond its box')
    result = Node("volume", "gridvolume", node.location, node.plugin_location, node.id)
    voxels, _ = hierarchical_voxels(translation.builder, read)
    name = translation.pack(".vol", vol_bytes(voxels.values))
    return having(result, to_world=entry["to_world"], filename=name)


def _panorama(translation: Translation, read: Node, node: Node) -> Node | None:
    sampling = node.find("sampling")
    if sampling is not None:
        node = _renamed(node, node.plugin, "sampling", mis_compensation=sampling.value == "compensated")
    return _without(translation, node, "theta_max")


def _daylight(translation: Translation, read: Node, node: Node) -> Node | None:
    """Sun and sky in the same place; the sky ends at the horizon."""
    values = translation.builder.construction(read).values
    if values.get("extend") or values.get("stretch", 1.0) > 1:
        translation.warn(node, f"Mitsuba 3 does not extend {node} below the horizon")
    written = for_mitsuba3(translation.builder, read, values)
    empty = Node("emitter", "sunsky", node.location, node.plugin_location, node.id)
    return None if written is None else having(empty, **written)


Adapter: TypeAlias = Callable[[Translation, Node, Node], "Node | None"]
ADAPTERS: dict[tuple[str, str], Adapter] = {
    ("integrator", "path"): _path,
    **{("integrator", name): _path for name in ("volpath", "volpathmis", "volpath_simple")},
    ("sensor", "perspective"): _sensor,
    ("sensor", "thinlens"): _sensor,
    ("sensor", "orthographic"): _sensor,
    ("sensor", "telecentric"): _sensor,
    ("sensor", "radiancemeter"): _one_pixel,
    ("sensor", "distant"): _one_pixel,
    ("rfilter", "box"): _box,
    ("emitter", "projector"): _projector,
    ("emitter", "envmap"): _panorama,
    ("emitter", "spot"): _spot,
    **{("film", name): _film for name in ("film", "hdrfilm", "ldrfilm", "mfilm", "tiledhdrfilm")},
    **{("sampler", name): _sampler for name in ("sobol", "halton", "hammersley", *HAS["sampler"].split())},
    ("bsdf", "twosided"): _two_sided,
    ("bsdf", "mixturebsdf"): _mixture,
    ("bsdf", "bumpmap"): _map,
    ("bsdf", "normalmap"): _map,
    ("bsdf", "conductor"): _conductor,
    ("bsdf", "roughconductor"): _conductor,
    ("bsdf", "roughdielectric"): _rough,
    ("bsdf", "roughplastic"): _rough,
    **{("bsdf", name): _disney for name in ("disneybsdf", "disneymetal", "disneyglass")},
    ("bsdf", "disneydiffuse"): _disney_diffuse,
    ("bsdf", "phong"): _phong,
    ("bsdf", "ward"): _ward,
    ("bsdf", "hair"): _hair,
    **{("emitter", name): _daylight for name in ("sun", "sky", "sunsky")},
    ("medium", "homogeneous"): _homogeneous,
    ("medium", "heterogeneous"): _heterogeneous,
    ("phase", "sggx"): _sggx,
    ("volume", "gridvolume"): _grid_volume,
    ("volume", "hgridvolume"): _hierarchical_volume,
    ("texture", "bitmap"): _bitmap,
    ("texture", "checkerboard"): _checkerboard,
    ("texture", "scale"): _inner,
    ("texture", "vertexcolors"): _vertex_colors,
}
