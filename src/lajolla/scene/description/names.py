"""Names of the objects in the description's lists: what a picture's ids stand for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .entries import Objects

KINDS = {"shapes": "shape", "materials": "material", "instances": "instance"}  # lists, and what is in them


@dataclass(frozen=True)
class Numbered:
    """Numbers from 1 for the entries of a list, in file order, and the name that each number stands for.

    `names[0]` is empty: 0 means that there is nothing.
    """

    numbers: npt.NDArray[np.int32]
    names: Sequence[str]

    def of(self, indices: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
        """The numbers of entries by their indices; 0 for -1."""
        if self.numbers.max(initial=0) == len(self.numbers):  # each entry has a number of its own
            return indices + np.int32(1)
        return np.append(self.numbers, np.int32(0))[indices]


def numbered(objects: Objects, core: Mapping[str, Any], where: str) -> Numbered:
    """Numbers for the shapes, materials or instances of a description.

    An entry is named by the id that its object has in the scene, a material by that of its bsdf; others are
    named as in `Scene.params`: "shape_3", and "shape_3.bsdf" by the first shape that has the material.
    Entries that are parts of the same object share its number.
    """
    count = sum(_rows(entry) for entry in core.get(where, ()))
    ids = _material_ids(objects, core) if where == "materials" else _ids_of(objects, where)
    firsts = {_index(name): _index(first) for name, first in objects.firsts.items() if _is_in(name, where)}
    met: dict[str, int] = {}
    for index, name in sorted(ids.items()):
        firsts[index] = met.setdefault(name, index)
    first = np.arange(count)
    first[list(firsts)] = list(firsts.values())
    is_first = first == np.arange(count)
    numbers = np.cumsum(is_first)[first].astype(np.int32)
    parts = _names_by_shapes(objects, core) if where == "materials" else {}
    return Numbered(numbers, _texts(KINDS[where], np.flatnonzero(is_first), ids, parts))


def _is_in(name: str, where: str) -> bool:
    return name.startswith(f"{where}[")


def _index(name: str) -> int:
    return int(name[name.index("[") + 1 : -1])


def _ids_of(objects: Objects, where: str) -> dict[int, str]:
    return {_index(name): known for name, known in objects.ids.items() if _is_in(name, where)}


def _rows(entry: Mapping[str, Any]) -> int:
    return next((len(value) for value in entry.values() if hasattr(value, "row")), 1)


def _material_ids(objects: Objects, core: Mapping[str, Any]) -> dict[int, str]:
    adapters = core.get("adapters", ())
    fronts = (front for entry in core["materials"] for front in _values(entry, "front"))
    names = (_name_of(front, objects, adapters) for front in fronts)
    return {index: name for index, name in enumerate(names) if name}


def _values(entry: Mapping[str, Any], key: str) -> Iterator[Any]:
    """The value of each entry that a stored one represents."""
    value = entry[key]
    return (value.row(i) if hasattr(value, "row") else value for i in range(_rows(entry)))


def _name_of(material: int | Mapping[str, int], objects: Objects, adapters: Sequence[Any]) -> str:
    """The id of a material: of the bsdf itself, or of the first one inside that has one."""
    if not isinstance(material, Mapping):
        return objects.ids.get(f"bsdfs[{material}]", "")
    index = material["adapter"]
    children = (adapters[index][key] for key in ("first", "second", "child") if key in adapters[index])
    inner = (name for child in children if (name := _name_of(child, objects, adapters)))
    return objects.ids.get(f"adapters[{index}]", "") or next(inner, "")


def _names_by_shapes(objects: Objects, core: Mapping[str, Any]) -> dict[int, str]:
    """Names of materials by the first shape that has each: "ball.bsdf"."""
    ids, names = _ids_of(objects, "shapes"), dict[int, str]()
    met: Counter[str] = Counter()
    materials = (material for entry in core.get("shapes", ()) for material in _values(entry, "material"))
    for index, material in enumerate(materials):
        name = ids.get(index, f"shape_{index + 1}")
        met[name] += 1
        if material not in names:
            names[material] = f"{name}{f'_{met[name]}' if met[name] > 1 else ''}.bsdf"
    return names


def _texts(
    kind: str, firsts: npt.NDArray[np.intp], ids: dict[int, str], parts: Mapping[int, str]
) -> list[str]:
    """The name of each number: the id, or one made of what it is a part of, or of its place, that is no
    other's id."""
    taken = set(ids.values())
    names = [""]
    for index in firsts.tolist():
        name = ids.get(index)
        if name is None:
            name = parts.get(index, f"{kind}_{index + 1}")
            while name in taken:
                name += "_"
        names.append(name)
    return names
