"""Changes of parameters as changes of a description's entries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lajolla import _core
from lajolla.params.materials import Material, Materials, reference
from lajolla.params.objects import MATERIAL, Entry, Lists, SceneObject, entry_name, place_of, rows_in
from lajolla.params.textures import (
    USERS,
    arranged,
    dependents,
    is_texture,
    reached,
    renumbered,
    textures_in,
    unclamped,
    unused,
)
from lajolla.params.values import WITH_OBJECTS, placed, with_arrays
from lajolla.scene import Objects, SceneError, SceneWarning
from lajolla.scene.editing import Editor
from lajolla.scene.schema import COMPOSITING, TEXTURED, Field, terminator_field
from lajolla.scene.syntax.transforms import turns_over

# Entries are changed before those that refer to them.
ORDER = ("textures", "bsdfs", "adapters", "materials", "volumes", "phases", "media")
# What a shape refers to, and how the camera sees it.
SLOT = ("material", "interior", "exterior", *COMPOSITING)


class Edits:
    """Collects changes: the entries that differ, and then the description with them."""

    def __init__(
        self, lists: Lists, objects: Mapping[str, SceneObject], known: Objects, loaded: Mapping[str, int]
    ) -> None:
        """
        Args:
            lists: the description.
            objects: its objects by name.
            known: where they come from.
            loaded: the lengths of its lists when it was loaded; their textures are kept.
        """
        self._lists = lists
        self._objects = objects
        textures = lists.core.get("textures", ())
        self._editor = Editor(textures, two_sided=known.two_sided, terminator=known.terminator)
        self._known = known
        self._loaded = loaded
        self._entries: dict[str, dict[str, Any]] = {}
        # Arrays of meshes by entry, with a path for messages.
        self._arrays: dict[str, tuple[str, dict[str, Any]]] = {}
        self._paths: dict[str, str] = {}  # of entries, for messages
        self._materials = Materials(lists, objects, known, loaded, self._entries)
        self._rebound: set[int] = set()  # textures whose values may have other bounds
        self.moved: dict[int, int] = {}  # textures that have another place
        self.replaced: set[int] = set()  # places of textures that others have taken
        self._touched: dict[str, set[str]] = {}  # names of an entry's fields that differ

    @property
    def warnings(self) -> list[SceneWarning]:
        """Values that were not taken as given."""
        return self._editor.warnings

    @property
    def refers_anew(self) -> bool:
        """Whether any object refers to another one than before."""
        return self._refers

    _refers = False

    def set(self, found: SceneObject, field: Field, value: object, path: str) -> None:
        """Changes a field of an object.

        Raises:
            SceneError: the value is of another type or out of range.
        """
        if field.type == MATERIAL:
            new: Any = self._inner_material(found, field, value, path)
        elif field.type == "phase":
            new = self._index("phase", value, path)
        else:
            given = self._reference(field, value, path)
            new = self._current(found, field, given)
            if new is None:
                new = self._editor.value(found.kind, found.model, field, given, path)
            if field.type in WITH_OBJECTS:  # a colour in place of a colour refers to nothing
                old = self._value(found, field)
                self._refers |= isinstance(old, Mapping) or isinstance(new, Mapping)
        if found.kind == "texture":
            self._check_contents(found, new, path)
        self._put(found, field.name, new)
        self._paths[found.entry] = path
        if f"has_{field.name}" in found.fields:  # as the reader notes it
            self._put(found, f"has_{field.name}", True)

    def _value(self, found: SceneObject, field: Field) -> Any:  # noqa: ANN401
        """The value that a field has so far, None if it has its default."""
        entry: Any = self._entries.get(found.entry) or self._lists.entry(found.entry)
        for inner in found.inner:
            entry = entry[inner]
        return entry.get(field.name)

    def _current(self, found: SceneObject, field: Field, given: object) -> Any:  # noqa: ANN401
        """The value that a field has, if that refers to the given texture; else None."""
        use, textures = self._value(found, field), self._editor.textures
        same = is_texture(given) and is_texture(use) and unclamped(textures, use) == given
        return use if same else None

    def _check_contents(self, found: SceneObject, value: object, path: str) -> None:
        if place_of(found.entry)[1] in reached(self._editor.textures, textures_in(value)):
            raise SceneError("a texture cannot contain itself", self._editor.location(path))

    def _inner_material(self, found: SceneObject, field: Field, value: object, path: str) -> Material:
        """A bsdf in an adapter, which is made of what comes before it."""
        if isinstance(value, Mapping):
            self._refers = True
            self._materials.drop(f"{found.name}.{field.name}")
            new: Material = self._materials.make(self._editor.material(value, path))[0]
        else:
            spare = self._spare(value)
            new = spare[0] if spare else self._material(value, path)
        if isinstance(new, Mapping) and new["adapter"] >= place_of(found.entry)[1]:
            shown = f'"{value}"' if isinstance(value, str) else "a new adapter"
            message = f'{shown} comes after "{found.name}" in the scene and cannot be put into it'
            raise SceneError(message, self._editor.location(path))
        return new

    def set_array(self, found: SceneObject, name: str, value: object, path: str) -> None:
        """Changes one of a mesh's arrays."""
        self._arrays.setdefault(found.entry, (path, {}))[1][name] = value
        self._entry(found.entry)

    def set_size(self, found: SceneObject, value: object, path: str) -> None:
        """Changes the size of the film, of which the whole is rendered then."""
        try:
            width, height = (int(v) for v in np.asarray(value).tolist())
            if not np.array_equal(np.asarray(value), (width, height)):
                raise ValueError
        except (TypeError, ValueError, OverflowError):
            message = "a size is two whole numbers: width and height"
            raise SceneError(message, self._editor.location(path)) from None
        entry = self._entry(found.entry)
        for name in [name for name in entry if name.startswith("crop_")]:
            del entry[name]
        for name, number in (("width", width), ("height", height)):
            field = found.fields[name]
            self._put(found, name, self._editor.value("film", "film", field, number, path))

    def own(self, found: SceneObject) -> SceneObject:
        """The object with an entry of its own, if the reader stored equal objects once."""
        if found.owner:
            self._refers = True
            if found.owner.startswith("shapes"):  # which gets another material, and is the same shape
                self._touched.setdefault(found.owner, set()).add("material")
        return self._materials.own(found)

    def set_bsdf(self, found: SceneObject, value: object, path: str) -> None:
        """Makes a shape look like another bsdf of the scene, on both sides as where that is used, or like a
        new one.

        Raises:
            SceneError: there is no such bsdf, or it is used with several others on the back.
        """
        index = self._material_index(found, value, path)
        if index != self._materials.entry(found.entry).get("material", -1):
            self._put(found, "material", index)
            self._refers = True

    def _material_index(self, found: SceneObject, value: object, path: str) -> int:
        """The index of the material of a bsdf or of another shape, "ball.bsdf"."""
        if isinstance(value, Mapping) and value.get("type") == "ref":
            value = value.get("id")
        if isinstance(value, Mapping):
            self._materials.drop(f"{found.name}.bsdf", f"{found.name}.bsdf_back")
            self._refers = True
            return self._materials.slot(*self._materials.make(self._editor.material(value, path)))
        spare = self._spare(value)
        if spare is not None:
            return self._materials.slot(*spare)
        shape = self._objects.get(str(value).removesuffix(".bsdf"))
        is_shape = shape is not None and shape.kind == "shape" and str(value).endswith(".bsdf")
        if shape is not None and is_shape and value not in self._objects:
            like: int = self._materials.entry(shape.entry).get("material", -1)
            if like >= 0:
                return like
        front = self._material(value, path)  # from here on a shape has a material of its own
        like = self._materials.entry(shape.entry).get("material", -1) if shape and is_shape else -1
        alike = self._materials.slots_of(front)
        known = [self._materials.entry(found.entry).get("material", -1), like]
        known += [index for index in alike if self._materials.entry(f"materials[{index}]")["back"] == -1]
        index = next((index for index in known if index in alike), alike[0] if len(alike) == 1 else -1)
        if index >= 0:
            return index
        if alike:
            users = (other for other in self._objects.values() if other.kind == "shape")
            names = [f'"{s.name}.bsdf"' for s in users if self._lists.entry(s.entry).get("material") in alike]
            message = (
                f'"{value}" has other sides on several shapes; name one of them: {", ".join(names[:12])}'
            )
            raise SceneError(message, self._editor.location(path))
        return self._materials.slot(front, -1, self._materials.terminator(entry_name(front)))

    def set_terminator(self, found: SceneObject, value: object, path: str) -> None:
        """Changes what the materials do whose outermost bsdf this is.

        Raises:
            SceneError: the value is none of the choices.
        """
        given = self._editor.value("bsdf", found.model, terminator_field(), value, path)
        self._materials.set_terminator(found, given)

    def _spare(self, value: object) -> tuple[Material, Material, str] | None:
        """The sides of a bsdf of the scene that no shape uses yet, and its terminator; None if it is none."""
        if not isinstance(value, str) or value in self._objects or value not in self._known.spare:
            return None
        self._refers = True
        made = self._editor.material(self._known.spare[value], value)
        return self._materials.make(made)

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

    def _material(self, value: object, path: str) -> Material:
        name = str(value)
        if name in self._objects and self._objects[name].kind == "adapter":
            self._refers = True
            return reference(self.own(self._objects[name]).entry)
        return self._index("bsdf", value, path)

    def _index(self, kind: str, value: object, path: str) -> int:
        """The index of the object of a name; -1 for None."""
        self._refers = True
        if value is None and kind not in ("texture", "volume"):
            return -1
        found = self._objects.get(str(value))
        if isinstance(value, str) and found is not None and found.kind == kind and not found.inner:
            return place_of(self.own(found).entry)[1]
        names = [name for name, other in self._objects.items() if other.kind == kind and not other.inner]
        names += self._known.spare if kind == "bsdf" else ()
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
        if found.kind == "texture" and self._editor.put_texture(index := place_of(found.entry)[1], entry):
            self._rebound.add(index)

    def _finish_film(self) -> None:
        """A window that is the whole film stays that, as when a scene is loaded."""
        touched, before = self._touched.get("film", set()), self._lists.entry("film")
        for side, offset, crop in (
            ("width", "crop_offset_x", "crop_width"),
            ("height", "crop_offset_y", "crop_height"),
        ):
            entry = self._entries.get("film", {})
            whole = crop in before and before.get(offset, 0) + before[crop] == before[side]
            if side in touched and crop in entry and crop not in touched and whole:
                entry[crop] = entry[side] - entry.get(offset, 0)

    def _finish_shapes(self) -> None:
        for name, touched in list(self._touched.items()):
            if name.startswith("shapes") and touched & {"to_world", "face_normals"}:
                self._turn(name)
        for name in self._entries:
            if "mesh" in self._entries[name]:
                self._finish_mesh(name)

    def _turn(self, name: str) -> None:
        """A mirrored sphere is turned inside out, as by the reader."""
        before, after, known = self._lists.entry(name), self._entries[name], self._known
        is_sphere = "sphere" in (known.plugins.get(name), after["type"])
        mirrored = turns_over(_matrix(before)) != turns_over(_matrix(after))
        if is_sphere and known.mirrored and mirrored and "flip_normals" not in self._touched[name]:
            after["flip_normals"] = not after.get("flip_normals", False)

    def _finish_mesh(self, name: str) -> None:
        before, entry = self._lists.entry(name), self._entries[name]
        path, arrays = self._arrays.get(name, (self._paths.get(name, name), {}))
        try:
            if arrays:
                entry["mesh"] = with_arrays(entry["mesh"], arrays, before, entry)
            touched = self._touched.get(name, set())
            smooth = "face_normals" in touched and not entry["face_normals"] and "normals" not in arrays
            entry["mesh"] = placed(entry["mesh"], before, entry, smooth=smooth)
        except (TypeError, ValueError) as problem:
            reason = str(problem).partition("\n")[0]
            raise SceneError(reason, self._editor.location(path)) from None
        if entry["mesh"] is not before["mesh"]:
            self._touched.setdefault(name, set()).add("mesh")

    # Textures

    def _finish_textures(self) -> None:
        """Brings changed textures into the range of their users, and new ones behind those they refer to."""
        if self._rebound:
            self._clamp_users()
        textures, count = self._editor.textures, self._lists.count("textures")
        changed = self._entries.values()
        new = [index for entry in changed for index in textures_in(entry) if index >= count]
        if not new and not any(name.startswith("textures") for name in self._entries):
            return
        edited = {place_of(name)[1] for name in self._entries if name.startswith("textures")}
        free = unused(self._lists, self._loaded["textures"], changed) - edited
        numbers = arranged(textures, count, free, new)
        self.moved = {index: at for index, at in numbers.items() if index < count}
        self.replaced = {at for at in numbers.values() if at < count}
        self._renumber(textures, numbers)

    def _clamp_users(self) -> None:
        dependent = dependents(self._editor.textures, self._rebound)
        for found in sorted(self._objects.values(), key=lambda found: found.kind != "texture"):
            entry: Any = self._entries.get(found.entry) or self._lists.entry(found.entry)
            for inner in found.inner:
                entry = entry[inner]
            for field in found.fields.values():
                use = entry.get(field.name)
                if field.type in TEXTURED and is_texture(use) and use["texture"] in dependent:
                    inside = unclamped(self._editor.textures, use)
                    path = f"{found.name}.{field.name}"
                    clamped = self._editor.in_range(found.kind, found.model, field, dict(inside), path)
                    if clamped != use:
                        self._put(found, field.name, clamped)

    def _renumber(self, textures: Sequence[Entry], numbers: Mapping[int, int]) -> None:
        """Writes textures at their new places, and these into all that refers to them."""
        count = self._lists.count("textures")
        for where in USERS if any(index < count for index in numbers) else ():
            for first, stored in zip(
                self._lists.firsts(where), self._lists.core.get(where, ()), strict=False
            ):
                if any(index in numbers for index in textures_in(stored)):
                    for row in range(rows_in(stored)):
                        self._entry(f"{where}[{first + row}]")
        edited = set[int]()
        for name, entry in list(self._entries.items()):
            if name.startswith("textures"):
                del self._entries[name]
                edited.add(place_of(name)[1])
            else:
                self._entries[name] = renumbered(entry, numbers)
        for index, texture in enumerate(textures):
            stays = index < count and index not in self.replaced
            refers = stays and any(inner in numbers for inner in textures_in(texture))
            if index in edited or index in numbers or refers:
                at = numbers.get(index, index)
                self._entries[f"textures[{at}]"] = renumbered(texture, numbers)

    def changes(self) -> dict[str, dict[str, Any]]:
        """What `_core.Scene.with_changes` takes.

        Raises:
            SceneError: arrays of a mesh do not fit.
        """
        self._finish_film()
        self._finish_shapes()
        self._finish_textures()
        rank = {where: number for number, where in enumerate(ORDER)}

        def order(name: str) -> tuple[int, int]:
            where, index = place_of(name)
            return rank.get(where, len(ORDER)), index

        result = {}
        for name in sorted(self._entries, key=order):
            entry = self._entries[name]
            touched = self._touched.get(name, {"type"})
            if name.startswith("shapes") and touched <= set(SLOT):
                entry = {key: entry[key] for key in SLOT if key in entry}
            result[name] = entry
        return result

    def renamed(self, objects: Mapping[str, SceneObject]) -> Mapping[str, SceneObject]:
        """The objects after the changes by the names that they had; call `changes` before."""
        copies, dropped = self._materials.copies, self._materials.dropped
        if not (copies or dropped or self.moved or self.replaced):
            return objects
        result = {}
        for name, found in objects.items():
            key = found.owner, found.entry
            at = place_of(found.entry)[1] if found.kind == "texture" else -1
            if key in copies:
                result[name] = replace(found, entry=copies[key], owner="")
            elif at in self.moved:
                result[name] = replace(found, entry=f"textures[{self.moved[at]}]")
            elif at not in self.replaced and name not in dropped:
                result[name] = found
        return result

    def known_after(self) -> Objects:
        """Where the objects come from after the changes."""
        made, known = self._materials, self._known
        if not made.added:
            return known

        def merged(before: Mapping[str, str], new: Mapping[str, str]) -> dict[str, str]:
            return {**{name: own for name, own in before.items() if name not in made.added}, **new}

        return replace(
            known,
            ids=merged(known.ids, made.ids),
            plugins=merged(known.plugins, made.plugins),
            terminators=merged(known.terminators, made.terminators),
        )

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


def _matrix(entry: Entry) -> Any:  # noqa: ANN401
    return np.asarray(entry.get("to_world", np.eye(4)), float)


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
