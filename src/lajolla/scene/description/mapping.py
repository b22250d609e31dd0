"""Checks that textured shapes have what their textures need: coordinates, or faces."""

from __future__ import annotations

from collections.abc import Iterator

from .builder import Builder
from .faces import check_faces
from .plugin import BLACK, Entry

MAPPED = ("bitmap", "checkerboard", "gridtexture")  # where on a texture a point is comes from its coordinates


def check_textures(builder: Builder) -> None:
    """Warns about shapes without texture coordinates whose textures need them.

    Raises:
        SceneError: a texture has a picture for each face, and a shape has other faces, or none.
    """
    _warn_of_missing_coordinates(builder)
    if any(texture["type"] == "ptex" for texture in builder.textures.stored):
        _check_faces(builder)


def _check_faces(builder: Builder) -> None:
    for i, shape in builder.shapes.alike():
        materials = shape["material"]
        if not isinstance(materials, int):  # several in a column
            materials = builder.shapes[i]["material"]
        emitter = shape.get("emitter", BLACK)
        lights = [builder.emitters[emitter]] if emitter >= 0 else []
        for owner in (*_parts(builder, materials), *lights):
            check_faces(builder, owner, shape, builder.places[f"shapes[{i}]"])


def _warn_of_missing_coordinates(builder: Builder) -> None:
    needing: dict[int, bool] = {}  # materials
    for i, shape in builder.shapes.alike():
        if shape["type"] != "sdfgrid" and not ("mesh" in shape and shape["mesh"].uvs is None):
            continue
        material, emitter = shape["material"], shape.get("emitter", BLACK)
        if material not in needing:
            needing[material] = any(_is_mapped(builder, part) for part in _parts(builder, material))
        if needing[material] or (emitter >= 0 and _is_mapped(builder, builder.emitters[emitter])):
            message = "there is a texture on a shape that has no texture coordinates"
            builder.diagnostics.warn(message, builder.places[f"shapes[{i}]"])


def _parts(builder: Builder, material: int) -> Iterator[Entry]:
    """The bsdfs and adapters of a material slot."""
    waiting = [builder.materials[material][side] for side in ("front", "back")]
    met: list[int | dict[str, int]] = []
    while waiting:
        part = waiting.pop()
        if part == BLACK or part in met:
            continue
        met.append(part)
        if isinstance(part, dict):
            entry = builder.adapters[part["adapter"]]
            waiting += [entry[name] for name in ("first", "second", "child") if name in entry]
            yield entry
        else:
            yield builder.bsdfs[part]


def _is_mapped(builder: Builder, entry: Entry) -> bool:
    """Whether an entry of the description has a texture that needs coordinates, also within others."""
    for value in entry.values():
        if not isinstance(value, dict):
            continue
        texture = builder.textures[value["texture"]] if "texture" in value else value
        if texture.get("type") in MAPPED or _is_mapped(builder, texture):
            return True
    return False
