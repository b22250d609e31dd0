"""Shape groups and their instances: nested groups become instances of their parts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from ..schema import COMPOSITING, Field
from ..syntax.errors import SceneError
from ..syntax.members import Irregular
from ..syntax.nodes import Array, Node, Property
from .builder import Builder
from .plugin import Entry

# Nested groups and merged shapes of a small file could create more objects than memory can hold. Their number
# is limited to MOST_REPEATED, plus MOST_PER_SHAPE for each shape of the file.
MOST_REPEATED = 2**22
MOST_PER_SHAPE = 64
TO_WORLD = Field("to_world", "transform", "")

Group = TypeVar("Group")
Member = TypeVar("Member")
AddShape = Callable[[Builder, Node], Sequence[int]]


@dataclass(frozen=True)
class Placement:
    """How an instance shows what is in it."""

    matrix: Array
    compositing: Entry  # how the camera sees it, where that is not the default

    def __matmul__(self, inner: Placement) -> Placement:
        """That of an instance in a group that is placed so."""
        return Placement(self.matrix @ inner.matrix, inner.compositing | self.compositing)


AS_IT_IS = Placement(np.eye(4), {})


@dataclass
class Contents(Generic[Group]):
    """What a shape group holds: placed groups without groups in them, and shapes that are lights."""

    groups: list[tuple[Placement, Group]]
    lights: list[tuple[Placement, Node]]

    def extend(self, outer: Placement, inner: Contents[Group]) -> None:
        """Adds the contents of a nested group."""
        self.groups += [(outer @ placed, group) for placed, group in inner.groups]
        self.lights += [(outer @ placed, light) for placed, light in inner.lights]


def add_instance(builder: Builder, node: Node, add_shape: AddShape) -> None:
    """Adds an instance to the description.

    Light sampling has no instances: shapes that are lights are added once for every place.

    Raises:
        SceneError: there is not one shape group in it.
    """
    group_node = group_of(builder, node)
    contents = _contents(builder, group_node, add_shape)
    shown = Contents[int]([], [])
    shown.extend(placement(builder, node), contents)
    for placed, group in shown.groups:
        entry = {"group": group, "to_world": placed.matrix + 0.0, **placed.compositing}
        builder.add("instances", entry, node)
    for placed, light in shown.lights:
        _add_light(builder, light, placed, add_shape)


def plain_group(add_shape: AddShape) -> Callable[[Builder, Node], int]:
    """What finds the group of the description that a shapegroup is.

    It raises `Irregular` where the shapegroup is more than that.
    """

    def find(builder: Builder, group: Node) -> int:
        if group.plugin.lower() != "shapegroup":
            raise Irregular
        contents = _contents(builder, group, add_shape)
        if contents.lights or len(contents.groups) != 1 or contents.groups[0][0] is not AS_IT_IS:
            raise Irregular
        return contents.groups[0][1]

    return find


def group_of(builder: Builder, node: Node) -> Node:
    groups = [child for _, child in node.children("shape")]
    if not groups or any(group.plugin.lower() != "shapegroup" for group in groups):
        raise SceneError(f'{node} needs a shape "shapegroup" inside, or a reference to one', node.location)
    if len(groups) > 1:
        builder.diagnostics.warn(
            f"{node} has more than one shape group; the first one is used", node.location
        )
    return groups[0]


def check_size(scene: Node) -> None:
    """Counts the objects that a scene's shapes and instances will create, before creating them.

    Raises:
        SceneError: they are too many.
    """
    added: dict[Node, int] = {}
    placed: dict[Node, int] = {}
    total, largest, owner = 0, 0, scene
    for _, node in scene.children("shape"):
        count = _added(node, added, placed)
        total += count * node.count
        if count > largest:
            largest, owner = count, node
    limit = MOST_REPEATED + MOST_PER_SHAPE * (sum(node.count for node in added) + len(placed))
    if total > limit:
        message = f"instances and merged shapes make {total:,} objects; the limit is {limit:,}"
        raise SceneError(message, owner.location)


def _added(node: Node, added: dict[Node, int], placed: dict[Node, int]) -> int:
    """The number of shapes and instances that a shape becomes, with the members of a new group."""
    if node not in added:
        children = [child for _, child in node.children("shape")]
        members = {m for prop in node.properties for m in prop.members if isinstance(m, Node)}
        kind = node.plugin.lower()
        if kind == "instance":  # the largest of those in a run
            first = sum(_placed(child, added, placed) for child in children)
            added[node] = max(first, *(_placed(member, added, placed) for member in members), 0)
        elif kind in ("merge", "shapegroup"):
            added[node] = sum(_added(child, added, placed) * child.count for child in children)
        else:
            added[node] = 1
    return added[node]


def _placed(group: Node, added: dict[Node, int], placed: dict[Node, int]) -> int:
    """How many objects an instance of a group is: its own shapes are one."""
    if group not in placed:
        total = 1
        for _, child in group.children("shape"):
            if child.plugin.lower() == "instance":
                total += _added(child, added, placed) * child.count
            elif child.plugin.lower() in ("shapegroup", "merge"):
                total += _placed(child, added, placed)
            else:
                total += child.count * _has_lights(child)
        placed[group] = total
        _added(group, added, placed)
    return placed[group]


def _contents(builder: Builder, group: Node, add_shape: AddShape) -> Contents[int]:
    """What a group holds, as groups of the description; it is built once."""

    def close(node: Node, members: list[int]) -> int:
        return builder.add("groups", {"shapes": members}, node)

    def flatten() -> Contents[int]:
        for node in (group, *_one_by_one(builder, group)):
            if node.plugin.lower() in ("shapegroup", "instance"):
                builder.construct(node)  # warns about unused properties
        contents = flattened(
            builder,
            group,
            lambda shape: add_shape(builder, shape),
            close,
            lambda inner: _contents(builder, inner, add_shape),
        )
        if not contents.groups and not contents.lights:
            builder.diagnostics.warn(f"{group} is empty", group.location)
        return contents

    return builder.once(("contents", group), flatten)


def flattened(
    builder: Builder,
    group: Node,
    make: Callable[[Node], Sequence[Member]],
    close: Callable[[Node, list[Member]], Group],
    contents_of: Callable[[Node], Contents[Group]],
) -> Contents[Group]:
    """What a group holds, without groups in groups.

    Args:
        builder: of the description.
        group: the shape group.
        make: makes members of a shape that stands in it.
        close: makes a group of these members, if there are any.
        contents_of: gives what another group holds.
    """
    contents: Contents[Group] = Contents([], [])
    members: list[Member] = []
    for child in _one_by_one(builder, group):
        name = child.plugin.lower()
        if name == "shapegroup":
            contents.extend(AS_IT_IS, contents_of(child))
        elif name == "instance":
            contents.extend(placement(builder, child), contents_of(group_of(builder, child)))
        elif any(emitter.plugin.lower() == "area" for _, emitter in child.children("emitter")):
            contents.lights.append((AS_IT_IS, child))
        else:
            members += make(child)
    if members:
        contents.groups.append((AS_IT_IS, close(group, members)))
    return contents


def _one_by_one(builder: Builder, group: Node) -> Iterator[Node]:
    """The shapes of a group; instances and lights, which are placed one by one, without runs."""
    for child in members_of(group):
        if child.run is not None and (child.plugin.lower() == "instance" or _has_lights(child)):
            yield from builder.members(child)
        else:
            yield child


def _has_lights(shape: Node) -> bool:
    """Whether a shape, or any member of a run of shapes, has an emitter."""
    values = (value for prop in shape.properties for value in (prop.value, *prop.members))
    return any(isinstance(value, Node) and value.kind == "emitter" for value in values)


def members_of(group: Node) -> Iterator[Node]:
    """The shapes of a group, and those that are merged in it."""
    for _, child in group.children("shape"):
        if child.plugin.lower() == "merge":
            yield from members_of(child)
        else:
            yield child


def placement(builder: Builder, node: Node) -> Placement:
    """Where a shape or an instance is, and how the camera sees it."""
    given = {name: prop for name in (TO_WORLD.name, *COMPOSITING) if (prop := node.find(name)) is not None}
    to_world = given.pop(TO_WORLD.name, None)
    matrix = np.eye(4) if to_world is None else builder.convert(node, to_world, TO_WORLD)
    values = {name: builder.convert(node, prop, Field(name, "boolean", "")) for name, prop in given.items()}
    return Placement(matrix, unusual(values))


def unusual(entry: Entry) -> Entry:
    """How the camera sees a shape or an instance, where that is not the default."""
    return {name: entry[name] for name, usual in COMPOSITING.items() if entry.get(name, usual) != usual}


def placed_light(builder: Builder, light: Node, outer: Placement) -> Node:
    """A shape of a group as if it stood in the scene itself."""
    place = light.property_location("to_world")
    placed = outer @ placement(builder, light)
    values = {"to_world": placed.matrix, **placed.compositing}
    properties = [Property(name, value, place, place) for name, value in values.items()]
    return replace(light, properties=[*light.without(values), *properties])


def _add_light(builder: Builder, light: Node, outer: Placement, add_shape: AddShape) -> None:
    added = add_shape(builder, placed_light(builder, light, outer))
    if np.linalg.det(outer.matrix[:3, :3]) < 0:
        for index in added:
            shape = builder.shapes[index]
            if not keeps_sides(shape):
                shape["flip_normals"] = not shape.get("flip_normals", False)


def keeps_sides(shape: Entry) -> bool:
    """Whether a mirror leaves the sides as they are: it flips those that depend on the vertex order."""
    return shape["type"] != "mesh" or not (shape["mesh"].normals is None or shape.get("face_normals"))
