"""Translates nodes to plugins, properties and files that Mitsuba 3 supports.

What Mitsuba 3 lacks is replaced by what comes nearest, with a warning, as this renderer does where it lacks
something itself.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np

from lajolla.picture_files import Budget

from ..description.assemble import NEVER_LIGHTS
from ..description.builder import Builder, Construction, named
from ..description.instances import Contents
from ..description.plugin import Entry, Part, Plugin, Values, is_child
from ..description.plugins import colours, subdivision
from ..description.plugins.textures import decode, is_alpha
from ..formats.images import FLOAT_RGB, Pixels, read_pixels
from ..formats.ply import ply_bytes
from ..schema import COMPOSITING, ROBUST, Field
from ..syntax.files import MissingFile, file_bytes
from ..syntax.nodes import Node, Property, Rgb, Value, Vector, below
from .coats import coating
from .instances import group, instances
from .meshes import reads_alike
from .plugins import (
    ADAPTERS,
    HAS,
    NEAREST,
    OTHERWISE,
    REQUIRED,
    having,
    having_bsdf,
    like,
    with_boundary,
)

# Properties of ours that only say how to find what is written already.
READING = ("collapse", "load_materials", "max_smooth_angle", "normal_weights", "srgb", *subdivision.NAMES)
# Those that Mitsuba 3 does not have, with their defaults.
OURS = {"multiscatter": False, "terminator": "none", **COMPOSITING}
ENVIRONMENTS = ("constant", "envmap", "sunsky")
# Kinds of children of which one counts; of bsdfs in pairs two.
COUNTED = {"scene": ("integrator",), "sensor": ("film", "sampler", "medium"), "film": ("rfilter",)}
COUNTED |= {"shape": ("bsdf", "emitter"), "bsdf": ("bsdf",)}
PAIRS = ("twosided", "blendbsdf")
MAPS = ("bumpmap", "normalmap")
COATS = ("coating", "roughcoating")
CONSTANTS = {plugin.name for plugin in colours.PLUGINS}


@dataclass
class Losses:
    """The replacement of an object, and the names of the properties it loses."""

    used: str = ""
    names: list[str] = field(default_factory=list)


@dataclass
class Translator:
    """Translates nodes; each is translated once, so that what is shared stays shared.

    `packed` collects the files to write beside the scene, by their names in it: PLY files and images. They
    hold what Mitsuba 3 cannot read as it is, and with `pack_all` all meshes.
    """

    builder: Builder
    folder: Path  # of the file to write
    stem: str  # its name
    pack_all: bool = False
    packed: dict[str, bytes | Pixels] = field(default_factory=dict)
    losses: list[Losses] = field(default_factory=list)  # of the objects that are being translated
    copied: dict[str, Path] = field(default_factory=dict)  # where files among these come from
    done: dict[Node, Node | None] = field(default_factory=dict)
    made: dict[Node, list[Node]] = field(default_factory=dict)  # of shapes
    pictures: Budget = field(default_factory=Budget)  # of those that are read again
    groups: dict[Node, Contents[Node]] = field(default_factory=dict)

    def scene(self, root: Node, core: Mapping[str, Any]) -> Node:
        """The whole scene; a missing integrator or camera is that of the description."""
        result = like(root, "scene")
        for kind in ("integrator", "sensor"):
            if not any(root.children(kind)):
                result.properties.append(self._described(root, kind, core[kind]))
        if (robust := root.find(ROBUST)) is not None:
            result.properties.append(robust)
        around = None
        for prop in _counted(root, _first_camera_first(root)):
            for child in self._values(root, prop, None, {}) if isinstance(prop.value, Node) else ():
                if isinstance(child, Node) and child.kind == "emitter" and child.plugin in ENVIRONMENTS:
                    if around is not None:
                        self.warn(child, f"Mitsuba 3 supports one environment light; {child} is omitted")
                        continue
                    around = child
                result.properties.append(Property(prop.name, child, prop.location, prop.name_location))
        self._fill_copies(result)
        return result

    def _described(self, root: Node, kind: str, entry: Mapping[str, Any]) -> Property:
        plugin = self.builder.table[kind][entry["type"]]
        names = {field.name for field in plugin.fields} & entry.keys()
        node = having(Node(kind, plugin.name, root.location, root.location), **{n: entry[n] for n in names})
        return Property("", self.node(node), root.location, root.location)

    def node(self, node: Node) -> Node | None:
        """The node for Mitsuba 3; None if it is omitted."""
        if node not in self.done:
            built = self.builder.construction(node)
            try:
                self.done[node] = None if built.node is None else self._translate(built.node, built)
            except MissingFile:  # reading the scene warned of it
                self.done[node] = None
        return self.done[node]

    def entry(self, node: Node) -> Entry:
        """The entry of the description that was made of a node, as it was read."""
        result = self.builder.construction(node).result
        assert isinstance(result, dict)
        return result

    def _properties(self, node: Node, plugin: Plugin, values: Values) -> Node:
        """The node with each of its properties translated."""
        result = like(node, plugin.name)
        fields = {f.name: f for f in plugin.fields}
        meant = {
            id(prop): fields.get(name)
            for name, prop in named(node, fields)
            if name in fields or is_child(prop.value, plugin)
        }
        values = values | self._values_of_children(node, plugin, fields)
        given = {name: getattr(node.find(name), "value", default) for name, default in OURS.items()}
        self.lose(*(name for name, default in OURS.items() if given[name] != default))
        used = [prop for prop in node.properties if id(prop) in meant and prop.name not in OURS]
        for prop in _counted(node, used):
            for value in self._values(node, prop, meant[id(prop)], values):
                result.properties.append(Property(prop.name, value, prop.location, prop.name_location))
        for name in REQUIRED.get((node.kind, plugin.name), ()):
            if result.find(name) is None:
                result = having(result, **{name: fields[name].default})
        return result

    def _values_of_children(self, node: Node, plugin: Plugin, fields: Mapping[str, Field]) -> Values:
        """Of textures that plugins convert themselves, as any name would do, but have that of a field."""
        return {
            prop.name: self.builder.convert(node, prop, fields[prop.name])
            for prop, child in node.children("texture")
            if prop.name in fields and is_child(child, plugin) and self.builder.texture(child) is not None
        }

    def _values(self, node: Node, prop: Property, field: Field | None, values: Values) -> list[Value]:
        if isinstance(prop.value, Node) and prop.value.kind == "shape":
            return list(self.shapes(prop.value))
        value = self._property(node, prop, field, values)
        return [] if value is None else [value]

    def _translate(self, node: Node, built: Construction) -> Node | None:
        plugin = self.builder.plugin(node)
        assert plugin is not None
        with self._reporting(node):
            result = self._properties(node, plugin, built.values)
            adapter = ADAPTERS.get((node.kind, plugin.name))
            if node.kind == "bsdf" and plugin.name in COATS:
                adapter = coating
            if adapter is not None:
                return adapter(self, node, result)
            return result if plugin.name in HAS[node.kind].split() else self.nearest(result)

    @contextmanager
    def _reporting(self, node: Node) -> Iterator[None]:
        """Reports in one warning what replaces an object, and which properties it loses."""
        lost = Losses()
        self.losses.append(lost)
        try:
            yield
        finally:
            self.losses.pop()
        names = ", ".join(f'"{name}"' for name in dict.fromkeys(lost.names))
        if lost.used:
            without = f", without {names}" if names else ""
            self.warn(node, f"Mitsuba 3 does not support {node}; {lost.used}{without}")
        elif names:
            self.warn(node, f"Mitsuba 3 does not support {names} of {node}")

    def replaced(self, node: Node, used: str) -> None:
        """Notes what is written for an object whose plugin Mitsuba 3 does not have."""
        self.losses[-1].used = used

    def lose(self, *names: str) -> None:
        """Notes properties of the object that is being translated which Mitsuba 3 does not have."""
        self.losses[-1].names += names

    def _property(self, node: Node, prop: Property, field: Field | None, values: Values) -> Value | None:
        child = prop.value if isinstance(prop.value, Node) else None
        if child is not None and (child.kind != "texture" or field is None):
            return self.node(child)
        if field is None or field.name not in values:
            return None  # reading the scene warned of it
        value = values[field.name]
        if child is not None and child.plugin.lower() not in CONSTANTS:
            return self.node(child)
        if child is not None and isinstance(value, dict):  # a texture inside
            nested = next((inner for _, inner in child.children("texture")), None)
            return nested and self.node(nested)
        if field.type in ("texture_spectrum", "spectrum", "volume_spectrum") and isinstance(value, tuple):
            red, green, blue = value
            return Rgb((red, green, blue))
        if field.type == "vector":
            return Vector(value)
        return self._path(node, value) if field.name == "filename" else cast("Value", value)

    def _path(self, node: Node, name: str) -> str:
        path, _ = self.builder.find(node)
        try:
            written = Path(os.path.relpath(path.resolve(), self.folder.resolve())).as_posix()
        except ValueError:  # another drive
            written = path.resolve().as_posix()
        try:
            written.encode()
        except UnicodeEncodeError:  # XML cannot name the file: a copy gets another name
            known = (name for name, source in self.copied.items() if source == path)
            written = next(known, f"{self.stem}-files/{len(self.packed)}{path.suffix}")
            self.copied[written] = path
            self.packed[written] = b""  # filled when it is known whether it is used
        return written

    def _fill_copies(self, scene: Node) -> None:
        """Copies the files of the written scene, except packed meshes."""
        names = {p.value for node in below([scene]) for p in node.properties if isinstance(p.value, str)}
        for name, path in self.copied.items():
            if name in names:
                self.packed[name] = file_bytes(path)
            else:
                del self.packed[name]

    def nearest(self, node: Node) -> Node | None:
        """The closest plugin that Mitsuba 3 supports."""
        name = NEAREST.get((node.kind, node.plugin.lower()), OTHERWISE.get(node.kind, ""))
        self.replaced(node, f'"{name}" is written' if name else "it is ignored")
        if not name:
            return None
        plugin = self.builder.table[node.kind][name]
        known = {f.name for f in plugin.fields}
        kept = [p for p in node.properties if p.name in known or is_child(p.value, plugin)]
        self.lose(*(p.name or str(p.value) for p in node.properties if p not in kept))
        return Node(node.kind, name, node.location, node.plugin_location, node.id, kept)

    def warn(self, node: Node, message: str) -> None:
        """Reports something that is not written as it was read."""
        self.builder.diagnostics.warn(message, node.location)

    def linear_image(self, node: Node, gamma: float, channel: str) -> str:
        """Packs a bitmap's pixels as linear floating-point numbers; the name of the file."""
        place = node.property_location("filename")
        path = self._file_of(node)
        pixels, encoded = read_pixels(path, place, self.pictures, channel, pixel=FLOAT_RGB)
        linear = decode(pixels, 1.0 if is_alpha(channel) else gamma) if encoded else pixels
        return self.pack(".exr", np.broadcast_to(linear, (*linear.shape[:2], 3)))

    def pack(self, ending: str, content: bytes | Pixels) -> str:
        """Adds a file to those that are written beside the scene; its name."""
        name = f"{self.stem}-files/{len(self.packed)}{ending}"
        self.packed[name] = content
        return name

    def _file_of(self, node: Node) -> Path:
        """The file that a translated object names: the one to read, where a copy is still to be written."""
        written = str(getattr(node.find("filename"), "value", ""))
        return self.copied.get(written, self.folder / written)

    # Shapes

    def shapes(self, node: Node) -> list[Node]:
        """The shape itself if Mitsuba 3 treats it identically, else its meshes."""
        if node not in self.made:
            built = self.builder.construction(node)
            known = built.node
            try:
                with self._reporting(known or node):
                    self.made[node] = [] if known is None else self._shapes(known, built)
            except MissingFile:  # reading the scene warned of it
                self.made[node] = []
        return self.made[node]

    def _shapes(self, node: Node, built: Construction) -> list[Node]:
        plugin = self.builder.plugin(node)
        assert plugin is not None
        if plugin.name == "merge":
            return [shape for _, child in node.children("shape") for shape in self.shapes(child)]
        if plugin.name == "shapegroup":
            return group(self, node)
        if plugin.name == "instance":
            return instances(self, node)
        result = with_boundary(self._properties(node, plugin, built.values))
        entry = built.result
        if isinstance(entry, list):
            parts = [part for part in entry if isinstance(part, Part)]
            return [self._packed(having_bsdf(result, self._part_bsdf(part)), part.entry) for part in parts]
        if not isinstance(entry, dict) or _is_empty(entry):
            return []
        if plugin.name in HAS["shape"].split() and not self._must_pack(result, entry):
            return [
                Node(node.kind, plugin.name, node.location, node.location, node.id, result.without(READING))
            ]
        if entry["type"] == "mesh":
            return [self._packed(result, entry)]
        return [nearest] if (nearest := self.nearest(result)) else []

    def _part_bsdf(self, part: Part) -> Node | None:
        return self.node(part.bsdf) if part.bsdf else None

    def _packed(self, node: Node, entry: Mapping[str, Any]) -> Node:
        name = self.pack(".ply", ply_bytes(entry["mesh"]))
        kept = ("", "face_normals", "flip_normals", "to_world")
        properties = [
            p
            for p in node.properties
            if p.name in kept or (isinstance(p.value, Node) and p.name not in subdivision.NAMES)
        ]
        return having(Node("shape", "ply", node.location, node.location, node.id, properties), filename=name)

    def _must_pack(self, node: Node, entry: Mapping[str, Any]) -> bool:
        if node.plugin in ("obj", "ply", "serialized"):
            indexed = node.plugin == "obj" and node.find("shape_index") is not None
            divided = getattr(node.find("subdivision"), "value", False) is True
            weights = getattr(node.find("normal_weights"), "value", "angle")
            smoothed = node.find("max_smooth_angle") is not None or weights != "angle"
            if self.pack_all or indexed or divided or smoothed:
                return True
            mesh = entry["mesh"]
            coloured = node.plugin != "ply" and bool(
                mesh.attributes
            )  # which Mitsuba reads of PLY files alone
            alike = reads_alike(self._file_of(node), node.plugin, len(mesh.faces))
            return mesh.mended or coloured or not alike
        return node.plugin in ("sphere", "cylinder") and entry["type"] == "mesh"


def _is_empty(entry: Entry) -> bool:
    """Whether a shape is a mesh without faces, which Mitsuba 3 refuses."""
    return entry["type"] == "mesh" and len(entry["mesh"].faces) == 0


def _first_camera_first(root: Node) -> list[Property]:
    """A scene's properties; of several sensors Mitsuba 3 shows the first."""
    sensors = [prop for prop, _ in root.children("sensor")]
    if not root.unsaid.last_sensor or len(sensors) < 2:
        return root.properties
    others = [p for p in root.properties if not (isinstance(p.value, Node) and p.value.kind == "sensor")]
    return [*reversed(sensors), *others]


def _counted(node: Node, properties: list[Property]) -> list[Property]:
    """The properties without surplus children."""
    name = node.plugin.lower()
    kinds = () if name == "mixturebsdf" else COUNTED.get(node.kind, ())
    kinds += ("texture",) if name in MAPS else ()
    most = 2 if name in PAIRS else 1
    met: Counter[str] = Counter()
    result = []
    for prop in properties:
        if not _has_use(node, prop):
            continue
        kind = prop.value.kind if isinstance(prop.value, Node) else ""
        met[kind] += 1
        if kind in kinds and met[kind] > most:
            continue
        result.append(prop)
    return result


def _has_use(node: Node, prop: Property) -> bool:
    """Whether a child of a scene or a shape has a meaning there, as when the scene is rendered."""
    child = prop.value
    if not isinstance(child, Node):
        return True
    if child.kind == "subsurface":
        return False
    if node.kind == "scene" and child.kind in ("integrator", "sensor"):
        return child in node.outermost(child.kind)
    if node.kind == "scene":  # lights of shapes, and constants, are written where they are used
        elsewhere = {"emitter": ("area",), "texture": CONSTANTS}.get(child.kind, ())
        return child.plugin.lower() not in elsewhere
    if node.kind != "shape" or child.kind not in ("emitter", "medium"):
        return True
    if child.kind == "medium":
        return prop.name in ("interior", "exterior")
    return child.plugin.lower() == "area" and node.plugin.lower() not in NEVER_LIGHTS
