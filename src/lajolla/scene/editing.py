"""Values from Python as those of a description's entries, checked like those of scene files and dicts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from lajolla import _core

from .description.bounds import bounds_of
from .description.builder import Builder, plugins_by_kind
from .description.plugin import Entry, Use
from .description.plugins.emitters import panorama
from .description.plugins.textures import bitmap_image, pixels_from_python
from .description.plugins.volumes import grid_values
from .description.substitutes import SUBSTITUTES
from .description.values import clamp_texture, convert, in_range_of
from .schema import TEXTURED, Field
from .syntax.dict_reader import value_from_python
from .syntax.errors import Blame, Diagnostics, Location, SceneWarning, Source
from .syntax.nodes import Node, Property
from .syntax.resolve import resolve
from .versions.upgrade import upgrade


class Editor:
    """Converts values for entries of a description; textures given as dicts are added to its list."""

    def __init__(self, textures: Sequence[Entry], name: str = "params") -> None:
        self._textures = textures
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

    def in_range(self, kind: str, model: str, field: Field, use: Use, path: str) -> Use:
        """A texture whose values are in the range of a field that has it already."""
        location = self.location(path)
        owner = Node(kind, model, location, location)
        return in_range_of(self._builder, owner, use, Property(field.name, owner, location, location), field)

    @property
    def _builder(self) -> Builder:
        if self._seeded is None:
            self._seeded = Builder(Diagnostics(), [Path.cwd()])
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


def _is_use(given: object) -> TypeGuard[Use]:
    return isinstance(given, dict) and len(given) == 1 and next(iter(given)) in ("texture", "volume")
