"""Scene text to a tree of elements with locations."""

from __future__ import annotations

import codecs
import re
import xml.parsers.expat
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from .errors import Diagnostics, Location, SceneError, Source
from .files import file_bytes
from .nodes import KINDS

ROOTS = (*KINDS, "camera", "luminaire")  # elements with which files begin, those of old ones too
MAX_DEPTH = 64  # real scenes nest less than ten deep


@dataclass(eq=False)
class Element:
    """One XML element with its attributes as written."""

    tag: str
    attributes: dict[str, str]
    location: Location
    children: list[Element] = field(default_factory=list)
    places: dict[bytes, int] = field(default_factory=dict)  # of attributes, once they are asked for

    def at(self, attribute: str) -> Location:
        """The place of an attribute's value; that of the element when the attribute is absent."""
        if not self.places:
            self.places = dict(_attribute_places(self.location.source.data, self.location.offset))
        offset = self.places.get(attribute.encode())
        return Location(self.location.source, offset) if offset else self.location


# An attribute with its value in quotes, or the end of a tag.
IN_TAG = re.compile(rb"""(?<=\s)([^\s"'=<>]+)\s*=\s*("[^"]*"|'[^']*')|>""")


def _attribute_places(data: bytes, start: int) -> Iterator[tuple[bytes, int]]:
    """The attributes of the tag that starts there, each with the place of its value."""
    for found in IN_TAG.finditer(data, start):
        if not found.group(1):
            return
        yield found.group(1), found.start(2) + 1


def read_source(path: Path, diagnostics: Diagnostics, data: bytes | None = None) -> Source:
    """Reads a scene file, or takes its bytes, as text of whatever encoding it is in.

    Raises:
        SceneError: the file is missing, is no regular file, or cannot be read or decoded.
    """
    source = Source(str(path), b"", path.parent)
    if data is None:
        data = _bytes_of(path, source)
    source.data = _to_utf8(data, source, diagnostics)
    return source


def _bytes_of(path: Path, source: Source) -> bytes:
    if not path.is_file():
        raise SceneError("no such file" if not path.exists() else "not a file", Location(source))
    try:
        return file_bytes(path)
    except OSError as problem:
        raise SceneError(f"cannot be read: {problem.strerror}", Location(source)) from None


def _to_utf8(data: bytes, source: Source, diagnostics: Diagnostics) -> bytes:
    encoding = _encoding(data)
    try:
        return data.decode(encoding or "utf-8").removeprefix("\ufeff").encode()
    except UnicodeError:
        if encoding:
            raise SceneError(f"the text is not valid {encoding}", Location(source)) from None
        diagnostics.warn("the text is not UTF-8 and declares no encoding; read as latin-1", Location(source))
        return data.decode("latin-1").encode()
    except LookupError:
        raise SceneError(f'unknown text encoding "{encoding}"', Location(source)) from None


def _encoding(data: bytes) -> str | None:
    """The encoding that a byte order mark or the XML declaration names, if any."""
    if data.startswith((codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE)):
        return "utf-32"
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    if data.startswith((b"<\0", b"\0<")):
        return "utf-16-le" if data[0] else "utf-16-be"
    declared = re.match(rb"""\s*<\?xml[^>]*?encoding\s*=\s*["']([A-Za-z0-9._-]+)""", data[:256])
    name = declared.group(1).decode().lower() if declared else ""
    return None if name in ("", "utf-8", "utf8") else name


def parse_xml(source: Source) -> Element:
    """Parses a source to its root element.

    Raises:
        SceneError: malformed XML, a document type (hence any entity), or elements nested too deep.
    """
    parser = xml.parsers.expat.ParserCreate("utf-8")
    document = Element("", {}, Location(source))
    open_elements = [document]

    def here() -> Location:
        return Location(source, max(0, parser.CurrentByteIndex))

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(open_elements) > MAX_DEPTH:
            raise SceneError(f"elements are nested more than {MAX_DEPTH} deep", here())
        element = Element(tag, attributes, here())
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def refuse_doctype(*_: object) -> None:
        raise SceneError("a document type is not allowed in a scene (entities are refused)", here())

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: open_elements.pop()
    parser.StartDoctypeDeclHandler = refuse_doctype
    try:
        try:
            parser.Parse(source.data, True)
        finally:  # what is no scene may be anything
            source.quoted &= bool(document.children) and document.children[0].tag in ROOTS
    except xml.parsers.expat.ExpatError as problem:
        reason = xml.parsers.expat.errors.messages.get(problem.code, "malformed")
        offset = min(max(0, parser.ErrorByteIndex), len(source.data))
        raise SceneError(f"not valid XML: {reason}", Location(source, offset)) from None
    return document.children[0]
