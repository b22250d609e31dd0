"""In what two descriptions of the same scene differ."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from lajolla.params.materials import terminator_of
from lajolla.params.objects import (
    KINDS,
    MATERIAL,
    ONE_MODEL,
    SINGLE,
    Entry,
    Lists,
    SceneObject,
    names_by_entry,
)
from lajolla.params.values import WITH_OBJECTS
from lajolla.saving.values import differing_arrays, equal, material_entry
from lajolla.scene.schema import ROBUST

OUTPUTS = ("other_integrators", "channels")  # of integrators that show several things; options may add some
LISTS = (*KINDS, "materials", "groups")
MEDIA = ("interior", "exterior", "medium")


@dataclass
class Comparison:
    """Compares two descriptions, object by object, wherever textures and materials are in their lists.

    Attributes:
        names: of the objects of the first one, for paths.
    """

    first: Lists
    second: Lists
    names: Mapping[str, str]
    met: set[tuple[str, str]] = field(default_factory=set)

    def paths(self) -> Iterator[str]:
        """The paths of all parameters that differ."""
        for where in SINGLE:
            yield from self.entries(where, where, where)
        for where in () if self._same_lists() else ("shapes", "instances", "emitters"):
            counts = {lists.count(where) for lists in (self.first, self.second)}
            if len(counts) > 1:
                yield where
            for index in range(min(counts)):
                yield from self.entries(f"{where}[{index}]", f"{where}[{index}]", f"{where}[{index}]")
        for name in (*OUTPUTS, "groups"):
            if not equal(self.first.core.get(name), self.second.core.get(name)):
                yield "integrator" if name in OUTPUTS else name
        if bool(self.first.core.get("robust")) != bool(self.second.core.get("robust")):
            yield ROBUST

    def _same_lists(self) -> bool:
        """Whether all lists are the same, entry by entry: no object has to be looked at then."""
        return all(equal(self.first.core.get(name), self.second.core.get(name)) for name in LISTS)

    def entries(self, first: str, second: str, fallback: str) -> Iterator[str]:
        """The paths of what differs between an entry of either one, and what they refer to."""
        if (first, second) in self.met:
            return
        self.met.add((first, second))
        a, b = self.first.entry(first), self.second.entry(second)
        where = first.partition("[")[0]
        kind = KINDS.get(where, where)
        yield from self._values(a, b, kind, self.names.get(first, fallback))

    def _values(self, a: Entry, b: Entry, kind: str, name: str) -> Iterator[str]:
        model = ONE_MODEL.get(kind) or a["type"]
        if kind == "film":
            a, b = whole_window(a), whole_window(b)
        if model != (ONE_MODEL.get(kind) or b["type"]):
            yield f"{name}.type"
            return
        for declared in SceneObject(name, kind, model, "").fields.values():
            x, y = a.get(declared.name, declared.default), b.get(declared.name, declared.default)
            yield from self._field(declared.type, x, y, f"{name}.{declared.name}")
        if kind == "shape":
            yield from self._materials(a.get("material", -1), b.get("material", -1), name)
        for side in (side for side in MEDIA if side in a or side in b):
            yield from self._reference("media", a.get(side, -1), b.get(side, -1), f"{name}.{side}")
        if kind == "shape" and (a.get("emitter", -1) < 0) != (b.get("emitter", -1) < 0):
            yield f"{name}.emitter"
        if kind == "emitter" and a.get("lightgroup", 0) != b.get("lightgroup", 0):
            yield f"{name}.lightgroup"

    def _field(self, kind: str, x: Any, y: Any, path: str) -> Iterator[str]:  # noqa: ANN401
        if kind == "phase":
            yield from self._reference("phases", x, y, path)
        elif kind == MATERIAL:
            yield from self._material(x, y, path)
        elif kind == "bsdf" and isinstance(x, Mapping) and isinstance(y, Mapping):
            yield from self._values(x, y, "bsdf", path)
        elif (
            kind in WITH_OBJECTS
            and isinstance(x, Mapping)
            and isinstance(y, Mapping)
            and x.keys() == y.keys()
        ):
            (what, i), j = next(iter(x.items())), next(iter(y.values()))
            yield from self._reference(f"{what}s", i, j, path)
        elif kind == "mesh":
            yield from (f"{path.removesuffix('mesh')}{name}" for name in differing_arrays(x, y))
        elif not equal(x, y):
            yield path

    def _materials(self, x: int, y: int, name: str) -> Iterator[str]:
        if x < 0 or y < 0:
            yield from [f"{name}.bsdf"] if x != y else []
            return
        a, b = self.first.entry(f"materials[{x}]"), self.second.entry(f"materials[{y}]")
        for side in ("front", "back"):
            yield from self._material(a[side], b[side], f"{name}.bsdf")
        if terminator_of(a) != terminator_of(b):
            yield f"{self.names.get(material_entry(a['front']), f'{name}.bsdf')}.terminator"

    def _material(self, x: Any, y: Any, path: str) -> Iterator[str]:  # noqa: ANN401
        if x == -1 or y == -1 or isinstance(x, Mapping) != isinstance(y, Mapping):
            yield from [path] if x != y else []
        else:
            yield from self.entries(material_entry(x), material_entry(y), path)

    def _reference(self, where: str, x: int, y: int, path: str) -> Iterator[str]:
        if x < 0 or y < 0:
            yield from [path] if x != y else []
        else:
            yield from self.entries(f"{where}[{x}]", f"{where}[{y}]", path)


def comparison(
    first: Mapping[str, Any], second: Mapping[str, Any], objects: Mapping[str, SceneObject]
) -> Comparison:
    """Compares two descriptions; `objects` are those of the first one by their names."""
    return Comparison(Lists(dict(first)), Lists(dict(second)), names_by_entry(objects))


def whole_window(film: Entry) -> Entry:
    """A film's entry with a window; without one, that is the whole film."""
    left, top = film.get("crop_offset_x", 0), film.get("crop_offset_y", 0)
    width = film.get("crop_width", 0) or film["width"] - left
    height = film.get("crop_height", 0) or film["height"] - top
    return {
        **film,
        "crop_offset_x": left,
        "crop_offset_y": top,
        "crop_width": width,
        "crop_height": height,
    }
