"""Checks that textures with a picture for each face have as many as the meshes that they are on."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..syntax.errors import Location, SceneError
from .plugin import Context, Entry


def check_faces(context: Context, owner: Entry, shape: Entry, location: Location) -> None:
    """Compares the `ptex` textures in an entry of the description with a shape.

    Args:
        owner: a bsdf, an emitter, or anything else with textures.
        shape: the entry of the shape.
        location: what to blame.

    Raises:
        SceneError: the shape has no faces, or another number of them.
    """
    for value in owner.values():
        for pictures in _pictures(context, value):
            count = pictures["images"].face_count
            faces = shape["mesh"].face_count if "mesh" in shape else 0
            if faces == 0:
                message = "a ptex texture needs a mesh whose faces are known: obj, ply, or arrays with faces"
                raise SceneError(message, location)
            if faces != count:
                raise SceneError(
                    f"a ptex texture has pictures of {count:,} faces, but this shape has {faces:,}", location
                )


def _pictures(context: Context, value: Any) -> Iterator[Entry]:  # noqa: ANN401
    """The `ptex` textures that a value of an entry consists of."""
    if not isinstance(value, dict):
        return
    entry = context.entry("textures", value["texture"]) if "texture" in value else value
    if entry.get("type") == "ptex":
        yield entry
        return
    for part in entry.values():
        yield from _pictures(context, part)
