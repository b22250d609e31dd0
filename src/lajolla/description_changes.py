"""What differs between two descriptions, as changes of a scene that was built from the first."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lajolla import _core

ENTRIES = ("film", "rfilter", "sampler", "integrator", "sensor")
LISTS = (
    *("textures", "bsdfs", "adapters", "materials", "emitters", "shapes", "instances"),
    *("volumes", "phases", "media"),
)


def description_changes(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any] | None:
    """The entries of `after` that differ, for `_core.Scene.with_changes`; None if it cannot make them."""
    changes: dict[str, Any] = {}
    for key in before.keys() | after.keys():
        old, new = before.get(key), after.get(key)
        if _equal(old, new):
            continue
        if key in ENTRIES and isinstance(old, dict) and isinstance(new, dict):
            changes[key] = new
        elif key in LISTS and isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
            pairs = [(i, a, b) for i, (a, b) in enumerate(zip(old, new, strict=True)) if not _equal(a, b)]
            if any(a.get("emitter") != b.get("emitter") for _, a, b in pairs) or _has_columns([*old, *new]):
                return None
            changes.update({f"{key}[{i}]": entry for i, _, entry in pairs})
        else:
            return None
    return changes


def _has_columns(entries: list[dict[str, Any]]) -> bool:
    """Whether an entry stands for several, so that its place in the list is not its number."""
    return any(isinstance(value, _core.Column) for entry in entries for value in entry.values())


def _equal(a: object, b: object) -> bool:
    """Whether two values of descriptions are equal; objects of the core only if they are the same."""
    if a is b:
        return True
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return type(a) is type(b) and np.array_equal(np.asarray(a), np.asarray(b))
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_equal(a[key], b[key]) for key in a)
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(map(_equal, a, b))
    return type(a) is type(b) and bool(a == b)
