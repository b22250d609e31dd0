"""Changes of a scene file's text, element by element: everything else stays as it is written."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
import xml.parsers.expat
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from lajolla.scene.syntax.errors import Location, Source
from lajolla.scene.syntax.typed import OLD_KINDS

TAG = re.compile(rb"""<([^\s/>]+)(?:[^"'>]|"[^"]*"|'[^']*')*>""")  # one that opens an element
DECLARATION = re.compile(rb"""\s*<\?xml[^>]*?encoding\s*=\s*["']([A-Za-z0-9._-]+)""")
BEFORE_ROOT = re.compile(rb"(?:\s+|<!--.*?-->|<\?.*?\?>)*", re.DOTALL)
INDENT = "    "

Splice = tuple[int, int, bytes]  # the bytes from the first to the second number are replaced


@dataclass
class Span:
    """Where an element is: its bytes, and those of its children."""

    tag: str
    attributes: dict[str, str]
    start: int
    opened: int  # the end of the first tag
    closing: int = 0  # the start of the last tag; the end of an element without one
    end: int = 0
    children: list[Span] = field(default_factory=list)


def kind_of(span: Span) -> str:
    """The kind of an object; the tag of other elements."""
    if span.tag == "spectrum" and "type" in span.attributes:
        return "texture"
    return OLD_KINDS.get(span.tag, span.tag)


class _Done(Exception):
    """The element has ended."""


def span_at(data: bytes, start: int) -> Span:
    """The element that starts at a byte of a text that was read before."""
    around = Span("", {}, start, start)
    open_spans = [around]
    parser = xml.parsers.expat.ParserCreate("utf-8")

    def begin(tag: str, attributes: dict[str, str]) -> None:
        at = start + parser.CurrentByteIndex
        span = Span(tag, attributes, at, end_of_tag(data, at))
        open_spans[-1].children.append(span)
        open_spans.append(span)

    def end(tag: str) -> None:
        span = open_spans.pop()
        empty = data[span.opened - 2 : span.opened - 1] == b"/"
        span.closing = span.opened if empty else start + parser.CurrentByteIndex
        span.end = span.opened if empty else data.index(b">", span.closing) + 1
        if len(open_spans) == 1:
            raise _Done

    parser.StartElementHandler, parser.EndElementHandler = begin, end
    try:
        parser.Parse(data[start:], True)
    except _Done:
        pass
    finally:  # the parser and the functions know each other
        parser.StartElementHandler = parser.EndElementHandler = None
    return around.children[0]


def end_of_tag(data: bytes, start: int) -> int:
    """Where the tag that starts at a byte ends."""
    found = TAG.match(data, start)
    assert found is not None
    return found.end()


class ElementText:
    """Changes of one element."""

    def __init__(self, source: Source, start: int) -> None:
        self.source = source
        self.span = span_at(source.data, start)
        self.attributes: dict[str, str] = {}  # new values
        self.replaced: dict[int, list[ET.Element]] = {}  # what takes the place of children, by their starts
        self.added: list[ET.Element] = []
        self.instead: list[ET.Element] = []  # of the whole element

    def put(self, new: list[ET.Element], instead_of: Callable[[Span], bool]) -> None:
        """Puts elements in the place of some children, or behind all of them."""
        old = [child for child in self.span.children if instead_of(child)]
        for child in old:
            self.replaced[child.start] = []
        if old:
            self.replaced[old[0].start] = new
        else:
            self.added += new

    def splices(self) -> Iterator[Splice]:
        """The changes of the text."""
        data, span = self.source.data, self.span
        if self.instead:
            yield self._replacement(span, self.instead)
            return
        for name, value in self.attributes.items():
            yield _attribute(self.source, span, name, value)
        for child in span.children:
            if child.start in self.replaced:
                yield self._replacement(child, self.replaced[child.start])
        if not self.added:
            return
        own = _indent(data, span.start)
        inner = _indent(data, span.children[0].start) if span.children else None
        inner = own + INDENT if inner is None else inner
        text = "".join(f"\n{inner}{_text(element, inner)}" for element in self.added).encode()
        if span.closing == span.end:  # <name .../>
            end = data.rindex(b"/", span.start, span.opened)
            text = b">" + text + f"\n{own}</{span.tag}>".encode()
            yield len(data[:end].rstrip()), span.end, text
        else:
            at = len(data[: span.closing].rstrip())
            yield at, at, text if b"\n" in data[at : span.closing] else text + f"\n{own}".encode()

    def _replacement(self, child: Span, new: list[ET.Element]) -> Splice:
        data = self.source.data
        if new:
            indent = _indent(data, child.start)
            return child.start, child.end, f"\n{indent}".join(_text(e, indent) for e in new).encode()
        before = len(data[: child.start].rstrip(b" \t"))
        alone = data[before - 1 : before] == b"\n" and data[child.end : child.end + 1] in (b"\n", b"\r", b"")
        return (before - 1 if alone else child.start), child.end, b""


class SourceText:
    """Changes of one file."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.root = _root(source.data)
        self.elements: dict[int, ElementText] = {}
        self.first: list[ET.Element] = []  # to be added at the beginning of the root element
        self.moved: tuple[Span, bool] | None = None  # an element to be the first, or the last, of the root

    def element(self, place: Location) -> ElementText:
        """The element at a place, to be changed."""
        if place.start not in self.elements:
            self.elements[place.start] = ElementText(self.source, place.start)
        return self.elements[place.start]

    def around(self, plugin: str, is_inside: Callable[[Span], bool]) -> Iterator[ElementText]:
        """The objects of a plugin that have such a child, to be changed."""
        waiting = [span_at(self.source.data, self.root)]
        while waiting:
            span = waiting.pop()
            waiting += span.children
            if span.attributes.get("type") == plugin and any(map(is_inside, span.children)):
                yield self.element(Location(self.source, span.start))

    def text(self) -> bytes:
        """The whole text with all changes, in UTF-8."""
        data = self.source.data
        splices = [splice for element in self.elements.values() for splice in element.splices()]
        opened = end_of_tag(data, self.root)
        if self.first:
            lines = "".join(f"\n{INDENT}{_text(element, INDENT)}" for element in self.first)
            splices.append((opened, opened, lines.encode()))
        if declared := DECLARATION.match(data):
            splices.append((*declared.span(1), b"utf-8"))  # as it was read
        if self.moved is not None:
            splices = _with_moved(data, splices, *self.moved, opened)
        return _spliced(data, 0, len(data), splices)


def _with_moved(data: bytes, splices: list[Splice], span: Span, first: bool, opened: int) -> list[Splice]:
    """The changes with an element at another place of the root element."""
    inside = [s for s in splices if span.start <= s[0] and s[1] <= span.end]
    text = _spliced(data, span.start, span.end, inside)
    at = opened if first else len(data[: data.rindex(b"</")].rstrip())
    begin = len(data[: span.start].rstrip())
    others = [splice for splice in splices if splice not in inside]
    return [*others, (at, at, f"\n{INDENT}".encode() + text), (begin, span.end, b"")]


def _spliced(data: bytes, start: int, end: int, splices: list[Splice]) -> bytes:
    """The text with all changes but those inside of others, which replace what was changed."""
    parts, at = [], start
    for first, last, text in sorted(splices, key=lambda splice: splice[:2]):
        if last <= at and first < at:
            continue
        if first < at:
            raise ValueError("changes overlap")
        parts += [data[at:first], text]
        at = last
    return b"".join([*parts, data[at:end]])


def _root(data: bytes) -> int:
    """Where the outermost element starts: behind comments and declarations."""
    before = BEFORE_ROOT.match(data)
    assert before is not None
    return before.end()


def _attribute(source: Source, span: Span, name: str, value: str) -> Splice:
    """Another value of an attribute, or a new one."""
    escaped = _escaped(value)
    if name not in span.attributes:
        at = span.start + 1 + len(span.tag.encode())
        return at, at, f' {name}="{escaped}"'.encode()
    at = Location(source, span.start, attribute=name).offset
    return at, source.data.index(source.data[at - 1 : at], at), escaped.encode()


def _escaped(value: str) -> str:
    """The text of an attribute, as it is between quotes."""
    written = ET.tostring(ET.Element("x", v=value), encoding="unicode")
    return written[len('<x v="') : -len('" />')].replace("'", "&apos;")


def _indent(data: bytes, start: int) -> str:
    """The white space in front of an element at the beginning of its line; that of the line otherwise."""
    line = data[data.rfind(b"\n", 0, start) + 1 : start]
    return line[: len(line) - len(line.lstrip())].decode()


def _text(element: ET.Element, indent: str) -> str:
    ET.indent(element, INDENT)
    return ET.tostring(element, encoding="unicode").replace("\n", f"\n{indent}").replace(" />", "/>")
