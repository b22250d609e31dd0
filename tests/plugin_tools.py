"""Every plugin as a dict, with what it needs, in a small scene in which it belongs."""

from __future__ import annotations

from typing import Any

from lajolla.scene import plugins_by_kind

PARAMETERS: dict[tuple[str, str], dict[str, Any]] = {
    ("texture", "regular"): {"values": "1, 2", "wavelength_min": 400.0, "wavelength_max": 700.0},
    ("texture", "irregular"): {"values": "1, 2", "wavelengths": "400, 700"},
    ("texture", "uniform"): {"value": 0.5},
    ("texture", "srgb"): {"color": [0.1, 0.2, 0.3]},
    ("texture", "rawconstant"): {"value": [0.1, 0.2, 0.3]},
    ("texture", "blackbody"): {"temperature": 5000.0},
    ("texture", "clamped"): {"texture": {"type": "checkerboard"}},
    ("texture", "scale"): {"texture": {"type": "checkerboard"}},
    ("bsdf", "mixturebsdf"): {"weights": "1"},
    ("integrator", "aov"): {"aovs": "a:depth"},
    **{("emitter", name): {"resolution": 16} for name in ("sky", "sunsky")},
}
FILES = {
    "obj": "a.obj", "ply": "a.ply", "serialized": "a.serialized", "linearcurve": "a.txt",
    "bsplinecurve": "a.txt", "hair": "a.txt", "sdfgrid": "a.vol", "gridvolume": "a.vol",
    "blackbodyvolume": "a.vol",
}  # fmt: skip


def plugin_entry(kind: str, name: str) -> dict[str, Any]:
    """A plugin as a dict with what it needs."""
    plugin = plugins_by_kind()[kind][name.lower()]
    entry: dict[str, Any] = {"type": name, **PARAMETERS.get((kind, name), {})}
    if any(field.name == "filename" for field in plugin.fields) and kind != "film":
        entry["filename"] = FILES.get(name, "a.exr")
    if kind == "bsdf" and "bsdf" in plugin.children:
        entry["inner"] = {"type": "diffuse"}
        if name == "blendbsdf":
            entry["other"] = {"type": "conductor"}
    if kind == "phase" and name == "blendphase":
        entry |= {"phase_0": {"type": "isotropic"}, "phase_1": {"type": "hg"}}
    if kind == "integrator" and "integrator" in plugin.children:
        entry["inner"] = {"type": "path"}
    if kind == "shape" and name == "instance":
        entry["group"] = {"type": "shapegroup", "ball": {"type": "sphere"}}
    return entry


def scene_with(kind: str, entry: dict[str, Any]) -> dict[str, Any]:
    """A small scene in which a plugin stands where it belongs."""
    ball: dict[str, Any] = {"type": "sphere", "center": [0, 0, 5]}
    film: dict[str, Any] = {"type": "hdrfilm", "width": 2, "height": 2}
    camera: dict[str, Any] = {"type": "perspective", "film": film}
    scene: dict[str, Any] = {"type": "scene", "ball": ball, "camera": camera}
    if kind in ("integrator", "shape"):
        scene["own"] = entry
    elif kind == "emitter":
        (ball if entry["type"] == "area" else scene)["own"] = entry
    elif kind == "sensor":
        scene["camera"] = {**entry, "film": film}
    elif kind == "film":
        camera["film"] = entry
    elif kind == "rfilter":
        film["rfilter"] = entry
    elif kind == "sampler":
        camera["sampler"] = entry
    elif kind == "bsdf":
        ball["bsdf"] = entry
    elif kind == "texture":
        ball["bsdf"] = {"type": "diffuse", "reflectance": entry}
    elif kind == "medium":
        ball["interior"] = entry
    elif kind == "phase":
        ball["interior"] = {"type": "homogeneous", "phase": entry}
    elif kind == "volume":
        ball["interior"] = {"type": "heterogeneous", "sigma_t": entry}
    return scene
