"""What materials do at the terminator: a property of the outermost bsdf in files, or of those inside it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from lajolla.params import TERMINATOR, Params
from lajolla.params.materials import INSIDE
from lajolla.params.objects import Lists, SceneObject, entry_name
from lajolla.saving.texts import ElementText, SourceText, Span
from lajolla.scene import Description


@dataclass(frozen=True)
class Change:
    """What a bsdf or an adapter was shown to do, and what it does now."""

    before: str
    now: str


@dataclass
class Terminators:
    """The changes of a scene.

    Attributes:
        read: the scene as it was read.
        before, now: the parameters, before and after.
    """

    read: Description
    before: Params
    now: Params

    def must_be_written(self, found: SceneObject) -> bool:
        """Whether a bsdf or an adapter has to say it: it differs, or that of a bsdf inside it does."""
        if found.kind not in ("bsdf", "adapter") or self._path(found) not in self.now:
            return False
        _, *inside = self._inside(found.entry)  # its own entry may stand for other objects, too
        return self._change(found) is not None or any(entry in self.changed for entry in inside)

    @cached_property
    def changed(self) -> Mapping[str, Change]:
        """The changes by the entries that the objects had."""
        objects = (found for found in self.before.objects.values() if found.kind in ("bsdf", "adapter"))
        return {found.entry: change for found in objects if (change := self._change(found)) is not None}

    def _change(self, found: SceneObject) -> Change | None:
        said = self._said(found.entry) or self.read.objects.terminator
        before, now = self.before.get(self._path(found), said), self.now.get(self._path(found))
        return None if now is None or now == before else Change(before, now)

    @staticmethod
    def _path(found: SceneObject) -> str:
        return f"{found.name}.{TERMINATOR}"

    def _said(self, entry: str) -> str:
        """What the file says of it, or of what is inside; "" for nothing."""
        return self.read.objects.terminators.get(entry, "")

    @cached_property
    def _lists(self) -> Lists:
        return Lists(self.read.core)

    def _inside(self, entry: str) -> Iterator[str]:
        """The bsdf or the adapter of an entry, and all that it contains."""
        yield entry
        if entry.startswith("adapters"):
            for name, value in self._lists.entry(entry).items():
                if name in INSIDE and (inner := entry_name(value)):
                    yield from self._inside(inner)

    def put(self, text: SourceText, element: ElementText, found: SceneObject) -> None:
        """Lets a bsdf say it, and those that have it on one of their sides, where they would change."""
        identity = element.span.attributes.get("id")

        def is_side(child: Span) -> bool:
            is_reference = child.tag == "ref" and child.attributes.get("id") == identity is not None
            return child.start == element.span.start or is_reference

        for two in list(text.around("twosided", is_side)):
            self._put_around(text, two)
        put(element, self.now[self._path(found)])

    def _put_around(self, text: SourceText, two: ElementText) -> None:
        sides = [entry for child in two.span.children if (entry := self._entry_of(text, child))]
        default = self.read.objects.terminator
        own = [child.attributes.get("value", "") for child in two.span.children if says(child)]
        value = next(iter([*own, *filter(None, map(self._said, sides)), default]))
        front = self.changed.get(sides[0]) if sides else None
        now = front.now if front and front.before == value else value
        after = {self.changed[side].now if side in self.changed else self._said(side) for side in sides}
        inherited = (after - {""}) or {default}
        if now != value if own else inherited != {now}:
            put(two, now)

    def _entry_of(self, text: SourceText, child: Span) -> str:
        """The entry of a bsdf, in place or by reference; "" for others."""
        if child.tag == "ref":
            return self._by_id.get(child.attributes.get("id", ""), "")
        return self._by_start.get((text.source.name, child.start), "")

    @cached_property
    def _by_id(self) -> Mapping[str, str]:
        ids = self.read.objects.ids.items()
        return {own: entry for entry, own in ids if entry.startswith(("bsdfs", "adapters"))}

    @cached_property
    def _by_start(self) -> Mapping[tuple[str, int], str]:
        result = {}
        for found in self.before.objects.values():
            if found.kind in ("bsdf", "adapter"):
                place = self.read.places.find(found.entry)
                for each in [*([place] if place else []), *self.read.places.others.get(found.entry, [])]:
                    result[each.source.name, each.start] = found.entry
        return result


def says(child: Span) -> bool:
    """Whether an element is the property."""
    return child.attributes.get("name") == TERMINATOR


def put(element: ElementText, value: str) -> None:
    """Sets the property of a bsdf."""
    element.put([said(value)], says)


def said(value: str) -> ET.Element:
    """The property."""
    return ET.Element("string", name=TERMINATOR, value=value)
