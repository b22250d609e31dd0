"""Declarations of plugins, the results of their `build`, and the `Context` that they build in."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, TypeAlias, TypeVar

from lajolla.film import Film
from lajolla.picture_files import Budget

from ..schema import INNER_KINDS, Field, Schema, fields_of
from ..syntax.errors import Diagnostics, Location
from ..syntax.nodes import Blackbody, Node, Property, Rgb, Spectrum, Vector
from .outputs import Layer, Picture

Made = TypeVar("Made")

# An entry of the description: "type", and values of that model's fields. The fields are declared in C++;
# values are checked when they are converted to the type of the field, and when the core builds the model.
Entry: TypeAlias = dict[str, Any]
Values: TypeAlias = dict[str, Any]  # of a plugin's fields, converted, by name
Use: TypeAlias = dict[str, int]  # {"texture": index} or {"volume": index}
Colour: TypeAlias = tuple[float, ...]  # linear sRGB; six numbers for some volumes
Constant: TypeAlias = float | Vector | Rgb | Spectrum | Blackbody  # a constant texture


@dataclass(frozen=True)
class AdapterId:
    """An entry of the description's adapters."""

    index: int


BLACK = -1
MaterialId: TypeAlias = int | AdapterId  # the index of a bsdf, an adapter, or BLACK


@dataclass(frozen=True)
class Slot:
    """A material slot: the materials of the front and of the back, and what is done at the terminator."""

    front: MaterialId
    back: MaterialId = BLACK
    terminator: str = ""  # none is said


@dataclass(frozen=True)
class Part:
    """One of several shapes that replace a shape of the file, and its bsdf; None: the default one."""

    entry: Entry
    bsdf: Node | None


@dataclass(frozen=True)
class FilmPart:
    """A film: the size of the picture, its output settings, and its layers for `multichannel`."""

    entry: Entry
    film: Film
    layers: tuple[Layer, ...]


# The result of `Plugin.build`: an entry; for emitters also several; for textures and volumes also a constant,
# or a reference to another one; for bsdfs also a slot; for shapes also several parts; None omits the object.
Built: TypeAlias = Entry | list[Entry] | list[Part] | Constant | Colour | Slot | Picture | FilmPart | None


class Context(Protocol):
    """The interface through which plugins access the description under construction."""

    diagnostics: Diagnostics
    pictures: Budget
    sky_pixels: int  # in all computed skies so far
    subdivision_triangles: int  # of all subdivision surfaces so far

    @property
    def film(self) -> Film:
        """The output settings of the film."""

    @property
    def layers(self) -> tuple[Layer, ...]:
        """The film's settings for the integrators in `multichannel`."""

    def camera(self) -> Entry | None:
        """The entries "sensor" and "film" of the scene's camera; None if it has none."""

    def directories(self, location: Location) -> list[Path]:
        """The folders in which files named by an object are searched."""

    def find(self, node: Node, name: str = "filename") -> tuple[Path, Location]:
        """The file that a property names, and the location of the name."""

    def reading(self, path: Path, location: Location) -> None:
        """Counts the settings with which a file is read, because each takes memory; too many are an error."""

    def note_exchanged(self, texture: int) -> None:
        """Notes that the colours of a texture are not in the file's order."""

    def once(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """The result of `make`, which is called once per key."""

    def read(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """The same for the content of a file, which may be known from another scene.

        The key has the file's `identity` and everything else that the result depends on.
        """

    def convert(self, owner: Node, prop: Property, field: Field) -> Any:  # noqa: ANN401
        """A property's value, converted to the type of a field."""

    def declared(self, kind: str, plugin: str) -> tuple[Field, ...]:
        """The fields of a plugin."""

    def report_texture(self, node: Node, name: str) -> None:
        """Reports a texture for a parameter that must be constant."""

    def texture(self, node: Node) -> Use | Constant | None:
        """The value of a texture."""

    def volume(self, node: Node) -> Use | Colour | None:
        """The value of a volume."""

    def index(self, node: Node) -> int:
        """The index of a phase function or a medium in its list; -1 if it is ignored."""

    def slot(self, node: Node) -> Slot | None:
        """The material slot of a bsdf; None if it is ignored."""

    def picture(self, node: Node) -> Picture:
        """The integrator whose radiance is the picture, and the channels beside it."""

    def entry(self, where: str, index: int) -> Entry:
        """An entry of one of the description's lists."""

    def add(self, where: str, entry: Entry, node: Node) -> int:
        """Adds an entry to a list of the description and returns its index."""

    def add_once(self, where: str, entry: Entry, node: Node) -> int:
        """The index of an entry in a list of the description; adds it if no equal entry is there."""

    def adapt(self, node: Node, plugin: str, values: Values, **children: MaterialId) -> AdapterId:
        """Adds an adapter around materials."""

    def lets_light_through(self, material: MaterialId) -> bool:
        """Whether any part of a material is transmissive."""


@dataclass(frozen=True)
class Plugin:
    """A plugin of scene files.

    `build(context, node, values)` gets the converted values of the given properties; `Built` lists what it
    returns for each kind.
    """

    kind: str
    name: str
    doc: str  # empty: the doc of the core model with the same name
    fields: tuple[Field, ...]
    build: Callable[[Context, Node, Values], Built]
    children: tuple[str, ...] = ()
    model: str = ""  # the core model that it builds and whose fields it shares
    hidden: tuple[str, ...] = ()  # fields of the model that scenes do not set
    in_runs: bool = False  # `build` accepts columns of values

    @cached_property
    def by_name(self) -> Mapping[str, Field]:
        """The fields by their names."""
        return {field.name: field for field in self.fields}

    def with_model(self, schema: Schema) -> Plugin:
        """The same plugin with the fields of its core model before its own, and its doc if it has none."""
        kind = next((inner for inner in INNER_KINDS if self.model in schema.get(inner, {})), self.kind)
        doc = self.doc or schema.get(kind, {}).get(self.name, {"doc": ""})["doc"]
        shared = fields_of(schema, kind, self.model) if self.model else ()
        own = {f.name for f in self.fields}
        kept = [f for f in shared if f.name not in own and f.name not in self.hidden]
        return replace(self, doc=doc, fields=(*kept, *self.fields), hidden=())

    def described(self) -> dict[str, Any]:
        """The plugin in the form of `_core.schema()`."""
        return {"doc": self.doc, "fields": [asdict(f) | {"choices": list(f.choices)} for f in self.fields]}


def is_child(value: object, plugin: Plugin) -> bool:
    """Whether a value is an object that the plugin may contain without a field for it."""
    return isinstance(value, Node) and value.kind in plugin.children
