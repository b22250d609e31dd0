"""Scenes as anybody might write them: mostly sensible, with a mistake here and there; as XML or as dicts."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar
from xml.sax.saxutils import quoteattr

import numpy as np
from hypothesis import strategies as st
from plugin_tools import FILES, PARAMETERS

from lajolla.scene import plugins_by_kind
from lajolla.scene.description.substitutes import SUBSTITUTES
from lajolla.scene.schema import CHILDREN, Field

T = TypeVar("T")
Draw = Callable[[st.SearchStrategy[int]], int]

VERSIONS = ("3.0.0", "3.5.2", "2.1.0", "0.6.0", "0.5.0", "0.4.0", "3", "", "x", "99.0.0", "0.0.0")
NUMBERS = (0.5, 1.0, 0.0, 2.0, 10.0, 0.1, -1.0, 90.0, 1e-6, 100.0)
EXTREMES = (-0.0, 1e-30, 1e-45, 3e38, -3e38, 1e39, 1e300, 2.0**31, 2.0**63, float("nan"), float("inf"))
WORDS = (
    "",
    "a",
    "x y",
    "true",
    "none",
    "Au",
    "$level",
    "$nothing",
    "../a",
    "a.exr",
    "\u00e9",
    "1, 2",
    "#ff8000",
    "0x10",
)
MARKUP = (
    '<default name="level" value="0.5"/>',
    '<default name="level"/>',
    '<alias id="bsdf" as="other"/>',
    '<alias id="other" as="bsdf"/>',
    '<include filename="part.xml"/>',
    '<include filename="nowhere.xml"/>',
    '<path value="."/>',
    "<null/>",
    "<!-- a remark -->",
    "text",
    "&#0;",
    "<![CDATA[x]]>",
    "<?php ?>",
)
TAGS = ("float", "integer", "boolean", "string", "point", "vector", "rgb", "srgb", "spectrum", "blackbody",
        "transform", "animation", "ref", "bsdf", "texture", "shape", "emitter", "scene")  # fmt: skip
IDS = ("bsdf", "texture", "shape", "medium", "group", "emitter")
# What fields hold that are objects.
OBJECTS = {
    "texture_float": "texture", "texture_spectrum": "texture", "image": "texture", "phase": "phase",
    "volume_float": "volume", "volume_spectrum": "volume", "volume_matrix": "volume", "grid": "volume",
}  # fmt: skip
NEEDED = {  # children without which a plugin makes no sense
    "twosided": ("bsdf",), "mask": ("bsdf",), "bumpmap": ("texture", "bsdf"), "coating": ("bsdf",),
    "normalmap": ("texture", "bsdf"), "blendbsdf": ("bsdf", "bsdf"), "roughcoating": ("bsdf",),
    "mixturebsdf": ("bsdf",), "blendphase": ("phase", "phase"), "merge": ("shape", "shape"),
    "shapegroup": ("shape",), "instance": ("group",), "moment": ("integrator",), "aov": ("integrator",),
    "multichannel": ("integrator", "integrator"), "area": (),
}  # fmt: skip
MOST_DEPTH = 4


@dataclass
class Ref:
    id: str


@dataclass
class Colour:
    values: tuple[float, ...]


@dataclass
class Vector:
    values: tuple[float, ...]


@dataclass
class Samples:
    """A spectrum: (wavelength, value) pairs, or one number."""

    pairs: tuple[tuple[float, float], ...]


@dataclass
class Transform:
    """Operations of a <transform>, the first one first."""

    operations: tuple[tuple[str, tuple[float, ...]], ...]


@dataclass
class Thing:
    """An object: a plugin with named entries, children among them."""

    kind: str
    plugin: str
    id: str = ""
    entries: list[tuple[str, Any]] = field(default_factory=list)


class Author:
    """Makes choices; what comes first in a list of choices is the simplest."""

    def __init__(self, draw: Draw) -> None:
        self.draw = draw
        self.children = 0

    def below(self, count: int) -> int:
        return self.draw(st.integers(0, count - 1))

    def pick(self, choices: Sequence[T]) -> T:
        return choices[self.below(len(choices))]

    def one_in(self, count: int) -> bool:
        return self.below(count) == count - 1

    def scene(self) -> Thing:
        """A scene that shows something, as far as it is right."""
        film = Thing("film", "hdrfilm", "", [("width", 4), ("height", 3)])
        parts = [self.thing("integrator") if self.one_in(2) else Thing("integrator", "path")]
        sensor = self.thing("sensor") if self.one_in(3) else Thing("sensor", "perspective")
        for kind, chance in (("film", 4), ("sampler", 4), ("medium", 8)):
            if self.one_in(chance):
                sensor.entries.append((self.name_of(kind), self.thing(kind)))
        sensor.entries.insert(0, ("film", film))
        parts.append(sensor)
        parts += [self.thing("emitter") for _ in range(self.below(3))]
        for _ in range(self.below(3)):
            shared = self.thing(self.pick(("bsdf", "texture", "medium")))
            shared.id = self.pick((shared.kind, self.pick(IDS)))
            parts.append(shared)
        parts += [self.shape() for _ in range(1 + self.below(3))]
        if self.one_in(6):
            parts.append(Thing("shape", "shapegroup", "group", [("ball", Thing("shape", "sphere"))]))
        return Thing("scene", "scene", "", [(self.name_of(part.kind), part) for part in parts])

    def name_of(self, kind: str) -> str:
        """A name of its own for a child."""
        self.children += 1
        return f"{kind}_{self.children}"

    def shape(self) -> Thing:
        ball = Thing("shape", "sphere", "", [("center", Vector((0.0, 0.0, 5.0)))])
        shape = self.thing("shape") if self.one_in(2) else ball
        for kind, name, chance in (("bsdf", "", 2), ("emitter", "", 4), ("medium", "interior", 4),
                                   ("medium", "exterior", 8)):  # fmt: skip
            if self.one_in(chance):
                child = self.thing(kind) if kind != "emitter" or self.one_in(4) else Thing("emitter", "area")
                shape.entries.append((name or self.name_of(kind), child))
        return shape

    def thing(self, kind: str, depth: int = 0) -> Thing:
        """A plugin of a kind with some of its parameters."""
        if kind == "group":
            return Thing("shape", "shapegroup", "", [("ball", Thing("shape", "sphere"))])
        names = list(plugins_by_kind()[kind])
        if self.one_in(12):
            names = [*SUBSTITUTES.get(kind, ("",)), "", "difuse", "lajolla"]
        name = self.pick(names)
        made = Thing(kind, name, self.pick(IDS) if self.one_in(20) else "")
        plugin = plugins_by_kind()[kind].get(name)
        if plugin is None:
            return made
        given = dict(PARAMETERS.get((kind, name), {}))
        fields = {f.name: f for f in plugin.fields}
        if "filename" in fields and kind != "film":
            given["filename"] = FILES.get(name, self.pick(("a.exr", "a.png")))
        for value in given.values():
            assert not isinstance(value, Thing)
        made.entries += [(key, self.own(value)) for key, value in given.items() if not self.one_in(16)]
        for child in NEEDED.get(name, ()):
            if not self.one_in(16) and depth < MOST_DEPTH:
                made.entries.append((self.name_of(child), self.child(child, depth)))
        for _ in range(self.below(4)):
            if not fields:
                break
            chosen = fields[self.pick(list(fields))]
            made.entries.append((chosen.name, self.value(chosen, depth)))
        if self.one_in(16):
            made.entries.append((self.pick(("girth", "radius", "to_world", "")), self.anything(depth)))
        kinds = CHILDREN.get(kind, ())
        if kinds and self.one_in(12) and depth < MOST_DEPTH:
            child = self.pick(kinds)
            if child in plugins_by_kind():
                made.entries.append((self.name_of(child), self.child(child, depth)))
        return made

    def own(self, value: Any) -> Any:  # noqa: ANN401
        """A value of `PARAMETERS` in the words of this module."""
        if isinstance(value, dict):
            return Thing("texture", value["type"])
        return Colour(tuple(value)) if isinstance(value, list) else value

    def child(self, kind: str, depth: int) -> Thing | Ref:
        return Ref(self.pick(IDS)) if self.one_in(8) else self.thing(kind, depth + 1)

    def value(self, given: Field, depth: int) -> Any:  # noqa: ANN401
        """A value for a field: mostly one of its type."""
        if self.one_in(10):
            return self.anything(depth)
        if given.type in OBJECTS and depth < MOST_DEPTH and self.one_in(2):
            return self.child(OBJECTS[given.type], depth)
        simple: dict[str, Callable[[], Any]] = {
            "float": lambda: self.within(given),
            "texture_float": lambda: self.within(given),
            "volume_float": lambda: self.within(given),
            "integer": lambda: int(min(max(self.within(given), -(2.0**40)), 2.0**40)),
            "boolean": lambda: self.one_in(2),
            "choice": lambda: self.pick(given.choices or WORDS),
            "string": lambda: self.pick(WORDS),
            "floats": lambda: ", ".join(str(self.number()) for _ in range(self.below(5))),
            "vector": self.vector,
            "transform": self.transform,
            "spectrum": self.colour,
            "texture_spectrum": self.colour,
            "volume_spectrum": self.colour,
        }
        return simple.get(given.type, lambda: self.anything(depth))()

    def within(self, given: Field) -> float:
        """A number that the field takes, or nearly so."""
        bounds = [b for b in (given.minimum, given.maximum) if b is not None]
        number = self.pick((*NUMBERS, *bounds)) if not self.one_in(8) else self.pick(EXTREMES)
        if len(bounds) == 2 and not self.one_in(6) and np.isfinite(number):
            number = min(max(number, bounds[0]), bounds[1])
        return number if np.isfinite(number) or given.type != "integer" else 7.0

    def number(self) -> float:
        return self.pick(EXTREMES) if self.one_in(8) else self.pick(NUMBERS)

    def vector(self) -> Vector:
        return Vector(tuple(self.number() for _ in range(3 if not self.one_in(16) else self.below(5))))

    def colour(self) -> Any:  # noqa: ANN401
        case = self.below(4)
        if case == 0:
            return Colour(tuple(self.number() for _ in range(3)))
        if case == 1:
            return self.number()
        if case == 2:
            start, step = self.pick((400.0, 0.0, -5.0, 1e30)), self.pick((100.0, 1.0, 0.0, -1.0))
            return Samples(tuple((start + i * step, self.number()) for i in range(self.below(4))))
        return Colour((0.2, 0.5, 0.7))

    def transform(self) -> Transform:
        counts = {"translate": 3, "scale": 3, "rotate": 4, "matrix": 16, "lookat": 9}
        operations = []
        for _ in range(self.below(3)):
            name = self.pick(list(counts))
            operations.append((name, tuple(self.number() for _ in range(counts[name]))))
        return Transform(tuple(operations))

    def anything(self, depth: int) -> Any:  # noqa: ANN401
        """A value of any type."""
        case = self.below(9)
        kinds = ("texture", "bsdf", "shape", "medium", "phase", "volume", "emitter", "integrator", "rfilter")
        if case == 8 and depth < MOST_DEPTH:
            return self.thing(self.pick(kinds), depth + 1)
        simple: tuple[Callable[[], Any], ...] = (
            self.number, lambda: self.one_in(2), lambda: self.below(100) - 50, lambda: self.pick(WORDS),
            self.vector, self.colour, self.transform, lambda: Ref(self.pick(IDS)),
        )  # fmt: skip
        return simple[min(case, 7)]()

    # --- as XML

    def xml(self, scene: Thing) -> str:
        """The text of a scene file, in the words of its version, or nearly so."""
        version = self.pick(VERSIONS)
        self.camel = version.startswith("0") != self.one_in(16)
        inside = "".join(self.element(name, value) for name, value in scene.entries)
        stated = f" version={quoteattr(version)}" if version or self.one_in(2) else ""
        return f"<scene{stated}>{self.markup()}{inside}{self.markup()}</scene>"

    def markup(self) -> str:
        return self.pick(MARKUP) if self.one_in(8) else ""

    def element(self, name: str, value: Any) -> str:  # noqa: ANN401
        if self.camel and not isinstance(value, Thing):
            name = re.sub(r"_(\w)", lambda letter: letter[1].upper(), name)
        named = f" name={quoteattr(name)}" if not self.one_in(64) else ""
        if isinstance(value, Thing):
            inside = "".join(self.element(*entry) for entry in value.entries)
            named = named if not re.fullmatch(r"\w+_\d+", name) else ""  # a child needs none
            stated = f" id={quoteattr(value.id)}" if value.id else ""
            tag = value.kind if not self.one_in(200) else self.pick(TAGS)
            return f"<{tag} type={quoteattr(value.plugin)}{stated}{named}>{inside}{self.markup()}</{tag}>"
        tag, attributes = self.attributes(value)
        if self.one_in(100):
            tag = self.pick(TAGS)
        if isinstance(value, Transform):
            inside = "".join(self.operation(*operation) for operation in value.operations)
            return f"<{tag}{named}>{inside}</{tag}>"
        return f"<{tag}{named} {attributes}/>"

    def attributes(self, value: Any) -> tuple[str, str]:  # noqa: ANN401
        """The tag that a value has in scene files, and the rest."""
        if isinstance(value, Ref):
            return "ref", f"id={quoteattr(value.id)}"
        if isinstance(value, Colour):
            return self.pick(("rgb", "srgb", "spectrum")), f'value="{self.numbers(value.values)}"'
        if isinstance(value, Samples):
            return "spectrum", f'value="{", ".join(f"{w!r}:{v!r}" for w, v in value.pairs)}"'
        if isinstance(value, Vector) and len(value.values) == 3 and self.one_in(2):
            x, y, z = value.values
            return self.pick(("point", "vector")), f'x="{x!r}" y="{y!r}" z="{z!r}"'
        if isinstance(value, Vector):
            return self.pick(("point", "vector")), f'value="{self.numbers(value.values)}"'
        if isinstance(value, Transform):
            return self.pick(("transform", "transform", "animation")), ""
        tag = {bool: "boolean", int: "integer", float: "float"}.get(type(value), "string")
        return tag, f"value={quoteattr(str(value).lower() if tag == 'boolean' else str(value))}"

    def operation(self, name: str, values: tuple[float, ...]) -> str:
        if name == "rotate":
            x, y, z, angle = values
            return f'<rotate x="{x!r}" y="{y!r}" z="{z!r}" angle="{angle!r}"/>'
        if name == "lookat":
            parts = (self.numbers(values[i : i + 3]) for i in (0, 3, 6))
            return '<lookat origin="{}" target="{}" up="{}"/>'.format(*parts)
        if name == "scale" and self.one_in(2):
            return f'<scale value="{values[0]!r}"/>'
        return f'<{name} value="{self.numbers(values)}"/>'

    def numbers(self, values: Sequence[float]) -> str:
        return self.pick((", ", " ", ",")).join(f"{v!r}" for v in values)

    # --- as a dict

    def dict_of(self, thing: Thing) -> dict[str, Any]:
        """The scene as Python code writes it."""
        made: dict[str, Any] = {"type": thing.plugin}
        if thing.id and self.one_in(2):
            made["id"] = thing.id
        for name, value in thing.entries:
            key = value.id if isinstance(value, Thing) and value.id else name
            made[key] = self.python(value)
        return made

    def python(self, value: Any) -> Any:  # noqa: ANN401
        if isinstance(value, Thing):
            return self.dict_of(value)
        if isinstance(value, Ref):
            return {"type": "ref", "id": value.id}
        if isinstance(value, Colour):
            return {"type": self.pick(("rgb", "srgb")), "value": list(value.values)}
        if isinstance(value, Samples):
            return {"type": "spectrum", "value": [list(pair) for pair in value.pairs]}
        if isinstance(value, Vector):
            return self.pick((list, tuple, np.array))(value.values)
        if isinstance(value, Transform):
            matrix = np.eye(4)
            for name, values in value.operations:
                if name == "matrix":
                    with np.errstate(all="ignore"):
                        matrix = np.reshape(values, (4, 4)) @ matrix
            return matrix
        if isinstance(value, float):
            return self.pick((float, np.float64))(value)
        return value


@st.composite
def scene_texts(draw: Any) -> str:  # noqa: ANN401
    """Scene files."""
    author = Author(draw)
    return author.xml(author.scene())


@st.composite
def scene_dicts(draw: Any) -> dict[str, Any]:  # noqa: ANN401
    """Scenes for `lajolla.load_dict`."""
    author = Author(draw)
    return author.dict_of(author.scene())
