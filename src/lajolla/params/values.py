"""Values of parameters as NumPy arrays and Python's own, and meshes by their arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from lajolla import _core
from lajolla.colour import decode_srgb
from lajolla.scene.description.plugins.meshes import WEIGHTS, frame_of_normals
from lajolla.scene.formats.mesh_arrays import MESH_ARRAYS, mesh_of, with_unit_normals

Values: TypeAlias = npt.NDArray[Any]
Entry: TypeAlias = Mapping[str, Any]  # of a description

NUMBERS = ("spectrum", "vector", "transform", "floats", "matrix")
WITH_OBJECTS = ("texture_float", "texture_spectrum", "volume_float", "volume_spectrum", "volume_matrix")


def readable(kind: str, value: Any) -> Any:  # noqa: ANN401
    """A value of a description, by the type of its field; objects are the caller's."""
    if kind == "spectrum" or kind.endswith("_spectrum"):
        return np.array(np.broadcast_to(np.asarray(value, np.float64), 3))
    if kind in NUMBERS or kind == "volume_matrix":
        return np.array(value, np.float64)
    if kind == "image":
        return None if value is None else pixels_of(value)
    if kind == "grid":
        return None if value is None else np.array(value.__getstate__())
    return value


def pixels_of(image: _core.Image) -> npt.NDArray[np.float32]:
    """The linear values of a texture's pixels: (height, width, 1 or 3)."""
    width, height, channels, srgb, kind, words = image.__getstate__()
    stored: Values = np.asarray(words).view((np.uint8, np.float16, np.float32)[kind])
    per_texel = 4 if channels == 3 and kind < 2 else channels
    texels = stored[: width * height * per_texel].reshape(height, width, per_texel)[..., :channels]
    if kind > 0:
        return np.array(texels, np.float32)
    unit = np.asarray(texels, np.float32) / np.float32(255)
    return decode_srgb(unit) if srgb else unit


def mesh_array(mesh: _core.Mesh, name: str) -> Values | None:
    """One of a mesh's arrays; None if it has no normals or uvs."""
    found = getattr(mesh, MESH_ARRAYS[name]) if name in MESH_ARRAYS else mesh.attributes[name]
    return None if found is None else np.asarray(found)


def fixed(value: Any) -> Any:  # noqa: ANN401
    """The same; an array cannot be written to."""
    if isinstance(value, np.ndarray):
        value = value.view()
        value.flags.writeable = False
    return value


def mesh_names(mesh: _core.Mesh) -> list[str]:
    """The names of a mesh's arrays."""
    return [*MESH_ARRAYS, *mesh.attributes]


def with_arrays(mesh: _core.Mesh, arrays: Mapping[str, Any], before: Entry, after: Entry) -> _core.Mesh:
    """A mesh with other arrays.

    Vertex normals are computed again, as they are for files without normals, if positions or triangles
    change and normals do not.

    Args:
        mesh: has the other arrays.
        arrays: by the names of `mesh_names`, or those of new attributes; None removes.
        before, after: the mesh's shape: how it was placed and will be.

    Raises:
        ValueError: shapes of the arrays do not fit together.
    """
    kept = {name: mesh_array(mesh, name) for name in mesh_names(mesh)}
    moved = "positions" in arrays or "triangles" in arrays
    renew = moved and "normals" not in arrays and kept["normals"] is not None
    made = mesh_of({**kept, **({"normals": None} if renew else {}), **with_unit_normals(arrays)})
    if "triangles" not in arrays:
        made = made.with_faces_of(mesh)
    if renew:
        return _smoothed(made, after)
    return made if "normals" in arrays or not is_smoothed(mesh, before) else _smoothed(made, before)


def placed(mesh: _core.Mesh, before: Entry, after: Entry, *, smooth: bool) -> _core.Mesh:
    """A mesh whose computed normals are those that it would have if it was loaded with another placement, or
    with other weights.

    Args:
        mesh: as it is before.
        before, after: its shape.
        smooth: computes normals if it has none.

    Raises:
        ValueError: they depend on triangles that are not in the mesh.
    """
    if mesh.normals is None:
        return _smoothed(mesh, after) if smooth else mesh
    same = np.array_equal(_frame(before), _frame(after)) and _weights(before) == _weights(after)
    if same or not mesh.computed_normals or is_smoothed(mesh, after):
        return mesh
    if not is_smoothed(mesh, before):
        reason = "its vertex normals continue in other shapes of its file"
        raise ValueError(f"{reason}; load the scene with this value")
    return _smoothed(mesh, after)


def _frame(shape: Entry) -> Values:
    return frame_of_normals(shape.get("to_world", np.eye(4)))


def _weights(shape: Entry) -> str:
    return str(shape.get(WEIGHTS, "angle"))


def _smoothed(mesh: _core.Mesh, shape: Entry) -> _core.Mesh:
    return mesh.with_vertex_normals(_frame(shape).tolist(), _weights(shape))


def is_smoothed(mesh: _core.Mesh, shape: Entry) -> bool:
    """Whether its normals are computed as its shape says, from its own triangles alone."""
    if not mesh.computed_normals or mesh.normals is None:
        return False
    again = _smoothed(mesh, shape).normals
    return again is not None and np.array_equal(again, mesh.normals, equal_nan=True)
