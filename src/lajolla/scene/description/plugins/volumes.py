"""Volumes: constants, and grids from files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from lajolla import _core

from ...data.spectra import blackbody
from ...formats.hierarchical import read_hierarchical
from ...formats.volumes import read_voxels
from ...formats.voxels import VoxelError, Voxels, box_transform
from ...schema import Field
from ...syntax.errors import Location, SceneError
from ...syntax.files import find_file, identity
from ...syntax.nodes import Array, Blackbody, Node
from ..plugin import Colour, Context, Entry, Plugin, Values

KEPT = (np.uint8, np.float16, np.float32)


def _constant(context: Context, node: Node, values: Values) -> Colour:
    value: Colour = values.get("value", (1.0, 1.0, 1.0))
    return value


def placement_of(context: Context, volume: Node | None) -> Array:
    """The box of a constant volume, which may be inside another volume."""
    while volume is not None:
        prop = volume.find("to_world")
        if prop is not None:
            place: Array = context.convert(volume, prop, TO_WORLD)
            return place
        volume = next((child for _, child in volume.children("volume")), None)
    return np.eye(4)


def _grid_volume(context: Context, node: Node, values: Values) -> Entry:
    voxels, location = load_voxels(context, node, values)
    return _entry(context, node, values, voxels, _finite(context, voxels.values, location))


def _blackbody_volume(context: Context, node: Node, values: Values) -> Entry:
    """Planck's law at every voxel; radiance, not temperature, is interpolated."""
    scale = values.pop("scale", 1.0)
    factor, offset = values.pop("temperature_scale", 1.0), values.pop("temperature_offset", 0.0)
    values.setdefault("grid_name", "temperature")
    voxels, location = load_voxels(context, node, values)
    kelvin = factor * _finite(context, voxels.values, location).astype(np.float32)[..., :1] + offset
    top = max(float(kelvin.max()), 1.0)
    if top > MAX_KELVIN:
        raise SceneError(f"a temperature of {top:.4g} K is too high", location)
    colours = np.stack([blackbody(Blackbody(max(t, 1.0), scale)) for t in np.linspace(0, top, STEPS)])
    steps = np.linspace(0, top, STEPS)
    emitted = [np.interp(kelvin[..., 0], steps, column).astype(np.float32) for column in colours.T]
    return _entry(context, node, values, voxels, np.stack(emitted, axis=-1))


def load_voxels(context: Context, node: Node, values: Values) -> tuple[Voxels, Location]:
    """The voxels of a file or an array from Python, and the location for error messages."""
    arrays = [values.pop(name) for name in ("data", "grid") if name in values]
    grid_name = values.pop("grid_name", "density")
    if arrays:
        if "filename" in values:
            message = f"{node} takes a file or an array, not both"
            raise SceneError(message, node.property_location("filename"))
        return Voxels(grid_values(node, arrays[0]), np.eye(4)), node.location
    values.pop("filename", None)
    path, location = context.find(node)
    key = ("volume", identity(path), grid_name)

    def read() -> Voxels:
        context.reading(path, location)
        try:
            return read_voxels(path, grid_name)
        except VoxelError as problem:
            raise SceneError(f'"{path}" cannot be used as a volume: {problem}', location) from None

    values.setdefault("use_grid_bbox", path.suffix.lower() in (".nvdb", ".vdb"))
    return context.read(key, read), location


def _entry(
    context: Context, node: Node, values: Values, voxels: Voxels, array: npt.NDArray[np.generic]
) -> Entry:
    box = voxels.box if values.pop("use_grid_bbox", False) else np.eye(4)
    corners = [values.pop(name, None) for name in ("min", "max")]
    if None not in corners:
        try:
            box = box_transform(*(np.asarray(corner, float) for corner in corners))
        except VoxelError as problem:
            raise SceneError(f"{node}: {problem}", node.location) from None
    to_world: Array = values.pop("to_world", np.eye(4)) @ box
    return {"type": "gridvolume", "grid": _core.Grid(array), "to_world": to_world, **values}


def _finite(context: Context, array: npt.NDArray[np.generic], location: Location) -> npt.NDArray[np.generic]:
    if array.dtype != np.uint8 and not np.all(np.isfinite(array)):
        context.diagnostics.warn("the volume has voxels that are not finite; they are zero", location)
        array = np.where(np.isfinite(array), array, 0).astype(array.dtype)
    return np.ascontiguousarray(array)


def grid_values(node: Node, data: object) -> npt.NDArray[np.generic]:
    try:
        array = np.asarray(data)
        array = array[..., None] if array.ndim == 3 else array
        if array.ndim != 4 or array.shape[3] not in (1, 3, 6) or 0 in array.shape:
            message = f'"data" of {node} must have the shape (depth, height, width[, 1, 3 or 6])'
            raise SceneError(message, node.location)
        return np.ascontiguousarray(array if array.dtype in KEPT else array.astype(np.float32))
    except (TypeError, ValueError):
        raise SceneError(f'"data" of {node} is not an array', node.location) from None


def _hierarchical(context: Context, node: Node, values: Values) -> Entry:
    for name in ("filename", "prefix", "postfix"):
        values.pop(name, None)
    voxels, location = hierarchical_voxels(context, node)
    values = {"align_corners": True, "wrap_mode": "zero", "use_grid_bbox": True, **values}
    return _entry(context, node, values, voxels, _finite(context, voxels.values, location))


def hierarchical_voxels(context: Context, node: Node) -> tuple[Voxels, Location]:
    """The voxels of all blocks of a `hgridvolume`, and what to blame for them."""
    path, location = context.find(node)
    prefix, postfix = (str(getattr(node.find(name), "value", "")) for name in ("prefix", "postfix"))
    folders = context.directories(location)

    def file_of(x: int, y: int, z: int) -> Path:
        return find_file(f"{prefix}{x:03}_{y:03}_{z:03}{postfix}", folders, location)

    try:
        return read_hierarchical(path, file_of), location
    except SceneError:
        raise
    except (OSError, MemoryError, VoxelError) as problem:
        reason = str(problem) or "it does not fit into memory"
        raise SceneError(f'"{path}" cannot be used as a volume: {reason}', location) from None


MAX_KELVIN = 1e6
STEPS = 1024  # of the table of colours over temperatures

FILE = (
    Field("filename", "string", "a .vol, .nvdb or .vdb file"),
    Field("grid_name", "string", "which grid of a .nvdb or .vdb file", "density"),
    Field("use_grid_bbox", "boolean", "use the box of the file instead of the unit cube (.vol: off)", False),
    Field("min", "vector", "with max: the box to fill, instead of the unit cube"),
    Field("max", "vector", "with min"),
    Field("data", "grid", "from Python: an array (depth, height, width[, 1, 3 or 6]) instead of a file"),
    Field("grid", "grid", "from Python: the same"),
)
BLOCKS = (
    Field("filename", "string", "the list of the blocks"),
    Field("prefix", "string", "of the names of their files, before XXX_YYY_ZZZ", ""),
    Field("postfix", "string", "behind it", ""),
)
VALUE = Field("value", "spectrum", "the value everywhere", (1.0, 1.0, 1.0))
TO_WORLD = Field(
    "to_world", "transform", "places the unit cube, in which there is a medium of this extinction"
)
TEMPERATURE = (
    Field("scale", "float", "multiplies the radiance", 1.0, 0.0),
    Field("temperature_scale", "float", "kelvin per unit of the grid", 1.0, unit="K"),
    Field("temperature_offset", "float", "added to the temperature", 0.0, unit="K"),
)

PLUGINS = (
    Plugin("volume", "constvolume", "The same value everywhere.", (VALUE, TO_WORLD), _constant),
    Plugin("volume", "gridvolume", "", FILE, _grid_volume, model="gridvolume", hidden=("grid",)),
    Plugin(
        "volume",
        "blackbodyvolume",
        "A grid of temperatures, as the radiance of black bodies.",
        (*FILE, *TEMPERATURE),
        _blackbody_volume,
        model="gridvolume",
        hidden=("grid",),
    ),
    Plugin(
        "volume",
        "hgridvolume",
        "Grids within a grid, each a .vol file; they become one.",
        BLOCKS,
        _hierarchical,
        model="gridvolume",
        hidden=("grid",),
    ),
)
