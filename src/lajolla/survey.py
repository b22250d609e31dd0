"""`lajolla check --all`: opens all scenes below a folder."""

from __future__ import annotations

import codecs
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from lajolla import _core
from lajolla.limits import OptionError
from lajolla.loaded_scene import Scene
from lajolla.scene import SceneError
from lajolla.scene.syntax.files import file_bytes

# What may stand in front of the first element of an XML file.
PROLOGUE = re.compile(rb"(?:\xef\xbb\xbf)?\s*(?:<\?.*?\?>|<!--.*?-->|<!DOCTYPE[^>]*>)?\s*", re.DOTALL)
INCLUDE = re.compile(rb"""<include\s[^<>]*filename\s*=\s*["']([^"']*)""")
PARAMETERS = re.compile(r"(?:\$\w+)+")
UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
CAMERA = re.compile(rb"<(sensor|camera)\s")
CONTENT = re.compile(rb"<(shape|include)\s")


@dataclass(frozen=True)
class Finding:
    """Result for one scene file; `error` is the first line of the message, empty if it opened."""

    path: Path
    warnings: int = 0
    error: str = ""


def survey(folder: Path, open_scene: Callable[[Path], Scene]) -> list[Finding]:
    """Opens every scene file below a folder.

    A file that another one includes is a fragment, and no finding, unless it is a whole scene by itself: with
    a camera and something to see. One of these that fails is a fragment if a scene that opens includes it.

    Args:
        folder: searched for `*.xml`, at any depth.
        open_scene: opens one file.
    """
    from rich.console import Console  # not loaded with the renderer, which has no use for it
    from rich.progress import track

    paths = sorted(path for path in folder.rglob("*") if path.suffix.lower() == ".xml")
    texts = {path: _text(path) for path in paths if path.is_file()}
    included = _included(texts)
    files = [
        path for path, text in texts.items() if _is_scene(text) and (_is_whole(text) or path not in included)
    ]
    shown = sys.stderr.isatty()
    progress = track(files, "reading", console=Console(stderr=True), transient=True, disable=not shown)
    findings = [_finding(path, open_scene) for path in progress]
    good = {finding.path for finding in findings if not finding.error}
    return [
        finding for finding in findings if not finding.error or not included.get(finding.path, set()) & good
    ]


def _is_scene(text: bytes) -> bool:
    """Whether the first element of a file is a scene."""
    at = 0
    while (passed := PROLOGUE.match(text, at)) and passed.end() > at:
        at = passed.end()
    return re.match(rb"<scene\b", text[at : at + 7]) is not None


def _is_whole(text: bytes) -> bool:
    """Whether a scene file has a camera and something to see."""
    return CAMERA.search(text) is not None and CONTENT.search(text) is not None


def _included(texts: Mapping[Path, bytes]) -> dict[Path, set[Path]]:
    """The files that others include, with those that do by their place; some are known by their name only."""
    places = {_place(path): path for path in texts}
    found: dict[Path, set[Path]] = {}
    elsewhere: set[str] = set()
    for path, text in texts.items():
        for raw in set(INCLUDE.findall(text)):
            name = raw.decode(errors="replace").replace("\\", "/")
            place = _place(path.parent / name)
            if place in places and not PARAMETERS.search(name):
                found.setdefault(places[place], set()).add(path)
            else:
                elsewhere.add(name.rsplit("/", 1)[-1])
    # Parameters stand for any text, but not for all of a name.
    patterns = [_pieces(name) for name in sorted(elsewhere) if PARAMETERS.sub("", Path(name).stem)]
    return {
        path: set() for path in texts if any(_matches(path.name.lower(), pieces) for pieces in patterns)
    } | found


def _place(path: Path) -> str:
    """A path as files are found: through links, in any case."""
    return os.path.realpath(str(path).replace("\0", "?")).lower()


def _pieces(name: str) -> list[str]:
    """What stands between the parameters of a name, in lower case."""
    return PARAMETERS.split(name.lower())


def _matches(name: str, pieces: Sequence[str]) -> bool:
    """Whether a name consists of these pieces in their order, with any text between them.

    Each piece is taken where it is found first, which never spoils the match of a later one; a regular
    expression would try all other places too.
    """
    first, *others = pieces
    if not others:
        return name == first
    if not name.startswith(first):
        return False
    at = len(first)
    for piece in others[:-1]:
        found = name.find(piece, at)
        if found < 0:
            return False
        at = found + len(piece)
    return name.endswith(others[-1]) and len(name) - len(others[-1]) >= at


def _text(path: Path) -> bytes:
    try:
        text = file_bytes(path)
        return text.decode("utf-16").encode() if text[:2] in UTF_16 else text
    except (OSError, UnicodeError):  # a file that may not be read, or is none of text
        return b""


def _finding(path: Path, open_scene: Callable[[Path], Scene]) -> Finding:
    try:
        return Finding(path, warnings=len(open_scene(path).warnings))
    except (SceneError, OptionError, _core.DescriptionError) as problem:
        return Finding(path, error=str(problem).splitlines()[0])
    except MemoryError:
        return Finding(path, error="not enough memory")
    except Exception as problem:  # whatever is wrong with one scene, the others are read
        return Finding(path, error=" ".join([f"{type(problem).__name__}:", *str(problem).splitlines()[:1]]))


def table(folder: Path, findings: Sequence[Finding]) -> Iterator[str]:
    """The lines of a report: a row for each file, then the counts."""
    names = [str(finding.path.relative_to(folder)).replace("\n", "\\n") for finding in findings]
    width = max((len(name) for name in names), default=0)
    yield f"{'scene':{width}}  opened  warnings  error"
    for name, finding in zip(names, findings, strict=True):
        answer, warnings = ("no", "") if finding.error else ("yes", str(finding.warnings))
        message = finding.error.removeprefix(f"{finding.path}:")
        yield f"{name:{width}}  {answer:6}  {warnings:>8}  {message}".rstrip()
    opened = sum(not finding.error for finding in findings)
    silent = sum(not finding.error and finding.warnings == 0 for finding in findings)
    failed = len(findings) - opened
    yield f"{len(findings)} scenes: {opened} opened, {silent} of them without a warning; {failed} failed"
