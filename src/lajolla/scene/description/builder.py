"""Nodes to the description that the core takes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any, TypeGuard

from lajolla.film import Film
from lajolla.picture_files import Budget

from ..schema import (
    BLACK,
    CHILDREN,
    HARMLESS,
    TEXTURED,
    AdapterId,
    Content,
    Field,
    MaterialId,
    Plugin,
    Slot,
    core_schema,
    fields_of,
)
from ..syntax.errors import Diagnostics, Location, SceneError, blamed_on, did_you_mean
from ..syntax.files import MissingFile, find_file
from ..syntax.nodes import Node, Property
from .outputs import Picture
from .plugins import READER_PLUGINS
from .plugins.films import Layer
from .substitutes import DROPPED, NESTED, for_substitute, misspelt, substitute_for
from .values import convert

# Objects that a scene can do without: one whose file is missing is left out.
DISPENSABLE = ("texture", "bsdf", "shape", "emitter", "medium")

MOST_SETTINGS = 32  # settings with which one file is read
MOST_LOOKUPS = 1024  # that one texture may take

# Lists of the description whose entries other entries name by index.
LISTS = {"phase": "phases", "medium": "media"}


@dataclass
class Plugins(Mapping[str, Plugin]):
    """The plugins of a kind by their names in lower case, created on first use."""

    makers: dict[str, Callable[[], Plugin]] = field(default_factory=dict)
    made: dict[str, Plugin] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Plugin:
        if name not in self.made:
            self.made[name] = self.makers[name]()
        return self.made[name]

    def __contains__(self, name: object) -> bool:
        return name in self.makers

    def __iter__(self) -> Iterator[str]:
        return iter(self.makers)

    def __len__(self) -> int:
        return len(self.makers)


@cache
def plugins_by_kind() -> Mapping[str, Mapping[str, Plugin]]:
    """All plugins: the core's models, overridden by the reader's own."""
    schema = core_schema()
    table: dict[str, Plugins] = {}
    for kind, models in schema.items():
        if kind == "adapter":
            continue  # the reader's own plugins make them
        for name in models:
            table.setdefault(kind, Plugins()).makers[name.lower()] = partial(_of_model, kind, name)
    for plugin in READER_PLUGINS:
        table.setdefault(plugin.kind, Plugins()).makers[plugin.name.lower()] = partial(
            plugin.with_model, schema
        )
    return table


def _of_model(kind: str, name: str) -> Plugin:
    """A model of the core as a plugin."""
    schema = core_schema()
    fields, doc = fields_of(schema, kind, name), schema[kind][name]["doc"]
    return Plugin(kind, name, doc, fields, _entry, CHILDREN.get(kind, ()), model=name)


def _entry(builder: Builder, node: Node, values: dict[str, Any]) -> dict[str, Any]:
    plugin = builder.plugin(node)
    assert plugin is not None
    return {"type": plugin.model, **values}


@dataclass
class Builder:
    """Builds a description."""

    core: ModuleType
    diagnostics: Diagnostics
    search_paths: list[Path]
    two_sided: bool = False
    integrator: str | None = None  # in place of the scene's
    sensor: str | int | None = None  # which one of several, by id or number
    table: Mapping[str, Mapping[str, Plugin]] = field(default_factory=plugins_by_kind)
    textures: list[dict[str, Any]] = field(default_factory=list)
    lookups: list[int] = field(default_factory=list)  # of each texture, how many it takes
    bsdfs: list[dict[str, Any]] = field(default_factory=list)
    transmissive: list[bool] = field(default_factory=list)  # of each bsdf, whether light passes through
    adapters: list[dict[str, Any]] = field(default_factory=list)
    materials: list[dict[str, Any]] = field(default_factory=list)
    emitters: list[dict[str, Any]] = field(default_factory=list)
    shapes: list[dict[str, Any]] = field(default_factory=list)
    volumes: list[dict[str, Any]] = field(default_factory=list)
    phases: list[dict[str, Any]] = field(default_factory=list)
    media: list[dict[str, Any]] = field(default_factory=list)
    groups: list[dict[str, Any]] = field(default_factory=list)
    instances: list[dict[str, Any]] = field(default_factory=list)
    film: Film = field(default_factory=Film)  # how the picture is written
    layers: list[Layer] = field(default_factory=list)  # what the film says of integrators in `multichannel`
    built: dict[Node, Any] = field(default_factory=dict)  # textures and bsdfs are shared
    indices: dict[str, int] = field(default_factory=dict)  # of bsdfs and adapters by what they are
    slots: dict[Slot, int] = field(default_factory=dict)
    places: dict[str, Location] = field(default_factory=dict)  # of entries: "shapes[3]"
    pictures: Budget = field(default_factory=Budget)
    sky_pixels: int = 0  # of the pictures of skies
    settings: dict[Path, int] = field(default_factory=dict)  # number of settings each file is read with
    files: dict[tuple[Any, ...], Any] = field(default_factory=dict)  # meshes and images are read once

    # Files

    def directories(self, location: Location) -> list[Path]:
        """The folders in which the files of an object are searched."""
        return [location.source.directory, *self.search_paths]

    def find(self, node: Node, name: str = "filename") -> tuple[Path, Location]:
        """The file that a property names, and the place of the name.

        Raises:
            SceneError: the property or the file is missing.
        """
        prop = node.find(name)
        if prop is None or not isinstance(prop.value, str):
            raise SceneError(f'{node} needs the string "{name}"', node.location)
        return find_file(prop.value, self.directories(prop.location), prop.location), prop.location

    def reading(self, path: Path, location: Location) -> None:
        """Counts the settings with which a file is read; each takes memory.

        Raises:
            SceneError: they are too many.
        """
        self.settings[path] = self.settings.get(path, 0) + 1
        if self.settings[path] > MOST_SETTINGS:
            raise SceneError(f'"{path}" is used with more than {MOST_SETTINGS} different settings', location)

    # Plugins

    def plugin(self, node: Node) -> Plugin | None:
        """The plugin of a node, ignoring the case of its name."""
        return self.table.get(node.kind, {}).get(node.plugin.lower())

    def construct(self, node: Node) -> Content:
        """The result of the node's plugin, or of its replacement; None if the node is ignored.

        Raises:
            SceneError: the object cannot be built, or, when strict, is not known.
        """
        known = self.known(node)
        plugin = self.plugin(known) if known else None
        if known is None or plugin is None:
            return None
        try:
            with blamed_on(node.location, str(node)):
                return plugin.build(self, known, self.values(known, plugin))
        except MissingFile as problem:
            if node.kind not in DISPENSABLE:
                raise
            self.diagnostics.unknown(f"{problem.message}; {node} is ignored", problem.location)
            return None

    def known(self, node: Node) -> Node | None:
        """The node itself if its plugin is known, else its replacement, with a warning."""
        if self.plugin(node) is not None:
            return node
        names = self.table.get(node.kind, {})
        nested = next((child for _, child in node.children(node.kind)), None)
        name = substitute_for(node, names, nested)
        if name is DROPPED:
            hint = did_you_mean(node.plugin, names, limit=0)
            self._report_substitute(node, f"it is ignored{hint}")
            return None
        if name is NESTED and nested is not None:
            lost = [prop for prop in node.properties if prop.value is not nested]
            self._report_substitute(node, f"the {nested} inside it is used", lost)
            return self.known(nested)
        plugin = names[name]
        kept, lost = node.properties, []
        if name != misspelt(node, names):  # what another plugin has is no mistake of the file's
            known = {f.name for f in plugin.fields}
            properties = for_substitute(node)
            kept = [p for p in properties if p.name in known or is_child(p.value, plugin)]
            lost = [p for p in properties if p not in kept]
        self._report_substitute(node, f'"{plugin.name}" is used', lost)
        return Node(node.kind, plugin.name, node.location, node.plugin_location, node.id, kept)

    def _report_substitute(self, node: Node, used: str, lost: Iterable[Property] = ()) -> None:
        """Reports what replaces an unknown plugin, and which of its properties are lost."""
        harmless = HARMLESS.get(node.kind, ())
        names = [f'"{p.name}"' if p.name else f"the {p.value}" for p in lost if p.name not in harmless]
        without = f", without {', '.join(names)}" if names else ""
        if node.plugin:
            self.diagnostics.unknown(f"unknown {node}; {used}{without}", node.plugin_location)
        elif names:  # that there is none was warned about
            self.diagnostics.unknown(f"{used} for the {node}{without}", node.plugin_location)

    def values(self, node: Node, plugin: Plugin) -> dict[str, Any]:
        """The node's properties as fields of the plugin; unknown ones are warned about."""
        fields = {f.name: f for f in plugin.fields}
        values: dict[str, Any] = {}
        for name, prop in named(node, fields):
            if _is_texture(prop.value) and self.texture(prop.value) is None:
                continue  # left out, as was warned about
            if name in fields and not is_child(prop.value, plugin):
                if _is_texture(prop.value) and not self.fits(prop.value, fields[name]):
                    self.report_texture(node, prop.name)
                    continue
                values[name] = convert(self, node, prop, fields[name])
            elif not is_child(prop.value, plugin) and prop.name not in HARMLESS.get(node.kind, ()):
                self.report_unknown(node, prop, fields)
        return values

    def fits(self, texture: Node, field: Field) -> bool:
        """Whether a field accepts this texture; constant textures count as their value."""
        return field.type in TEXTURED or not isinstance(self.texture(texture), dict)

    def report_texture(self, node: Node, name: str) -> None:
        """Reports a texture for a parameter that must be constant."""
        message = f'"{name}" of {node} takes no texture; the default is used'
        self.diagnostics.unknown(message, node.property_location(name))

    def report_unknown(self, node: Node, prop: Property, fields: Iterable[str]) -> None:
        """Reports a property that the plugin does not have."""
        if prop.name:
            problem = f'{node} has no property "{prop.name}"{did_you_mean(prop.name, fields)}'
        else:
            problem = f"{node} does not support the {prop.value}"
        self.diagnostics.unknown(problem, prop.name_location)

    def picture(self, node: Node) -> Picture:
        """The outputs of an integrator."""
        result = self.construct(node)
        return result if isinstance(result, Picture) else Picture(result)

    # Shared objects

    def texture(self, node: Node) -> Content:
        """The value of a texture: a colour, or `{"texture": index}`. A texture used twice is built once."""
        if node not in self.built:
            value = self.construct(node)
            if isinstance(value, dict) and "type" in value:
                value = {"texture": self.add("textures", value, node)}
            self.built[node] = value
        return self.built[node]

    def number_texture(self, node: Node, value: dict[str, int]) -> dict[str, int]:
        """A texture that is read as a number: Mitsuba 3 exchanges the colours of checkerboards then."""
        entry = self.textures[value["texture"]]
        if entry["type"] != "checkerboard" or node.version < (2, 0, 0):
            return value
        if ("numbers", node) not in self.files:
            first, second = entry.get("color0", 0.4), entry.get("color1", 0.2)
            exchanged = {**entry, "color0": second, "color1": first}
            self.files["numbers", node] = self.add("textures", exchanged, node)
        return {"texture": self.files["numbers", node]}

    def volume(self, node: Node) -> Content:
        """The value of a volume: a colour, or `{"volume": index}`."""
        if node not in self.built:
            value = self.construct(node)
            is_entry = isinstance(value, dict) and "type" in value
            self.built[node] = {"volume": self.add("volumes", value, node)} if is_entry else value
        return self.built[node]

    def index(self, node: Node) -> int:
        """The index of a phase function or a medium in its list; -1 when it is ignored."""
        if node not in self.built:
            entry = self.construct(node)
            self.built[node] = -1 if entry is None else self.add(LISTS[node.kind], entry, node)
        return self.built[node]

    def slot(self, node: Node) -> Slot | None:
        """The material slot of a bsdf; None when it is ignored."""
        if node not in self.built:
            result = self.construct(node)
            self.built[node] = (
                Slot(self.add_once("bsdfs", result, node)) if isinstance(result, dict) else result
            )
        return self.built[node]

    def add(self, where: str, entry: dict[str, Any], node: Node) -> int:
        """Adds an entry to a list of the description; its index."""
        entries: list[dict[str, Any]] = getattr(self, where)
        if where == "textures":
            self._count_lookups(entry, node)
        self.places[f"{where}[{len(entries)}]"] = node.location
        entries.append(entry)
        return len(entries) - 1

    def _count_lookups(self, entry: dict[str, Any], node: Node) -> None:
        """Limits lookups: textures that use each other twice double the time at every level."""
        inner = (value["texture"] for value in entry.values() if isinstance(value, dict))
        lookups = 1 + sum(self.lookups[index] for index in inner)
        if lookups > MOST_LOOKUPS:
            message = f"{node} needs more than {MOST_LOOKUPS} texture lookups per point"
            raise SceneError(message, node.location)
        self.lookups.append(lookups)

    def add_once(self, where: str, entry: dict[str, Any], node: Node) -> int:
        """The index of an entry of a list; the same one is not added twice."""
        key = repr((where, entry))
        if key not in self.indices:
            if where == "bsdfs":
                self.transmissive.append(self._is_transmissive(entry, node))
            self.indices[key] = self.add(where, entry, node)
        return self.indices[key]

    def _is_transmissive(self, entry: dict[str, Any], node: Node) -> bool:
        """Lets the core validate the values."""
        try:
            return bool(self.core.transmissive(entry))
        except self.core.DescriptionError as problem:
            raise SceneError(str(problem).removeprefix("bsdf."), node.location) from None

    def adapt(self, node: Node, plugin: str, values: dict[str, Any], **children: MaterialId) -> AdapterId:
        """An adapter around materials."""
        entry = {"type": plugin, **values, **{name: _described(child) for name, child in children.items()}}
        return AdapterId(self.add_once("adapters", entry, node))

    def bsdfs_of(self, material: MaterialId) -> Iterator[int]:
        """The indices of the bsdfs that a material is made of, each once."""
        waiting, met = [material], {material, BLACK}
        while waiting:
            part = waiting.pop()
            if not isinstance(part, AdapterId):
                if part != BLACK:
                    yield part
                continue
            for name in ("first", "second", "child"):
                child = self.adapters[part.index].get(name, BLACK)
                child = AdapterId(child["adapter"]) if isinstance(child, dict) else child
                if child not in met:
                    met.add(child)
                    waiting.append(child)

    def add_material(self, slot: Slot, shape: Node) -> int:
        """The index of a shape's material slot; the same one is not added twice."""
        if slot not in self.slots:
            entry = {"front": _described(slot.front), "back": _described(slot.back)}
            self.slots[slot] = self.add("materials", entry, shape)
        return self.slots[slot]


def _described(material: MaterialId) -> Content:
    return {"adapter": material.index} if isinstance(material, AdapterId) else material


def named(node: Node, fields: Mapping[str, Field]) -> Iterator[tuple[str, Property]]:
    """The properties with the names of the fields that they mean.

    Phase functions go to the fields of their type, in order, unless they are named as one.
    """
    given = {prop.name for prop in node.properties}
    free = [f.name for f in fields.values() if f.type == "phase" and f.name not in given]
    for prop in node.properties:
        unnamed = isinstance(prop.value, Node) and prop.value.kind == "phase" and prop.name not in fields
        yield free.pop(0) if unnamed and free else prop.name, prop


def _is_texture(value: object) -> TypeGuard[Node]:
    return isinstance(value, Node) and value.kind == "texture"


def is_child(value: object, plugin: Plugin) -> bool:
    return isinstance(value, Node) and value.kind in plugin.children
