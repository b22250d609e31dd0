"""Scenes whose holdouts and shadow catchers are ordinary objects to the camera, so that they are found."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lajolla import _core
from lajolla.params.edits import SLOT
from lajolla.params.objects import Lists, rows_in

HOLDOUT, CATCHER = "holdout", "shadow_catcher"  # properties of shapes and instances


def without(
    core: _core.Scene, description: dict[str, Any], holes: Collection[str] = (HOLDOUT, CATCHER)
) -> _core.Scene:
    """The scene without these properties of its objects; itself if it has none."""
    lists = Lists(description)
    changes = {}
    for where in ("shapes", "instances"):
        for first, stored in zip(lists.firsts(where).tolist(), description.get(where, ()), strict=False):
            if not any(stored.get(hole) for hole in holes):
                continue
            for name in (f"{where}[{index}]" for index in range(first, first + rows_in(stored))):
                entry = lists.entry(name)
                kept = SLOT if where == "shapes" else entry
                changes[name] = {key: entry[key] for key in kept if key in entry and key not in holes}
    return (core.with_changes(changes) if changes else None) or core


def held_out(core: _core.Scene, description: dict[str, Any], threads: int) -> NDArray[np.bool_] | None:
    """The pixels (height, width) whose centres show a holdout; None if the scene has none."""
    filled = without(core, description, (HOLDOUT,))
    if filled is core:
        return None
    seen, there = (_core.ids_at_centres(each, threads)[..., 0] >= 0 for each in (core, filled))
    return np.asarray(there & ~seen)
