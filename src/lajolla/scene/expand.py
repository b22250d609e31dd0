"""Parameters, includes and search paths: from one file's elements to those of the whole scene."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from .elements import Element, parse_xml, read_source
from .errors import Diagnostics, SceneError, Source, did_you_mean
from .files import find_file

MAX_INCLUDES = 16
MAX_FILLED = 1_000_000  # characters; defaults that double each other would fill the memory otherwise
LATEST = (3, 0, 0)
PARAMETER = re.compile(r"(?<!\\)\$([A-Za-z0-9_]+)")


@dataclass
class Document:
    """A scene's root element, without `default`, `include` and `path`, and the folders its files are in."""

    root: Element
    search_paths: list[Path]


def expand_file(path: Path, parameters: Mapping[str, str], diagnostics: Diagnostics) -> Document:
    """Reads a scene file, and all that it includes, with parameters filled in.

    Args:
        path: the scene file.
        parameters: values for `$name`; they win over the file's own defaults.

    Raises:
        SceneError: a file is missing or malformed, or includes itself.
    """
    expander = _Expander(dict(parameters), diagnostics, path.parent)
    root = expander.file(path, [], None)
    for name in sorted(set(parameters) - expander.used):
        known = expander.used | expander.defaults.keys()
        diagnostics.unknown(f'parameter "{name}" is used nowhere{did_you_mean(name, known)}', root.location)
    return Document(root, [*expander.search_paths, path.parent])


@dataclass
class _Expander:
    parameters: dict[str, str]
    diagnostics: Diagnostics
    root_folder: Path
    defaults: dict[str, str] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    search_paths: list[Path] = field(default_factory=list)

    def file(self, path: Path, including: list[Path], parent: Source | None) -> Element:
        source = read_source(path, str(path), self.diagnostics)
        root = parse_xml(source)
        source.version = _version(root, source, parent, self.diagnostics)
        stack = [*including, path.resolve()]
        self._substitute(root)
        root.children = [c for child in root.children for c in self._expand(child, stack)]
        return root

    def _expand(self, element: Element, including: list[Path]) -> Iterator[Element]:
        """What stands for `element` in the tree: nothing, itself, or an included file's content."""
        if not self._substitute(element):
            return
        if element.tag == "default":
            name = required(element, "name")
            self.defaults.setdefault(name, required(element, "value"))
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
        root = self.file(path, including, element.location.source)
        if root.tag == "scene":
            yield from root.children
        else:
            if "name" in element.attributes:
                root.attributes["name"] = element.attributes["name"]
            yield root

    def _find(self, element: Element, attribute: str) -> Path:
        folders = [element.location.source.directory, *self.search_paths, self.root_folder]
        return find_file(required(element, attribute), folders, element.at(attribute))

    def _add_search_path(self, element: Element) -> None:
        path = self._find(element, "value")
        if not path.is_dir():
            raise SceneError(f'"{path}" is not a folder', element.at("value"))
        self.search_paths.insert(0, path)

    def _substitute(self, element: Element) -> bool:
        """Fills in `$name` in all attributes; False when an unknown one makes the element meaningless."""
        unknown = [
            key for key, text in element.attributes.items() if "$" in text and not self._fill(element, key)
        ]
        if "type" in unknown:
            element.attributes["type"] = ""
        elif not element.attributes.get("type", "?").strip():
            message = f"the type of <{element.tag}> is empty; the default is used, or nothing without one"
            self.diagnostics.unknown(message, element.at("type"))
        return not [key for key in unknown if key != "type"]

    def _fill(self, element: Element, attribute: str) -> bool:
        values = self.defaults | self.parameters
        longest_first = sorted(values, key=len, reverse=True)
        names = re.compile(r"(?<!\\)\$(" + "|".join(map(re.escape, longest_first)) + ")") if values else None

        def value(match: re.Match[str]) -> str:
            self.used.add(match.group(1))
            return values[match.group(1)]

        text = element.attributes[attribute]
        missing = [m.group(1) for m in PARAMETER.finditer(names.sub("", text) if names else text)]
        if missing:
            hint = did_you_mean(missing[0], values)
            message = f'parameter "${missing[0]}" is not defined, <{element.tag}> is left out'
            if attribute == "type":
                message = f'parameter "${missing[0]}" is not defined, the default {element.tag} is used'
            self.diagnostics.unknown(message + hint, element.at(attribute))
            return False
        filled = (names.sub(value, text) if names else text).replace("\\$", "$")
        if len(filled) > max(MAX_FILLED, len(text)):
            raise SceneError(
                f"parameters make this longer than {MAX_FILLED} characters", element.at(attribute)
            )
        element.attributes[attribute] = filled
        return True


def required(element: Element, attribute: str) -> str:
    """An attribute that must be there.

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
