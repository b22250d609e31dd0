"""Instances for Mitsuba 3, whose shape groups contain neither groups nor lights."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..description.instances import group_of, keeps_sides, members_of, placement
from ..schema import Part
from ..syntax.nodes import Array, Node, Property
from .plugins import having, like

if TYPE_CHECKING:
    from .translator import Translator


@dataclass
class Contents:
    """Contents of a shape group: flat groups with transforms, and emitting shapes."""

    groups: list[tuple[Array, Node]]
    lights: list[tuple[Array, Node]]

    def extend(self, matrix: Array, inner: Contents) -> None:
        """Adds the contents of a nested group."""
        self.groups += [(matrix @ placed, group) for placed, group in inner.groups]
        self.lights += [(matrix @ placed, light) for placed, light in inner.lights]


def instances(translator: Translator, node: Node) -> list[Node]:
    """An instance of every group that it shows, and the lights among them as plain shapes."""
    contents = _contents(translator, group_of(translator.builder, node))
    matrix = placement(translator.builder, node)
    result = []
    for placed, group in contents.groups:
        one = (
            like(node, "instance") if not result else Node("shape", "instance", node.location, node.location)
        )
        one.properties.append(Property("", group, node.location, node.location))
        result.append(having(one, to_world=matrix @ placed))
    return result + [
        s for placed, light in contents.lights for s in _light(translator, light, matrix @ placed)
    ]


def group(translator: Translator, node: Node) -> list[Node]:
    """The direct members of a group, as a group."""
    contents = _contents(translator, node)
    return [inner for _, inner in contents.groups if inner.location == node.location]


def _contents(translator: Translator, node: Node) -> Contents:
    if node not in translator.groups:
        translator.groups[node] = _build(translator, node)
    return translator.groups[node]


def _build(translator: Translator, node: Node) -> Contents:
    contents = Contents([], [])
    own = like(node, "shapegroup")
    for child in members_of(node):
        name = child.plugin.lower()
        if name == "shapegroup":
            contents.extend(np.eye(4), _contents(translator, child))
        elif name == "instance":
            inner = _contents(translator, group_of(translator.builder, child))
            contents.extend(placement(translator.builder, child), inner)
        elif any(emitter.plugin.lower() == "area" for _, emitter in child.children("emitter")):
            contents.lights.append((np.eye(4), child))
        else:
            shapes = translator.shapes(child)
            own.properties += [Property("", shape, node.location, node.location) for shape in shapes]
    if own.properties:
        contents.groups.append((np.eye(4), own))
    return contents


def _light(translator: Translator, light: Node, matrix: Array) -> list[Node]:
    """A shape of a group as if it stood in the scene itself."""
    place = light.property_location("to_world")
    placed = Property("to_world", matrix @ placement(translator.builder, light), place, place)
    moved = replace(light, id="", properties=[*light.without(["to_world"]), placed])
    shapes = translator.shapes(moved)
    if np.linalg.det(matrix[:3, :3]) > 0:
        return shapes
    built = translator.builder.construct(moved)
    entries = [p.entry if isinstance(p, Part) else p for p in (built if isinstance(built, list) else [built])]
    return [
        shape if keeps_sides(entry) else having(shape, flip_normals=not _flipped(shape))
        for shape, entry in zip(shapes, entries, strict=True)
    ]


def _flipped(shape: Node) -> bool:
    flips = shape.find("flip_normals")
    return bool(flips and flips.value)
