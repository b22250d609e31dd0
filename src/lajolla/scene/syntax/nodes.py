"""The scene as typed objects, from XML elements or Python dicts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias, Union

import numpy as np
import numpy.typing as npt

from .errors import Location
from .members import Run

Array: TypeAlias = npt.NDArray[np.float64]

# Kinds of nodes that represent an object with a plugin name.
KINDS = (
    "scene",
    "integrator",
    "sensor",
    "film",
    "rfilter",
    "sampler",
    "bsdf",
    "texture",
    "emitter",
    "shape",
    "medium",
    "phase",
    "volume",
    "subsurface",
)


@dataclass(frozen=True)
class Vector:
    """A point or a vector: three numbers."""

    xyz: tuple[float, float, float]


@dataclass(frozen=True)
class Rgb:
    """A linear sRGB colour."""

    values: tuple[float, float, float]


@dataclass(frozen=True)
class Spectrum:
    """Values over wavelengths in nm, linear in between; without wavelengths, one value over all of them."""

    values: tuple[float, ...]
    wavelengths: tuple[float, ...] = ()


@dataclass(frozen=True)
class SpectrumFile:
    """A spectrum in an `.spd` file."""

    filename: str


@dataclass(frozen=True)
class Blackbody:
    """Planck's law at a temperature in kelvin, times a scale."""

    temperature: float
    scale: float = 1.0


@dataclass(frozen=True, eq=False)
class Column:
    """Values of the members of a run: numbers (count,), triples (count, 3) or matrices (count, 4, 4)."""

    rows: npt.NDArray[Any]


@dataclass(frozen=True)
class Reference:
    """The object that has this id, anywhere in the scene."""

    id: str


# A transform is a 4x4 array; any other object (an image, a mesh) comes from a Python dict only.
Value: TypeAlias = Union[
    bool,
    int,
    float,
    str,
    Vector,
    Rgb,
    Spectrum,
    SpectrumFile,
    Blackbody,
    Array,
    Column,
    Reference,
    "Node",
    object,
]


@dataclass(slots=True)
class Property:
    """A named value of a node. `name` is empty for children that are identified by their kind.

    In a run the value is a `Column` where numbers differ; where references do, it is that of the first
    member, and `members` has those of all.
    """

    name: str
    value: Value
    location: Location  # of the value
    name_location: Location
    members: list[Reference] | list[Node] = field(default_factory=list)


@dataclass(frozen=True)
class Unsaid:
    """Differences between file versions that no property can express; `versions` sets them in nodes.

    The defaults are those of Mitsuba 3.
    """

    integrator: str = ""  # for a scene without one; "": "path", with a warning
    last_sensor: bool = False  # the last of several sensors is used, not the first
    camera: bool = False  # a scene without a camera gets one that sees everything
    daylight: bool = False  # a scene without light gets sun and sky
    lights_add_up: bool = False  # several environment lights cause no warning
    boundary: str = "diffuse"  # the bsdf of a shape around a medium, without its own
    mirrored: bool = True  # a mirrored sphere is turned inside out
    bounded: bool = True  # a constant extinction ends at a box, as a grid does
    exchanged: bool = True  # a checkerboard that is read as a number exchanges its colours
    terminator: str = "none"  # of materials that do not set it


SINCE_2 = Unsaid()


@dataclass(eq=False, slots=True)
class Node:
    """An object of the scene: its kind ("bsdf"), its plugin ("diffuse") and its properties in file order.

    One with a `run` stands for as many objects as that has members. Those of BSDFs have `ids`.
    """

    kind: str
    plugin: str
    location: Location
    plugin_location: Location
    id: str = ""
    properties: list[Property] = field(default_factory=list)
    unsaid: Unsaid = SINCE_2
    run: Run | None = None
    ids: Sequence[str] = ()

    @property
    def count(self) -> int:
        """The number of objects that it represents."""
        return 1 if self.run is None else len(self.run)

    def find(self, name: str) -> Property | None:
        """The property of that name; the last one if it was given twice."""
        return next((p for p in reversed(self.properties) if p.name == name), None)

    def property_location(self, name: str) -> Location:
        """The place of a property's value; that of the node when the property is absent."""
        prop = self.find(name)
        return prop.location if prop else self.location

    def children(self, *kinds: str) -> Iterator[tuple[Property, Node]]:
        """The child nodes of these kinds in order, each with the property that holds it."""
        for prop in self.properties:
            if isinstance(prop.value, Node) and prop.value.kind in kinds:
                yield prop, prop.value

    def outermost(self, kind: str) -> list[Node]:
        """The children of a kind, each once, without those that are declared here and used in another one."""
        found = list(dict.fromkeys(node for _, node in self.children(kind)))
        if len(found) < 2:
            return found
        parts = set(below(found))
        return [node for node in found if node not in parts]

    def set_default(self, name: str, value: Value) -> None:
        """Adds a property unless one of that name is there."""
        if self.find(name) is None:
            self.properties.append(Property(name, value, self.plugin_location, self.plugin_location))

    def without(self, names: Iterable[str]) -> list[Property]:
        """The properties except those of these names."""
        dropped = set(names)
        return [p for p in self.properties if p.name not in dropped]

    def __str__(self) -> str:
        return f'{self.kind} "{self.plugin}"' if self.plugin else self.kind


def below(nodes: Iterable[Node]) -> list[Node]:
    """All nodes below these, each once however often it is referred to."""
    found: dict[Node, None] = {}
    waiting = list(nodes)
    while waiting:
        for prop in waiting.pop().properties:
            for value in (prop.value, *prop.members):
                if isinstance(value, Node) and value not in found:
                    found[value] = None
                    waiting.append(value)
    return list(found)
