"""An XML element as it is written, that knows where it stands."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from .errors import Location, Source
from .members import Run

NO_COLUMNS: Mapping[str, list[str]] = MappingProxyType({})


class Element:
    """One XML element with its attributes as written.

    An element in a run (`runs.py`) stands for several that are alike: it is the first of them, and `columns`
    holds the texts of attributes that differ. `run` is that of the outermost one.
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
        self.last: Element | None = None  # of its run, as it was parsed

    @property
    def location(self) -> Location:
        return Location(self.source, self.start)

    def at(self, attribute: str) -> Location:
        """The place of an attribute's value; that of the element when the attribute is absent."""
        return Location(self.source, self.start, attribute=attribute)
