"""Changes of parameters as changes of a description's entries."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lajolla import _core
from lajolla.params.objects import KINDS, MATERIAL, Lists, SceneObject, place_of
from lajolla.params.values import WITH_OBJECTS, with_arrays
from lajolla.scene import SceneError, SceneWarning
from lajolla.scene.editing import Editor
from lajolla.scene.schema import Field

# Entries are changed before those that refer to them.
ORDER = ("textures", "bsdfs", "adapters", "materials", "volumes", "phases", "media")
LISTS_OF = {kind: where for where, kind in KINDS.items()}
SLOT = ("material", "interior", "exterior")  # what a shape refers to


class Edits:
    """Collects changes: the entries that differ, and then the description with them."""

    def __init__(self, lists: Lists, objects: Mapping[str, SceneObject]) -> None:
        self._lists = lists
        self._objects = objects
        self._editor = Editor(lists.core.get("textures", ()))
        self._entries: dict[str, dict[str, Any]] = {}
        self._arrays: dict[
            str, tuple[str, dict[str, Any]]
        ] = {}  # of meshes by entry, with a path for messages
        self._touched: dict[str, set[str]] = {}  # names of an entry's fields that differ

    @property
    def warnings(self) -> list[SceneWarning]:
        """Values that were not taken as given."""
        return self._editor.warnings

    @property
    def refers_anew(self) -> bool:
        """Whether any object refers to another one than before."""
        return self._refers or bool(self._editor.added_textures)

    _refers = False

    def set(self, found: SceneObject, field: Field, value: object, path: str) -> None:
        """Changes a field of an object.

        Raises:
            SceneError: the value is of another type or out of range.
        """
        if field.type == MATERIAL:
            new: Any = self._material(value, path)
        elif field.type == "phase":
            new = self._index("phase", value, path)
        else:
            given = self._reference(field, value, path)
            new = self._editor.value(found.kind, found.model, field, given, path)
            self._refers |= field.type in WITH_OBJECTS
        self._put(found, field.name, new)

    def set_array(self, found: SceneObject, name: str, value: object, path: str) -> None:
        """Changes one of a mesh's arrays."""
        self._arrays.setdefault(found.entry, (path, {}))[1][name] = value
        self._entry(found.entry)

    def set_size(self, found: SceneObject, value: object, path: str) -> None:
        """Changes the size of the film, of which the whole is rendered then."""
        try:
            width, height = (int(v) for v in np.asarray(value).tolist())
        except (TypeError, ValueError):
            message = "a size is two whole numbers: width and height"
            raise SceneError(message, self._editor.location(path)) from None
        entry = self._entry(found.entry)
        for name in [name for name in entry if name.startswith("crop_")]:
            del entry[name]
        for name, number in (("width", width), ("height", height)):
            field = found.fields[name]
            self._put(found, name, self._editor.value("film", "film", field, number, path))

    def set_bsdf(self, found: SceneObject, value: object, path: str) -> None:
        """Makes a shape look like another bsdf of the scene, on both sides as where that is used."""
        front = self._material(value, path)
        materials = self._lists.core["materials"]
        backs = (m["back"] for m in materials if not hasattr(m["front"], "row") and m["front"] == front)
        entry = {"front": front, "back": next((b for b in backs if not hasattr(b, "row")), -1)}
        index = self._lists.count("materials") + sum(k.startswith("materials") for k in self._entries)
        self._entries[f"materials[{index}]"] = entry
        self._put(found, "material", index)
        self._refers = True

    def set_medium(self, found: SceneObject, name: str, value: object, path: str) -> None:
        """Sets the medium inside or outside of a shape, or that in which the camera is."""
        self._put(found, name, self._index("medium", value, path))

    # How references are written

    def _reference(self, field: Field, value: object, path: str) -> object:
        """{"texture": index} for the name of a texture, and likewise of a volume; else the value."""
        if field.type not in WITH_OBJECTS or not isinstance(value, str):
            return value
        kind = field.type.partition("_")[0]
        return {kind: self._index(kind, value, path)}

    def _material(self, value: object, path: str) -> int | dict[str, int]:
        name = str(value)
        if name in self._objects and self._objects[name].kind == "adapter":
            self._refers = True
            return {"adapter": place_of(self._objects[name].entry)[1]}
        return self._index("bsdf", value, path)

    def _index(self, kind: str, value: object, path: str) -> int:
        """The index of the object of a name; -1 for None."""
        self._refers = True
        if value is None and kind not in ("texture", "volume"):
            return -1
        found = self._objects.get(str(value))
        if isinstance(value, str) and found is not None and found.kind == kind and not found.inner:
            return place_of(found.entry)[1]
        names = [name for name, other in self._objects.items() if other.kind == kind and not other.inner]
        known = f"; the scene has {', '.join(names[:12])}" if names else ""
        message = f"expected the name of a {kind}, got {value!r}{known}"
        raise SceneError(message, self._editor.location(path))

    # Entries

    def _entry(self, name: str) -> dict[str, Any]:
        if name not in self._entries:
            self._entries[name] = dict(self._lists.entry(name))
        return self._entries[name]

    def _put(self, found: SceneObject, name: str, value: object) -> None:
        entry = self._entry(found.entry)
        self._touched.setdefault(found.entry, set()).add(found.inner[0] if found.inner else name)
        for inner in found.inner:
            entry[inner] = dict(entry[inner])
            entry = entry[inner]
        entry[name] = value

    def _finish_meshes(self) -> None:
        for name, (path, arrays) in self._arrays.items():
            entry = self._entry(name)
            try:
                entry["mesh"] = with_arrays(entry["mesh"], arrays, entry.get("to_world", np.eye(4)))
            except (TypeError, ValueError) as problem:
                reason = str(problem).partition("\n")[0]
                raise SceneError(reason, self._editor.location(path)) from None
            self._touched.setdefault(name, set()).add("mesh")

    def changes(self) -> dict[str, dict[str, Any]]:
        """What `_core.Scene.with_changes` takes. Raises SceneError if arrays of a mesh do not fit."""
        self._finish_meshes()
        first = self._lists.count("textures")
        added = {f"textures[{first + i}]": entry for i, entry in enumerate(self._editor.added_textures)}
        self._entries = {**added, **self._entries}
        rank = {where: number for number, where in enumerate(ORDER)}
        ordered = sorted(self._entries, key=lambda name: rank.get(place_of(name)[0], len(ORDER)))
        result = {}
        for name in ordered:
            entry = self._entries[name]
            touched = self._touched.get(name, {"type"})
            if name.startswith("shapes") and touched <= set(SLOT):
                entry = {key: entry[key] for key in SLOT if key in entry}
            result[name] = entry
        return result

    def description(self) -> dict[str, Any]:
        """The description with all changes; call `changes` before."""
        core = dict(self._lists.core)
        in_lists: dict[str, dict[int, dict[str, Any]]] = {}
        for name, entry in self._entries.items():
            where, index = place_of(name)
            if "[" in name:
                in_lists.setdefault(where, {})[index] = entry
            else:
                core[where] = entry
        for where, changed in in_lists.items():
            core[where] = self._with_entries(where, changed)
        return core

    def _with_entries(self, where: str, changed: Mapping[int, dict[str, Any]]) -> list[Any]:
        """A list with other entries; stored ones with columns are split where one of their rows differs."""
        stored = list(self._lists.core.get(where, ()))
        count = self._lists.count(where)
        inside = sorted((index for index in changed if index < count), reverse=True)
        for index in inside:
            at, row = self._lists.stored(where, index)
            entry = stored[at]
            columns = [key for key, value in entry.items() if hasattr(value, "row")]
            before = _rows(entry, columns, slice(0, row))
            after = _rows(entry, columns, slice(row + 1, None))
            stored[at : at + 1] = [*before, changed[index], *after]
        return [*stored, *(changed[index] for index in sorted(changed) if index >= count)]


def _rows(entry: dict[str, Any], columns: list[str], rows: slice) -> list[dict[str, Any]]:
    """An entry with some of its rows; nothing if there are none."""
    cut = {}
    for key in columns:
        numbers, integer = entry[key].__getstate__()
        part = np.asarray(numbers)[rows]
        if not len(part):
            return []
        cut[key] = _core.Column(np.ascontiguousarray(part, np.int64 if integer else np.float64))
    return [{**entry, **cut}] if columns else []
