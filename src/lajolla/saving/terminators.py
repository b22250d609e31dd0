"""What a material does at the terminator: a property of the outermost bsdf in files."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from lajolla.params import TERMINATOR, Params
from lajolla.params.objects import SceneObject
from lajolla.saving.texts import ElementText, SourceText, Span


def has_changed(found: SceneObject, before: Params, now: Params) -> bool:
    """Whether it differs where a bsdf or an adapter was and is the outermost one."""
    if found.kind not in ("bsdf", "adapter"):
        return False
    values = {params.get(f"{found.name}.{TERMINATOR}") for params in (before, now)}
    return len(values - {None}) > 1


def put(text: SourceText, element: ElementText, value: str) -> None:
    """Sets it of a bsdf, and of those that have this one on both sides and say another."""

    def says(child: Span) -> bool:
        return child.attributes.get("name") == TERMINATOR

    def is_side(child: Span) -> bool:
        identity = child.attributes.get("id")
        is_reference = child.tag == "ref" and identity == element.span.attributes.get("id")
        return child.start == element.span.start or is_reference

    around = [two for two in text.around("twosided", is_side) if any(map(says, two.span.children))]
    for each in (element, *around):
        each.put([ET.Element("string", name=TERMINATOR, value=value)], says)
