"""Scene text to a tree of elements with locations."""

from __future__ import annotations

import codecs
import errno
import re
import xml.parsers.expat
from collections.abc import Callable
from pathlib import Path

from lajolla.messages import shortened

from .element import Element
from .errors import Diagnostics, Location, SceneError, Source
from .files import MissingFile, file_bytes
from .members import Run
from .nodes import KINDS
from .runs import add_to_run, extend_run

ROOTS = (*KINDS, "camera", "luminaire")  # elements with which files begin, those of old ones too
MAX_DEPTH = 64  # real scenes nest less than ten deep
CHUNK = 1 << 14  # bytes that are parsed at once, and as many more as the object takes that begins there
END_OF_OBJECT = re.compile(rb"</shape>|</bsdf>(?=\s*<(?:bsdf|shape)\b)")  # after which a run may go on


def read_source(path: Path, diagnostics: Diagnostics, data: bytes | None = None) -> Source:
    """Reads a scene file, or takes its bytes, and detects the encoding of the text.

    Raises:
        SceneError: the file is missing, is no regular file, or cannot be read or decoded.
    """
    source = Source(str(path), b"", path.parent)
    if data is None:
        data = _bytes_of(path, source)
    source.data = _to_utf8(data, source, diagnostics)
    return source


def _bytes_of(path: Path, source: Source) -> bytes:
    try:
        if not path.is_file():
            if not path.exists():
                raise MissingFile("no such file", Location(source))
            raise SceneError("not a file", Location(source))
        return file_bytes(path)
    except MissingFile:
        raise
    except OSError as problem:
        if problem.errno == errno.ENAMETOOLONG:
            source.name = shortened(path)
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


def parse_xml(source: Source, *, runs: bool = True) -> Element:
    """Parses a source to its root element.

    Args:
        source: the text.
        runs: put objects that are alike into runs.

    Raises:
        SceneError: malformed XML, a document type (hence any entity), or elements nested too deep.
    """
    document = Element("", {}, source, 0)
    try:
        _parse(document, 0, len(source.data), add_to_run if runs else None)
    finally:  # what is no scene may be anything
        source.quoted &= bool(document.children) and document.children[0].tag in ROOTS
    return document.children[0]


def parse_member(run: Run, index: int) -> Element:
    """A member of a run, once more, as an ordinary element."""
    start, stop = run.span(index)
    around = Element("", {}, run.source, start)
    _parse(around, start, stop, None)
    return around.children[0]


class _Done(Exception):
    """An element has ended, and what follows is not asked for."""


def _parse(
    document: Element, first: int, last: int, fold: Callable[[list[Element], int], None] | None
) -> None:
    """Parses a part of a source that contains one element, and adds it to another element."""
    source, data = document.source, document.source.data
    base = first  # the byte of the source with which the parser's count begins
    parser = xml.parsers.expat.ParserCreate("utf-8")
    open_elements = [document]

    def here() -> Location:
        return Location(source, base + max(0, parser.CurrentByteIndex))

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(open_elements) > MAX_DEPTH:
            raise SceneError(f"elements are nested more than {MAX_DEPTH} deep", here())
        element = Element(tag, attributes, source, base + parser.CurrentByteIndex)
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def end(tag: str) -> None:
        open_elements.pop()
        in_runs = tag == "shape" or (tag == "bsdf" and len(open_elements) == 2)
        if in_runs and fold is not None:
            fold(open_elements[-1].children, base + parser.CurrentByteIndex)
        if len(open_elements) == 1 and last - first < len(data):
            raise _Done

    def refuse_doctype(*_: object) -> None:
        raise SceneError("a document type is not allowed in a scene (entities are refused)", here())

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.StartDoctypeDeclHandler = refuse_doctype
    try:
        at = first
        while at < last:
            end_of_object = END_OF_OBJECT.search(data, at + CHUNK, last)
            cut = end_of_object.end() if end_of_object else last
            parser.Parse(data[at:cut], False)
            siblings = open_elements[-1].children
            at = extend_run(siblings[-1], cut) if siblings and fold is not None else cut
            base += at - cut
        parser.Parse(b"", True)
    except _Done:
        pass
    except xml.parsers.expat.ExpatError as problem:
        reason = xml.parsers.expat.errors.messages.get(problem.code, "malformed")
        offset = min(max(0, base + parser.ErrorByteIndex), len(source.data))
        raise SceneError(f"not valid XML: {reason}", Location(source, offset)) from None
    finally:  # the parser and the functions know each other: what is left would stay until it is looked for
        parser.StartElementHandler = parser.EndElementHandler = parser.StartDoctypeDeclHandler = None
