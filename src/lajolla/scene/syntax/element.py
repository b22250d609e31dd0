"""An XML element as written, with its location."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from .errors import Location, Source
from .members import Run

NO_COLUMNS: Mapping[str, list[str]] = MappingProxyType({})


class Element:
    """One XML element with its attributes as written.

    An element in a run (`runs.py`) represents several similar ones: it is the first of them, and `columns`
    contains the texts of attributes that differ. Only the outermost element of a run has `run`.
    """

    __slots__ = ("attributes", "children", "columns", "last", "run", "source", "start", "tag")

    def __init__(self, tag: str, attributes: dict[str, str], source: Source, start: int) -> None:
        self.tag = tag
        self.attributes = attributes
        self.source = source
        self.start = start  # a byte of the source
        self.children: list[Element] = []
        self.columns: Mapping[str, list[str]] = NO_COLUMNS
        self.run: Run | None = None
        self.last: Element | None = None  # the last element of the run that was parsed

    @property
    def location(self) -> Location:
        return Location(self.source, self.start)

    def at(self, attribute: str) -> Location:
        """The location of an attribute's value, or of the element if the attribute is absent."""
        return Location(self.source, self.start, attribute=attribute)
