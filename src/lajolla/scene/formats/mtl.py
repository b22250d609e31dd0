"""Material libraries of OBJ files, converted to materials as in Mitsuba 0.6."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from lajolla.colour import decode_srgb

from ..syntax.errors import Diagnostics, Location, SceneError
from ..syntax.files import file_bytes, find_file
from ..syntax.nodes import Node, Property, Rgb, Value

BLACK = Rgb((0.0, 0.0, 0.0))
DIELECTRIC, CONDUCTOR = (4, 6, 7, 9), (5, 8)  # values of `illum`


@dataclass
class Material:
    """What the statements after one `newmtl` say."""

    diffuse: Value = BLACK
    specular: Value = BLACK
    exponent: float = 0.0
    bump: Node | None = None
    opacity: Value | None = None
    model: int = 0


@dataclass
class Reader:
    """Reads one library; problems are warned about and ignored."""

    path: Path
    location: Location  # what to blame in the scene
    diagnostics: Diagnostics
    materials: dict[str, Material] = field(default_factory=dict)

    def read(self) -> dict[str, Node]:
        """Every material by its name."""
        current = Material()  # statements before the first name count for nothing
        for number, line in enumerate(file_bytes(self.path).splitlines(), start=1):
            keyword, _, rest = line.decode("utf-8", "replace").strip().partition(" ")
            rest = rest.strip()
            if keyword == "newmtl":
                current = self.materials.setdefault(rest, Material())
                continue
            try:
                self._statement(current, keyword, rest)
            except ValueError:
                self._warn(f'line {number}: "{keyword}" is not followed by what it needs')
        bsdfs = {name: self._bsdf(material) for name, material in self.materials.items()}
        for name, bsdf in bsdfs.items():
            bsdf.id = name
        return bsdfs

    def _statement(self, material: Material, keyword: str, rest: str) -> None:
        if keyword == "Kd":
            material.diffuse = _colour(rest)
        elif keyword == "Ks":
            material.specular = _colour(rest)
        elif keyword == "map_Kd":
            material.diffuse = self._texture(rest) or BLACK
        elif keyword == "map_Ks":
            material.specular = self._texture(rest) or BLACK
        elif keyword in ("bump", "map_bump", "map_Bump"):
            material.bump = self._texture(rest, raw=True)
        elif keyword == "map_d":
            material.opacity = self._texture(rest)
        elif keyword == "d":
            value = min(max(_number(rest.split()[-1] if rest else ""), 0.0), 1.0)
            material.opacity = None if value == 1 else value
        elif keyword == "Ns":
            material.exponent = max(_number(rest), 0.0)
        elif keyword == "illum":
            material.model = int(rest)

    def _texture(self, text: str, *, raw: bool = False) -> Node | None:
        """A bitmap. Options precede the file name."""
        name = text.split()[-1] if text.startswith("-") else text
        for wanted in (name, name.replace("\\", "/").rsplit("/", 1)[-1]):
            try:
                path = find_file(wanted, [self.path.parent], self.location)
            except SceneError:
                continue
            properties = [("filename", str(path.resolve())), ("filter_type", "ewa"), ("raw", raw)]
            return self._node("texture", "bitmap", properties if raw else properties[:2])
        self._warn(f'the texture "{name}" is not found')
        return None

    def _bsdf(self, material: Material) -> Node:
        bsdf = self._surface(material)
        if material.bump is not None:
            bsdf = self._node("bsdf", "bumpmap", [("", material.bump), ("", bsdf)])
        if material.opacity is not None:
            bsdf = self._node("bsdf", "mask", [("opacity", material.opacity), ("", bsdf)])
        return bsdf

    def _surface(self, material: Material) -> Node:
        if material.model in DIELECTRIC:
            return self._node("bsdf", "dielectric", [])
        if material.model in CONDUCTOR:
            return self._node("bsdf", "conductor", [("material", "Al")])
        if material.model != 2 or material.specular == BLACK or material.exponent == 0:
            return self._node("bsdf", "diffuse", [("reflectance", material.diffuse)])
        return self._node(
            "bsdf",
            "phong",
            [
                ("diffuse_reflectance", material.diffuse),
                ("specular_reflectance", material.specular),
                ("exponent", material.exponent),
            ],
        )

    def _node(self, kind: str, plugin: str, properties: list[tuple[str, Value]]) -> Node:
        at = self.location
        made = [Property(name, value, at, at) for name, value in properties]
        return Node(kind, plugin, at, at, properties=made)

    def _warn(self, message: str) -> None:
        self.diagnostics.warn(f'"{self.path}": {message}', self.location)


def _number(text: str) -> float:
    value = float(text)
    if not abs(value) < 1e30:
        raise ValueError
    return value


def _colour(text: str) -> Rgb:
    """Colours are sRGB, as in Mitsuba 0.6; above 1 they are clamped."""
    encoded = [min(max(_number(word), 0.0), 1.0) for word in text.split()[:3]]
    red, green, blue = decode_srgb(encoded).tolist()
    return Rgb((red, green, blue))


def materials_of(
    names: list[str], obj: Path, location: Location, diagnostics: Diagnostics
) -> dict[str, Node]:
    """The materials of an OBJ file's libraries, which are in its folder; warns about missing ones."""
    materials: dict[str, Node] = {}
    for name in names:
        try:
            path = find_file(name, [obj.parent], location)
            materials |= Reader(path, location, diagnostics).read()
        except (SceneError, OSError):
            diagnostics.warn(f'"{obj}": its material library "{name}" cannot be read', location)
    return materials
