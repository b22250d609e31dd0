"""Nodes to XML: the text of a Mitsuba 3 scene file."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from ..syntax.nodes import Node, Rgb, Value, Vector

SHARED_KINDS = ("bsdf", "texture", "medium", "phase", "shape")


def scene_text(root: Node) -> str:
    """A scene file of version 3.0.0. What is used more than once is written once, and referred to."""
    writer = _Writer(Counter(), {})
    writer.count(root)
    scene = ET.Element("scene", version="3.0.0")
    for prop in root.properties:
        name = "" if isinstance(prop.value, Node) else prop.name
        writer.add(scene, name, prop.value, top=scene)
    ET.indent(scene, "    ")
    return ET.tostring(scene, encoding="unicode") + "\n"


@dataclass
class _Writer:
    uses: Counter[Node]
    ids: dict[Node, str]
    taken: set[str] = field(default_factory=set)

    def count(self, node: Node) -> None:
        """Counts how often each node below is used."""
        for prop in node.properties:
            if isinstance(prop.value, Node):
                self.uses[prop.value] += 1
                if self.uses[prop.value] == 1:
                    self.count(prop.value)

    def add(self, parent: ET.Element, name: str, value: Value, *, top: ET.Element) -> None:
        """Adds a property to its element; shared objects go to the top, in front of what refers to them."""
        if not isinstance(value, Node):
            parent.append(_constant(name, value))
        elif self.uses[value] > 1 and value.kind in SHARED_KINDS:
            if value not in self.ids:
                self.ids[value] = self._id(value)
                top.append(self._object("", value, top, self.ids[value]))
            if parent is not top:
                parent.append(ET.Element("ref", _attributes(name, id=self.ids[value])))
        else:
            parent.append(self._object(name, value, top, self._id(value) if value.id else ""))

    def _id(self, node: Node) -> str:
        """The node's own id, or a new one; no two are the same."""
        wanted = node.id or f"{node.kind}-{len(self.taken)}"
        while wanted in self.taken:
            wanted += "-"
        self.taken.add(wanted)
        return wanted

    def _object(self, name: str, node: Node, top: ET.Element, identity: str) -> ET.Element:
        attributes = {"id": identity} if identity else {}
        element = ET.Element(node.kind, _attributes(name, type=node.plugin, **attributes))
        for prop in node.properties:
            self.add(element, prop.name, prop.value, top=top)
        return element


def _attributes(name: str, **others: str) -> dict[str, str]:
    attributes = {"name": name, **others} if name else others
    return {key: text.replace("$", "\\$") for key, text in attributes.items()}  # no parameters are meant


def _constant(name: str, value: Value) -> ET.Element:
    if isinstance(value, np.ndarray):
        transform = ET.Element("transform", name=name)
        ET.SubElement(transform, "matrix", value=_numbers(*value.ravel()))
        return transform
    tag, text = _tag_and_text(value)
    return ET.Element(tag, _attributes(name, value=text))


def _tag_and_text(value: Value) -> tuple[str, str]:
    if isinstance(value, bool):
        return "boolean", str(value).lower()
    if isinstance(value, int):
        return "integer", str(value)
    if isinstance(value, float):
        return "float", _numbers(value)
    if isinstance(value, Rgb):
        return "rgb", _numbers(*value.values)
    if isinstance(value, Vector):
        return "vector", _numbers(*value.xyz)
    if isinstance(value, tuple | list):
        return "string", ", ".join(map(_numbers, value))
    return "string", str(value)


def _numbers(*values: float) -> str:
    return " ".join(f"{value:.9g}" for value in values)
