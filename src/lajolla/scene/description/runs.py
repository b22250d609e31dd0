"""Adds the shapes of a run to the description at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from lajolla import _core

from ..schema import HARMLESS
from ..syntax.errors import Diagnostics, SceneError
from ..syntax.members import Irregular
from ..syntax.nodes import Array, Column, Node, Property, Rgb, below
from .builder import TERMINATOR, Builder, slot_entry
from .instances import unusual
from .plugin import BLACK, Plugin, Slot, is_child
from .values import convert, convert_column

Material = Callable[[Builder, Node, Node | None], int]  # the material of a shape that has this bsdf
GroupOf = Callable[[Builder, Node], int]  # the index of a shapegroup in the description

# What shapes in a run may contain or refer to. Lights and media are added for one shape at a time.
SHARED = ("bsdf", "shape")


def add_run(builder: Builder, node: Node, material: Material, group_of: GroupOf) -> range | None:
    """Adds the shapes of a run to the description, as columns; returns their indices, none for instances.

    Adds nothing and returns None if a member causes an error or a warning, or if the plugin does not support
    runs.
    """
    plugin = builder.plugin(node)
    if plugin is None or not plugin.in_runs:
        return None
    try:
        entry = _entry(builder, node, plugin)
        if entry["type"] == "instance":
            _add_instances(builder, node, entry, group_of)
            return range(0)
        entry |= {"material": _materials(builder, node, material), "emitter": -1}
        return add_columns(builder, "shapes", entry, node)
    except Irregular:
        return None


def add_columns(
    builder: Builder, where: str, entry: dict[str, Any], node: Node, members: Sequence[int] | None = None
) -> range:
    """Adds an entry with columns to a list of the description, for the given members of a run or for all."""
    assert node.run is not None
    members = range(node.count) if members is None else members
    if not any(isinstance(value, Column) for value in entry.values()):
        name, value = next((name, value) for name, value in entry.items() if type(value) is int)
        entry = {**entry, name: Column(np.full(len(members), value))}
    first = getattr(builder, where).add(_stored(builder, entry), len(members))
    builder.places.add_run(where, first, node.run, members)
    return range(first, first + len(members))


@contextmanager
def _irregular_if_reported(builder: Builder) -> Iterator[None]:
    """Raises Irregular instead of reporting errors and warnings."""
    diagnostics = builder.diagnostics
    builder.diagnostics = quiet = Diagnostics(strict=True)
    try:
        yield
    except (SceneError, _core.DescriptionError):
        raise Irregular from None
    finally:
        builder.diagnostics = diagnostics
    if quiet.collected:
        raise Irregular


def _entry(builder: Builder, node: Node, plugin: Plugin) -> dict[str, Any]:
    """The entry that a plugin builds from the node of a run."""
    with _irregular_if_reported(builder):
        entry = plugin.build(builder, node, _values(builder, node, plugin))
    if not isinstance(entry, dict):
        raise Irregular
    return entry


def _values(builder: Builder, node: Node, plugin: Plugin) -> dict[str, Any]:
    fields = plugin.by_name
    values: dict[str, Any] = {}
    for prop in node.properties:
        if isinstance(prop.value, Node):
            children = (prop.value, *_members(prop))
            if any(not is_child(child, plugin) or child.kind not in SHARED for child in children):
                raise Irregular
        elif prop.name in fields:
            column = isinstance(prop.value, Column)
            field = fields[prop.name]
            values[prop.name] = convert_column(prop, field) if column else convert(builder, node, prop, field)
        elif prop.name not in HARMLESS.get(node.kind, ()):
            raise Irregular
    return values


def _only_child(node: Node, kind: str) -> Property | None:
    children = [prop for prop, _ in node.children(kind)]
    if len(children) > 1:
        raise Irregular
    return children[0] if children else None


def _members(prop: Property) -> Iterator[Node]:
    """The objects that a property refers to, each once."""
    return iter(dict.fromkeys(member for member in prop.members if isinstance(member, Node)))


def _materials(builder: Builder, node: Node, material: Material) -> int | Column:
    prop = _only_child(node, "bsdf")
    if prop is None:
        return material(builder, node, None)
    bsdf = prop.value
    assert isinstance(bsdf, Node)
    if prop.members:
        found = {member: material(builder, node, member) for member in _members(prop)}
        return Column(np.array([found[member] for member in prop.members if isinstance(member, Node)]))
    if bsdf.run is None:
        return material(builder, node, bsdf)
    own = [bsdf, *(inner for inner in below([bsdf]) if inner.run is not None)]
    properties = [prop for part in own for prop in part.properties]
    for shared in below([bsdf]):  # messages about shared objects do not concern the run
        if shared.kind == "bsdf" and shared.run is None:
            builder.slot(shared)
        elif shared.kind == "texture":
            builder.texture(shared)
    plugin = builder.plugin(bsdf)
    if any(prop.members for prop in properties):
        return _copied_materials(builder, node, bsdf, properties, material)
    if any(isinstance(prop.value, Column) for prop in properties):
        if plugin is not None and plugin.in_runs and len(own) == 1:
            return _own_materials(builder, bsdf, plugin)
        return _copied_materials(builder, node, bsdf, properties, material)
    if any(part.ids for part in own):  # they are the same, but have names
        raise Irregular
    with _irregular_if_reported(builder):
        return material(builder, node, bsdf)


def _copied_materials(
    builder: Builder, node: Node, bsdf: Node, properties: list[Property], material: Material
) -> Column:
    """The materials of shapes with a bsdf each; different ones are built one by one."""
    columns = [prop.value.rows for prop in properties if isinstance(prop.value, Column)]
    columns += [np.array([id(member) for member in p.members], float) for p in properties if p.members]
    named = [part.ids for part in (bsdf, *below([bsdf])) if part.ids]
    known: dict[tuple[bytes, tuple[str, ...]], int] = {}
    indices = []
    for i, numbers in enumerate(_row_keys(columns)):
        key = numbers, tuple(ids[i] for ids in named)
        if key not in known:
            with _irregular_if_reported(builder):
                known[key] = material(builder, node, _copy(bsdf, i))
        indices.append(known[key])
    return Column(np.array(indices, np.int64))


def _row_keys(columns: list[Array]) -> list[bytes]:
    """The numbers in each row of some columns."""
    rows = np.ascontiguousarray(np.concatenate([c.reshape(len(c), -1) for c in columns], axis=1))
    data, size = rows.tobytes(), rows.strides[0]
    return [data[at : at + size] for at in range(0, len(data), size)]


def _copy(node: Node, index: int) -> Node:
    """The bsdf of one member of a run."""
    properties = []
    for prop in node.properties:
        value = prop.value
        if isinstance(value, Column):
            row = value.rows[index].tolist()
            value = row if isinstance(row, float) else Rgb(tuple(row)) if len(row) == 3 else value.rows[index]
        elif isinstance(value, Node) and value.run is not None:
            value = _copy(value, index)
        elif prop.members:
            value = prop.members[index]
        properties.append(replace(prop, value=value, members=[]))
    return replace(node, properties=properties, run=None, id=node.ids[index] if node.ids else "", ids=())


def _own_materials(builder: Builder, bsdf: Node, plugin: Plugin) -> Column:
    """The materials of shapes with a bsdf each, which differ only in numbers."""
    entry = _entry(builder, bsdf, plugin)
    terminator = entry.pop(TERMINATOR, "")
    columns = {name: value.rows.tolist() for name, value in entry.items() if isinstance(value, Column)}
    with _irregular_if_reported(builder):
        if _core.transmissive(_stored(builder, entry)):
            raise Irregular
    kept: list[int] = []  # members whose bsdf is new
    indices = []
    for i, row in enumerate(zip(*columns.values(), strict=True)):
        one = {name: tuple(v) if isinstance(v, list) else v for name, v in zip(columns, row, strict=True)}
        name = bsdf.ids[i] if bsdf.ids else ""
        key = builder.key_of("bsdfs", {**entry, **one}, name)
        if key not in builder.indices:
            builder.indices[key] = len(builder.bsdfs) + len(kept)
            if name:
                builder.objects.ids[f"bsdfs[{builder.indices[key]}]"] = name
            kept.append(i)
        indices.append(builder.indices[key])
    if kept:
        rows = {n: Column(v.rows[kept]) for n, v in entry.items() if isinstance(v, Column)}
        add_columns(builder, "bsdfs", {**entry, **rows}, bsdf, kept)
        builder.transmissive += [False] * len(kept)
    return _slots(builder, bsdf, indices, terminator)


def _stored(builder: Builder, entry: dict[str, Any]) -> dict[str, Any]:
    """An entry with columns of the core."""
    return {
        name: _core.Column(np.ascontiguousarray(value.rows)) if isinstance(value, Column) else value
        for name, value in entry.items()
    }


def _slots(builder: Builder, bsdf: Node, fronts: list[int], terminator: str) -> Column:
    """The indices of the material slots with these opaque bsdfs."""
    kept: list[int] = []
    indices = []
    for i, front in enumerate(fronts):
        slot = builder.finished(Slot(front, BLACK, terminator))
        if slot not in builder.slots:
            builder.slots[slot] = len(builder.materials) + len(kept)
            kept.append(i)
        indices.append(builder.slots[slot])
    if kept:
        seen = Column(np.array([fronts[i] for i in kept], np.int64))
        entry = {**slot_entry(slot), "front": seen, "back": seen if builder.two_sided else BLACK}
        add_columns(builder, "materials", entry, bsdf, kept)
    return Column(np.array(indices, np.int64))


def _add_instances(builder: Builder, node: Node, entry: dict[str, Any], group_of: GroupOf) -> None:
    prop = _only_child(node, "shape")
    if prop is None or not isinstance(prop.value, Node):
        raise Irregular
    groups: int | Column
    if prop.members:
        found = {member: group_of(builder, member) for member in _members(prop)}
        groups = Column(np.array([found[member] for member in prop.members if isinstance(member, Node)]))
    else:
        groups = group_of(builder, prop.value)
    matrix = entry.get("to_world", np.eye(4))  # without negative zeros, as single instances have none
    to_world = Column(matrix.rows + 0.0) if isinstance(matrix, Column) else matrix + 0.0
    add_columns(builder, "instances", {"group": groups, "to_world": to_world, **unusual(entry)}, node)
