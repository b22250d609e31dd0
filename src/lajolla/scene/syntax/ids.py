"""Nodes by their ids, also those of the members of a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from .errors import Location
from .members import Run
from .nodes import Column, Node


class Member(NamedTuple):
    """One of the objects that the node of a run stands for."""

    node: Node
    number: int  # from 0

    @property
    def location(self) -> Location:
        assert self.node.run is not None
        return Location(self.node.run.source, self.node.run.starts[self.number])


def no_runs(member: Member) -> Node:
    raise AssertionError(f"{member.node} is in a run")


@dataclass(eq=False)
class Ids(Mapping[str, Node]):
    """Every id with its node. A member of a run gets a node of its own, by `alone`, when it is looked up."""

    found: dict[str, Node | Member] = field(default_factory=dict)
    alone: Callable[[Member], Node] = no_runs
    made: dict[str, Node] = field(default_factory=dict)  # by `alone`

    def __getitem__(self, name: str) -> Node:
        value = self.found[name]
        if isinstance(value, Node):
            return value
        if name not in self.made:
            self.made[name] = self.alone(value)
        return self.made[name]

    def __contains__(self, name: object) -> bool:
        return name in self.found

    def __iter__(self) -> Iterator[str]:
        return iter(self.found)

    def __len__(self) -> int:
        return len(self.found)

    def together(self, names: Sequence[str], run: Run) -> Node | None:
        """What the members of a run refer to by these names, as if each contained it.

        None unless all are members of one other run.
        """
        members = [value for name in names if isinstance(value := self.found[name], Member)]
        if len(members) < len(names) or len({id(member.node) for member in members}) != 1:
            return None
        return _rows(members[0].node, [member.number for member in members], run)


def _rows(node: Node, indices: list[int], run: Run) -> Node:
    """Some objects of a run, one for each member of another run."""
    properties = []
    for prop in node.properties:
        value = prop.value
        if isinstance(value, Column):
            value = Column(value.rows[indices])
        elif isinstance(value, Node):
            value = _rows(value, indices, run)
        properties.append(replace(prop, value=value))
    ids = [node.ids[index] for index in indices] if node.ids else ()
    return replace(node, properties=properties, run=run, ids=ids)
