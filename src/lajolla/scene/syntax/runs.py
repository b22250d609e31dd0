"""Runs: consecutive objects that differ only in numbers and references, read as one.

They are shapes, or the BSDFs of a scene, which differ in their ids too, so that others can refer to each. A
scene of a million spheres has few kinds of them. The first object of a run represents all, as an
element and later as a node, with the numbers of the others in columns. If a member causes an error or a
warning, or is not supported in runs, the run is dissolved: its members are parsed again and processed
individually.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import islice

from .element import Element
from .errors import Location
from .members import Run

VECTOR = ("value", "x", "y", "z")

# Elements that a run may contain, with the attributes that may differ.
COLUMNS: dict[str, tuple[str, ...]] = {
    "shape": (),
    "bsdf": (),
    "transform": (),
    "boolean": (),
    "integer": (),
    "string": (),
    "float": ("value",),
    "rgb": ("value",),
    "point": VECTOR,
    "vector": VECTOR,
    "translate": VECTOR,
    "scale": VECTOR,
    "rotate": (*VECTOR, "angle"),
    "matrix": ("value",),
    "ref": ("id",),
}

VALUE = rb"""([ !#%(-;=-~]*)"""  # an attribute's value without references, parameters and quotes
START_TAG = re.compile(rb"""<(?:[^"'>]|"[^"]*"|'[^']*')*>""")
MOST_VALUES = (
    64  # of an object, for `extend_run`: the time of its pattern grows with the square of their number
)


def add_to_run(siblings: list[Element], end: int) -> None:
    """Moves the last of `siblings`, whose end tag starts at byte `end`, into a run with the one before it."""
    if len(siblings) < 2:
        return
    first, last = siblings[-2:]
    if last.tag == "bsdf" and last.attributes.get("id") in (None, first.attributes.get("id")):
        return  # nothing can refer to it, or it is a mistake
    found: list[tuple[Element, str, str]] = []
    if not _alike(first, last, found, _outermost(last)):
        return
    data = first.source.data
    if data.find(b"$", last.start, end) >= 0 or (
        first.run is None and data.find(b"$", first.start, end) >= 0
    ):
        return
    stop = _stop(last, end)
    if first.run is None:
        first.run = Run(first.source, first.start, stop)
    run = first.run
    for element, name, text in found:
        if name not in element.columns:
            element.columns = {**element.columns, name: [element.attributes[name]] * len(run)}
        element.columns[name].append(text)
    run.starts.append(last.start)
    first.last = last
    run.stop = stop
    siblings.pop()


def _stop(element: Element, end: int) -> int:
    """The byte behind an element, which expat reports to end at `end`: behind `/>`, but before `</shape>`."""
    data = element.source.data
    tag = None if element.children else START_TAG.match(data, element.start)
    if tag is not None and tag[0].endswith(b"/>"):
        return tag.end()
    return data.find(b">", end) + 1


def extend_run(first: Element, end: int) -> int:
    """Adds the objects from byte `end` on with the same text as the last one of a run, except for values.

    Programs write such objects, and they need no parsing. Returns the byte at which they end.
    """
    run, last = first.run, first.last
    if run is None or last is None or run.stop != end:
        return end
    data = first.source.data
    gap = data[end : data.find(b"<", end)]
    if gap.strip():
        return end
    values = list(islice(_values(first, last, _outermost(last)), MOST_VALUES + 1))
    if len(values) > MOST_VALUES:
        return end
    places = [(name.offset, mine, name.attribute) for mine, name in values]
    places.sort(key=lambda place: place[0])
    pattern, at = re.escape(gap) + b"()", last.start
    for offset, _, _ in places:
        stop = data.index(data[offset - 1], offset)
        pattern += re.escape(data[at:offset]) + VALUE
        at = stop
    match = re.compile(pattern + re.escape(data[at : run.stop])).match
    known, rows = len(run), []
    while found := match(data, end):
        run.starts.append(found.end(1))
        rows.append(found.groups()[1:])
        end = found.end()
    for (_, mine, name), column in zip(places, zip(*rows, strict=True), strict=False):
        before = mine.attributes[name]
        texts = [value.decode() for value in column]
        if name in mine.columns:
            mine.columns[name].extend(texts)
        elif any(text != before for text in texts):
            mine.columns = {**mine.columns, name: [before] * known + texts}
    run.stop = end
    return end


def _outermost(element: Element) -> tuple[str, ...]:
    """The attributes of an object of a run, itself, that may differ."""
    return ("id",) if element.tag == "bsdf" else COLUMNS.get(element.tag, ())


def _values(first: Element, last: Element, columns: Sequence[str]) -> Iterator[tuple[Element, Location]]:
    """The attributes that may differ: elements of a run's first object, with the locations in its last one.

    `columns` are those of the elements themselves.
    """
    for name in last.attributes:
        if name in columns:
            yield first, last.at(name)
    for mine, theirs in zip(first.children, last.children, strict=True):
        yield from _values(mine, theirs, COLUMNS[theirs.tag])


def _alike(
    first: Element, other: Element, found: list[tuple[Element, str, str]], columns: Sequence[str]
) -> bool:
    """Whether an element can join a run; appends the attributes of columns and their texts to `found`."""
    tag, attributes = first.tag, other.attributes
    if tag != other.tag or len(first.children) != len(other.children) or tag not in COLUMNS:
        return False
    if first.columns or attributes != first.attributes:
        if attributes.keys() != first.attributes.keys():
            return False
        for name, text in attributes.items():
            if name in first.columns:
                found.append((first, name, text))
            elif text != first.attributes[name]:
                if name not in columns:
                    return False
                found.append((first, name, text))
    if "type" in attributes and not attributes["type"].strip():
        return False
    if "id" in attributes and "id" not in columns:
        return False
    for mine, theirs in zip(first.children, other.children, strict=True):
        if mine.run or theirs.run or not _alike(mine, theirs, found, COLUMNS.get(mine.tag, ())):
            return False
    return True
