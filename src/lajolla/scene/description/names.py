"""Names of the objects in the description's lists: what a picture's ids stand for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ..syntax.nodes import Node

NAMED = {"shapes": "shape", "materials": "material", "instances": "instance"}  # lists, and what is in them


@dataclass
class Names:
    """Collects the names of entries while a description is built.

    An entry is named by the id that its object has in the scene. Entries that are parts of the same object
    share its name; most entries of large scenes have no id, and nothing is stored for them.
    """

    ids: dict[str, dict[int, str]] = field(default_factory=dict)  # by list and index
    firsts: dict[str, dict[int, int]] = field(default_factory=dict)  # the first entry of the same object
    counts: dict[str, int] = field(default_factory=dict)
    _met: dict[Node, int] = field(default_factory=dict)

    def note(self, where: str, index: int, node: Node) -> None:
        """Notes that an entry is, or is a part of, this object."""
        if where not in NAMED or where == "materials":
            return
        first = self._met.setdefault(node, index)
        if node.id:
            self.name(where, index, node.id)
        elif first != index:
            self.firsts.setdefault(where, {})[index] = first

    def name(self, where: str, index: int, name: str) -> None:
        """Names an entry."""
        self.ids.setdefault(where, {})[index] = name

    def finish(self, counts: dict[str, int]) -> None:
        """Notes how many entries there are; no more are added."""
        self.counts = counts
        self._met.clear()  # it holds the whole scene

    def numbered(self, where: str) -> Numbered:
        """Numbers for the entries of a list."""
        ids, firsts = self.ids.get(where, {}), dict(self.firsts.get(where, {}))
        met: dict[str, int] = {}
        for index, name in ids.items():
            firsts[index] = met.setdefault(name, index)
        first = np.arange(self.counts[where])
        first[list(firsts)] = list(firsts.values())
        is_first = first == np.arange(len(first))
        numbers = np.cumsum(is_first)[first].astype(np.int32)
        return Numbered(numbers, _texts(NAMED[where], np.flatnonzero(is_first), ids))


@dataclass(frozen=True)
class Numbered:
    """Numbers from 1 for the entries of a list, in file order, and the name that each number stands for.

    `names[0]` is empty: 0 means that there is nothing.
    """

    numbers: npt.NDArray[np.int32]
    names: Sequence[str]


def _texts(kind: str, firsts: npt.NDArray[np.intp], ids: dict[int, str]) -> list[str]:
    """The name of each number: the id, or one made of the kind and the number that is no other's id."""
    taken = set(ids.values())
    names = [""]
    for number, index in enumerate(firsts.tolist(), start=1):
        name = ids.get(index)
        if name is None:
            name = f"{kind}_{number}"
            while name in taken:
                name += "_"
        names.append(name)
    return names


def material_name(bsdf: Node) -> str:
    """The id of a material: of the object itself, or of the first one inside that has one."""
    inner = (name for _, child in bsdf.children("bsdf") if (name := material_name(child)))
    return bsdf.id or next(inner, "")
