"""The objects of a scene's description, with readable names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain, count
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np

from lajolla.scene import Objects, core_schema
from lajolla.scene.schema import Field, fields_of

Entry: TypeAlias = Mapping[str, Any]

KINDS = {  # of the entries in the description's lists
    "textures": "texture",
    "bsdfs": "bsdf",
    "adapters": "adapter",
    "emitters": "emitter",
    "volumes": "volume",
    "phases": "phase",
    "media": "medium",
    "shapes": "shape",
    "instances": "instance",
}
SINGLE = ("integrator", "sensor", "film", "rfilter", "sampler")  # of which a scene has one; their own kinds
ONE_MODEL = {"film": "film", "instance": "instance"}  # kinds without "type"
MATERIAL = "material"  # the type of fields that refer to a bsdf or an adapter
MATERIALS = ("bsdfs", "adapters")  # the lists of what these are


@dataclass(frozen=True)
class SceneObject:
    """An object of a scene.

    Attributes:
        name: what the paths of its parameters begin with: its id in the scene, or one made of the name of the
            object that it is a part of, or of its kind and number.
        kind: "bsdf", "shape", ...
        model: the model that it is in the core, as in `lajolla list`.
        entry: of the description that it is, such as "bsdfs[3]".
        inner: names of the fields that lead to it within that entry: ("base",) for what a coating covers.
        owner: of a bsdf or an adapter without an id, if the reader stored it once for equal ones: the entry
            of the shape, or of the adapter with an id, that this one is a part of; else "".
    """

    name: str
    kind: str
    model: str
    entry: str
    inner: tuple[str, ...] = ()
    owner: str = ""

    def __reduce__(self) -> tuple[object, ...]:
        """A pickle holds no fields."""
        return SceneObject, (self.name, self.kind, self.model, self.entry, self.inner, self.owner)

    @cached_property
    def fields(self) -> dict[str, Field]:
        """The fields of its model, by name."""
        own = fields_of(core_schema(), self.kind, self.model)
        return {f.name: f for f in own if (self.kind, f.name) != ("instance", "group")}


NO_OBJECTS: Mapping[str, SceneObject] = MappingProxyType({})


def place_of(entry: str) -> tuple[str, int]:
    """The list and the index of "bsdfs[3]"; index 0 for the entries that are not in lists."""
    where, _, index = entry.removesuffix("]").partition("[")
    return where, int(index or 0)


@dataclass
class Lists:
    """Access to the entries of a description by their names."""

    core: dict[str, Any]
    _firsts: dict[str, np.ndarray[Any, Any]] = field(default_factory=dict)

    def count(self, where: str) -> int:
        """The number of entries in a list."""
        return int(self.firsts(where)[-1])

    def firsts(self, where: str) -> np.ndarray[Any, Any]:
        """The index of the first entry that each stored one represents (see `_core.Column`), and the end."""
        if where not in self._firsts:
            counts = [rows_in(entry) for entry in self.core.get(where, ())]
            self._firsts[where] = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])
        return self._firsts[where]

    def stored(self, where: str, index: int) -> tuple[int, int]:
        """The position of the stored entry that represents one of a list, and which of its rows that is."""
        firsts = self.firsts(where)
        if index < 0 or index >= firsts[-1]:
            raise IndexError(f"{where}[{index}]")
        at = int(np.searchsorted(firsts, index, side="right")) - 1
        return at, index - int(firsts[at])

    def materials_of(self, front: int | Mapping[str, int]) -> list[int]:
        """The indices of the materials with this bsdf or adapter on the front."""
        found: list[int] = []
        for first, entry in zip(self.firsts("materials").tolist(), self.core["materials"], strict=False):
            fronts = entry["front"]
            if hasattr(fronts, "row"):
                rows = np.flatnonzero(np.asarray(fronts.__getstate__()[0]) == front)
                found += (first + rows).tolist()
            elif fronts == front:
                found += range(first, first + rows_in(entry))
        return found

    @cached_property
    def outermost(self) -> Mapping[str, int]:
        """The first material with each bsdf or adapter on the front, by the names of their entries."""
        found: dict[str, int] = {}
        for first, entry in zip(self.firsts("materials").tolist(), self.core["materials"], strict=False):
            fronts = entry["front"]
            rows = fronts.__getstate__()[0].tolist() if hasattr(fronts, "row") else [fronts]
            for row, front in enumerate(rows):
                found.setdefault(entry_name(front), first + row)
        return found

    def entry(self, name: str) -> Entry:
        """The entry of a name."""
        where, index = place_of(name)
        if where not in KINDS and where not in ("materials", "groups"):
            single: Entry = self.core[where]
            return single
        at, row = self.stored(where, index)
        stored = self.core[where][at]
        return {k: v.row(row) if hasattr(v, "row") else v for k, v in stored.items()}


def entry_name(material: int | Mapping[str, int]) -> str:
    """The name of the entry of a bsdf or an adapter; "" for black."""
    if isinstance(material, Mapping):
        return f"adapters[{material['adapter']}]"
    return f"bsdfs[{int(material)}]" if material >= 0 else ""


def rows_in(entry: Entry) -> int:
    """How many entries a stored one represents."""
    return next((len(value) for value in entry.values() if hasattr(value, "row")), 1)


def objects_of(
    lists: Lists, known: Objects, before: Mapping[str, SceneObject] = NO_OBJECTS
) -> dict[str, SceneObject]:
    """All objects of a description by their names: the camera and what there is one of, shapes with their
    parts, instances, and lights that have no shape.

    Args:
        lists: the description.
        known: ids of its objects.
        before: the objects before a change; they keep their names, and stay although nothing refers to them.
    """
    return _Namer(lists, known, before).objects


class _Namer:
    """Names objects from the scene's shapes downwards.

    `owner` is the entry of the nearest object above that cannot be stored together with an equal one: a
    shape, or an adapter with an id. When a scene was loaded, bsdfs and adapters without an id that several
    owners refer to are objects of their own, which the reader stored once because they are equal. After a
    change, what has several users is one object, as these were made the same by name.
    """

    def __init__(self, lists: Lists, known: Objects, before: Mapping[str, SceneObject]) -> None:
        self.lists = lists
        self.ids = known.ids
        self.kept = names_by_use(before)
        self.taken = set(self.kept.values())
        self.objects: dict[str, SceneObject] = {}
        self.named: set[tuple[str, str]] = set()  # owners and entries
        self.is_loaded = not before  # and not changed yet
        self.first_owners: dict[str, tuple[str, list[str]]] = {}  # and names, by entry
        self.stored_once = {found.entry for found in before.values() if found.owner}
        for where in SINGLE:
            self.add(where, where, where, lists.entry(where))
        medium = lists.entry("sensor").get("medium", -1)
        self.refer("media", medium, "sensor.medium")
        for index in range(lists.count("shapes")):
            self.shape(index)
        for where in ("instances", "emitters"):
            for index in range(lists.count(where)):
                self.refer(where, index, f"{KINDS[where]}_{index + 1}")
        for name, found in before.items():
            if "[" in found.entry and not found.inner:
                self.refer(*place_of(found.entry), name, found.owner)

    def shape(self, index: int) -> None:
        name = self.refer("shapes", index, f"shape_{index + 1}")
        entry_name = f"shapes[{index}]"
        entry = self.lists.entry(entry_name)
        self.refer("emitters", entry.get("emitter", -1), f"{name}.emitter")
        if entry.get("material", -1) >= 0:
            material = self.lists.entry(f"materials[{entry['material']}]")
            self.material(material.get("front", -1), f"{name}.bsdf", entry_name)
            self.material(material.get("back", -1), f"{name}.bsdf_back", entry_name)
        for side in ("interior", "exterior"):
            self.refer("media", entry.get(side, -1), f"{name}.{side}")

    def material(self, material: int | Mapping[str, int], suggested: str, owner: str) -> None:
        if isinstance(material, Mapping):
            self.refer("adapters", material["adapter"], suggested, owner)
        else:
            self.refer("bsdfs", material, suggested, owner)

    def refer(self, where: str, index: int, suggested: str, owner: str = "") -> str:
        """Names an entry, and all that it refers to, if they have no name yet."""
        entry_name = f"{where}[{index}]"
        may_be_shared = where in MATERIALS and entry_name not in self.ids
        key = self.owner_of(entry_name, owner) if may_be_shared else "", entry_name
        if index < 0 or key in self.named:
            return ""
        self.named.add(key)
        entry = self.lists.entry(entry_name)
        if entry.get("type") == "clamped":  # the reader's: a texture in the range of its field
            self.use(entry["texture"], suggested)
            return ""
        name = self.kept.get(key) or self.unique(self.ids.get(entry_name, suggested))
        inside = owner if may_be_shared and owner else entry_name
        self.add(name, KINDS[where], entry_name, entry, owner=key[0], inside=inside)
        return name

    def owner_of(self, entry: str, owner: str) -> str:
        """The owner of an object if its entry is stored once for several."""
        if not self.is_loaded:
            return owner if entry in self.stored_once else ""
        if entry in self.stored_once:
            return owner
        first, names = self.first_owners.setdefault(entry, (owner, []))
        if first == owner:
            return ""
        self.stored_once.add(entry)
        self.named.add((first, entry))
        for name in names:
            self.objects[name] = replace(self.objects[name], owner=first)
        return owner

    def add(
        self,
        name: str,
        kind: str,
        entry_name: str,
        entry: Entry,
        inner: tuple[str, ...] = (),
        owner: str = "",
        inside: str = "",
    ) -> None:
        model = ONE_MODEL.get(kind) or entry["type"]
        found = self.objects[name] = SceneObject(name, kind, model, entry_name, inner, owner)
        if not owner and entry_name in self.first_owners:
            self.first_owners[entry_name][1].append(name)
        for f in found.fields.values():
            self.part(found, f, entry.get(f.name, f.default), inside)

    def part(self, found: SceneObject, f: Field, value: Any, inside: str) -> None:  # noqa: ANN401
        path = f"{found.name}.{f.name}"
        if f.type == MATERIAL:
            self.material(value, path, inside)
        elif f.type == "phase":
            self.refer("phases", value, path)
        elif f.type == "bsdf" and isinstance(value, Mapping):
            self.add(path, "bsdf", found.entry, value, (*found.inner, f.name), found.owner)
        else:
            self.use(value, path)

    def use(self, value: object, suggested: str) -> None:
        """Names the texture or the volume that a value refers to."""
        if isinstance(value, Mapping):
            for kind, where in (("texture", "textures"), ("volume", "volumes")):
                if kind in value:
                    self.refer(where, value[kind], suggested)

    def unique(self, name: str) -> str:
        numbered = (f"{name}_{i}" for i in count(2))
        return next(n for n in chain([name], numbered) if n not in self.objects and n not in self.taken)


def names_by_entry(objects: Mapping[str, SceneObject]) -> dict[str, str]:
    """The names of objects by their entries."""
    return {found.entry: found.name for found in objects.values() if not found.inner}


def names_by_use(objects: Mapping[str, SceneObject]) -> dict[tuple[str, str], str]:
    """The names of objects by their owners and entries."""
    return {(found.owner, found.entry): found.name for found in objects.values() if not found.inner}
