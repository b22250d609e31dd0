"""What files of before 0.4 mean otherwise than those of 0.4 to 0.6, once their names are in snake_case."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..syntax.nodes import Node, Rgb, Spectrum, Value

PLUGINS = {
    ("bsdf", "composite"): "mixturebsdf",
    ("bsdf", "lambertian"): "diffuse",
    ("bsdf", "microfacet"): "roughplastic",
    ("bsdf", "mirror"): "conductor",
    ("bsdf", "roughglass"): "roughdielectric",
    ("bsdf", "roughmetal"): "roughconductor",
    ("texture", "exrtexture"): "bitmap",
    ("texture", "ldrtexture"): "bitmap",
}
# Of plugins under their old names.
PROPERTIES: Mapping[str, Mapping[str, str]] = {
    "checkerboard": {"bright_color": "color0", "dark_color": "color1"},
    "gridtexture": {"bright_color": "color0", "dark_color": "color1"},
    "cylinder": {"p1": "p0", "p2": "p1"},
    "microfacet": {"alpha_b": "alpha"},
    "roughglass": {"alpha_b": "alpha"},
    "roughmetal": {"alpha_b": "alpha", "ior": "eta"},
    "sphere": {"inverted": "flip_normals"},
    "ward": {"alpha_x": "alpha_u", "alpha_y": "alpha_v"},
}
# Default diffuse and specular reflectances; those given in files are scaled by an amount.
REFLECTANCES = {"microfacet": (0.0, 1.0), "phong": (0.5, 0.2), "ward": (0.5, 0.2)}


def restate(node: Node, version: tuple[int, int, int]) -> None:
    """Brings one node of a file of a version before 0.4 to 0.4, in place."""
    if version < (0, 3, 0):
        _from_before_0_3(node)
    if node.kind == "sensor":
        _turn_over(node)
        smaller = getattr(node.find("map_smaller_side"), "value", True)
        node.properties = node.without(["map_smaller_side"])
        if node.plugin == "perspective":
            node.set_default("fov_axis", "smaller" if smaller else "larger")


def _turn_over(sensor: Node) -> None:
    """Cameras had +x to the right of the picture."""
    for prop in sensor.properties:
        if prop.name == "to_world" and isinstance(prop.value, np.ndarray):
            prop.value = prop.value @ np.diag([-1.0, 1.0, 1.0, 1.0])


def _from_before_0_3(node: Node) -> None:
    old = node.plugin.lower()
    if node.kind == "bsdf" and old in REFLECTANCES:
        _scale_reflectances(node, *REFLECTANCES[old])
    names = PROPERTIES.get(old, {})
    if old != "cylinder" or node.find("p2") is not None:
        for prop in node.properties:
            prop.name = names.get(prop.name, prop.name)
    if node.kind == "bsdf" and old == "mirror":
        node.set_default("material", "Cr")
    node.plugin = PLUGINS.get((node.kind, old), node.plugin)


def _scale_reflectances(node: Node, diffuse: float, specular: float) -> None:
    """Scales reflectances by amounts. Amounts for textures are kept, and reported as unused properties."""
    for name, default in (("diffuse", diffuse), ("specular", specular)):
        node.set_default(f"{name}_reflectance", default)
        amount, reflectance = node.find(f"{name}_amount"), node.find(f"{name}_reflectance")
        if amount is None or reflectance is None or not isinstance(amount.value, int | float):
            continue
        scaled = _scaled(reflectance.value, float(amount.value))
        if scaled is not None:
            reflectance.value = scaled
            node.properties.remove(amount)


def _scaled(value: Value, amount: float) -> Value | None:
    if isinstance(value, int | float):
        return value * amount
    if isinstance(value, Rgb):
        red, green, blue = (amount * v for v in value.values)
        return Rgb((red, green, blue))
    if isinstance(value, Spectrum):
        return Spectrum(tuple(amount * v for v in value.values), value.wavelengths)
    return None
