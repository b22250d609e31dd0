"""A scene's nodes in the words of Mitsuba 3: the plugins, properties and files that it has.

What Mitsuba 3 lacks is replaced by what comes nearest, with a warning, as this renderer does where it lacks
something itself.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from .build import Builder
from .convert import constant_or_texture, convert
from .images import Pixels, is_integer_file, read_pixels
from .nodes import Node, Property, Rgb, Value, Vector
from .plugins import colours
from .plugins.textures import decode
from .ply_bytes import ply_bytes
from .schema import Field, Plugin

# The plugins that are written under their own name.
HAS = {
    "integrator": "path direct volpath volpathmis ptracer depth aov moment",
    "sensor": "perspective thinlens orthographic distant radiancemeter irradiancemeter",
    "film": "hdrfilm",
    "rfilter": "box tent gaussian mitchell catmullrom lanczos",
    "sampler": "independent stratified multijitter orthogonal ldsampler",
    "bsdf": "diffuse dielectric thindielectric roughdielectric conductor roughconductor plastic roughplastic "
    "twosided mask bumpmap normalmap blendbsdf null principled principledthin hair measured",
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
    ("emitter", "sun"): "sunsky",
    ("emitter", "sky"): "sunsky",
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
# Properties of ours that only say how to find what is written already, or that no other renderer has.
OURS = ("strategy", "version", "multiscatter")
CONSTANTS = {plugin.name for plugin in colours.PLUGINS}


@dataclass
class Translator:
    """Translates nodes; each is translated once, so that what is shared stays shared.

    `packed` collects the files to write beside the scene, by their names in it: PLY files and images. They
    hold what Mitsuba 3 cannot read as it is, and with `pack` all meshes.
    """

    builder: Builder
    folder: Path  # of the file to write
    stem: str  # its name
    pack: bool = False
    packed: dict[str, bytes | Pixels] = field(default_factory=dict)
    done: dict[Node, Node | None] = field(default_factory=dict)

    def scene(self, root: Node, core: Mapping[str, Any]) -> Node:
        """The whole scene, with the integrator and the camera of its description where it has none itself."""
        result = _like(root, "scene")
        for kind in ("integrator", "sensor"):
            if not any(root.children(kind)):
                result.properties.append(self._described(root, kind, core[kind]))
        for prop in root.properties:
            if isinstance(prop.value, Node) and (child := self.node(prop.value)) is not None:
                result.properties.append(Property(prop.name, child, prop.location, prop.name_location))
        return result

    def _described(self, root: Node, kind: str, entry: Mapping[str, Any]) -> Property:
        plugin = self.builder.table[kind][entry["type"]]
        names = {field.name for field in plugin.fields} & entry.keys()
        node = _with(Node(kind, plugin.name, root.location, root.location), **{n: entry[n] for n in names})
        return Property("", self.node(node), root.location, root.location)

    def node(self, node: Node) -> Node | None:
        """The node in Mitsuba 3's words; None when it is left out."""
        if node not in self.done:
            known = self.builder.known(node)
            self.done[node] = None if known is None else self._translate(known)
        return self.done[node]

    def _translate(self, node: Node) -> Node | None:
        plugin = self.builder.plugin(node)
        assert plugin is not None
        result = _like(node, plugin.name)
        fields = {f.name: f for f in plugin.fields}
        for prop in node.properties:
            value = self._property(node, plugin, prop, fields.get(prop.name))
            if value is not None and prop.name not in OURS:
                result.properties.append(Property(prop.name, value, prop.location, prop.name_location))
        if (node.kind, plugin.name) in ADAPTERS:
            return ADAPTERS[node.kind, plugin.name](self, result)
        if node.kind == "shape":
            return self._shape(node, result)
        return result if plugin.name in HAS[node.kind].split() else self.nearest(result)

    def _property(self, node: Node, plugin: Plugin, prop: Property, field: Field | None) -> Value | None:
        if isinstance(prop.value, Node):
            if prop.value.kind != "texture" or field is None:
                return self.node(prop.value)
            if prop.value.plugin.lower() not in CONSTANTS:
                return self.node(prop.value)
            if isinstance(content := constant_or_texture(self.builder, prop), dict):  # a texture inside
                nested = next((child for _, child in prop.value.children("texture")), None)
                return nested and self.node(nested)
            prop = Property(prop.name, content, prop.location, prop.name_location)
        if field is None:
            return None  # reading the scene told of it
        value = convert(self.builder, node, prop, field)
        if field.type in ("texture_spectrum", "spectrum") and isinstance(value, tuple):
            return Rgb(value)
        if field.type == "vector":
            return Vector(value)
        if field.name == "filename":
            return self._path(node, value)
        return value

    def _path(self, node: Node, name: str) -> str:
        path, _ = self.builder.find(node)
        try:
            return Path(os.path.relpath(path.resolve(), self.folder.resolve())).as_posix()
        except ValueError:  # another drive
            return path.resolve().as_posix()

    def nearest(self, node: Node) -> Node | None:
        """What comes nearest to a plugin that Mitsuba 3 does not have."""
        name = NEAREST.get((node.kind, node.plugin.lower()), OTHERWISE.get(node.kind, ""))
        used = f'"{name}" is written' if name else "it is left out"
        self.warn(node, f"Mitsuba 3 has no {node}; {used}")
        if not name:
            return None
        known = {f.name for f in self.builder.table[node.kind][name].fields}
        kept = [p for p in node.properties if p.name in known or (isinstance(p.value, Node) and not p.name)]
        return Node(node.kind, name, node.location, node.plugin_location, node.id, kept)

    def warn(self, node: Node, message: str) -> None:
        """Tells of something that is not written as it was read."""
        self.builder.diagnostics.warn(message, node.location)

    def linear_image(self, node: Node, gamma: float, channel: str) -> str:
        """Packs a bitmap's pixels as linear floating-point numbers; the name of the file."""
        path = self.folder / str(getattr(node.find("filename"), "value", ""))
        pixels = read_pixels(path, node.property_location("filename"), channel)
        name = f"{self.stem}-files/{len(self.packed)}.exr"
        self.packed[name] = decode(pixels, gamma) if is_integer_file(path) else pixels
        return name

    # Shapes

    def _shape(self, node: Node, result: Node) -> Node | None:
        """Under its own name where Mitsuba 3 makes the same of it, else as the mesh that it is to us."""
        if result.plugin in HAS["shape"].split() and not self._must_pack(node, result):
            return result
        entry = self.builder.construct(node)
        if entry is None:
            return None
        if entry["type"] != "mesh":
            return self.nearest(result)
        name = f"{self.stem}-files/{len(self.packed)}.ply"
        self.packed[name] = ply_bytes(entry["mesh"])
        kept = ("", "face_normals", "flip_normals", "to_world")
        properties = [p for p in result.properties if p.name in kept or isinstance(p.value, Node)]
        return _with(Node("shape", "ply", node.location, node.location, node.id, properties), filename=name)

    def _must_pack(self, node: Node, result: Node) -> bool:
        if result.plugin in ("obj", "ply", "serialized"):
            return self.pack or result.find("max_smooth_angle") is not None
        return result.plugin in ("sphere", "cylinder") and self.builder.construct(node)["type"] == "mesh"


def _like(node: Node, plugin: str) -> Node:
    return Node(node.kind, plugin, node.location, node.plugin_location, node.id)


def _with(node: Node, **values: Value) -> Node:
    """The node with these properties in place of those of the same name."""
    properties = [
        *node.without(values),
        *(Property(name, value, node.location, node.location) for name, value in values.items()),
    ]
    return Node(node.kind, node.plugin, node.location, node.plugin_location, node.id, properties)


def _renamed(node: Node, plugin: str, *without: str, **values: Value) -> Node:
    result = _with(node, **values)
    result.plugin = plugin
    result.properties = result.without(without)
    return result


# What needs more than its own name: each takes a translated node and gives the one to write.


def _mixture(translator: Translator, node: Node) -> Node | None:
    """A sum of bsdfs as nested pairs; what the weights leave over is black."""
    weights = _numbers(node, "weights")
    parts = [prop.value for prop, _ in node.children("bsdf")][: len(weights)]
    total = max(1.0, sum(weights))
    black = _with(Node("bsdf", "diffuse", node.location, node.location), reflectance=Rgb((0.0,) * 3))
    result, covered = black, 1 - sum(weights[: len(parts)]) / total
    for part, weight in reversed(list(zip(parts, weights, strict=False))):
        covered += weight / total
        share = weight / total / covered if covered > 0 else 0.0
        pair = Node("bsdf", "blendbsdf", node.location, node.location)
        result = part if share > 1 - 1e-6 else _holding(_with(pair, weight=share), result, part)
    return _named(result, node.id)


def _numbers(node: Node, name: str) -> list[float]:
    return [float(word) for word in str(getattr(node.find(name), "value", "")).replace(",", " ").split()]


def _holding(node: Node, *children: Value) -> Node:
    node.properties += [Property("", child, node.location, node.location) for child in children]
    return node


def _named(node: Node, name: str) -> Node:
    """The node under another id; one that has an id already is kept by it."""
    return (
        node
        if node.id or not name
        else Node(node.kind, node.plugin, node.location, node.plugin_location, name, node.properties)
    )


def _inner(translator: Translator, node: Node) -> Node | None:
    nested = next((child for _, child in node.children(node.kind)), None)
    used = f"the {nested} inside it is written" if nested else "it is left out"
    translator.warn(node, f"Mitsuba 3 has no {node}; {used}")
    return nested


def _rough(translator: Translator, node: Node) -> Node:
    """`roughness` is the square root of alpha."""
    roughness = node.find("roughness")
    if roughness is None or not isinstance(roughness.value, int | float):
        return node
    return _renamed(node, node.plugin, "roughness", alpha=float(roughness.value) ** 2)


def _conductor(translator: Translator, node: Node) -> Node:
    """Indices of refraction relative to what is around the metal."""
    node = _rough(translator, node)
    outside = getattr(node.find("ext_eta"), "value", 1.0)
    numbers = node.find("eta") or node.find("k")
    if outside == 1:
        return _renamed(node, node.plugin, "ext_eta", *(["material"] if numbers else []))
    entry = translator.builder.construct(node)
    relative = {name: Rgb(entry[name]) for name in ("eta", "k") if isinstance(entry[name], tuple)}
    return _renamed(node, node.plugin, "ext_eta", "material", **relative)


def _phong(translator: Translator, node: Node) -> Node | None:
    """The width of the lobe as Walter et al. 2007 relate the two, section 5.2."""
    exponent = getattr(node.find("exponent"), "value", 30.0)
    alpha = math.sqrt(2 / (exponent + 2)) if isinstance(exponent, int | float) else 0.25
    return translator.nearest(_with(node, alpha=alpha))


def _ward(translator: Translator, node: Node) -> Node | None:
    alphas = [getattr(node.find(name), "value", 0.1) for name in ("alpha_u", "alpha_v")]
    known = [float(alpha) for alpha in alphas if isinstance(alpha, int | float)]
    return translator.nearest(_with(node, alpha=float(np.mean(known or [0.1]))))


def _bitmap(translator: Translator, node: Node) -> Node:
    """An image; encodings and channels that Mitsuba 3 does not know are written out as linear values."""
    filter_type = getattr(node.find("filter_type"), "value", "bilinear")
    result = _with(node, filter_type="nearest" if filter_type == "nearest" else "bilinear")
    if getattr(node.find("wrap_mode"), "value", "") in ("zero", "one"):
        translator.warn(node, f"Mitsuba 3 cannot wrap {node} so; its border is repeated")
        result = _with(result, wrap_mode="clamp")
    gamma, channel = (
        getattr(node.find(name), "value", other) for name, other in (("gamma", -1.0), ("channel", ""))
    )
    result.properties = result.without(("gamma", "channel", "max_anisotropy"))
    if channel or (gamma > 0 and gamma != 1):
        return _with(result, raw=False, filename=translator.linear_image(node, gamma, channel))
    return _with(result, raw=True) if gamma == 1 else result


def _vertex_colors(translator: Translator, node: Node) -> Node:
    return _renamed(node, "mesh_attribute", name="vertex_color")


def _sensor(translator: Translator, node: Node) -> Node | None:
    """Mitsuba 3 takes no scale in a camera's placement."""
    place = node.find("to_world")
    if place is not None:
        matrix = np.array(place.value, dtype=np.float64)
        matrix[:3, :3] /= np.linalg.norm(matrix[:3, :3], axis=0)
        node = _with(node, to_world=matrix)
    return node if node.plugin in HAS["sensor"].split() else translator.nearest(node)


def _film(translator: Translator, node: Node) -> Node:
    known = ("width", "height", "crop_offset_x", "crop_offset_y", "crop_width", "crop_height")
    kept = [p for p in node.properties if p.name in known or isinstance(p.value, Node)]
    return Node("film", "hdrfilm", node.location, node.plugin_location, node.id, kept)


def _path(translator: Translator, node: Node) -> Node:
    roulette = getattr(node.find("rr_depth"), "value", None)
    return _with(node, rr_depth=1) if roulette == 0 else node


Adapter: TypeAlias = Callable[[Translator, Node], "Node | None"]
ADAPTERS: dict[tuple[str, str], Adapter] = {
    ("integrator", "path"): _path,
    ("integrator", "volpath"): _path,
    ("sensor", "perspective"): _sensor,
    ("sensor", "thinlens"): _sensor,
    ("sensor", "orthographic"): _sensor,
    ("film", "hdrfilm"): _film,
    ("film", "ldrfilm"): _film,
    ("bsdf", "mixturebsdf"): _mixture,
    ("bsdf", "coating"): _inner,
    ("bsdf", "roughcoating"): _inner,
    ("bsdf", "conductor"): _conductor,
    ("bsdf", "roughconductor"): _conductor,
    ("bsdf", "roughdielectric"): _rough,
    ("bsdf", "roughplastic"): _rough,
    ("bsdf", "phong"): _phong,
    ("bsdf", "ward"): _ward,
    ("texture", "bitmap"): _bitmap,
    ("texture", "scale"): _inner,
    ("texture", "vertexcolors"): _vertex_colors,
}
