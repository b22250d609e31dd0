"""The parameters of a loaded scene, by readable paths, as Mitsuba's `traverse` shows them.

scene.params["red.reflectance"]                # reads
scene["red.reflectance"] = (0.6, 0.05, 0.05)   # changes the scene
other = scene.with_params({"sensor.fov": 40})  # a changed copy, which shares what is the same
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import Any

from lajolla import _core
from lajolla.messages import Error
from lajolla.params import combined
from lajolla.params.edits import Edits
from lajolla.params.objects import (
    MATERIAL,
    MATERIALS,
    NO_OBJECTS,
    Lists,
    SceneObject,
    entry_name,
    names_by_use,
    objects_of,
)
from lajolla.params.values import WITH_OBJECTS, fixed, mesh_array, mesh_names, readable
from lajolla.scene import Description, Objects, Places, SceneError, plugins_by_kind, reason_of
from lajolla.scene.description.plugins.meshes import WEIGHTS
from lajolla.scene.formats.mesh_arrays import ATTRIBUTES, OTHER_NAMES
from lajolla.scene.schema import Field, terminator_field

__all__ = ["Info", "ParamError", "Params", "SceneObject"]


class ParamError(Error, KeyError):
    """There is no parameter of this path; the message names the most similar one."""

    def __str__(self) -> str:
        return str(self.args[0])


@dataclass(frozen=True)
class Info:
    """Where an object of a scene comes from, and what it is.

    Attributes:
        name: what the paths of its parameters begin with.
        kind: "bsdf", "shape", "emitter", ...
        plugin: its name in the scene file, such as "obj" or "sunsky".
        model: the model of the renderer that this became, such as "mesh" or "envmap".
        file, line: where it is in a scene file, lines counted from one; the key in a dict, and 0; "" and 0 if
            that is not known.
        params: the names of its parameters.
    """

    name: str
    kind: str
    plugin: str
    model: str
    file: str
    line: int
    params: tuple[str, ...]


class Params(Mapping[str, Any]):
    """All parameters of a scene: a mapping of paths, such as "red.reflectance", to values.

    Values are NumPy arrays (colours, vectors, matrices, pixels (height, width, 1 or 3), voxels, and the
    arrays of meshes) or Python's numbers, truth values and strings. Arrays are read-only: what is written
    into one would not change the scene; change a copy, and set that. What refers to another object, such as
    a reflectance to a texture, has the name of that object as its value.
    """

    def __init__(
        self,
        description: Description,
        places: Places | None = None,
        before: Mapping[str, SceneObject] = NO_OBJECTS,
        *,
        renamed: bool = True,
        loaded: Mapping[str, int] | None = None,
    ) -> None:
        """The parameters of a description.

        Args:
            description: of the scene.
            places: where its entries come from.
            before: the objects before a change; they keep their names.
            renamed: whether other objects may be there after the change.
            loaded: the lengths of its lists before any change.
        """
        self._lists = Lists(description.core)
        self._known: Objects = description.objects
        self._places = places or Places()
        self._before, self._renamed = before, renamed
        self._loaded = {name: self._lists.count(name) for name in GROWING} if loaded is None else loaded

    def __getstate__(self) -> dict[str, Any]:
        """A pickle holds neither places in files nor what follows from the rest."""
        return {
            "_lists": Lists(self._lists.core),
            "_known": self._known,
            "_places": Places(),
            "_before": dict(self._before),
            "_renamed": self._renamed,
            "_loaded": self._loaded,
        }

    @cached_property
    def objects(self) -> Mapping[str, SceneObject]:
        """All objects by name."""
        return objects_of(self._lists, self._known, self._before) if self._renamed else self._before

    @cached_property
    def _names(self) -> dict[tuple[str, str], str]:
        return names_by_use(self.objects)

    @cached_property
    def _aliases(self) -> dict[str, str]:
        """Ids of the objects of which a scene has one, such as the camera."""
        ids = {self._known.ids[name]: name for name in self.objects if name in self._known.ids}
        return {name: found for name, found in ids.items() if name not in self.objects}

    def __iter__(self) -> Iterator[str]:
        for name, found in self.objects.items():
            yield from (f"{name}.{param}" for param in self._params_of(found))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __getitem__(self, path: str) -> Any:  # noqa: ANN401
        """The value of a parameter. Raises ParamError."""
        name, _, param = str(path).rpartition(".")
        known = self._object(name)
        if known is not None and (parts := combined.parts_of(known, param)):
            try:
                return combined.read(param, {part: self[f"{name}.{part}"] for part in parts})
            except ValueError as problem:
                raise ParamError(f"the scene has no parameter {path!r}: {problem}") from None
        found, param = self.find(path)
        entry: Any = self._entry(found)
        if param in SPECIAL:
            return self._special(found, entry, param)
        if param not in found.fields:
            if param not in mesh_names(entry["mesh"]):
                raise self._unknown(path, found)
            return fixed(mesh_array(entry["mesh"], param))
        field = found.fields[param]
        return self._value(field, entry.get(param, field.default), found.owner or found.entry)

    def __repr__(self) -> str:
        shown = [f"{path} = {short(self[path])}" for path in islice(self, MOST_SHOWN)]
        more = len(self) - len(shown)
        return "\n".join([*shown, f"... and {more} more"] if more else shown)

    def info(self, name: str) -> Info:
        """Where an object comes from, and what it is; also of the object of a parameter's path.

        Raises ParamError.
        """
        name = self._aliases.get(name, name)
        found = self.objects[name] if name in self.objects else self.find(name)[0]
        plugin = self._known.plugins.get(found.entry, found.model) if not found.inner else found.model
        place = self._places.find(found.entry)
        file, line = "", 0
        if place is not None:
            file = place.key or place.source.name
            line = place.line if place.source.data else 0
        params = tuple(self._params_of(found))
        return Info(found.name, found.kind, plugin, found.model, file, line, params)

    def field(self, path: str) -> Field:
        """The declaration of a parameter: type, default, minimum, maximum, unit, choices and description.

        Raises ParamError.
        """
        found, param = self.find(path)
        return found.fields.get(param) or OTHERS.get(param) or ARRAY

    def find(self, path: str) -> tuple[SceneObject, str]:
        """The object and the name of the parameter that a path means. Raises ParamError."""
        name, _, param = str(path).rpartition(".")
        found = self._object(name)
        if found is not None and self._has(found, param):
            return found, param
        raise self._unknown(path, found)

    def _object(self, name: str) -> SceneObject | None:
        return self.objects.get(self._aliases.get(name, name))

    def _unknown(self, path: str, found: SceneObject | None) -> ParamError:
        name, _, param = str(path).rpartition(".")
        if found is None:
            known = list(self) if len(self.objects) < MOST_COMPARED else []
            hint = nearest_hint(str(path), known) or "; scene.params lists all"
        elif param in OTHER_NAMES and "mesh" in found.fields:
            hint = f"; did you mean {f'{name}.{OTHER_NAMES[param]}'!r}?"
        elif param == WEIGHTS and param in found.fields:
            hint = f": the normals of {name} are not computed"
        elif parts := combined.parts_of(found, param):
            hint = f": it stands for {' and '.join(parts)}"
        else:
            own = list(self._params_of(found))
            read_as = param in plugin_fields(found.kind, self._known.plugins.get(found.entry, found.model))
            hint = "" if read_as else nearest_hint(param, own, f"{name}.")
            hint = hint or f"; {name} has {', '.join(own[:MOST_LISTED])}"
        return ParamError(f"the scene has no parameter {path!r}{hint}")

    def edits(self, values: Mapping[str, Any]) -> Edits:
        """The changes of some parameters. Raises ParamError, and SceneError for values that do not fit."""
        edits = Edits(self._lists, self.objects, self._known, self._loaded)
        values = self._expanded(values)
        found_by = {path: self.find(path) for path in values}
        textures_first = sorted(found_by.items(), key=lambda item: item[1][0].kind != "texture")
        for path, (shown, param) in textures_first:  # others depend on their ranges
            value, found = values[path], edits.own(shown)
            if param == "size":
                edits.set_size(found, value, path)
            elif param == "bsdf" and found.kind == "shape":
                edits.set_bsdf(found, value, path)
            elif param == TERMINATOR:
                edits.set_terminator(found, value, path)
            elif param in SPECIAL:
                edits.set_medium(found, param, value, path)
            elif param in found.fields:
                edits.set(found, found.fields[param], value, path)
            else:
                edits.set_array(found, param, value, path)
        return edits

    def _expanded(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Values with the parameters for which others stand, in place of these."""
        result: dict[str, Any] = {}
        given: dict[str, dict[str, Any]] = {}  # by object
        for path, value in values.items():
            name, _, param = str(path).rpartition(".")
            found = self._object(name)
            if found is None or not combined.parts_of(found, param):
                result[path] = value
            else:
                given.setdefault(name, {})[param] = value
        for name, own in given.items():
            found = self._object(name)
            assert found is not None
            parts = {part: self[f"{name}.{part}"] for p in own for part in combined.parts_of(found, p)}
            try:
                result |= {f"{name}.{part}": value for part, value in combined.written(own, parts).items()}
            except SceneError as problem:
                raise SceneError(f"params[{name}.{next(iter(own))}]: {problem.message}") from None
        return result

    def after(self, edits: Edits, description: Description) -> Params:
        """The parameters of the description that the edits made."""
        before = edits.renamed(self.objects)
        return Params(description, self._places, before, renamed=edits.refers_anew, loaded=self._loaded)

    def of(self, description: Description, places: Places) -> Params:
        """The parameters of the same scene with another camera or other outputs."""
        if self._before is NO_OBJECTS:
            return Params(description, places)
        return Params(description, places, self.objects, loaded=self._loaded)

    def refusal(self, problem: Exception, changes: Mapping[str, Any]) -> SceneError:
        """The error to raise when the core refuses changes: the core's message with an object's name."""
        entry = re.match(r"(\w+(?:\[\d+\])?)(?: \(\w+\))?(?:\.|: )(.*)", str(problem), re.DOTALL)
        if isinstance(problem, _core.DescriptionError) and entry and entry[1] in changes:
            names = (name for (_, known), name in self._names.items() if known == entry[1])
            return SceneError(f"{next(names, entry[1])}: {entry[2]}")
        return SceneError(reason_of(problem))

    def _has(self, found: SceneObject, param: str) -> bool:
        if (param in found.fields and self._applies(found, param)) or param in self._params_of(found):
            return True
        return "mesh" in found.fields and param.startswith(ATTRIBUTES) and param not in OTHER_NAMES

    def _params_of(self, found: SceneObject) -> Iterator[str]:
        """The names of its parameters: fields, arrays of meshes, and references that are no fields."""
        for field in found.fields.values():
            if field.type == "mesh":
                yield from mesh_names(self._entry(found)["mesh"])
            elif field.type != "bsdf" and self._applies(found, field.name):
                yield field.name
        if found.kind == "film":
            yield "size"
        elif found.kind == "shape":
            yield "bsdf"
            yield from ("interior", "exterior") if self._lists.core.get("media") else ()
        elif found.kind == "sensor" and self._lists.core.get("media"):
            yield "medium"
        elif self._slot(found) is not None:
            yield TERMINATOR

    def _applies(self, found: SceneObject, field: str) -> bool:
        """Whether a field can change anything: weights only change normals that are computed."""
        if field != WEIGHTS:
            return True
        mesh = self._entry(found)["mesh"]
        return mesh.computed_normals or mesh.normals is None

    def _entry(self, found: SceneObject) -> Mapping[str, Any]:
        entry = self._lists.entry(found.entry)
        for inner in found.inner:
            entry = entry[inner]
        return entry

    def _slot(self, found: SceneObject) -> Mapping[str, Any] | None:
        """The first material whose outermost bsdf or adapter on the front is this object; None if none is."""
        if found.kind not in ("bsdf", "adapter") or found.inner:
            return None
        index = self._lists.outermost.get(found.entry)
        if found.owner:
            own = self._lists.entry(found.owner).get("material", -1)
            is_front = own >= 0 and entry_name(self._lists.entry(f"materials[{own}]")["front"]) == found.entry
            index = own if is_front else None
        return None if index is None else self._lists.entry(f"materials[{index}]")

    def _special(self, found: SceneObject, entry: Mapping[str, Any], param: str) -> Any:  # noqa: ANN401
        if param == "size":
            return (entry["width"], entry["height"])
        if param == TERMINATOR:
            slot = self._slot(found)
            assert slot is not None
            return slot.get(TERMINATOR, "none")
        if param != "bsdf":
            return self._name("media", entry.get(param, -1))
        if entry.get("material", -1) < 0:
            return None
        return self._material(self._lists.entry(f"materials[{entry['material']}]")["front"], found.entry)

    def _value(self, field: Field, value: Any, owner: str) -> Any:  # noqa: ANN401
        if field.type == MATERIAL:
            return self._material(value, owner)
        if field.type == "phase":
            return self._name("phases", value)
        if field.type in WITH_OBJECTS and isinstance(value, Mapping):
            return self._use(value)
        return fixed(readable(field.type, value))

    def _use(self, value: Mapping[str, Any]) -> str | None:
        if "volume" in value:
            return self._name("volumes", value["volume"])
        entry = self._lists.entry(f"textures[{value['texture']}]")
        return (
            self._use(entry["texture"])
            if entry["type"] == "clamped"
            else self._name("textures", value["texture"])
        )

    def _material(self, value: int | Mapping[str, int], owner: str) -> str | None:
        """The name of a bsdf or an adapter, as the owner may have one of those that are stored once."""
        where, index = ("adapters", value["adapter"]) if isinstance(value, Mapping) else ("bsdfs", value)
        return self._names.get((owner, f"{where}[{index}]")) or self._name(where, index)

    def _name(self, where: str, index: int) -> str | None:
        return self._names.get(("", f"{where}[{index}]"))


MOST_SHOWN = 1000
MOST_COMPARED = 10000  # objects whose paths are compared with an unknown one
MOST_LISTED = 12
GROWING = ("textures", *MATERIALS)  # lists to which changes may add entries
TERMINATOR = "terminator"  # of the materials whose outermost bsdf an object is
SPECIAL = ("size", "bsdf", "interior", "exterior", "medium", TERMINATOR)
OTHERS = {
    TERMINATOR: terminator_field(),
    "size": Field("size", "size", "width and height in pixels; the whole film is rendered"),
    "bsdf": Field("bsdf", "bsdf", "name of the bsdf that the shape looks like"),
    "interior": Field("interior", "medium", "name of the medium inside"),
    "exterior": Field("exterior", "medium", "name of the medium outside"),
    "medium": Field("medium", "medium", "name of the medium in which the camera is"),
    "positions": Field("positions", "array", "(N, 3) vertices, before to_world"),
    "triangles": Field("triangles", "array", "(M, 3) indices of vertices"),
    "normals": Field("normals", "array", "(N, 3) unit vectors, or None: flat"),
    "uvs": Field("uvs", "array", "(N, 2) texture coordinates, or None"),
}
ARRAY = Field("attribute", "array", "(N or M, channels) values per vertex or per face")


def nearest_hint(name: str, known: list[str], before: str = "") -> str:
    near = difflib.get_close_matches(name, known, n=1)
    return f"; did you mean {before + near[0]!r}?" if near else ""


def plugin_fields(kind: str, plugin: str) -> Collection[str]:
    """The parameters that scene files give a plugin."""
    known = plugins_by_kind().get(kind, {}).get(plugin.lower())
    return known.by_name if known else ()


def short(value: object) -> str:
    """A value in one line."""
    shape = getattr(value, "shape", ())
    return f"<array {shape}>" if len(shape) > 1 or (shape and shape[0] > 6) else repr(value)
