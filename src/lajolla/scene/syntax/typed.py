"""Elements to nodes with typed properties; later stages do not depend on XML."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .element import Element
from .elements import parse_member
from .errors import Diagnostics, Location, SceneError, did_you_mean
from .expand import required
from .ids import Ids
from .literals import (
    Text,
    parse_blackbody,
    parse_boolean,
    parse_float,
    parse_integer,
    parse_rgb,
    parse_spectrum,
)
from .members import Irregular
from .nodes import KINDS, Column, Node, Property, Reference, Rgb, SpectrumFile, Value, Vector
from .transforms import parse_numbers_of, parse_transform, parse_xyz, stack_columns

OBJECT_ATTRIBUTES = ("type", "id", "name", "version")
VALUE_ATTRIBUTES = ("name", "value", "intent")
VECTOR_ATTRIBUTES = ("name", "value", "x", "y", "z")
ATTRIBUTES = {
    **dict.fromkeys(("float", "integer", "boolean", "string", "rgb", "srgb"), VALUE_ATTRIBUTES),
    **dict.fromkeys(("point", "vector", "translate", "scale"), VECTOR_ATTRIBUTES),
    "spectrum": (*OBJECT_ATTRIBUTES, *VALUE_ATTRIBUTES, "filename"),
    "blackbody": ("name", "temperature", "scale", "multiplier"),
    "rotate": (*VECTOR_ATTRIBUTES, "angle"),
    "matrix": ("value",),
    "lookat": ("origin", "target", "up", *(point + axis for point in "otu" for axis in "xyz")),
    "transform": ("name", "time"),
    "animation": ("name",),
    "ref": ("id", "name"),
    "alias": ("id", "as"),
}

OLD_KINDS = {"camera": "sensor", "luminaire": "emitter"}  # tags of 0.4 and before


@dataclass
class Tree:
    """A scene's root node, its aliases (name, target, place), and all nodes."""

    root: Node
    aliases: list[tuple[str, str, Location]] = field(default_factory=list)
    nodes: list[Node] = field(default_factory=list)
    ids: Ids = field(default_factory=Ids)  # and aliases, once references are followed


def nodes_from_elements(root: Element, diagnostics: Diagnostics) -> Tree:
    """Types a whole element tree.

    Raises:
        SceneError: an unknown element, a missing attribute, or a value that does not parse.
    """
    tree = Tree(Node("scene", "scene", root.location, root.location))
    tree.nodes.append(tree.root)
    _add_children(root, tree.root, tree, diagnostics)
    return tree


def _add_children(element: Element, node: Node, tree: Tree, diagnostics: Diagnostics) -> None:
    given: set[str] = set()
    for child in element.children:
        if child.run is None:
            _add(child, node, given, tree, diagnostics)
        elif not _add_run(child, node, tree):
            for index in range(len(child.run)):
                _add(parse_member(child.run, index), node, given, tree, diagnostics)


def _add_run(element: Element, parent: Node, tree: Tree) -> bool:
    """Adds the first object of a run for all of them; returns False if it causes an error or a warning."""
    if "name" in element.attributes:  # one object would replace the other
        return False
    alone, quiet = Tree(parent), Diagnostics(strict=True)
    own = Node("shape", "", parent.location, parent.location)
    try:
        with np.errstate(all="ignore"):
            _add(element, own, set(), alone, quiet)
    except (SceneError, Irregular):
        return False
    if quiet.collected or any(inside.kind != "bsdf" for inside in alone.nodes[1:]):
        return False
    first = alone.nodes[0]
    if first.kind == "bsdf":
        if any(isinstance(prop.value, Reference) for one in alone.nodes for prop in one.properties):
            return False
        first.id, first.ids = "", element.columns["id"]
    for one in alone.nodes:
        one.run = element.run
    parent.properties += own.properties
    tree.nodes += alone.nodes
    return True


def member_of_run(node: Node, index: int) -> Tree:
    """One object of a run's node, parsed individually."""
    assert node.run is not None
    tree = Tree(Node("scene", "scene", node.location, node.location))
    _add(parse_member(node.run, index), tree.root, set(), tree, Diagnostics())
    return tree


def _add(element: Element, parent: Node, given: set[str], tree: Tree, diagnostics: Diagnostics) -> None:
    """Adds an element to its parent node, which already has properties of the given names."""
    tag = OLD_KINDS.get(element.tag, element.tag)
    _check_attributes(element, diagnostics)
    if tag == "alias":
        tree.aliases.append((required(element, "as"), required(element, "id"), element.at("as")))
        return
    value: Value
    members: list[Reference] = []
    if tag == "ref":
        value = Reference(required(element, "id"))
        place = element.at("id")
        members = [Reference(name) for name in element.columns.get("id", ())]
    elif (tag in KINDS and tag != "scene") or (tag == "spectrum" and "type" in element.attributes):
        value = _object("texture" if tag == "spectrum" else tag, element, tree, diagnostics)
        place = element.location
    elif tag in VALUES:
        required(element, "name")
        _refuse_children(element)
        value = VALUES[tag](element)
        place = element.at("value") if "value" in element.attributes else element.location
    else:
        known = [*KINDS, *VALUES, *OLD_KINDS, "ref", "alias", "default", "include", "path"]
        raise SceneError(
            f"unknown element <{element.tag}>{did_you_mean(element.tag, known)}", element.location
        )
    name = element.attributes.get("name", "")
    if name in given:
        diagnostics.warn(f'"{name}" is given twice in {parent}; the last one is used', element.at("name"))
        parent.properties = parent.without([name])
    if name:
        given.add(name)
    parent.properties.append(Property(name, value, place, element.at("name"), members))


def _object(kind: str, element: Element, tree: Tree, diagnostics: Diagnostics) -> Node:
    plugin = required(element, "type").strip()
    node = Node(kind, plugin, element.location, element.at("type"), element.attributes.get("id", ""))
    tree.nodes.append(node)
    _add_children(element, node, tree, diagnostics)
    return node


def _check_attributes(element: Element, diagnostics: Diagnostics) -> None:
    """Reports unknown attributes of elements and of transform operations."""
    known = ATTRIBUTES.get(element.tag.lower(), OBJECT_ATTRIBUTES)
    for name in element.attributes:
        if name not in known:
            message = f'<{element.tag}> has no attribute "{name}"{did_you_mean(name, known)}'
            diagnostics.unknown(message, element.at(name))
    if element.tag in ("transform", "animation"):
        for child in element.children:
            _check_attributes(child, diagnostics)


def _refuse_children(element: Element) -> None:
    if element.children and element.tag not in ("transform", "animation"):
        child = element.children[0]
        raise SceneError(f"<{child.tag}> is not allowed inside <{element.tag}>", child.location)


def _text(element: Element, attribute: str = "value") -> Text:
    return Text(required(element, attribute), element.at(attribute))


def _float(element: Element) -> float | Column:
    if not element.columns:
        return parse_float(_text(element))
    return Column(parse_numbers_of(element, "value", (1,))[0])


def _vector(element: Element) -> Vector | Column:
    xyz = parse_xyz(element, 0.0)
    if element.columns:
        return Column(stack_columns(xyz))
    x, y, z = map(float, xyz)
    return Vector((x, y, z))


def _rgb(element: Element, *, srgb: bool) -> Rgb | Column:
    if not element.columns:
        return parse_rgb(_text(element), srgb=srgb)
    values = parse_numbers_of(element, "value", (1, 3))
    return Column(stack_columns(values * 3 if len(values) == 1 else values))


def _spectrum(element: Element) -> Value:
    if "filename" in element.attributes and "value" not in element.attributes:
        return SpectrumFile(element.attributes["filename"])
    return parse_spectrum(_text(element))


def _blackbody(element: Element) -> Value:
    factor = "scale" if "scale" in element.attributes else "multiplier"  # which it was before 0.4
    scale = _text(element, factor) if factor in element.attributes else None
    return parse_blackbody(_text(element, "temperature"), scale)


def _animation(element: Element) -> Value:
    """The first transform of an animation: the shutter opens then."""
    if not element.children:
        raise SceneError("<animation> needs a <transform>", element.location)

    def time(child: Element) -> float:
        return parse_float(_text(child, "time")) if "time" in child.attributes else 0.0

    return parse_transform(min(element.children, key=time))


VALUES: dict[str, Callable[[Element], Value]] = {
    "float": _float,
    "integer": lambda e: parse_integer(_text(e)),
    "boolean": lambda e: parse_boolean(_text(e)),
    "string": lambda e: required(e, "value"),
    "point": _vector,
    "vector": _vector,
    "rgb": lambda e: _rgb(e, srgb=False),
    "srgb": lambda e: _rgb(e, srgb=True),
    "spectrum": _spectrum,
    "blackbody": _blackbody,
    "transform": parse_transform,
    "animation": _animation,
}
