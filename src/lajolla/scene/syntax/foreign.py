"""Objects of other libraries in scene dicts, converted by common protocols or rejected.

No library is imported for this. Paths have `__fspath__`; arrays, tensors and pictures have `__array__` or a
similar protocol; transforms have `matrix`; meshes have `vertices`, and `faces` or `triangles`.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lajolla.colour import decode_srgb

from .errors import Location, SceneError, reason_of

ARRAYS = ("__array__", "__array_interface__", "__dlpack__")
# Modes of PIL images that must be converted to red, green and blue.
INDIRECT_MODES = ("1", "P", "PA", "CMYK", "YCbCr", "LAB", "HSV", "RGBX", "La", "RGBa")


def plain(value: Any, location: Location) -> Any:  # noqa: ANN401
    """Converts a value to a number, string or array; returns lists, meshes and our own objects unchanged.

    Raises:
        SceneError: the type is not supported, or the conversion fails.
    """
    if isinstance(value, bool | int | float | str | np.ndarray) or type(value).__module__ == "lajolla._core":
        result = value
    elif isinstance(value, os.PathLike):
        result = os.fsdecode(value)
    elif isinstance(value, Sequence) and not isinstance(value, bytes | bytearray | memoryview):
        if value and (isinstance(value[0], Mapping) or is_mesh(value[0])):
            raise SceneError("a list of objects cannot be part of a scene: give each a key", location)
        result = value
    elif any(hasattr(type(value), name) for name in ARRAYS) or isinstance(value, np.generic | memoryview):
        result = _array(value, location)
    elif hasattr(value, "matrix"):
        result = _array(value.matrix, location)
    elif is_mesh(value):
        result = value
    else:
        what = "nothing (None)" if value is None else f"an object of the type {type_name(value)}"
        raise SceneError(f"{what} cannot be part of a scene", location)
    single = isinstance(result, np.ndarray) and result.ndim == 0
    return result.item() if single else result


def is_mesh(value: Any) -> bool:  # noqa: ANN401
    """Whether an object of another library is a triangle mesh, such as those of trimesh and Open3D."""
    has_faces = hasattr(value, "faces") or hasattr(value, "triangles")
    return hasattr(value, "vertices") and has_faces and not isinstance(value, np.ndarray)


def mesh_colours(mesh: Any, vertices: int, faces: int) -> dict[str, np.ndarray[Any, Any]]:  # noqa: ANN401
    """The colours of a mesh as its attributes "vertex_color" and "face_color", linear.

    trimesh has them in `visual`, where integers are sRGB, as everywhere; Open3D in `vertex_colors`.
    """
    visual = getattr(mesh, "visual", None)
    kind = getattr(visual, "kind", None)
    given = getattr(visual, f"{kind}_colors", None) if kind in ("vertex", "face") else None
    if given is None and visual is None:
        kind, given = "vertex", getattr(mesh, "vertex_colors", None)
    colours = np.zeros((0, 3)) if given is None else np.asarray(given)
    if colours.ndim != 2 or colours.shape[1] < 3 or len(colours) != (vertices if kind == "vertex" else faces):
        return {}
    colours = colours[:, :3]
    if colours.dtype.kind in "iu":
        colours = decode_srgb(colours.astype(np.float32) / np.float32(255))
    return {f"{kind}_color": np.ascontiguousarray(colours, np.float32)}


def type_name(value: object) -> str:
    kind = type(value)
    return kind.__qualname__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__qualname__}"


def _array(value: Any, location: Location) -> np.ndarray[Any, Any]:  # noqa: ANN401
    try:
        if getattr(value, "mode", None) in INDIRECT_MODES and hasattr(value, "convert"):
            value = value.convert("RGB")
        lacks_array = not any(hasattr(value, name) for name in ARRAYS[:2]) and hasattr(value, "__dlpack__")
        array = np.from_dlpack(value) if lacks_array else np.asarray(value)
        return _encoded_as_usual(array, value)
    except Exception as problem:  # the other library may raise any exception
        what = f"the {type_name(value)} cannot become an array"
        raise SceneError(f"{what}: {reason_of(problem)}", location) from None


def _encoded_as_usual(array: np.ndarray[Any, Any], picture: object) -> np.ndarray[Any, Any]:
    """Converts to linear if `srgb_gamma` contradicts the convention that integers are sRGB, floats linear."""
    is_encoded, is_integer = getattr(picture, "srgb_gamma", None), array.dtype.kind == "u"
    if not callable(is_encoded) or bool(is_encoded()) == is_integer:
        return array
    return array / np.float32(np.iinfo(array.dtype).max) if is_integer else decode_srgb(array)
