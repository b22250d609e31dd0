"""Instances for Mitsuba 3, whose shape groups contain neither groups nor lights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..description.instances import (
    Contents,
    Placement,
    flattened,
    group_of,
    keeps_sides,
    placed_light,
    placement,
)
from ..description.plugin import Part
from ..syntax.nodes import Node, Property
from .plugins import having, holding, like
from .translation import Translation


def instances(translation: Translation, node: Node) -> list[Node]:
    """An instance of every group that it shows, and the lights among them as plain shapes."""
    contents = _contents(translation, group_of(translation.builder, node))
    outer = placement(translation.builder, node)
    translation.lose(*outer.compositing)
    result: list[Node] = []
    for placed, group in contents.groups:
        one = (
            like(node, "instance") if not result else Node("shape", "instance", node.location, node.location)
        )
        one.properties.append(Property("", group, node.location, node.location))
        result.append(having(one, to_world=(outer @ placed).matrix))
    return result + [
        s for placed, light in contents.lights for s in _light(translation, light, outer @ placed)
    ]


def group(translation: Translation, node: Node) -> list[Node]:
    """The direct members of a group, as a group."""
    contents = _contents(translation, node)
    return [inner for _, inner in contents.groups if inner.location == node.location]


def _contents(translation: Translation, node: Node) -> Contents[Node]:
    if node not in translation.groups:

        def close(group: Node, shapes: list[Node]) -> Node:
            own = like(group, "shapegroup")
            return holding(own, *shapes)

        translation.groups[node] = flattened(
            translation.builder,
            node,
            translation.shapes,
            close,
            lambda inner: _contents(translation, inner),
        )
    return translation.groups[node]


def _light(translation: Translation, light: Node, outer: Placement) -> list[Node]:
    """A shape of a group as if it stood in the scene itself."""
    moved = replace(placed_light(translation.builder, light, outer), id="")
    shapes = translation.shapes(moved)
    if np.linalg.det(outer.matrix[:3, :3]) > 0:
        return shapes
    built = translation.builder.construction(moved).result
    parts = built if isinstance(built, list) else [built]
    entries = [part.entry if isinstance(part, Part) else part for part in parts]
    return [
        shape
        if isinstance(entry, dict) and keeps_sides(entry)
        else having(shape, flip_normals=not _flipped(shape))
        for shape, entry in zip(shapes, entries, strict=True)
    ]


def _flipped(shape: Node) -> bool:
    flips = shape.find("flip_normals")
    return bool(flips and flips.value)
