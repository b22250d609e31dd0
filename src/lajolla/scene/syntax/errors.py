"""Locations in scene files, and messages that point to them."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

from lajolla.messages import LajollaWarning

EXCERPT_WIDTH = 100
MOST_WARNINGS = 1000  # that differ
LONGEST_NAME = 64  # of what is compared with names that there are

# An attribute with its value in quotes, or the end of a tag.
IN_TAG = re.compile(rb"""(?<=\s)([^\s"'=<>]+)\s*=\s*("[^"]*"|'[^']*')|>""")


@dataclass(eq=False)
class Source:
    """One scene file: its name as shown in messages, its UTF-8 text, its folder and its format version.

    What is not `quoted` may be no scene at all, but a file that is nobody's business. `named` are the files
    that its objects name, at the places where they were found, or first looked for.
    """

    name: str
    data: bytes = field(repr=False)
    directory: Path
    version: tuple[int, int, int] = (3, 0, 0)
    quoted: bool = True
    named: set[Path] = field(default_factory=set, repr=False)


class Location(NamedTuple):
    """A place in a scene file, or the path of a key in a scene dict (`key`).

    In a file it is the byte at `start`, or the value of an attribute of the tag that starts there: where that
    is will only be looked for when a message needs it.
    """

    source: Source
    start: int = 0
    key: str = ""
    attribute: str = ""

    @property
    def offset(self) -> int:
        """The byte, counted from zero."""
        if not self.attribute:
            return self.start
        wanted = self.attribute.encode()
        for found in IN_TAG.finditer(self.source.data, self.start):
            if not found.group(1):
                break
            if found.group(1) == wanted:
                return found.start(2) + 1
        return self.start

    @property
    def line(self) -> int:
        """Line number, counted from one."""
        return self.source.data.count(b"\n", 0, self.offset) + 1

    @property
    def column(self) -> int:
        """Column in characters, counted from one."""
        return len(self.source.data[self._line_start : self.offset].decode("utf-8", "replace")) + 1

    @property
    def _line_start(self) -> int:
        return self.source.data.rfind(b"\n", 0, self.offset) + 1

    def excerpt(self) -> str:
        """The line with a caret under the place, cut to a readable width; empty where none is to be shown."""
        if self.key or not self.source.data or not self.source.quoted:
            return ""
        start = self._line_start
        end = self.source.data.find(b"\n", start)
        line = self.source.data[start : end if end >= 0 else None].decode("utf-8", "replace").rstrip()
        caret = self.column - 1
        cut = (
            max(0, caret - EXCERPT_WIDTH // 2)
            if len(line) > EXCERPT_WIDTH
            else len(line) - len(line.lstrip())
        )
        shown = line[cut : cut + EXCERPT_WIDTH].replace("\t", " ")
        printable = "".join(c if c.isprintable() else "?" for c in shown)
        return f"\n    {printable}\n    {' ' * max(0, caret - cut)}^"

    def __str__(self) -> str:
        if self.key:
            return f"{self.source.name}[{self.key}]"
        return f"{self.source.name}:{self.line}:{self.column}" if self.source.data else self.source.name


def format_message(severity: str, message: str, location: Location | None) -> str:
    """`file:line:column: severity: message`, then the line and a caret."""
    if location is None:
        return f"{severity}: {message}"
    return f"{location}: {severity}: {message}{location.excerpt()}"


class SceneError(Exception):
    """A scene that cannot be read; `str()` is the full message with place, excerpt and caret."""

    def __init__(self, message: str, location: Location | None = None) -> None:
        super().__init__(message, location)
        self.message = message
        self.location = location

    def __str__(self) -> str:
        return format_message("error", self.message, self.location)


class SceneWarning(LajollaWarning):
    """Something in a scene that is not rendered as written; the first of `count` places that say so.

    `str()` is the full message with place, excerpt and caret.
    """

    def __init__(self, message: str, location: Location | None = None, count: int = 1) -> None:
        super().__init__(message, location, count)
        self.message = message
        self.location = location
        self.count = count

    def __str__(self) -> str:
        more = f" ({self.count} times)" if self.count > 1 else ""
        return format_message("warning", self.message + more, self.location)

    def __repr__(self) -> str:
        place = f", at {self.location}" if self.location else ""
        return f"<SceneWarning: {self.message}{place}>"


class Blame:
    """Within it, exceptions of libraries, the core and plugins become one message.

    There is one for each object of a scene, hence no generator, which would take three times as long.
    """

    __slots__ = ("place", "what")

    def __init__(self, place: Location, what: object = "") -> None:
        """`place` is what in the scene they are busy with, `what` its name, before the reason."""
        self.place = place
        self.what = what

    def __enter__(self) -> None:
        pass

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(problem, Exception) and not isinstance(problem, SceneError):
            reason = f"{self.what}: " if self.what else ""
            raise SceneError(reason + reason_of(problem), self.place) from problem


def reason_of(problem: Exception) -> str:
    """The first line of an exception's message, understandable without a traceback."""
    if isinstance(problem, MemoryError):
        return "not enough memory"
    if isinstance(problem, OSError) and problem.strerror:
        return f'"{problem.filename}": {problem.strerror}' if problem.filename else problem.strerror
    text = next(iter(str(problem).splitlines()), "")
    if isinstance(problem, KeyError):
        return f"{text} is missing"
    clear = isinstance(problem, ValueError | RuntimeError) and text
    return text if clear else f"{type(problem).__name__}: {text}".rstrip(": ")


@dataclass
class Diagnostics:
    """Collects warnings. With `strict`, unsupported requests are errors."""

    strict: bool = False
    collected: dict[str, SceneWarning] = field(default_factory=dict)
    suppressed: int = 0  # beyond MOST_WARNINGS

    def warn(self, message: str, location: Location | None = None, count: int = 1) -> None:
        """Collects a warning that something is not rendered as written, at `count` locations."""
        known = self.collected.get(message)
        if known:
            known.count += count
        elif len(self.collected) >= MOST_WARNINGS:
            self.suppressed += count
        else:
            self.collected[message] = SceneWarning(message, location, count)

    def unknown(self, message: str, location: Location | None = None, count: int = 1) -> None:
        """Notes an unknown name: a warning, or an error when strict."""
        if self.strict:
            raise SceneError(message, location)
        self.warn(message, location, count)

    @property
    def warnings(self) -> list[SceneWarning]:
        """The warnings in order of occurrence."""
        more = [SceneWarning(f"there are {self.suppressed} more warnings")] if self.suppressed else []
        return [*self.collected.values(), *more]


def nearest(name: str, valid: Iterable[str]) -> str | None:
    """The valid name that `name` most resembles, regardless of case; None when nothing is close."""
    return _nearest(name.lower(), tuple(sorted(valid))) if len(name) <= LONGEST_NAME else None


@lru_cache(1024)  # a mistake is often repeated
def _nearest(name: str, valid: tuple[str, ...]) -> str | None:
    by_lower = {v.lower(): v for v in valid}
    found = difflib.get_close_matches(name, by_lower, n=1, cutoff=0.6)
    return by_lower[found[0]] if found else None


def did_you_mean(name: str, valid: Iterable[str], limit: int = 12) -> str:
    """A hint to append to a message: the nearest valid name, else the valid names where they are few."""
    names = sorted(valid)
    close = nearest(name, names)
    if close:
        return f'; did you mean "{close}"?'
    return f"; valid: {', '.join(names)}" if 0 < len(names) <= limit else ""
