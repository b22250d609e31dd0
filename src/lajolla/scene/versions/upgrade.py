"""Converts nodes of older files to the names and defaults of Mitsuba 3.

Names change from camelCase to snake_case, `uscale` and similar properties become a transform, and defaults
that differ between versions are set explicitly, so that later stages do not depend on the version.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from ..schema import HARMLESS, Declared
from ..syntax.errors import Diagnostics
from ..syntax.names import snake_case
from ..syntax.nodes import Node, Property, Unsaid
from . import oldest

AIR = 1.000277

BEFORE_2 = Unsaid(
    integrator="direct",
    last_sensor=True,
    camera=True,
    daylight=True,
    lights_add_up=True,
    boundary="null",
    mirrored=False,
    bounded=False,
    exchanged=False,
)

OLD_PLUGINS = {
    ("film", "exrfilm"): "hdrfilm",
    ("film", "pngfilm"): "ldrfilm",
    ("integrator", "errctrl"): "adaptive",
    ("bsdf", "bump"): "bumpmap",
    ("bsdf", "roughconductorggx"): "roughconductorGGX",
    ("bsdf", "roughdielectricggx"): "roughdielectricGGX",
}
OLD_PROPERTIES = {
    ("emitter", "intensity_scale"): "scale",
    ("medium", "density_multiplier"): "scale",
    ("sensor", "focus_depth"): "focus_distance",
    ("film", "crop_x"): "crop_offset_x",
    ("film", "crop_y"): "crop_offset_y",
    ("film", "high_quality_edges"): "sample_border",
    ("integrator", "luminaire_samples"): "emitter_samples",
    ("medium", "size_multiplier"): "scale",
    ("sampler", "depth"): "dimension",
}
# Alternative names of properties in Mitsuba 0.6; if both are given, the first one applies.
SYNONYMS = {
    "diffuse": ("reflectance", "diffuse_reflectance"),
    "roughdiffuse": ("reflectance", "diffuse_reflectance"),
    "difftrans": ("transmittance", "diffuse_transmittance"),
}
RADIANT = {"area": "radiance", "constant": "radiance", "directional": "irradiance"}  # formerly "intensity"
UV_PROPERTIES = ("uscale", "vscale", "uvscale", "uoffset", "voffset")


def upgrade(
    nodes: Iterable[Node], table: Mapping[str, Mapping[str, Declared]], diagnostics: Diagnostics
) -> None:
    """Upgrades nodes of files before 2.0, in place. Disney's BSDFs accept both spellings in all versions.

    Also changes the case of plugin names to that of the table.
    """
    for node in nodes:
        known = table.get(node.kind, {}).get(node.plugin.lower())
        node.plugin = known.name if known else node.plugin
        if node.location.source.version < (2, 0, 0):
            node.unsaid = BEFORE_2
            _upgrade_names(node)
            if node.location.source.version < (0, 4, 0):
                oldest.restate(node, node.location.source.version)
            _upgrade_uv(node)
            _write_defaults(node)
        elif node.kind == "bsdf" and node.plugin.lower().startswith("disney"):
            _upgrade_names(node)
        else:
            _correct_names(node, [known] if known else table.get(node.kind, {}).values(), diagnostics)


def _correct_names(node: Node, plugins: Iterable[Declared], diagnostics: Diagnostics) -> None:
    """Corrects old names in newer files if the plugin, or any plugin for an unknown one, has the new name."""
    old = [(prop, name) for prop in node.properties if (name := snake_case(prop.name)) != prop.name]
    if not old:
        return
    fields = {field.name for plugin in plugins for field in plugin.fields}
    harmless = set(HARMLESS.get(node.kind, ()))
    for prop, name in old:
        if prop.name in fields or node.find(name) is not None:
            continue
        if name in fields:
            message = f'"{prop.name}" of {node} is the old name of "{name}"; it is read as "{name}"'
            diagnostics.unknown(message, prop.name_location, node.count)
        if name in fields | harmless:
            prop.name = name


def _upgrade_names(node: Node) -> None:
    node.plugin = OLD_PLUGINS.get((node.kind, node.plugin.lower()), node.plugin)
    for prop in node.properties:
        name = snake_case(prop.name)
        prop.name = current_name(node.kind, node.plugin, prop.name)
        if node.kind == "film" and name == "alpha" and isinstance(prop.value, bool):
            prop.name, prop.value = "pixel_format", "rgba" if prop.value else "rgb"
    name, synonym = SYNONYMS.get(node.plugin, ("", ""))
    if synonym and node.find(name) is None:
        for prop in node.properties:
            prop.name = name if prop.name == synonym else prop.name


def current_name(kind: str, plugin: str, name: str) -> str:
    """The name of a property in files of today, if old files have another one."""
    name = snake_case(name)
    if kind == "emitter" and name == "intensity":
        return RADIANT.get(plugin, name)
    return OLD_PROPERTIES.get((kind, name), name)


def _upgrade_uv(node: Node) -> None:
    """Replaces the scales and offsets of Mitsuba 0.x by `to_uv`, that is, uv * scale + offset."""
    given: dict[str, Property] = {}
    values: dict[str, float] = {}
    for prop in node.properties:
        if prop.name in UV_PROPERTIES and isinstance(prop.value, int | float):
            given[prop.name], values[prop.name] = prop, float(prop.value)
    if not given or node.kind != "texture":
        return
    both = values.get("uvscale", 1.0)
    matrix = np.eye(4)
    matrix[0, 0], matrix[1, 1] = values.get("uscale", both), values.get("vscale", both)
    matrix[0, 3], matrix[1, 3] = values.get("uoffset", 0.0), values.get("voffset", 0.0)
    first = next(iter(given.values()))
    node.properties = node.without(given)
    node.properties.append(Property("to_uv", matrix, first.location, first.name_location))


def _write_defaults(node: Node) -> None:
    if node.kind == "bsdf" and node.plugin in ("conductor", "roughconductor", "roughconductorGGX"):
        node.set_default("material", "Cu")
        node.set_default("ext_eta", AIR)  # eta and k are divided by it
    if node.kind == "bsdf" and node.plugin in ("roughconductorGGX", "roughdielectricGGX"):
        node.set_default("distribution", "ggx")
    elif node.kind == "medium" and node.plugin == "homogeneous":
        node.set_default("material", "Skin1")
    elif node.kind == "volume" and node.plugin == "gridvolume":
        node.set_default("use_grid_bbox", True)
        node.set_default("align_corners", True)
        node.set_default("wrap_mode", "zero")
    elif node.kind == "bsdf" and node.plugin in ("bumpmap", "normalmap"):
        node.set_default("flip_invalid_normals", False)
        node.set_default("use_shadowing_function", False)
    elif node.kind == "emitter" and node.plugin in ("sun", "sky", "sunsky"):
        node.set_default("up", "y")
        if node.plugin != "sky":
            node.set_default("sun_model", "preetham")
        if node.plugin != "sun":
            node.set_default("albedo", 0.2)
    elif node.kind == "texture" and node.plugin == "bitmap":
        node.set_default("filter_type", "ewa")
    elif node.kind == "integrator" and node.plugin == "field":
        node.set_default("first_shape", 0)
        for prop in node.properties:
            if prop.name == "field" and isinstance(prop.value, str):
                prop.value = snake_case(prop.value)
    elif node.kind == "shape" and node.plugin == "obj":
        node.set_default("load_materials", True)
    elif node.kind == "shape" and node.plugin == "ply":
        node.set_default("srgb", True)
