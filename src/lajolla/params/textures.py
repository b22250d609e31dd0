"""The textures of a description by their numbers: who refers to which, and where new ones go."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

from lajolla.params.objects import Entry, Lists

USERS = ("bsdfs", "adapters", "emitters")  # the lists, beside the textures', whose entries take textures


def textures_in(value: object) -> Iterator[int]:
    """The numbers of the textures to which an entry or a part of one refers."""
    if isinstance(value, Mapping):
        if is_texture(value):
            yield value["texture"]
        else:
            for part in value.values():
                yield from textures_in(part)


def is_texture(value: object) -> bool:
    """Whether a value of an entry is a reference to a texture."""
    return isinstance(value, Mapping) and len(value) == 1 and isinstance(value.get("texture"), int)


def renumbered(value: Any, numbers: Mapping[int, int]) -> Any:  # noqa: ANN401
    """An entry or a part of one with other numbers of textures."""
    if not isinstance(value, Mapping):
        return value
    if is_texture(value):
        return {"texture": numbers.get(value["texture"], value["texture"])}
    return {name: renumbered(part, numbers) for name, part in value.items()}


def unclamped(textures: Sequence[Entry], use: Mapping[str, Any]) -> Mapping[str, Any]:
    """A reference to the texture itself in place of the reader's, which keeps it in the range of a field."""
    while textures[use["texture"]]["type"] == "clamped":
        use = textures[use["texture"]]["texture"]
    return use


def reached(textures: Sequence[Entry], first: Iterable[int]) -> set[int]:
    """These textures, and all that they refer to."""
    waiting, met = list(first), set[int]()
    while waiting:
        index = waiting.pop()
        if index not in met:
            met.add(index)
            waiting += textures_in(textures[index])
    return met


def dependents(textures: Sequence[Entry], changed: Iterable[int]) -> set[int]:
    """These textures, and all that refer to them."""
    users: dict[int, list[int]] = {}
    for index, entry in enumerate(textures):
        for inner in textures_in(entry):
            users.setdefault(inner, []).append(index)
    waiting, met = list(changed), set[int]()
    while waiting:
        index = waiting.pop()
        if index not in met:
            met.add(index)
            waiting += users.get(index, ())
    return met


def unused(lists: Lists, loaded: int, changes: Iterable[Entry]) -> set[int]:
    """The textures that neither a description nor changes of it refer to.

    Those that were `loaded` are kept: they have names.
    """
    count = lists.count("textures")
    if count == loaded:
        return set()
    entries = [entry for where in USERS for entry in lists.core.get(where, ())]
    used = [index for entry in (*entries, *changes) for index in textures_in(entry) if index < count]
    textures = lists.core["textures"]
    return set(range(loaded, count)) - reached(textures, [*range(loaded), *used])


def arranged(
    textures: Sequence[Entry], count: int, free: Collection[int], used: Iterable[int]
) -> dict[int, int]:
    """The places of new textures, and of others that have to move behind those to which they refer.

    Args:
        textures: those of a description, with changes, and then new ones.
        count: of the description.
        free: places of the description that new ones may take.
        used: the new ones that are referred to; others are left out.
    """
    places: dict[int, int] = {}
    free, end = sorted(free), count

    def place(index: int) -> int:
        nonlocal end
        if index not in places:
            after = max((place(inner) for inner in textures_in(textures[index])), default=-1)
            if index < count and after < index:
                places[index] = index
            elif (slot := next((slot for slot in free if slot > after), None)) is not None:
                free.remove(slot)
                places[index] = slot
            else:
                places[index] = end
                end += 1
        return places[index]

    for index in (*(i for i in range(count) if i not in free), *used):
        place(index)
    return {index: at for index, at in places.items() if at != index or index >= count}
