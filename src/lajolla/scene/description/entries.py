"""The lists of a description, and where their entries come from."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, overload

from lajolla.film import Film

from ..syntax.errors import Location, SceneError, SceneWarning
from ..syntax.members import Run
from ..syntax.nodes import Node

Entry = dict[str, Any]


class Entries(Sequence[Entry]):
    """A list of the description. What is stored with columns of the core is as many as these have rows."""

    def __init__(self) -> None:
        self.stored: list[Entry] = []
        self._firsts: list[int] = []  # the index of each that is stored
        self._length = 0

    def add(self, entry: Entry, count: int = 1) -> int:
        """Adds an entry that represents `count` entries; returns the index of the first."""
        self.stored.append(entry)
        self._firsts.append(self._length)
        self._length += count
        return self._firsts[-1]

    def alike(self) -> Iterator[tuple[int, Entry]]:
        """Each that is stored, with the index of the first that it is."""
        return zip(self._firsts, self.stored, strict=True)

    def __len__(self) -> int:
        return self._length

    @overload
    def __getitem__(self, index: int) -> Entry: ...

    @overload
    def __getitem__(self, index: slice) -> list[Entry]: ...

    def __getitem__(self, index: int | slice) -> Entry | list[Entry]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(self._length))]
        if len(self.stored) == self._length:
            return self.stored[index]
        if not 0 <= index < self._length:
            raise IndexError(index)
        at = bisect_right(self._firsts, index) - 1
        return row_of(self.stored[at], index - self._firsts[at])


def row_of(entry: Entry, index: int) -> Entry:
    """One of those that an entry is; the entry itself if it is only one, so that it can be changed."""
    if not any(hasattr(value, "row") for value in entry.values()):
        return entry
    return {name: value.row(index) if hasattr(value, "row") else value for name, value in entry.items()}


@dataclass
class Objects:
    """The objects that entries come from, by the names of the entries ("bsdfs[3]").

    Most entries of large scenes have no id, and nothing is stored for them.
    """

    ids: dict[str, str] = field(default_factory=dict)  # that the objects have in the scene
    plugins: dict[str, str] = field(default_factory=dict)  # where they are not named like the core's model
    firsts: dict[str, str] = field(default_factory=dict)  # the first entry of the same object without an id
    inherited: dict[Node, str] = field(default_factory=dict)
    mirrored: bool = True  # as in `Unsaid`
    exchanges: bool = True  # `exchanged` of `Unsaid`
    two_sided: bool = False  # opaque materials are the same on the back
    terminator: str = "none"  # of materials that do not set it
    terminators: dict[str, str] = field(default_factory=dict)  # of bsdfs that set it, or those inside them
    spare: Mapping[str, Node] = field(default_factory=dict)  # bsdfs by their ids that no shape uses
    exchanged: set[str] = field(
        default_factory=set
    )  # checkerboards whose colours are not in the file's order
    _met: dict[Node, str] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        """A pickle does not hold what is not in the description."""
        return {**self.__dict__, "spare": {}}

    def inherit(self, node: Node, names: Iterable[Node]) -> None:
        """Notes that objects without an id share that of the object around them, which is no entry."""
        self.inherited.update({inner: self.id_of(node) for inner in names if not inner.id})

    def id_of(self, node: Node) -> str:
        """The id of an object, or that which it shares; of a coating also that of what it covers."""
        own = node.id or self.inherited.get(node, "")
        if own or not node.plugin.lower().endswith("coating"):
            return own
        return next((self.id_of(child) for _, child in node.children("bsdf")), "")

    def finish(self) -> None:
        """Forgets what only serves to note entries: it holds the whole scene."""
        self.inherited.clear()
        self._met.clear()

    def with_view(
        self, entries: Iterable[str], plugins: Mapping[str, str], own: Mapping[str, str]
    ) -> Objects:
        """The same with other plugins and ids of some entries."""
        kept = {name: plugin for name, plugin in self.plugins.items() if name not in entries}
        ids = {name: known for name, known in self.ids.items() if name not in entries}
        return replace(self, ids={**ids, **own}, plugins={**kept, **plugins})

    def note(self, where: str, entry: Entry, node: Node) -> None:
        """Notes that an entry comes from this object."""
        name = self.id_of(node)
        if name:
            self.ids[where] = name
        elif where.startswith("shapes") and (first := self._met.setdefault(node, where)) != where:
            self.firsts[where] = first
        if node.plugin and node.plugin != entry.get("type"):
            self.plugins[where] = node.plugin


@dataclass(frozen=True)
class View:
    """A camera of a scene: the entries of the description that belong to it ("sensor", "film", "rfilter" and
    "sampler"), how its picture is written, the plugins, places and ids of the entries, and warnings about it,
    or the problem if it cannot be used."""

    entries: Entry
    film: Film
    plugins: Mapping[str, str] = field(default_factory=dict)
    places: Mapping[str, Location] = field(default_factory=dict)
    warnings: Sequence[SceneWarning] = ()
    problem: SceneError | None = None
    ids: Mapping[str, str] = field(default_factory=dict)

    def without_places(self) -> View:
        """The same without places in files, which hold the contents of these."""
        warnings = [SceneWarning(warning.message) for warning in self.warnings]
        problem = self.problem and SceneError(self.problem.message)
        return replace(self, places={}, warnings=warnings, problem=problem)


class Places(dict[str, Location]):
    """Where the entries of a description come from, by their names: "shapes[3]", "film"."""

    def __init__(self) -> None:
        super().__init__()
        self.others: dict[str, list[Location]] = {}  # of objects that are the same as an entry's
        self._runs: list[tuple[str, int, Run, Sequence[int]]] = []

    def add_run(self, where: str, first: int, run: Run, members: Sequence[int]) -> None:
        """Notes that entries of a list from `first` on come from these members of a run."""
        self._runs.append((where, first, run, members))

    def with_places(self, places: Mapping[str, Location]) -> Places:
        """The same with other places of some entries."""
        result = Places()
        result.update({**self, **places})
        result.others, result._runs = self.others, self._runs
        return result

    def note_same(self, entry: str, place: Location) -> None:
        """Notes that an entry stands for another object too."""
        if place != self.get(entry) and place not in self.others.setdefault(entry, [])[-1:]:
            self.others[entry].append(place)

    def find(self, entry: str) -> Location | None:
        """The location of an entry; None if unknown."""
        if entry in self:
            return self[entry]
        named = re.fullmatch(r"(\w+)\[(\d+)\]", entry)
        for where, first, run, members in self._runs:
            if named and where == named[1] and 0 <= int(named[2]) - first < len(members):
                return Location(run.source, run.starts[members[int(named[2]) - first]])
        return None
