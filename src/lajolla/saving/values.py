"""Values of a description as elements of scene files, and files for what XML cannot hold."""

from __future__ import annotations

import hashlib
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lajolla import _core
from lajolla.params.materials import terminator_of
from lajolla.params.objects import KINDS, MATERIAL, Entry, Lists, SceneObject, place_of
from lajolla.params.textures import is_texture, unclamped
from lajolla.params.values import is_smoothed, mesh_array, mesh_names
from lajolla.scene import SceneError
from lajolla.scene.formats.ply import ply_bytes
from lajolla.scene.formats.voxels import vol_bytes
from lajolla.scene.schema import Field

Refer = Callable[[str, str], str | None]  # kind and entry: the id of an object of the file, if it is one

# Plugins whose names differ from those of the core's models.
PLUGINS = {("shape", "mesh"): "ply", ("film", "film"): "hdrfilm", ("bsdf", "coating"): "roughcoating"}
EXCHANGED = {"color0": "color1", "color1": "color0"}
NOT_IN_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # characters
NOT_WRITTEN = ("curves", "measurement")  # types of fields


class NotWritten(SceneError):
    """A value that scene files cannot hold; the message is the reason."""


@dataclass
class Values:
    """Writes values of the fields of a description's objects.

    Attributes:
        refer: how objects of the file are referred to.
        folder: of the files beside the scene, relative to it.
        ids: of the objects by their entries.
        known_ids: those that the file has.
        files: contents of these files by their names.
        exchanges: whether the file's version exchanges the colours of checkerboards that are read as numbers.
    """

    lists: Lists
    refer: Refer
    folder: str
    ids: Mapping[str, str] = field(default_factory=dict)
    known_ids: Collection[str] = ()
    files: dict[str, bytes | np.ndarray[Any, Any]] = field(default_factory=dict)
    exchanges: bool = True

    def whole(self, found: SceneObject, entry: Entry, name: str = "") -> ET.Element:
        """An object with all its values."""
        plugin = PLUGINS.get((found.kind, found.model), found.model)
        element = ET.Element(found.kind, {"type": plugin, **({"name": name} if name else {})})
        for declared in found.fields.values():
            value = entry.get(declared.name, declared.default)
            if not is_plain(declared, value):
                element.extend(self.field(found, declared, entry))
        return element

    def field(self, found: SceneObject, declared: Field, entry: Entry) -> list[ET.Element]:
        """The elements for a field of an entry; none for values that are absent."""
        value = entry.get(declared.name, declared.default)
        if value is None or (declared.type in ("phase", MATERIAL) and value == -1):
            return []
        if declared.type in NOT_WRITTEN:
            raise NotWritten(f"there is no file format for {declared.type} made in memory")
        if declared.type == "mesh":
            # The reader computes the same ones, and replaces those of files that have no length.
            computed = is_smoothed(value, entry)
            return [_constant("filename", self.file(".ply", ply_bytes(value, normals=not computed)))]
        if declared.type == "image":
            return self._image(found, value)
        if declared.type == "grid":
            voxels = np.asarray(value.__getstate__())
            return [_constant("filename", self.file(".vol", vol_bytes(voxels)))]
        if declared.type in ("phase", MATERIAL) or isinstance(value, Mapping):
            return [self._object(declared, value)]
        if declared.type in ("transform", "matrix"):
            return [_transform(declared.name, value)]
        return [_constant(declared.name, _typed(declared.type, value))]

    def reference(self, kind: str, entry: str, name: str) -> ET.Element:
        """A reference to an object of the file."""
        identity = self.refer(kind, entry)
        if identity is None:
            raise NotWritten(f"the {kind} is not in the scene file")
        return ET.Element("ref", {"id": plain_text(identity), **({"name": name} if name else {})})

    def material(self, entry_name: str) -> ET.Element:
        """A bsdf or an adapter: a reference if it has an id of the file, else all that is inside."""
        identity = self.ids.get(entry_name, "")
        if identity in self.known_ids:
            return ET.Element("ref", id=plain_text(identity))
        entry = self.lists.entry(entry_name)
        kind = KINDS[place_of(entry_name)[0]]
        found = SceneObject("", kind, entry["type"], entry_name)
        element = ET.Element("bsdf", type=PLUGINS.get((kind, found.model), found.model))
        if identity:
            element.set("id", plain_text(identity))
        for declared in found.fields.values():
            value = entry.get(declared.name, declared.default)
            if declared.type == MATERIAL:
                element.append(self.material(material_entry(value)))
            elif declared.type == "bsdf" or not is_plain(declared, value):
                element.extend(self.field(found, declared, entry))
        return element

    def sides(self, slot: Entry) -> ET.Element:
        """The material of a shape."""
        front, back = slot["front"], slot["back"]
        result = self.material(material_entry(front))
        if back != -1:
            sides = [result] if back == front else [result, self.material(material_entry(back))]
            result = ET.Element("bsdf", type="twosided")
            result.extend(sides)
        is_own = result.tag != "ref"  # else it is that of the object of the file
        if is_own and (terminator_of(slot) != "none" or next(result.iter("ref"), None) is not None):
            result.append(_constant("terminator", terminator_of(slot)))
        return result

    def _object(self, declared: Field, value: Any) -> ET.Element:  # noqa: ANN401
        """What a field refers to: an object of the file, or a texture that was added."""
        if declared.type == "phase":
            return self.reference("phase", f"phases[{value}]", declared.name)
        if declared.type == MATERIAL:
            return self.reference("bsdf", material_entry(value), "")
        if "volume" in value:
            return self.reference("volume", f"volumes[{value['volume']}]", declared.name)
        if not is_texture(value):  # the bsdf inside of a coating
            raise NotWritten("the bsdf inside of another one cannot be written again")
        textures = self.lists.core["textures"]
        entry_name = f"textures[{unclamped(textures, value)['texture']}]"
        if (identity := self.refer("texture", entry_name)) is not None:
            return ET.Element("ref", {"name": declared.name, "id": plain_text(identity)})
        entry = self.lists.entry(entry_name)
        if entry["type"] == "checkerboard" and declared.type == "texture_float" and self.exchanges:
            entry = exchanged(entry)
        return self.whole(SceneObject("", "texture", entry["type"], entry_name), entry, declared.name)

    def _image(self, found: SceneObject, image: _core.Image) -> list[ET.Element]:
        """Pixels in a file of their own type."""
        width, height, channels, srgb, kind, words = image.__getstate__()
        stored = np.asarray(words).view((np.uint8, np.float16, np.float32)[kind])
        per_texel = 4 if channels == 3 and kind < 2 else channels
        pixels = stored[: width * height * per_texel].reshape(height, width, per_texel)[..., :channels]
        name = self.file(".exr" if kind else ".png", np.ascontiguousarray(pixels))
        raw = [_constant("raw", not srgb)] if found.kind == "texture" and kind == 0 else []
        return [_constant("filename", name), *raw]

    def file(self, ending: str, content: bytes | np.ndarray[Any, Any]) -> str:
        """The name of a file; it follows from the content, so that no other one is replaced."""
        data = content if isinstance(content, bytes) else content.tobytes() + str(content.shape).encode()
        name = f"{self.folder}/{hashlib.blake2b(data, digest_size=8).hexdigest()}{ending}"
        self.files[name] = content
        return name


def exchanged(board: Entry) -> Entry:
    """A checkerboard with its colours exchanged."""
    return {EXCHANGED.get(name, name): value for name, value in board.items()}


def material_entry(value: int | Mapping[str, int]) -> str:
    """The name of the entry of a bsdf or an adapter."""
    return f"adapters[{value['adapter']}]" if isinstance(value, Mapping) else f"bsdfs[{value}]"


def _typed(kind: str, value: Any) -> Any:  # noqa: ANN401
    """A number, a colour as a tuple, a vector as an array, or a list of numbers."""
    if kind == "vector":
        return np.asarray(value, float)
    if kind in ("floats", "volume_matrix"):
        return [float(v) for v in value]
    if "spectrum" in kind and isinstance(value, int | float):
        return float(value)
    if "spectrum" in kind:
        return tuple(float(v) for v in value)
    return float(value) if kind in ("float", "texture_float", "volume_float") else value


def _constant(name: str, value: Any) -> ET.Element:  # noqa: ANN401
    if isinstance(value, bool):
        tag, text = "boolean", str(value).lower()
    elif isinstance(value, int):
        tag, text = "integer", str(value)
    elif isinstance(value, float):
        tag, text = "float", _number(value)
    elif isinstance(value, tuple):
        tag, text = "rgb", ", ".join(map(_number, value))
    elif isinstance(value, np.ndarray):
        tag, text = "vector", ", ".join(map(_number, value.tolist()))
    elif isinstance(value, list):
        tag, text = "string", ", ".join(map(_number, value))
    else:
        tag, text = "string", plain_text(str(value))
    return ET.Element(tag, name=name, value=text)


def _number(value: float) -> str:
    """The shortest text that is read as the same number."""
    return repr(value).removesuffix(".0")


def plain_text(value: str) -> str:
    """A text without parameters.

    Raises:
        NotWritten: it has characters that XML cannot hold.
    """
    if NOT_IN_XML.search(value):
        raise NotWritten(f"no scene file can hold the text {value!a}")
    return value.replace("$", "\\$")


def _transform(name: str, value: Any) -> ET.Element:  # noqa: ANN401
    element = ET.Element("transform", name=name)
    numbers = np.asarray(value, float).ravel().tolist()
    ET.SubElement(element, "matrix", value=" ".join(map(_number, numbers)))
    return element


def equal(a: Any, b: Any) -> bool:  # noqa: ANN401
    """Whether two values of descriptions are equal; objects of the core by what they hold."""
    if a is b:
        return True
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(equal(a[key], b[key]) for key in a)
    if isinstance(a, _core.Mesh) and isinstance(b, _core.Mesh):
        return not differing_arrays(a, b)
    if hasattr(a, "__getstate__") and type(a).__module__.startswith("lajolla"):
        return type(a) is type(b) and equal(a.__getstate__(), b.__getstate__())
    if a is None or b is None:
        return False
    if isinstance(a, str | bool) or isinstance(b, str | bool):
        return type(a) is type(b) and bool(a == b)
    if isinstance(a, list | tuple) and isinstance(b, list | tuple) and any(map(_is_nested, [*a, *b])):
        return len(a) == len(b) and all(map(equal, a, b))
    x, y = np.asarray(a), np.asarray(b)
    if 1 not in (x.size, y.size) and x.shape != y.shape:
        return False
    x, y = np.broadcast_arrays(x, y)
    return bool(np.array_equal(x, y, equal_nan=x.dtype.kind == y.dtype.kind == "f"))


def is_plain(declared: Field, value: Any) -> bool:  # noqa: ANN401
    """Whether a value need not be written: other defaults than this one depend on the version of a file."""
    return value is None or (declared.type == "transform" and equal(value, declared.default))


def differing_arrays(a: _core.Mesh, b: _core.Mesh) -> list[str]:
    """The names of the arrays in which two meshes differ."""
    if a is b:
        return []
    x, y = ({name: mesh_array(mesh, name) for name in mesh_names(mesh)} for mesh in (a, b))
    return [name for name in {**x, **y} if name not in x or name not in y or not equal(x[name], y[name])]


def _is_nested(value: object) -> bool:
    return not isinstance(value, int | float)
