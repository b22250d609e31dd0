"""Names of files in the text of a scene that will be in another folder."""

from __future__ import annotations

import os
import xml.parsers.expat
from collections.abc import Collection, Iterator
from pathlib import Path

from lajolla.saving.texts import SourceText
from lajolla.saving.values import NotWritten, plain_text
from lajolla.scene.syntax.errors import Location, Source
from lajolla.scene.syntax.files import in_any_case


def plain_name(stem: str) -> str:
    """A name that scene files can hold, in which a backslash separates folders."""
    return "".join(c if c.isprintable() and c != "\\" else "_" for c in stem)


def relative_to(path: Path, folder: Path) -> str:
    """The name of a file or a folder in a scene of another folder.

    Raises:
        NotWritten: it has a backslash, which separates folders in scene files.
    """
    whole = path.parent.resolve() / path.name
    try:
        name = Path(os.path.relpath(whole, folder.resolve())).as_posix()
    except ValueError:  # another drive
        name = whole.as_posix()
    if "\\" in name:
        raise NotWritten(f"no scene file can hold the name {name!a}")
    return name


def keep_files(text: SourceText, folder: Path, sources: Collection[Source]) -> None:
    """Changes names of files where another folder has a file of that name, too.

    Other names stay, as the saved scene names the folders in which they are found.

    Args:
        text: will be in `folder`.
        sources: all texts of the scene.
    """
    source = text.source
    if source.directory.resolve() == folder.resolve():
        return
    named = {str(path).lower(): path for path in source.named}
    listed = (path for other in sources for path in sorted(other.named) if path.is_dir())
    folders = list(dict.fromkeys([source.directory, *listed, *(other.directory for other in sources)]))
    for start, attribute, name in _named_files(source):
        wanted = name.replace("\\", "/")
        places = (str(old / wanted).lower() for old in folders)
        meant = next((named[place] for place in places if place in named), None)
        found = (in_any_case(other / wanted) for other in [folder, *folders])
        if meant and any(file and not _same(file, meant) for file in found):
            new = plain_text(relative_to(meant, folder))
            text.element(Location(source, start)).attributes[attribute] = new


def _same(file: Path, other: Path) -> bool:
    return other.exists() and file.samefile(other)


def _named_files(source: Source) -> Iterator[tuple[int, str, str]]:
    """The elements with names of files without parameters: start, attribute and name of each."""
    found: list[tuple[int, str, str]] = []
    parser = xml.parsers.expat.ParserCreate("utf-8")

    def begin(tag: str, attributes: dict[str, str]) -> None:
        key = "filename" if tag == "include" else "value"
        is_name = tag in ("include", "path") or attributes.get("name", "").lower() == "filename"
        if is_name and key in attributes and "$" not in attributes[key]:
            found.append((parser.CurrentByteIndex, key, attributes[key]))

    parser.StartElementHandler = begin
    parser.Parse(source.data, True)
    parser.StartElementHandler = None  # the parser and the function know each other
    yield from found
