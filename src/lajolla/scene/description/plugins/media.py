"""Media and phase functions: alternative coefficients, and materials by name."""

from __future__ import annotations

import numpy as np

from lajolla import _core

from ...data.materials import MATERIALS
from ...schema import Field
from ...syntax.errors import SceneError, did_you_mean
from ...syntax.nodes import Node
from ..plugin import Context, Entry, Plugin, Values
from .volumes import placement_of

Rgb = tuple[float, ...]


def _homogeneous(context: Context, node: Node, values: Values) -> Entry:
    """Homogeneous unless the albedo or the particles' area varies in space."""
    if values.keys() & {"sigma_a", "sigma_s"} and values.keys() & {"sigma_t", "albedo"}:
        message = f'{node} takes "sigma_a" and "sigma_s", or "sigma_t" and "albedo", not both'
        raise SceneError(message, node.location)
    for name in ("sigma_a", "sigma_s", "sigma_t"):
        if isinstance(values.get(name), dict):
            message = f'"{name}" of {node} must be the same everywhere; "heterogeneous" takes a grid'
            raise SceneError(message, node.property_location(name))
    scale, material = values.pop("scale", 1.0), values.pop("material", "")
    volume = values.pop("albedo") if isinstance(values.get("albedo"), dict) else None
    sigma_a, sigma_s = _coefficients(node, values, material)
    if volume is None and not _varies(context, values.get("phase", -1)):
        sigma_a, sigma_s = (tuple(scale * v for v in sigma) for sigma in (sigma_a, sigma_s))
        return {"type": "homogeneous", "sigma_a": sigma_a, "sigma_s": sigma_s, **values}
    sigma_t, albedo = _extinction(sigma_a, sigma_s)
    albedo = albedo if volume is None else volume
    return {"type": "heterogeneous", "sigma_t": sigma_t, "albedo": albedo, "scale": scale, **values}


def _coefficients(node: Node, values: Values, material: str) -> tuple[Rgb, Rgb]:
    """Absorption and scattering: as given, by extinction and albedo, or what a material has."""
    given = {name: values.pop(name) for name in ("sigma_a", "sigma_s", "sigma_t", "albedo") if name in values}
    direct = "sigma_a" in given or "sigma_s" in given
    if material:
        sigma_s, sigma_a = _named_material(node, material)
    elif direct:
        sigma_a = sigma_s = (0.0, 0.0, 0.0)
    else:
        sigma_a, sigma_s = (0.25,) * 3, (0.75,) * 3
    if direct:
        return given.get("sigma_a", sigma_a), given.get("sigma_s", sigma_s)
    total, known = _extinction(sigma_a, sigma_s)
    sigma_t, albedo = given.get("sigma_t", total), given.get("albedo", known)
    scattering = tuple(a * t for a, t in zip(albedo, sigma_t, strict=True))
    return tuple(t - s for t, s in zip(sigma_t, scattering, strict=True)), scattering


def _extinction(sigma_a: Rgb, sigma_s: Rgb) -> tuple[Rgb, Rgb]:
    """Extinction and albedo."""
    sigma_t = tuple(a + s for a, s in zip(sigma_a, sigma_s, strict=True))
    return sigma_t, tuple(s / t if t else 0.0 for s, t in zip(sigma_s, sigma_t, strict=True))


def _named_material(node: Node, name: str) -> tuple[Rgb, Rgb]:
    by_lower = {known.lower(): pair for known, pair in MATERIALS.items()}
    if name.lower() not in by_lower:
        hint = did_you_mean(name, MATERIALS)
        raise SceneError(f'no medium is called "{name}"{hint}', node.property_location("material"))
    return by_lower[name.lower()]


def _varies(context: Context, phase: int) -> bool:
    """Whether the area of a phase function's particles varies in space."""
    if phase < 0:
        return False
    entry = context.entry("phases", phase)
    if entry["type"] == "blendphase":
        parts = [context.entry("phases", i) for i in (entry["phase_0"], entry["phase_1"]) if i >= 0]
        if isinstance(entry.get("weight"), dict) and any(part["type"] == "sggx" for part in parts):
            return True
        return any(_varies(context, entry[name]) for name in ("phase_0", "phase_1"))
    return entry["type"] == "sggx" and isinstance(entry.get("S"), dict)


def _heterogeneous(context: Context, node: Node, values: Values) -> Entry:
    density = values.pop("density", None)
    if density is not None:
        if "sigma_t" in values:
            raise SceneError(f'{node} takes "sigma_t" or "density", not both', node.location)
        values["sigma_t"] = density
    extinction = values.get("sigma_t", (1.0, 1.0, 1.0))
    if not isinstance(extinction, dict) and node.unsaid.bounded:
        values["sigma_t"] = _boxed(context, node, extinction)
    return {"type": "heterogeneous", **values}


def _boxed(context: Context, medium: Node, extinction: Rgb) -> dict[str, int]:
    """A constant extinction as a volume: since version 2, it has a box as a grid does, and ends there."""
    prop = medium.find("sigma_t") or medium.find("density")
    volume = prop.value if prop and isinstance(prop.value, Node) else None
    grid = _core.Grid(np.array(extinction, np.float32).reshape(1, 1, 1, 3))
    entry = {"type": "gridvolume", "grid": grid, "to_world": placement_of(context, volume)}
    return {"volume": context.add("volumes", entry, volume or medium)}


def _hg(context: Context, node: Node, values: Values) -> Entry:
    if isinstance(values.get("g"), dict):
        context.report_texture(node, "g")
        del values["g"]
    return {"type": "hg", **values}


def _blend(context: Context, node: Node, values: Values) -> Entry:
    if "phase_0" not in values or "phase_1" not in values:
        raise SceneError(f"{node} needs two phase functions inside", node.location)
    if sum(_count_parts(context, values[name]) for name in ("phase_0", "phase_1")) > MAX_PARTS:
        raise SceneError(f"{node} mixes more than four phase functions", node.location)
    return {"type": "blendphase", **values}


def _count_parts(context: Context, phase: int) -> int:
    """The number of phase functions in a mixture."""
    entry: Entry = context.entry("phases", phase) if phase >= 0 else {"type": "isotropic"}
    if entry["type"] != "blendphase":
        return 1
    return sum(_count_parts(context, entry[name]) for name in ("phase_0", "phase_1"))


def _coefficient(name: str, doc: str) -> Field:
    return Field(name, "volume_spectrum", doc, None, 0.0, unit="1/length")


MAX_PARTS = 4  # of a mixture, which the core puts side by side

ALBEDO = Field("albedo", "volume_spectrum", "fraction of the extinction that is scattering", 0.75, 0.0, 1.0)
COEFFICIENTS = (
    _coefficient("sigma_a", "absorption; with sigma_s"),
    _coefficient("sigma_s", "scattering; with sigma_a"),
    Field("sigma_t", "volume_spectrum", "extinction; with albedo", 1.0, 0.0, unit="1/length"),
    ALBEDO,
    Field("scale", "float", "multiplies the coefficients", 1.0, 0.0),
    Field("material", "string", "name of a measured medium, for what is not given", ""),
)
DENSITY = Field("density", "volume_spectrum", "the same as sigma_t", None, 0.0, unit="1/length")
G = Field("g", "texture_float", "mean cosine of the deflection; of a colour the mean", 0.8, -0.999, 0.999)

PLUGINS = (
    Plugin("medium", "homogeneous", "", COEFFICIENTS, _homogeneous, model="homogeneous"),
    Plugin("medium", "heterogeneous", "", (DENSITY,), _heterogeneous, model="heterogeneous"),
    Plugin("phase", "hg", "", (G,), _hg, model="hg"),
    Plugin("phase", "blendphase", "", (), _blend, model="blendphase"),
)
