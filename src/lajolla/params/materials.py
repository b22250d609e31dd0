"""Changes of what shapes look like: bsdfs of their own in place of shared ones, and new ones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, TypeAlias

from lajolla.params.objects import MATERIALS, Entry, Lists, SceneObject, entry_name, place_of
from lajolla.scene import Objects, SceneError
from lajolla.scene.editing import Made

Material: TypeAlias = int | Mapping[str, int]  # a bsdf, an adapter, or -1 for black
INSIDE = ("first", "second", "child")  # the materials in an adapter


class Materials:
    """The bsdfs, adapters and material slots of a description, with changes."""

    def __init__(
        self,
        lists: Lists,
        objects: Mapping[str, SceneObject],
        known: Objects,
        loaded: Mapping[str, int],
        entries: dict[str, dict[str, Any]],
    ) -> None:
        """
        Args:
            lists: the description.
            objects: its objects by name.
            known: where they come from.
            loaded: the lengths of its lists when it was loaded.
            entries: those that differ; changes are added here.
        """
        self._lists = lists
        self._objects = objects
        self._known = known
        self._loaded = loaded
        self._entries = entries
        self._free: dict[str, list[int]] = {}  # places in each list
        self.copies: dict[tuple[str, str], str] = {}  # entries of owners' objects, by those before
        self.dropped: set[str] = set()  # names of objects that others replace
        self.added: set[str] = set()  # names of new entries, with their
        self.ids: dict[str, str] = {}
        self.plugins: dict[str, str] = {}
        self.terminators: dict[str, str] = {}

    def entry(self, name: str) -> Entry:
        """An entry, with its changes."""
        return self._entries.get(name) or self._lists.entry(name)

    def own(self, found: SceneObject) -> SceneObject:
        """The object with an entry of its own, if it shares one with equal objects."""
        key = found.owner, found.entry
        if found.owner and key not in self.copies:
            self._separate(found)
        return replace(found, entry=self.copies[key], owner="") if found.owner else found

    def _separate(self, found: SceneObject) -> None:
        """Copies what an owner shares, and what refers to it."""
        shared = {other.entry for other in self._objects.values() if other.owner}

        def copied(material: Material) -> Material:
            name = entry_name(material)
            if not name or name in self._known.ids or (name not in shared and "bsdfs" in name):
                return material
            key = found.owner if name in shared else "", name
            if key not in self.copies:
                content = {k: copied(v) if k in INSIDE else v for k, v in self.entry(name).items()}
                self.copies[key] = new = self._add(name.partition("[")[0], content)
                if name in self._known.plugins:
                    self.plugins[new] = self._known.plugins[name]
                self.terminators[new] = self.terminator(name)
            return reference(self.copies[key])

        where, at = place_of(found.owner)
        before = self.entry(found.owner)
        if where == "shapes":
            slot = self.entry(f"materials[{before['material']}]")
            material = self.slot(copied(slot["front"]), copied(slot["back"]), terminator_of(slot))
            after: dict[str, Any] = {**before, "material": material}
        else:
            after = {k: copied(v) if k in INSIDE else v for k, v in before.items()}
            if any(isinstance(after[k], Mapping) and after[k]["adapter"] >= at for k in INSIDE if k in after):
                message = f"{found.name} is stored together with an equal one; give them ids in the scene"
                raise SceneError(message)
        copied(reference(found.entry))  # where nothing refers to it any more
        self._entries[found.owner] = after

    def slot(self, front: Material, back: Material, terminator: str) -> int:
        """The index of the material slot with these sides; a new one if there is none."""
        slot = with_terminator({"front": front, "back": back}, terminator)
        found = [i for i in self.slots_of(front) if self.entry(f"materials[{i}]") == slot]
        return found[0] if found else place_of(self._add("materials", slot))[1]

    def set_terminator(self, found: SceneObject, value: str) -> None:
        """Changes what is done at the terminator, wherever a bsdf or an adapter is the outermost one.

        Others than the first material keep theirs if it differs: what is around the bsdf there sets it.
        """
        slots = {
            name: self.entry(name)
            for i in self.slots_of(reference(found.entry))
            for name in [f"materials[{i}]"]
        }
        shown = terminator_of(next(iter(slots.values())))
        for name, slot in slots.items():
            if terminator_of(slot) == shown:
                self._entries[name] = with_terminator(slot, value)

    def terminator(self, entry: str) -> str:
        """What a bsdf or an adapter does at the terminator where it becomes the outermost one."""
        own = self.terminators.get(entry) or self._known.terminators.get(entry)
        return own or self._known.terminator

    def slots_of(self, front: Material) -> list[int]:
        """The indices of the material slots with this bsdf or adapter on the front."""
        changed = {index: entry for index, entry in self._changed("materials") if entry["front"] == front}
        return sorted({*(i for i in self._lists.materials_of(front)), *changed})

    def _changed(self, where: str) -> Iterator[tuple[int, Entry]]:
        return ((place_of(k)[1], v) for k, v in self._entries.items() if k.startswith(f"{where}["))

    def make(self, made: Made) -> tuple[Material, Material, str]:
        """Adds new bsdfs and adapters; those of the front and of the back, and the terminator."""
        at: dict[str, str] = {}

        def placed(material: Material) -> Material:
            name = entry_name(material)
            return reference(at[name]) if name else material

        for name, entry in made.entries.items():
            content = {k: placed(v) if k in INSIDE else v for k, v in entry.items()}
            at[name] = self._add(name.partition("[")[0], content)
        self.ids |= {at[name]: own for name, own in made.ids.items()}
        self.plugins |= {at[name]: own for name, own in made.plugins.items()}
        self.terminators |= {at[name]: own for name, own in made.terminators.items()}
        return placed(made.front), placed(made.back), made.terminator

    def drop(self, *paths: str) -> None:
        """Notes that materials are replaced: their names and those of their parts are free, but for ids."""
        for name, found in self._objects.items():
            is_part = name in paths or name.startswith(tuple(f"{path}." for path in paths))
            if is_part and found.kind in ("bsdf", "adapter") and found.entry not in self._known.ids:
                self.dropped.add(name)

    # Places of new entries

    def _add(self, where: str, content: Mapping[str, Any]) -> str:
        """The name of a new entry. Those that are added are in the order of their places, as adapters may
        only contain earlier ones."""
        if where not in self._free:
            self._free[where] = self._unused(where) if where in MATERIALS else []
        end = max([self._lists.count(where), *(index + 1 for index, _ in self._changed(where))])
        index = self._free[where].pop(0) if self._free[where] else end
        name = f"{where}[{index}]"
        self._entries[name] = dict(content)
        self.added.add(name)
        return name

    def _unused(self, where: str) -> list[int]:
        """The places of entries that were added after loading and that nothing needs any more."""
        added = set(range(self._loaded[where], self._lists.count(where)))
        if not added:
            return []
        named = {found.entry for name, found in self._objects.items() if name not in self.dropped}
        kept = {index for index in added if f"{where}[{index}]" in named}
        shapes = {found.entry: name for name, found in self._objects.items() if found.kind == "shape"}
        replaced = {entry for entry, name in shapes.items() if f"{name}.bsdf" in self.dropped}
        slots = {self._lists.entry(entry).get("material", -1) for entry in shapes if entry not in replaced}
        used = (self._lists.entry(f"materials[{slot}]") for slot in slots if slot >= 0)
        waiting = [slot[side] for slot in used for side in ("front", "back")]
        while waiting:
            name = entry_name(waiting.pop())
            if name and place_of(name)[0] == where:
                kept.add(place_of(name)[1])
            if name.startswith("adapters"):
                waiting += [v for k, v in self._lists.entry(name).items() if k in INSIDE]
        return sorted(added - kept)


def terminator_of(slot: Entry) -> str:
    """What a material slot does at the terminator."""
    return str(slot.get("terminator", "none"))


def with_terminator(slot: Entry, terminator: str) -> dict[str, Any]:
    """The same material slot, as the reader writes it, with this terminator."""
    said = {} if terminator == "none" else {"terminator": terminator}
    return {"front": slot["front"], "back": slot["back"], **said}


def reference(entry: str) -> Material:
    """How other entries refer to a bsdf or an adapter."""
    where, index = place_of(entry)
    return index if where == "bsdfs" else {"adapter": index}
