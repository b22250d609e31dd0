"""Scenes as Python dicts, in the conventions of Mitsuba 3's `load_dict`."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from .errors import Location, SceneError, Source, did_you_mean, nearest
from .expand import LATEST
from .foreign import is_mesh, plain
from .literals import Text, checked_spectrum, parse_rgb
from .nodes import KINDS, Node, Property, Reference, Rgb, Spectrum, SpectrumFile, Unsaid, Value, Vector
from .resolve import MAX_NESTING
from .transforms import look_at
from .typed import Tree

Names: TypeAlias = Mapping[str, Collection[str]]  # of plugins in lower case, by kind

# A dict inside several others is an object in each. The number of such objects is limited to MOST_REPEATED,
# plus MOST_MEETINGS for each dict.
MOST_REPEATED = 1 << 14
MOST_MEETINGS = 64
MOST_SAMPLES = 1 << 16  # of a spectrum
# A program may only trace rays; and dicts need not look as in Mitsuba.
OF_DICTS = Unsaid(camera=True, terminator="hanika")
TABLES = ("attributes",)  # parameters that are dicts of arrays
LOSSY = ("roughconductor", "roughdielectric", "roughplastic")  # where microfacets shadow each other


def nodes_from_dict(scene: Mapping[str, Any], base_path: Path, known: Names, replaced: Names) -> Tree:
    """The nodes of a scene dict. Every key of the root is the id of its object. Rough surfaces give back the
    light that bounces between microfacets, and shadows on meshes with vertex normals are smooth, unless bsdfs
    say otherwise.

    Args:
        scene: the dict.
        base_path: the folder of files that it names.
        known: the plugins that there are.
        replaced: those that others stand in for.

    Raises:
        SceneError: no "type", an unknown one, or a value of a type that scenes do not have.
    """
    source = Source("scene", b"", base_path, LATEST)
    reader = _DictReader(source, known, replaced)
    kind = scene.get("type") if isinstance(scene, Mapping) else None
    if not isinstance(kind, str) or kind != "scene":
        raise SceneError('the dict must have {"type": "scene"}', Location(source))
    root = Node("scene", "scene", Location(source), Location(source), unsaid=OF_DICTS)
    reader.tree = Tree(root, nodes=[root])
    reader.properties(scene, root, [])
    give_back_lost_light(reader.tree.nodes)
    return reader.tree


def value_from_python(
    value: object, path: str, source: Source, known: Names, replaced: Names
) -> tuple[Value, Tree]:
    """A value of one parameter, and the nodes that it consists of if it is a dict.

    Args:
        value: as in a scene dict.
        path: of the parameter, for messages.
        source, known, replaced: as for `nodes_from_dict`.

    Raises:
        SceneError: as `nodes_from_dict`.
    """
    reader = _DictReader(source, known, replaced)
    location = Location(source, key=path)
    reader.tree = Tree(Node("scene", "scene", location, location), nodes=[])
    return reader.value(value, path.rsplit(".", 1)), reader.tree


def give_back_lost_light(nodes: Iterable[Node]) -> None:
    """Enables `multiscatter` in dicts that do not set it.

    Scene files are to look as in Mitsuba, where it is off. It stays off for glass whose roughness is or may
    be anisotropic, because the model does not support that.
    """
    for node in nodes:
        plugin = node.plugin.lower() if node.kind == "bsdf" else ""
        if plugin in LOSSY and not (plugin == "roughdielectric" and _may_be_anisotropic(node)):
            node.set_default("multiscatter", True)


def _may_be_anisotropic(node: Node) -> bool:
    given = [node.find(name) for name in ("alpha_u", "alpha_v")]
    values = [prop.value for prop in given if prop is not None]
    comparable = all(isinstance(value, int | float | Reference) for value in values)
    return bool(values) and not (comparable and len(values) == 2 and values[0] == values[1])


@dataclass
class _DictReader:
    source: Source
    known: Names
    replaced: Names
    tree: Tree | None = None
    met: set[int] = field(default_factory=set)  # dicts that are there, however often they are met
    meetings: int = 0

    def properties(self, entries: Mapping[str, Any], node: Node, path: list[str]) -> None:
        """Adds a dict's entries to its node."""
        if len(path) > MAX_NESTING:
            raise SceneError(f"dicts are nested more than {MAX_NESTING} deep", self.at(path[:4]))
        for key, entry in entries.items():
            if not isinstance(key, str):
                raise SceneError(f"the key {key!r} is not a string", self.at(path))
            if key in ("type", "id"):
                continue
            location = self.at([*path, key])
            value = self.value(entry, [*path, key])
            if is_mesh(value) and node.plugin.lower() != "mesh":
                value = self.mesh(value, [*path, key])
            node.properties.append(Property(key, value, location, location))

    def at(self, path: list[str]) -> Location:
        return Location(self.source, key=".".join(path))

    def value(self, entry: object, path: list[str]) -> Value:
        """A node for a dict, and a typed value for anything else."""
        location = self.at(path)
        if isinstance(entry, Mapping):
            return self.arrays(entry, path) if path[-1] in TABLES else self.typed(entry, path)
        value = plain(entry, location)
        if isinstance(value, int) and abs(value) > sys.float_info.max:
            raise SceneError("the number is too large", location)
        return value if isinstance(value, bool | int | float | str) else _array_value(value)

    def mesh(self, mesh: object, path: list[str]) -> Node:
        """The shape of a mesh object that is a value of a dict."""
        location = self.at(path)
        prop = Property("mesh", mesh, location, location)
        node = Node("shape", "mesh", location, location, path[0] if len(path) == 1 else "", [prop])
        assert self.tree is not None
        self.tree.nodes.append(node)
        return node

    def typed(self, entry: Mapping[str, Any], path: list[str]) -> Value:
        """A colour, a reference, or an object, by its "type"."""
        location = self.at(path)
        self.met.add(id(entry))
        self.meetings += 1
        if self.meetings > MOST_REPEATED + MOST_MEETINGS * len(self.met):
            raise SceneError(f"the same dicts make more than {MOST_REPEATED:,} objects", location)
        kind_of_value = entry.get("type")
        if not isinstance(kind_of_value, str):
            raise SceneError('a dict needs a "type"', location)
        if kind_of_value == "ref":
            return Reference(str(entry.get("id", "")))
        if kind_of_value in ("rgb", "srgb") and "value" in entry:
            return _rgb(_plain(entry["value"], location), location, srgb=kind_of_value == "srgb")
        if kind_of_value == "spectrum":
            return _spectrum(entry, location)
        if kind_of_value == "look_at":
            return self.look_at(entry, path)
        name = str(entry.get("id", path[0] if len(path) == 1 else ""))
        kind = self.kind(kind_of_value, path[-1], location)
        node = Node(kind, kind_of_value, location, location, name)
        assert self.tree is not None
        self.tree.nodes.append(node)
        self.properties(entry, node, path)
        return node

    def look_at(self, entry: Mapping[str, Any], path: list[str]) -> Value:
        """A matrix that places a camera: "origin", "target", and "up", which is +y by default."""
        location = self.at(path)
        for name in entry:
            if name not in ("type", "origin", "target", "up"):
                hint = did_you_mean(str(name), ("origin", "target", "up"))
                raise SceneError(f'a look_at has no "{name}"{hint}', location)
        points = []
        for name in ("origin", "target", "up"):
            value = _array_value(_plain(entry.get(name, (0.0, 1.0, 0.0) if name == "up" else None), location))
            if not isinstance(value, Vector) or not np.all(np.isfinite(value.xyz)):
                raise SceneError(f'a look_at needs "{name}": three numbers', location)
            points.append(np.array(value.xyz))
        try:
            return look_at(*points)
        except ValueError:
            message = "origin and target are the same, or up points along the view"
            raise SceneError(message, location) from None

    def arrays(self, entry: Mapping[str, Any], path: list[str]) -> Value:
        """Arrays by name, as a value of one parameter."""
        return {str(name): plain(value, self.at([*path, str(name)])) for name, value in entry.items()}

    def kind(self, plugin: str, key: str, location: Location) -> str:
        """The kind of object that a plugin name means; the key may be that of a kind ("integrator")."""
        name = plugin.lower()
        kinds = [k for k in KINDS if name in self.known.get(k, ()) or name in self.replaced.get(k, ())]
        if key in KINDS and (not kinds or key in kinds):
            return key
        if kinds:
            return kinds[0]
        known = [plugin for names in self.known.values() for plugin in names]
        close = nearest(plugin, known)
        hint = did_you_mean(plugin, known) if close else ""
        raise SceneError(f'unknown plugin "{plugin}"{hint}', location)


def _plain(entry: object, location: Location) -> object:
    """A value within a value; a dict is no mistake of another library's."""
    return entry if isinstance(entry, Mapping) else plain(entry, location)


def _array_value(entry: Any) -> Value:  # noqa: ANN401
    """Three numbers are a vector; other objects stay, for the field that takes them to judge."""
    if len_of(entry) != 3:
        return entry
    try:
        x, y, z = (float(v) for v in entry)
    except (TypeError, ValueError, OverflowError):
        return entry
    return Vector((x, y, z))


def len_of(entry: object) -> int:
    """The length of what may be a sequence of numbers, which is not looked at otherwise; 0 for others."""
    shape = getattr(entry, "shape", None)
    if isinstance(shape, tuple):
        return shape[0] if len(shape) == 1 else 0
    return len(entry) if isinstance(entry, Sequence) and not isinstance(entry, str | bytes) else 0


def _rgb(value: object, location: Location, *, srgb: bool) -> Rgb:
    try:
        text = (
            value
            if isinstance(value, str)
            else " ".join(map(repr, np.ravel(np.asarray(_small(value), float)).tolist()))
        )
    except (TypeError, ValueError, OverflowError):
        raise SceneError("a colour is one number or three", location) from None
    return parse_rgb(Text(text, location), srgb=srgb)


def _small(value: object) -> object:
    if getattr(value, "size", 0) > 3:
        raise ValueError
    return value


def _spectrum(entry: Mapping[str, Any], location: Location) -> Value:
    if "filename" in entry:
        return SpectrumFile(str(_plain(entry["filename"], location)))
    value: Any = _plain(entry.get("value", ""), location)
    try:
        if isinstance(value, int | float) and not isinstance(value, bool):
            return Spectrum((float(value),))
        if value is None or np.shape(value)[1:] not in ((), (2,)) or len(value) > MOST_SAMPLES:
            raise ValueError
        samples = np.asarray(value, dtype=np.float64)
        wavelengths = samples[:, 0] if "wavelengths" not in entry else np.asarray(entry["wavelengths"], float)
        values = samples[:, 1] if "wavelengths" not in entry else samples
        return checked_spectrum(tuple(map(float, wavelengths)), tuple(map(float, values)), location)
    except (TypeError, ValueError, IndexError, OverflowError):
        raise SceneError(
            'a spectrum needs a "value": a number or (wavelength, value) pairs', location
        ) from None
