"""Values from Python as those of a description's entries, checked like those of scene files and dicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from lajolla import _core

from .description.bounds import bounds_of
from .description.builder import Builder, plugins_by_kind
from .description.entries import Entries
from .description.plugin import AdapterId, Entry, MaterialId, Use
from .description.plugins.emitters import panorama
from .description.plugins.textures import bitmap_image, pixels_from_python
from .description.plugins.volumes import grid_values
from .description.substitutes import SUBSTITUTES
from .description.values import clamp_texture, convert, in_range_of
from .schema import TEXTURED, Field
from .syntax.dict_reader import OF_DICTS, give_back_lost_light, value_from_python
from .syntax.errors import Blame, Diagnostics, Location, SceneError, SceneWarning, Source
from .syntax.nodes import Node, Property
from .syntax.resolve import resolve
from .versions.upgrade import upgrade


@dataclass(frozen=True)
class Made:
    """A new material: its entries by names of their own ("bsdfs[0]"), each after those that it contains, with
    ids, plugins and terminators, and what is on its sides."""

    entries: Mapping[str, Entry]
    ids: Mapping[str, str]
    plugins: Mapping[str, str]
    terminators: Mapping[str, str]
    front: int | Mapping[str, int]
    back: int | Mapping[str, int]
    terminator: str


class Editor:
    """Converts values for entries of a description; textures given as dicts are added to its list."""

    def __init__(
        self,
        textures: Sequence[Entry],
        name: str = "params",
        *,
        two_sided: bool = False,
        terminator: str = "none",
    ) -> None:
        self._textures = textures
        self._two_sided = two_sided
        self._terminator = terminator
        self._source = Source(name, b"", Path.cwd())
        self._seeded: Builder | None = None

    @property
    def warnings(self) -> list[SceneWarning]:
        """Differences between the values and what they became, such as colours that were clamped."""
        return self._builder.diagnostics.warnings if self._seeded else []

    @property
    def textures(self) -> Sequence[Entry]:
        """The textures of the description, with their changes, and then those that the values contain."""
        return self._builder.textures.stored if self._seeded else self._textures

    def put_texture(self, index: int, entry: Entry) -> bool:
        """Changes a texture of the description; whether the bounds of its values may differ then."""
        builder = self._builder
        before = bounds_of(builder, {"texture": index})
        builder.textures.stored[index] = entry
        for key in [key for key in builder.made if isinstance(key, tuple) and key[0] == "bounds"]:
            del builder.made[key]
        return bounds_of(builder, {"texture": index}) != before

    def location(self, path: str) -> Location:
        """What messages about a parameter begin with."""
        return Location(self._source, key=path)

    def value(self, kind: str, model: str, field: Field, given: object, path: str) -> Any:  # noqa: ANN401
        """A value for a field of one of the core's models.

        Args:
            kind, model: as in the schema.
            field: of that model.
            given: a Python value; {"texture": index} for a texture that is there.
            path: of the parameter, for messages.

        Raises:
            SceneError: it is of another type or out of range.
        """
        location = self.location(path)
        owner = Node(kind, model, location, location)
        with Blame(location, owner), np.errstate(all="ignore"):
            if _is_use(given):
                if field.type not in TEXTURED:
                    return given
                prop = Property(field.name, owner, location, location)
                return clamp_texture(self._builder, owner, given, prop, field)
            if field.type == "image":
                return self._image(owner, given)
            if field.type == "grid":
                return given if isinstance(given, _core.Grid) else _core.Grid(grid_values(owner, given))
            return convert(self._builder, owner, self._property(field.name, given, path), field)

    def material(self, given: Mapping[str, Any] | Node, path: str) -> Made:
        """A new material.

        Args:
            given: a dict as in a scene, or a bsdf of the scene of which nothing was made yet.
            path: of the parameter, for messages.

        Raises:
            SceneError: it is no bsdf, or cannot be built.
        """
        builder, location = self._builder, self.location(path)
        with Blame(location), np.errstate(all="ignore"):
            node = given if isinstance(given, Node) else self._bsdf_node(given, path)
            slot = builder.slot(node)
            if slot is None:
                raise SceneError(f"there is no {node}", location)
            builder.terminator = self._terminator if isinstance(given, Node) else OF_DICTS.terminator
            slot = builder.finished(slot)
        entries = {f"{where}[{i}]": e for where in ADDED for i, e in enumerate(getattr(builder, where))}
        known = builder.objects
        ids = {name: own for name, own in known.ids.items() if name in entries}
        plugins = {name: own for name, own in known.plugins.items() if name in entries}
        for where in ADDED:
            setattr(builder, where, Entries())
        builder.transmissive, builder.indices, builder.materials_of = [], {}, {}
        terminators = {name: known.terminators.get(name, builder.terminator) for name in entries}
        builder.terminators, known.terminators = {}, {}
        front, back = _reference(slot.front), _reference(slot.back)
        return Made(entries, ids, plugins, terminators, front, back, slot.terminator)

    def _bsdf_node(self, given: Mapping[str, Any], path: str) -> Node:
        prop = self._property("bsdf", given, path)
        if not isinstance(prop.value, Node) or prop.value.kind != "bsdf":
            raise SceneError(f"expected a bsdf, got {prop.value}", prop.location)
        return prop.value

    def in_range(self, kind: str, model: str, field: Field, use: Use, path: str) -> Use:
        """A texture whose values are in the range of a field that has it already."""
        location = self.location(path)
        owner = Node(kind, model, location, location)
        return in_range_of(self._builder, owner, use, Property(field.name, owner, location, location), field)

    @property
    def _builder(self) -> Builder:
        if self._seeded is None:
            self._seeded = Builder(Diagnostics(), [Path.cwd()], two_sided=self._two_sided)
            for entry in self._textures:
                self._seeded.textures.add(entry)
                self._seeded.lookups.append(1)
        return self._seeded

    def _property(self, name: str, given: object, path: str) -> Property:
        builder, location = self._builder, self.location(path)
        value, tree = value_from_python(given, path, self._source, plugins_by_kind(), SUBSTITUTES)
        prop = Property(name, value, location, location)
        if tree.nodes:
            tree.root.properties.append(prop)
            give_back_lost_light(tree.nodes)
            upgrade(tree.nodes, builder.table, builder.diagnostics)
            resolve(tree)
        return prop

    def _image(self, owner: Node, given: object) -> _core.Image:
        if isinstance(given, _core.Image):
            return given
        found = pixels_from_python(owner, {"data": given})
        assert found is not None
        pixels, is_integer = found
        if owner.kind == "emitter":
            return panorama(self._builder, pixels, is_integer, "the array", owner.location)
        return bitmap_image(pixels, encoded=is_integer)


ADDED = ("bsdfs", "adapters")


def _reference(material: MaterialId) -> int | dict[str, int]:
    return {"adapter": material.index} if isinstance(material, AdapterId) else material


def _is_use(given: object) -> TypeGuard[Use]:
    return isinstance(given, dict) and len(given) == 1 and next(iter(given)) in ("texture", "volume")
