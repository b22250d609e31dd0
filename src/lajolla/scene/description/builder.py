"""Nodes to the description that the core takes."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeGuard, TypeVar, cast

from lajolla import _core
from lajolla.film import Film
from lajolla.picture_files import Budget

from ..schema import (
    CHILDREN,
    HARMLESS,
    INNER_KINDS,
    TEXTURED,
    Field,
    core_schema,
    fields_of,
    terminator_field,
)
from ..syntax.errors import Blame, Diagnostics, Location, SceneError, did_you_mean
from ..syntax.files import MissingFile, find_file
from ..syntax.nodes import Node, Property
from .entries import Entries, Objects, Places, View
from .outputs import Layer, Picture
from .plugin import (
    BLACK,
    AdapterId,
    Built,
    Colour,
    Constant,
    Context,
    Entry,
    MaterialId,
    Plugin,
    Slot,
    Use,
    Values,
    is_child,
)
from .plugins import READER_PLUGINS
from .substitutes import DROPPED, NESTED, for_substitute, misspelt, substitute_for
from .values import convert

Made = TypeVar("Made")

# Objects that a scene can do without: one whose file is missing is left out.
DISPENSABLE = ("texture", "bsdf", "shape", "emitter", "medium")

MOST_SETTINGS = 32  # settings with which one file is read
MOST_LOOKUPS = 1024  # that one texture may take

# A property of all emitters.
LIGHTGROUP = Field("lightgroup", "string", "name of the group of lights that it is in, for a layer", "")
REST = "rest"  # the layer of lights without a group
TERMINATOR = "terminator"  # a property of all bsdfs
MOST_LIGHT_GROUPS = 256  # as in the core

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
        if kind in INNER_KINDS:
            continue  # the reader's own plugins make them
        for name in models:
            table.setdefault(kind, Plugins()).makers[name.lower()] = partial(_of_model, kind, name)
    for plugin in READER_PLUGINS:
        table.setdefault(plugin.kind, Plugins()).makers[plugin.name.lower()] = partial(
            plugin.with_model, schema
        )
    for kind, common in (("emitter", LIGHTGROUP), ("bsdf", terminator_field())):
        makers = table[kind].makers
        makers.update({name: partial(_having, make, common) for name, make in makers.items()})
    return table


def _having(make: Callable[[], Plugin], field: Field) -> Plugin:
    plugin = make()
    return replace(plugin, fields=(*plugin.fields, field))


def _of_model(kind: str, name: str) -> Plugin:
    """A model of the core as a plugin."""
    schema = core_schema()
    fields, doc = fields_of(schema, kind, name), schema[kind][name]["doc"]

    def build(context: Context, node: Node, values: Values) -> Entry:
        return {"type": name, **values}

    in_runs = kind in ("shape", "bsdf")
    return Plugin(kind, name, doc, fields, build, CHILDREN.get(kind, ()), model=name, in_runs=in_runs)


@dataclass(frozen=True)
class FileContent:
    """What was made of a file, and the warnings about it."""

    made: object
    warnings: tuple[tuple[str, Location | None], ...]


@dataclass(frozen=True)
class Construction:
    """How a node was built."""

    node: Node | None  # the node itself, or its replacement; None if it is ignored
    values: Values
    result: Built


@dataclass
class Builder:
    """Builds a description."""

    diagnostics: Diagnostics
    search_paths: list[Path]
    two_sided: bool = False
    integrator: str | None = None  # in place of the scene's
    sensor: str | int | None = None  # which one of several, by id or number
    table: Mapping[str, Mapping[str, Plugin]] = field(default_factory=plugins_by_kind)
    textures: Entries = field(default_factory=Entries)
    lookups: list[int] = field(default_factory=list)  # of each texture, how many it takes
    bsdfs: Entries = field(default_factory=Entries)
    transmissive: list[bool] = field(default_factory=list)  # of each bsdf, whether light passes through
    adapters: Entries = field(default_factory=Entries)
    materials: Entries = field(default_factory=Entries)
    emitters: Entries = field(default_factory=Entries)
    shapes: Entries = field(default_factory=Entries)
    volumes: Entries = field(default_factory=Entries)
    phases: Entries = field(default_factory=Entries)
    media: Entries = field(default_factory=Entries)
    groups: Entries = field(default_factory=Entries)
    instances: Entries = field(default_factory=Entries)
    film: Film = field(default_factory=Film)  # how the picture is written
    light_groups: list[str] = field(default_factory=list)  # names; the first has number 1
    layers: tuple[Layer, ...] = ()  # what the film says of integrators in `multichannel`
    uses: dict[Node, Built] = field(default_factory=dict)  # of textures and volumes
    materials_of: dict[Node, Slot | None] = field(default_factory=dict)  # bsdfs
    terminators: dict[Node, str] = field(default_factory=dict)  # of bsdfs that set theirs
    terminator: str = "none"  # of others
    branches: dict[Node, str] = field(default_factory=dict)  # of bsdfs without an id in others, but the first
    indices_of: dict[Node, int] = field(default_factory=dict)  # phase functions and media
    indices: dict[str, int] = field(default_factory=dict)  # of bsdfs and adapters by what they are
    slots: dict[Slot, int] = field(default_factory=dict)
    places: Places = field(default_factory=Places)
    objects: Objects = field(default_factory=Objects)
    views: dict[str, View] = field(default_factory=dict)  # of the cameras beside the one that is used
    members: Callable[[Node], Iterator[Node]] = lambda node: iter((node,))  # of a run, one by one
    pictures: Budget = field(default_factory=Budget)
    sky_pixels: int = 0  # of the pictures of skies
    subdivision_triangles: int = 0
    camera: Callable[[], Entry | None] = lambda: None  # the scene's, with its film
    settings: dict[Path, int] = field(default_factory=dict)  # number of settings each file is read with
    kept: dict[Node, Construction] | None = None  # how nodes were built, for the way out
    made: dict[Hashable, object] = field(default_factory=dict)  # by `once`
    files: dict[Hashable, FileContent] = field(default_factory=dict)  # by `read`
    known_files: Mapping[Hashable, FileContent] = field(default_factory=dict)  # of another scene
    found: dict[tuple[str, str], Plugin | None] = field(default_factory=dict)  # by kind and name as written

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

    def once(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """What was made for this key before, or is made now."""
        if key not in self.made:
            self.made[key] = make()
        return cast("Made", self.made[key])

    def read(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """The content of a file, made now unless this or another scene has it."""
        if key in self.files:
            return cast("Made", self.files[key].made)
        if key in self.known_files:
            content = self.known_files[key]
            for message, location in content.warnings:
                self.diagnostics.warn(message, location)
        else:
            count = len(self.diagnostics.collected)
            made = make()
            warnings = list(self.diagnostics.collected.values())[count:]
            content = FileContent(made, tuple((w.message, w.location) for w in warnings))
        self.files[key] = content
        return cast("Made", content.made)

    # Plugins

    def plugin(self, node: Node) -> Plugin | None:
        """The plugin of a node, ignoring the case of its name."""
        key = node.kind, node.plugin
        if key not in self.found:
            plugins, name = self.table.get(node.kind, {}), node.plugin.lower()
            self.found[key] = plugins[name] if name in plugins else None  # noqa: SIM401, a Mapping's is slow
        return self.found[key]

    def construct(self, node: Node) -> Built:
        """The result of the node's plugin, or of its replacement; None if the node is ignored.

        It is made anew whenever it is asked for.

        Raises:
            SceneError: the object cannot be built, or, when strict, is not known.
        """
        known = self.known(node)
        plugin = self.plugin(known) if known else None
        values: Values = {}
        result = None
        if known is not None and plugin is not None:
            try:
                with Blame(node.location, node):
                    values = self.values(known, plugin)
                    group = values.pop(LIGHTGROUP.name, "") if known.kind == "emitter" else ""
                    if known.kind == "bsdf" and (terminator := values.pop(TERMINATOR, "")):
                        self.terminators[node] = terminator
                    result = plugin.build(self, known, dict(values) if self.kept is not None else values)
                    if group:
                        self._set_light_group(known, group, result)
            except MissingFile as problem:
                if node.kind not in DISPENSABLE:
                    raise
                self.diagnostics.unknown(f"{problem.message}; {node} is ignored", problem.location)
                known = None
        if self.kept is not None:
            self.kept[node] = self.kept[known or node] = Construction(known, values, result)
        return result

    def _set_light_group(self, node: Node, group: str, lights: Built) -> None:
        location = node.property_location(LIGHTGROUP.name)
        if not re.fullmatch(r"[\w-]+", group) or group == REST:
            message = f'"{group}" is no name of a light group: letters, digits, "_" and "-", and not "{REST}"'
            raise SceneError(message, location)
        if group not in self.light_groups:
            if len(self.light_groups) == MOST_LIGHT_GROUPS:
                raise SceneError(f"more than {MOST_LIGHT_GROUPS} light groups", location)
            self.light_groups.append(group)
        for light in lights if isinstance(lights, list) else [lights]:
            if isinstance(light, dict):
                light[LIGHTGROUP.name] = self.light_groups.index(group) + 1

    def construction(self, node: Node) -> Construction:
        """How a node was built; for a builder that keeps that."""
        assert self.kept is not None
        if node not in self.kept:
            self.construct(node)
        return self.kept[node]

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
        return replace(node, plugin=plugin.name, properties=kept)

    def _report_substitute(self, node: Node, used: str, lost: Iterable[Property] = ()) -> None:
        """Reports what replaces an unknown plugin, and which of its properties are lost."""
        harmless = HARMLESS.get(node.kind, ())
        names = [f'"{p.name}"' if p.name else f"the {p.value}" for p in lost if p.name not in harmless]
        without = f", without {', '.join(names)}" if names else ""
        if node.plugin:
            self.diagnostics.unknown(f"unknown {node}; {used}{without}", node.plugin_location)
        elif names:  # that there is none was warned about
            self.diagnostics.unknown(f"{used} for the {node}{without}", node.plugin_location)

    def values(self, node: Node, plugin: Plugin) -> Values:
        """The node's properties as fields of the plugin; unknown ones are warned about."""
        fields = plugin.by_name
        values: Values = {}
        for name, prop in named(node, fields):
            if _is_texture(prop.value) and self.texture(prop.value) is None:
                continue  # left out, as was warned about
            if is_child(prop.value, plugin):
                continue
            if name in fields:
                if _is_texture(prop.value) and not self.fits(prop.value, fields[name]):
                    self.report_texture(node, prop.name)
                    continue
                values[name] = convert(self, node, prop, fields[name])
            elif prop.name not in HARMLESS.get(node.kind, ()):
                self.report_unknown(node, prop, fields)
        return values

    def convert(self, owner: Node, prop: Property, field: Field) -> Any:  # noqa: ANN401
        """A property's value as a field of that type."""
        return convert(self, owner, prop, field)

    def declared(self, kind: str, plugin: str) -> tuple[Field, ...]:
        """The fields of a plugin."""
        return self.table[kind][plugin.lower()].fields

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
        return result if isinstance(result, Picture) else Picture(_entry(result))

    # Shared objects

    def texture(self, node: Node) -> Use | Constant | None:
        """The value of a texture: a colour, or `{"texture": index}`. A texture used twice is built once."""
        return cast("Use | Constant | None", self._use(node, "texture", "textures"))

    def volume(self, node: Node) -> Use | Colour | None:
        """The value of a volume: a colour, or `{"volume": index}`."""
        return cast("Use | Colour | None", self._use(node, "volume", "volumes"))

    def _use(self, node: Node, name: str, where: str) -> Built:
        if node not in self.uses:
            value = self.construct(node)
            if isinstance(value, dict) and "type" in value:
                value = {name: self.add(where, value, node)}
            self.uses[node] = value
        return self.uses[node]

    def index(self, node: Node) -> int:
        """The index of a phase function or a medium in its list; -1 when it is ignored."""
        if node not in self.indices_of:
            entry = self.construct(node)
            self.indices_of[node] = -1 if entry is None else self.add(LISTS[node.kind], _entry(entry), node)
        return self.indices_of[node]

    def slot(self, node: Node) -> Slot | None:
        """The material slot of a bsdf; None when it is ignored."""
        if node not in self.materials_of:
            branch = self.branches.get(node, "")
            for i, (_, child) in enumerate(node.children("bsdf")):
                if not child.id and (branch or i > 0):
                    self.branches[child] = f"{branch}/{i}"
            if node.plugin.lower() == "twosided":
                self.objects.inherit(node, (child for _, child in node.children("bsdf")))
            result = self.construct(node)
            slot = Slot(self.add_once("bsdfs", result, node)) if isinstance(result, dict) else result
            if isinstance(slot, Slot):
                slot = replace(slot, terminator=self._terminator(node))
                if slot.terminator and node.plugin.lower() != "twosided":
                    self.objects.terminators.setdefault(_entry_name(slot.front), slot.terminator)
            self.materials_of[node] = cast("Slot | None", slot)
        return self.materials_of[node]

    def _terminator(self, node: Node) -> str:
        """What a bsdf says of the terminator, or those inside it together; "" for nothing.

        Raises:
            SceneError: they do not agree.
        """
        if node in self.terminators:
            return self.terminators[node]
        slots = [slot for _, child in node.children("bsdf") if (slot := self.slot(child)) is not None]
        said = sorted({slot.terminator for slot in slots if slot.terminator})
        if len(said) > 1:
            both = " and ".join(f'"{each}"' for each in said)
            message = f"the bsdfs inside {node} have the terminators {both}; {node} itself can say which"
            raise SceneError(message, node.location)
        return said[0] if said else ""

    def entry(self, where: str, index: int) -> Entry:
        """An entry of one of the description's lists."""
        entries: Entries = getattr(self, where)
        return entries[index]

    def add(self, where: str, entry: Entry, node: Node) -> int:
        """Adds an entry to a list of the description; its index."""
        entries: Entries = getattr(self, where)
        if where == "textures":
            self._count_lookups(entry, node)
        index = entries.add(entry)
        self.places[f"{where}[{index}]"] = node.location
        if where != "materials":  # they come from shapes, and are their bsdfs
            self.objects.note(f"{where}[{index}]", entry, node)
        return index

    def note_exchanged(self, texture: int) -> None:
        """Notes that the colours of a texture are not in the file's order."""
        self.objects.exchanged.add(f"textures[{texture}]")

    def _count_lookups(self, entry: Entry, node: Node) -> None:
        """Limits lookups: textures that use each other twice double the time at every level."""
        inner = (value["texture"] for value in entry.values() if isinstance(value, dict))
        lookups = 1 + sum(self.lookups[index] for index in inner)
        if lookups > MOST_LOOKUPS:
            message = f"{node} needs more than {MOST_LOOKUPS} texture lookups per point"
            raise SceneError(message, node.location)
        self.lookups.append(lookups)

    def add_once(self, where: str, entry: Entry, node: Node) -> int:
        """The index of an entry of a list; the same one is not added twice, unless objects with other ids, or
        in other places of a material, are the same: one of them may be changed later."""
        key = self.key_of(where, entry, self.objects.id_of(node) + self.branches.get(node, ""))
        if key not in self.indices:
            if where == "bsdfs":
                self.transmissive.append(self._is_transmissive(entry, node))
            self.indices[key] = self.add(where, entry, node)
        else:
            self.places.note_same(f"{where}[{self.indices[key]}]", node.location)
        return self.indices[key]

    @staticmethod
    def key_of(where: str, entry: Entry, name: str = "") -> str:
        """By what an entry of a list is known, with the id of its object and its place in a material."""
        return repr((where, entry, name))

    def _is_transmissive(self, entry: Entry, node: Node) -> bool:
        """Lets the core validate the values."""
        try:
            return bool(_core.transmissive(entry))
        except _core.DescriptionError as problem:
            raise SceneError(str(problem).removeprefix("bsdf."), node.location) from None

    def adapt(self, node: Node, plugin: str, values: Values, **children: MaterialId) -> AdapterId:
        """An adapter around materials."""
        entry = {"type": plugin, **values, **{name: _described(child) for name, child in children.items()}}
        return AdapterId(self.add_once("adapters", entry, node))

    def lets_light_through(self, material: MaterialId) -> bool:
        """Whether any part of a material is transmissive."""
        return any(self.transmissive[bsdf] for bsdf in self._bsdfs_of(material))

    def _bsdfs_of(self, material: MaterialId) -> Iterator[int]:
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
        slot = self.finished(slot)
        if slot not in self.slots:
            self.slots[slot] = self.add("materials", slot_entry(slot), shape)
        return self.slots[slot]

    def finished(self, slot: Slot) -> Slot:
        """A slot with what it leaves open: of opaque materials the back, and the terminator."""
        if self.two_sided and slot.back == BLACK and not self.lets_light_through(slot.front):
            slot = replace(slot, back=slot.front)
        return replace(slot, terminator=slot.terminator or self.terminator)


def _entry(result: Built) -> Entry:
    assert isinstance(result, dict)  # all else is for other kinds of plugins
    return result


def _entry_name(material: MaterialId) -> str:
    return f"adapters[{material.index}]" if isinstance(material, AdapterId) else f"bsdfs[{material}]"


def slot_entry(slot: Slot) -> Entry:
    """The entry of a finished slot."""
    said = {} if slot.terminator == "none" else {TERMINATOR: slot.terminator}
    return {"front": _described(slot.front), "back": _described(slot.back), **said}


def _described(material: MaterialId) -> int | dict[str, int]:
    return {"adapter": material.index} if isinstance(material, AdapterId) else material


def named(node: Node, fields: Mapping[str, Field]) -> list[tuple[str, Property]]:
    """The properties with the names of the fields that they mean.

    Phase functions go to the fields of their type, in order, unless they are named as one.
    """
    result = [(prop.name, prop) for prop in node.properties]
    unnamed = [i for i, (name, prop) in enumerate(result) if _is_phase(prop.value) and name not in fields]
    if unnamed:
        given = {prop.name for prop in node.properties}
        free = [f.name for f in fields.values() if f.type == "phase" and f.name not in given]
        for i, name in zip(unnamed, free, strict=False):
            result[i] = name, result[i][1]
    return result


def _is_phase(value: object) -> bool:
    return isinstance(value, Node) and value.kind == "phase"


def _is_texture(value: object) -> TypeGuard[Node]:
    return isinstance(value, Node) and value.kind == "texture"
