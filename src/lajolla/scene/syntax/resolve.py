"""Resolves references."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from .errors import Location, SceneError, did_you_mean
from .ids import Ids, Member, no_runs
from .nodes import Node, Property, Reference
from .typed import Tree, member_of_run

MAX_NESTING = 64  # objects in objects, references followed


def resolve(tree: Tree, alone: Callable[[Member], Node] = no_runs) -> None:
    """Replaces every reference by its node; `alone` makes that of a member of a run.

    Raises:
        SceneError: an id that is nowhere, or twice; objects that contain themselves.
    """
    tree.ids = _ids(tree, alone)
    follow(tree, tree.ids)
    heights: dict[Node, int] = {}
    for node in tree.nodes:
        _refuse_cycles(node, [], heights)


def follow(tree: Tree, ids: Ids) -> None:
    """Replaces all references of a tree by their nodes.

    Raises:
        SceneError: an id is unknown.
    """
    for node in tree.nodes:
        for prop in node.properties:
            if prop.members:
                _follow_members(node, prop, ids)
            elif isinstance(prop.value, Reference):
                prop.value = _lookup(prop.value.id, ids, prop.location)


def _follow_members(node: Node, prop: Property, ids: Ids) -> None:
    """Replaces the references of the members of a run."""
    assert node.run is not None
    names = [reference.id for reference in prop.members if isinstance(reference, Reference)]
    missing = next((i for i, name in enumerate(names) if name not in ids), None)
    if missing is not None:
        follow(member_of_run(node, missing), ids)  # an error with its location
    together = ids.together(names, node.run)
    prop.members = [] if together else [ids[name] for name in names]
    prop.value = together or prop.members[0]


def _ids(tree: Tree, alone: Callable[[Member], Node]) -> Ids:
    """Every id and every alias with its node."""
    ids = Ids(alone=alone)
    for node in tree.nodes:
        members = ((name, Member(node, i)) for i, name in enumerate(node.ids))
        for name, one in members if node.ids else [(node.id, node)]:
            if name in ids:
                raise _taken(name, ids.found[name].location, one.location)
            if name:
                ids.found[name] = one
    aliases: dict[str, tuple[str, Location]] = {}
    for name, target, location in tree.aliases:
        if name in ids or name in aliases:
            first = ids.found[name].location if name in ids else aliases[name][1]
            raise _taken(name, first, location)
        aliases[name] = (target, location)
    ids.found |= {name: _follow(name, aliases, ids) for name in aliases}
    return ids


def _taken(name: str, first: Location, second: Location) -> SceneError:
    return SceneError(f'the id "{name}" is used twice; first at {first}', second)


def _follow(name: str, aliases: Mapping[str, tuple[str, Location]], ids: Mapping[str, Node]) -> Node:
    location = aliases[name][1]
    passed = [name]
    while passed[-1] in aliases:
        target = aliases[passed[-1]][0]
        if target in passed:
            raise SceneError(f"aliases form a cycle: {' -> '.join([*passed, target])}", location)
        passed.append(target)
        if len(passed) > MAX_NESTING:
            raise SceneError(f"aliases of aliases are more than {MAX_NESTING} deep", location)
    return _lookup(passed[-1], ids, location)


def _lookup(name: str, ids: Mapping[str, Node], location: Location) -> Node:
    if name not in ids:
        raise SceneError(f'no object has the id "{name}"{did_you_mean(name, ids)}', location)
    return ids[name]


def _refuse_cycles(node: Node, trail: list[Node], heights: dict[Node, int]) -> int:
    """How deep the objects below a node nest; each node is walked once."""
    if len(trail) > MAX_NESTING:
        raise SceneError(f"objects are nested more than {MAX_NESTING} deep", node.location)
    if node in trail:
        circle = [*trail[trail.index(node) :], node]
        names = " -> ".join(n.id or str(n) for n in circle)
        raise SceneError(f"objects contain each other: {names}", node.location)
    if node not in heights:
        children = {p.value: None for p in node.properties if isinstance(p.value, Node)}
        children |= {m: None for p in node.properties for m in p.members if isinstance(m, Node)}
        heights[node] = max(
            (1 + _refuse_cycles(child, [*trail, node], heights) for child in children), default=0
        )
    if len(trail) + heights[node] > MAX_NESTING:
        raise SceneError(f"objects are nested more than {MAX_NESTING} deep", node.location)
    return heights[node]
