"""Parameters, includes and search paths: from one file's elements to those of the whole scene."""

from __future__ import annotations

import os
import re
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from .element import Element
from .elements import parse_xml, read_source
from .errors import Diagnostics, Location, SceneError, Source, did_you_mean
from .files import find_file

MAX_INCLUDES = 16  # nested
MAX_INCLUDED = 1024  # in total
MAX_REPEATED = 1 << 22  # bytes of files that were included before
REPEATED_RATIO = 16  # additional bytes for each byte that is included for the first time
MAX_FILLED = 1_000_000  # characters; defaults that double each other would otherwise exhaust memory
LATEST = (3, 0, 0)
ORDINARY = "[A-Za-z0-9_]+"  # names of parameters
TO_EXPAND = re.compile(rb"""\$|<(?:default|include|path|null)\b|\stype\s*=\s*(?:"\s*"|'\s*')""")
MOST_HINTS = 256  # names that are compared with one that is missing


@dataclass(frozen=True)
class Included:
    """The text of a file where another one includes it."""

    source: Source
    place: Location  # of the element that includes it


@dataclass
class Document:
    """A scene's root element, without `default`, `include` and `path`, the folders its files are in, and what
    it includes."""

    root: Element
    search_paths: list[Path]
    includes: list[Included]


class UnknownParameter(Exception):
    """A required parameter that the scene does not have."""

    def __init__(self, name: str, known: Iterable[str]) -> None:
        super().__init__(name)
        self.name = name
        self.known = sorted(known)  # what the scene has


def expand_file(
    path: Path,
    parameters: Mapping[str, str],
    diagnostics: Diagnostics,
    *,
    data: bytes | None = None,
    required_names: Container[str] = (),
    runs: bool = True,
) -> Document:
    """Reads a scene file, and all that it includes, with parameters filled in.

    Args:
        path: the scene file.
        parameters: values for `$name`; they win over the file's own defaults.
        data: what is in the file, where it need not be opened.
        required_names: of parameters that the scene must have; others are warned about.
        runs: put objects that are alike into runs.

    Raises:
        SceneError: a file is missing or malformed, or includes itself.
        UnknownParameter: the scene does not have one that it must have.
    """
    expander = _Expander(dict(parameters), diagnostics, path.parent, runs)
    root = expander.file(path, [], None, data)
    for name in sorted(set(parameters) - expander.used):
        known = expander.used | expander.defaults.keys()
        if name in required_names:
            raise UnknownParameter(name, known)
        diagnostics.unknown(f'parameter "{name}" is not used{did_you_mean(name, known)}', root.location)
    return Document(root, [*expander.search_paths, path.parent], expander.includes)


@dataclass
class _Expander:
    parameters: dict[str, str]
    diagnostics: Diagnostics
    root_folder: Path
    runs: bool
    defaults: dict[str, str] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    search_paths: list[Path] = field(default_factory=list)
    included: set[Path] = field(default_factory=set)
    includes: list[Included] = field(default_factory=list)
    inclusions: int = 0
    included_once: int = 0  # bytes
    repeated: int = 0  # bytes
    longest: int = 0  # name of a parameter
    unusual: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        for name in self.parameters:
            self._note(name)

    def file(
        self, path: Path, including: list[Path], parent: Source | None, data: bytes | None = None
    ) -> Element:
        source = read_source(path, self.diagnostics, data)
        source.quoted = parent is None or self._is_own(path)
        root = parse_xml(source, runs=self.runs)
        source.version = _version(root, source, parent, self.diagnostics)
        stack = [*including, path.resolve()]
        self._substitute(root)
        ends = [*(child.start for child in root.children[1:]), len(source.data)]
        root.children = [
            whole
            for child, end in zip(root.children, ends, strict=False)
            for whole in ([child] if _is_whole(child, end) else self._expand(child, stack))
        ]
        return root

    def _is_own(self, path: Path) -> bool:
        """Whether a file is in the scene's folder or a folder that the scene names, by links too."""
        folders = map(os.path.abspath, [self.root_folder, *self.search_paths])
        return any(Path(os.path.abspath(path)).is_relative_to(folder) for folder in folders)

    def _expand(self, element: Element, including: list[Path]) -> Iterator[Element]:
        """The replacement of `element`: nothing, itself, or the content of an included file."""
        if element.run is not None:
            yield element
            return
        if not self._substitute(element):
            return
        if element.tag == "default":
            name = required(element, "name")
            self._define(name, required(element, "value"))
        elif element.tag == "path":
            self._add_search_path(element)
        elif element.tag == "include":
            yield from self._include(element, including)
        elif element.tag != "null":
            element.children = [c for child in element.children for c in self._expand(child, including)]
            yield element

    def _include(self, element: Element, including: list[Path]) -> Iterator[Element]:
        path = self._find(element, "filename")
        if path.resolve() in including:
            raise SceneError(f'"{path.name}" includes itself', element.at("filename"))
        if len(including) > MAX_INCLUDES:
            raise SceneError(f"files are included more than {MAX_INCLUDES} deep", element.location)
        self._count(path, element)
        root = self.file(path, including, element.source)
        self.includes.append(Included(root.source, element.location))
        if root.tag == "scene":
            yield from root.children
        else:
            if "name" in element.attributes:
                root.attributes["name"] = element.attributes["name"]
            yield root

    def _count(self, path: Path, element: Element) -> None:
        """Limits repeated includes, which could grow exponentially."""
        self.inclusions += 1
        size = path.stat().st_size
        if path in self.included:
            self.repeated += size
        else:
            self.included_once += size
        self.included.add(path)
        if self.inclusions > MAX_INCLUDED:
            raise SceneError(f"more than {MAX_INCLUDED} files are included", element.location)
        limit = MAX_REPEATED + REPEATED_RATIO * self.included_once
        if self.repeated > limit:
            message = f"files that are included again have {self.repeated:,} bytes; the limit is {limit:,}"
            raise SceneError(message, element.location)

    def _find(self, element: Element, attribute: str) -> Path:
        folders = [element.source.directory, *self.search_paths, self.root_folder]
        return find_file(required(element, attribute), folders, element.at(attribute))

    def _add_search_path(self, element: Element) -> None:
        path = self._find(element, "value")
        if not path.is_dir():
            raise SceneError(f'"{path}" is not a folder', element.at("value"))
        self.search_paths.insert(0, path)

    def _substitute(self, element: Element) -> bool:
        """Replaces `$name` in all attributes; False if an unknown parameter makes the element invalid."""
        unknown = [
            key for key, text in element.attributes.items() if "$" in text and not self._fill(element, key)
        ]
        if "type" in unknown:
            element.attributes["type"] = ""
        elif not element.attributes.get("type", "?").strip():
            message = f"the type of <{element.tag}> is empty; the default is used if there is one"
            self.diagnostics.unknown(message, element.at("type"))
        return not [key for key in unknown if key != "type"]

    def _fill(self, element: Element, attribute: str) -> bool:
        text = element.attributes[attribute]
        missing: list[str] = []
        size = 0

        def value(match: re.Match[str]) -> str:
            nonlocal size
            name = self._known_beginning(match.group(1))
            if not name:
                missing.append(match.group(1))
                return ""
            self.used.add(name)
            size += len(self._value(name))
            if size > MAX_FILLED:
                message = f"parameters make this longer than {MAX_FILLED} characters"
                raise SceneError(message, element.at(attribute))
            return self._value(name) + match.group(1)[len(name) :]

        filled = self._pattern().sub(value, text).replace("\\$", "$")
        if missing:
            known = self.defaults.keys() | self.parameters.keys() if self._names() <= MOST_HINTS else ()
            message = f'parameter "${missing[0]}" is not defined, <{element.tag}> is ignored'
            if attribute == "type":
                message = f'parameter "${missing[0]}" is not defined, the default {element.tag} is used'
            self.diagnostics.unknown(message + did_you_mean(missing[0], known), element.at(attribute))
            return False
        element.attributes[attribute] = filled
        return True

    def _names(self) -> int:
        return len(self.defaults) + len(self.parameters)

    def _value(self, name: str) -> str:
        return self.parameters[name] if name in self.parameters else self.defaults[name]

    def _known_beginning(self, name: str) -> str:
        """The longest known name with which a name begins, as in `$size_px` where there is a `size`."""
        for length in range(min(len(name), self.longest), 0, -1):
            if name[:length] in self.parameters or name[:length] in self.defaults:
                return name[:length]
        return ""

    def _pattern(self) -> re.Pattern[str]:
        """Matches possible parameters; names with unusual characters must be known."""
        return _pattern_of(tuple(sorted(self.unusual, key=len, reverse=True)))

    def _define(self, name: str, value: str) -> None:
        self.defaults.setdefault(name, value)
        self._note(name)

    def _note(self, name: str) -> None:
        self.longest = max(self.longest, len(name))
        if not re.fullmatch(ORDINARY, name):
            self.unusual.add(name)


def _is_whole(element: Element, end: int) -> bool:
    """Whether the text of an element contains nothing to expand, which is always true for runs."""
    return element.run is not None or TO_EXPAND.search(element.source.data, element.start, end) is None


@lru_cache(64)
def _pattern_of(unusual: tuple[str, ...]) -> re.Pattern[str]:
    return re.compile(r"(?<!\\)\$(" + "|".join([*map(re.escape, unusual), ORDINARY]) + ")")


def required(element: Element, attribute: str) -> str:
    """A required attribute.

    Raises:
        SceneError: it is missing.
    """
    if attribute not in element.attributes:
        given = ", ".join(element.attributes) or "none"
        raise SceneError(
            f'<{element.tag}> needs the attribute "{attribute}", it has: {given}', element.location
        )
    return element.attributes[attribute]


def _version(
    root: Element, source: Source, parent: Source | None, diagnostics: Diagnostics
) -> tuple[int, int, int]:
    text = root.attributes.get("version")
    if root.tag != "scene" and parent is None:
        raise SceneError(f"the root element is <{root.tag}>, not <scene>", root.location)
    if text is None and parent is not None:
        return parent.version
    if text is None:
        guess = (0, 6, 0) if re.search(rb'name\s*=\s*["\'][a-z]+[A-Z]', source.data) else LATEST
        diagnostics.warn(f"the file has no version; read as {guess[0]}.{guess[1]}", root.location)
        return guess
    found = re.fullmatch(r"\s*(\d{1,4})(?:\.(\d{1,4}))?(?:\.(\d{1,4}))?\s*", text)
    if not found:
        raise SceneError(f'"{text}" is not a version such as 3.0.0', root.at("version"))
    if int(found.group(1)) > LATEST[0]:
        diagnostics.warn(f"version {text.strip()} is newer than this reader; read as 3.x", root.at("version"))
    return (int(found.group(1)), int(found.group(2) or 0), int(found.group(3) or 0))
