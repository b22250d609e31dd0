"""Conversion of a property to the value that the core expects."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np

from lajolla import _core

from ..data.ior import index_of_refraction
from ..data.spectra import to_rgb
from ..formats.spectra import read_spd
from ..schema import Field
from ..syntax.errors import SceneError, did_you_mean, reason_of
from ..syntax.files import find_file
from ..syntax.foreign import is_mesh, mesh_colours, type_name
from ..syntax.literals import Text, parse_numbers
from ..syntax.members import Irregular
from ..syntax.nodes import Array, Blackbody, Column, Node, Property, Rgb, Spectrum, SpectrumFile, Vector
from ..syntax.transforms import checked_matrix
from .bounds import bounds_of, within
from .plugin import Colour, Constant, Context, Use

CONSTANTS = (int, float, Vector, Rgb, Spectrum, Blackbody)
INDEX_FIELDS = ("int_ior", "ext_ior", "ext_eta")  # these take the name of a material as well

# Replacements of choices from other versions, and whether the picture differs.
SAME_CHOICE = {
    ("field", "distance"): ("depth", False),
    ("file_format", "exr"): ("openexr", False),
    ("file_format", "jpg"): ("jpeg", False),
    ("distribution", "phong"): ("beckmann", True),
    ("distribution", "as"): ("beckmann", True),
}


def convert(context: Context, owner: Node, prop: Property, field: Field) -> Any:  # noqa: ANN401
    """A property's value as a field of that type.

    Raises:
        SceneError: the value is of another type or out of range.
    """
    value = CONVERTERS[field.type](context, owner, prop, field)
    if value is None:
        raise SceneError(f'"{prop.name}" of {owner} expects {EXPECTED[field.type]}', prop.location)
    if isinstance(value, tuple) and not all(map(math.isfinite, value)):
        raise SceneError(f'"{prop.name}" of {owner} must be finite', prop.location)
    return value


def convert_column(prop: Property, field: Field) -> Column:
    """The values of a run as a field of that type.

    Raises:
        Irregular: one of them is of another type or out of range, or the type has no columns.
    """
    column, (low, high) = prop.value, _limits(field)
    assert isinstance(column, Column)
    rows = column.rows
    shape = rows.shape[1:]
    if field.type == "transform" and shape == (4, 4) and field.name != "to_uv":
        return column  # checked when it was read
    if field.type == "vector" and shape == (3,):
        return column
    number = shape == () and field.type in ("float", "texture_float", "texture_spectrum", "spectrum")
    colour = shape == (3,) and field.type in ("texture_spectrum", "spectrum")
    low = max(low, 0.0) if colour else low
    if not (number or colour) or not np.all((rows >= low) & (rows <= high)):
        raise Irregular
    if colour:
        return Column(rows + 0.0)  # no negative zeros, as of single colours
    return Column(np.repeat(rows[:, None], 3, axis=1)) if "spectrum" in field.type else column


def _float(context: Context, owner: Node, prop: Property, field: Field) -> Use | float | None:
    value = prop.value
    if isinstance(value, str) and field.name in INDEX_FIELDS:
        return index_of_refraction(value, prop.location)
    if isinstance(value, Node) and value.kind == "texture":
        return _texture_float(context, owner, prop, field)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return _in_range(float(value), prop, field)


def _integer(context: Context, owner: Node, prop: Property, field: Field) -> int | None:
    value = prop.value
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    whole = int(_in_range(value, prop, field)) if math.isfinite(value) else None
    return whole if whole == value else None


def _in_range(value: float, prop: Property, field: Field) -> float:
    low, high = _limits(field)
    if not low <= value <= high or math.isinf(value):
        wanted = (
            "finite"
            if not math.isfinite(value)
            else f"at least {low:.10g}"
            if math.isinf(high)
            else f"between {low:.10g} and {high:.10g}"
        )
        raise SceneError(f'"{prop.name}" must be {wanted}, not {value:.10g}', prop.location)
    return value


def _limits(field: Field) -> tuple[float, float]:
    low = -math.inf if field.minimum is None else field.minimum
    return (low, math.inf if field.maximum is None else field.maximum)


def _boolean(context: Context, owner: Node, prop: Property, field: Field) -> bool | None:
    return prop.value if isinstance(prop.value, bool) else None


def _string(context: Context, owner: Node, prop: Property, field: Field) -> str | None:
    return prop.value if isinstance(prop.value, str) else None


def _choice(context: Context, owner: Node, prop: Property, field: Field) -> str | None:
    if not isinstance(prop.value, str):
        return None
    wanted = prop.value.strip().lower()
    same, differs = SAME_CHOICE.get((field.name, wanted), (wanted, False))
    if differs:
        context.diagnostics.warn(
            f'"{wanted}" is not supported for "{field.name}"; "{same}" is used', prop.location
        )
    if same not in field.choices:
        hint = did_you_mean(wanted, field.choices)
        raise SceneError(f'"{prop.value}" is no choice for "{prop.name}"{hint}', prop.location)
    return same


def _vector(context: Context, owner: Node, prop: Property, field: Field) -> tuple[float, float, float] | None:
    if isinstance(prop.value, Vector):
        return prop.value.xyz
    return prop.value.values if isinstance(prop.value, Rgb) else None


def _transform(context: Context, owner: Node, prop: Property, field: Field) -> Array | None:
    given = prop.value
    if getattr(given, "size", 16) > 16:
        return None
    try:
        value = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    if value.shape not in ((4, 4), (3, 3)):
        return None
    if field.name != "to_uv" and value.shape == (4, 4):
        return checked_matrix(value, prop.location)
    matrix = np.eye(4)  # texture space has two dimensions: z takes no part
    matrix[:2, :2], matrix[:2, 3] = value[:2, :2], value[:2, -1]
    return checked_matrix(matrix, prop.location)


def _texture_spectrum(context: Context, owner: Node, prop: Property, field: Field) -> Use | Colour | None:
    value = _constant_or_texture(context, prop)
    if value is None:
        return None
    if isinstance(value, dict):
        return clamp_texture(context, owner, value, prop, field)
    if isinstance(value, int | float):
        rgb = (float(value),) * 3
    else:
        colour = Rgb(value.xyz) if isinstance(value, Vector) else value
        emission = owner.kind == "emitter" or field.name == "emission"
        rgb = to_rgb(colour, emission=emission, diagnostics=context.diagnostics, location=prop.location)
    return _clamp(context, owner, rgb, prop, field)


def _texture_float(context: Context, owner: Node, prop: Property, field: Field) -> Use | float | None:
    """A colour becomes the mean of its channels, as in Mitsuba 3."""
    value = _texture_spectrum(context, owner, prop, field)
    if isinstance(value, dict) or value is None:
        return value
    return _mean(value)


def _volume_spectrum(context: Context, owner: Node, prop: Property, field: Field) -> Use | Colour | None:
    if not isinstance(prop.value, Node) or prop.value.kind != "volume":
        return _texture_spectrum(context, owner, prop, field)
    value = context.volume(prop.value)
    return value if isinstance(value, dict) or value is None else _clamp(context, owner, value, prop, field)


def _volume_float(context: Context, owner: Node, prop: Property, field: Field) -> Use | float | None:
    value = _volume_spectrum(context, owner, prop, field)
    return value if isinstance(value, dict) or value is None else _mean(value)


def _mean(rgb: tuple[float, ...]) -> float:
    return rgb[0] if rgb[0] == rgb[1] == rgb[2] else sum(rgb) / 3


def _volume_matrix(context: Context, owner: Node, prop: Property, field: Field) -> Use | Colour | None:
    """A volume, or six numbers; constvolumes with six numbers are the same."""
    node = prop.value
    if isinstance(node, Node) and node.kind == "volume":
        constant = node.find("value") if node.plugin.lower() == "constvolume" else None
        return context.volume(node) if constant is None else _six(_floats(context, owner, constant, field))
    return _six(_floats(context, owner, prop, field))


def _six(values: tuple[float, ...] | None) -> tuple[float, ...] | None:
    return values if values is not None and len(values) == 6 else None


def _floats(context: Context, owner: Node, prop: Property, field: Field) -> tuple[float, ...] | None:
    if isinstance(prop.value, str):
        return tuple(parse_numbers(Text(prop.value, prop.location)))
    if getattr(prop.value, "ndim", 1) != 1:
        return None
    try:
        values = np.asarray(prop.value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    if values.ndim != 1:
        return None
    return tuple(_in_range(v, prop, field) for v in values.tolist())


def _phase(context: Context, owner: Node, prop: Property, field: Field) -> int | None:
    node = prop.value
    return context.index(node) if isinstance(node, Node) and node.kind == "phase" else None


def _constant_or_texture(context: Context, prop: Property) -> Use | Constant | None:
    """A number, a colour, a vector, or `{"texture": index}`; None for anything else."""
    value = prop.value
    if isinstance(value, Node):
        return context.texture(value) if value.kind == "texture" else None
    if isinstance(value, SpectrumFile):
        path = find_file(value.filename, context.directories(prop.location), prop.location)
        return read_spd(path, prop.location)
    return value if isinstance(value, CONSTANTS) and not isinstance(value, bool) else None


def _clamp(
    context: Context, owner: Node, rgb: tuple[float, ...], prop: Property, field: Field
) -> tuple[float, ...]:
    low, high = _limits(field)
    if all([low <= v <= high for v in rgb]):
        return rgb
    clamped = tuple(min(max(v, low), high) for v in rgb)
    if max(abs(a - b) for a, b in zip(rgb, clamped, strict=True)) > 1e-4:
        shown = ", ".join(f"{v:.4g}" for v in rgb)
        bounds = f"below {low:g}" if min(rgb) < low else f"above {high:g}"
        context.diagnostics.warn(f'"{prop.name}" of {owner} is {bounds} ({shown}) and clamped', prop.location)
    return clamped


def clamp_texture(context: Context, owner: Node, value: Use, prop: Property, field: Field) -> Use:
    """The texture as the field reads it, with values in the range of the field; see `in_range_of`."""
    node = prop.value if isinstance(prop.value, Node) else owner
    if field.type == "texture_float":
        value = _read_as_number(context, node, value)
    return in_range_of(context, owner, value, prop, field)


def in_range_of(context: Context, owner: Node, value: Use, prop: Property, field: Field) -> Use:
    """The texture, with its values brought into the field's range where they may leave it."""
    node = prop.value if isinstance(prop.value, Node) else owner
    (low, high), found = _limits(field), bounds_of(context, value)
    if found is not None:
        below = [f"below {low:g}"] if found[0] < low - 1e-4 else []
        above = [f"above {high:g}"] if found[1] > high + 1e-4 else []
        if below or above:
            where = " and ".join(below + above)
            message = f'"{prop.name}" of {owner} is {where} somewhere and clamped'
            context.diagnostics.warn(message, prop.location)
    return within(context, value, (low, high), node)


def _read_as_number(context: Context, node: Node, value: Use) -> Use:
    """A texture that is read as a number: Mitsuba 3 exchanges the colours of checkerboards then."""
    entry = context.entry("textures", value["texture"])
    if entry["type"] != "checkerboard" or not node.unsaid.exchanged:
        return value
    first, second = entry.get("color0", 0.4), entry.get("color1", 0.2)
    exchanged = {**entry, "color0": second, "color1": first}
    index = context.once(("numbers", node), lambda: context.add("textures", exchanged, node))
    context.note_exchanged(index)
    return {"texture": index}


def _array(context: Context, owner: Node, prop: Property, field: Field) -> object:
    """Anything that may be an array: the plugin, which takes it, judges its shape."""
    return prop.value if not isinstance(prop.value, Node | str | int | float | Vector) else None


def _table(context: Context, owner: Node, prop: Property, field: Field) -> object:
    """An array; three numbers are one too."""
    value = np.array(prop.value.xyz) if isinstance(prop.value, Vector) else prop.value
    return value if hasattr(value, "__len__") and not isinstance(value, str) else None


def _tables(context: Context, owner: Node, prop: Property, field: Field) -> object:
    return prop.value if isinstance(prop.value, Mapping) else None


def _object(name: str) -> Converter:
    """A converter to objects of one of the core's classes, which only Python can make."""

    def convert_object(context: Context, owner: Node, prop: Property, field: Field) -> object:
        return prop.value if isinstance(prop.value, getattr(_core, name)) else None

    return convert_object


def _mesh(context: Context, owner: Node, prop: Property, field: Field) -> _core.Mesh | None:
    """One of the core's, or of another library: made smooth, as those of files without normals are."""
    if isinstance(prop.value, _core.Mesh):
        return prop.value
    given: Any = prop.value
    if not is_mesh(given):
        return None
    try:
        vertices = np.ascontiguousarray(given.vertices, np.float32)
        faces = np.ascontiguousarray(given.faces if hasattr(given, "faces") else given.triangles)
        if faces.size and not 0 <= faces.min() <= faces.max() < len(vertices):
            raise ValueError("its faces name vertices that are not there")
        uvs = getattr(getattr(given, "visual", None), "uv", None)
        uvs = None if uvs is None else np.ascontiguousarray(uvs, np.float32)
        attributes = mesh_colours(given, len(vertices), len(faces))
        mesh = _core.Mesh(vertices, faces.astype(np.uint32), None, uvs, attributes)
    except (TypeError, ValueError) as problem:
        what = f"the {type_name(given)} is no triangle mesh"
        raise SceneError(f"{what}: {reason_of(problem)}", prop.location) from None
    return mesh.with_vertex_normals(np.eye(4).tolist())


Converter: TypeAlias = Callable[[Context, Node, Property, Field], object]


CONVERTERS: dict[str, Converter] = {
    "float": _float,
    "integer": _integer,
    "boolean": _boolean,
    "choice": _choice,
    "string": _string,
    "vector": _vector,
    "transform": _transform,
    "spectrum": _texture_spectrum,
    "texture_float": _texture_float,
    "texture_spectrum": _texture_spectrum,
    "volume_float": _volume_float,
    "volume_spectrum": _volume_spectrum,
    "volume_matrix": _volume_matrix,
    "floats": _floats,
    "phase": _phase,
    "grid": _array,
    "measurement": _object("Measurement"),
    "mesh": _mesh,
    "curves": _object("Curves"),
    "image": _array,
    "face_images": _object("FaceImages"),
    "array": _table,
    "arrays": _tables,
}

EXPECTED = {
    "float": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "choice": "a string",
    "string": "a string",
    "vector": "a vector",
    "transform": "a transform",
    "spectrum": "a colour",
    "texture_float": "a number or a texture",
    "texture_spectrum": "a colour or a texture",
    "volume_float": "a number or a volume",
    "volume_spectrum": "a colour or a volume",
    "volume_matrix": "six numbers or a volume of six channels",
    "floats": "numbers",
    "phase": "a phase function",
    "grid": "an array",
    "measurement": "a measurement object",
    "mesh": "a mesh object",
    "curves": "a curves object",
    "image": "an image object",
    "face_images": "pictures of faces",
    "array": "an array",
    "arrays": "a dict of arrays",
}
