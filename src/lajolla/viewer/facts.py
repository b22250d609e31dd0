"""What the page is told of a scene: layers, objects, parameters, and what a pixel shows."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np

from lajolla import _core, holes
from lajolla.layers import with_shadows
from lajolla.loaded_scene import Scene
from lajolla.params.objects import names_by_entry
from lajolla.scene import plugins_by_kind
from lajolla.scene.schema import Field
from lajolla.viewer.view import View, with_film

MOST_OBJECTS = 300  # in a list
LARGEST_VALUE = 16  # numbers of a value that can be edited

Json: TypeAlias = dict[str, Any]


def scene_facts(view: View, layer: str) -> Json:
    """Of a scene that was opened."""
    scene = view.scene
    integrators = sorted({plugin.name for plugin in plugins_by_kind()["integrator"].values()})
    return {
        "layer": layer,
        "layers": view.layers,
        "integrators": integrators,
        "sensors": scene.sensors,
        "warnings": [str(warning) for warning in scene.warnings],
        "distance": _distance_ahead(scene),
        "seconds": scene.load_seconds + scene.build_seconds,
    }


def view_facts(view: View) -> Json:
    """Of what is rendered: the camera, the film and the integrator."""
    core = view.scene.description.core
    sensor = {name: value for name, value in core["sensor"].items() if name != "medium"}
    return {
        "view": view.number,
        "camera": view.scene.sensor,  # the name of the sensor
        "sensor": sensor,
        "film": core["film"],
        "window": view.window,
        "integrator": core["integrator"]["type"],
    }


def objects_found(scene: Scene, text: str) -> Json:
    """The objects whose names or kinds contain a text, in the order of the scene; as many as fit a list."""
    wanted = text.casefold()
    found = [
        {"name": name, "kind": item.kind, "model": item.model}
        for name, item in scene.params.objects.items()
        if wanted in name.casefold() or wanted in item.kind or wanted in item.model
    ]
    return {"objects": found[:MOST_OBJECTS], "count": len(found)}


def parameters_of(scene: Scene, name: str) -> Json:
    """The parameters of an object with their declarations. Raises ParamError."""
    info = scene.params.info(name)
    parameters = [_parameter(scene, f"{name}.{param}") for param in info.params]
    return {"object": name, "plugin": info.plugin, "place": _place(scene, name), "parameters": parameters}


def _parameter(scene: Scene, path: str) -> Json:
    declared: Field = scene.params.field(path)
    value = scene.params[path]
    size = np.size(value) if isinstance(value, np.ndarray | list | tuple) else 1
    is_small = size <= LARGEST_VALUE and isinstance(value, np.ndarray | bool | int | float | str | tuple)
    return {
        "path": path,
        "name": declared.name if declared.type != "array" else path.rpartition(".")[2],
        "type": declared.type,
        "doc": declared.doc,
        "minimum": declared.minimum,
        "maximum": declared.maximum,
        "unit": declared.unit,
        "choices": declared.choices,
        "value": value if is_small else None,
        "summary": ""
        if is_small
        else "none"
        if value is None
        else f"{type(value).__name__} {np.shape(value)}",
    }


def _place(scene: Scene, name: str) -> str:
    info = scene.params.info(name)
    return f"{info.file}:{info.line}" if info.line else info.file


def inspected(view: View, x: int, y: int) -> Json:
    """What is known of a pixel of the film: its mean so far, and the object that its centre shows."""
    left, top, width, height = view.window
    if not (left <= x < left + width and top <= y < top + height):
        return {"x": x, "y": y, "inside": False}
    rendering = view.rendering("")
    row, column = y - top, x - left
    values, labels = with_shadows(rendering.accumulator.image(), rendering.channels)
    value = values[row, column]
    errors = rendering.estimate.errors[row // 8, column // 8]
    error = float(np.sqrt(np.mean(errors)))
    channels = {label: float(value[3 + i]) for i, label in enumerate(labels)}
    return {
        "x": x,
        "y": y,
        "inside": True,
        "value": value[:3],
        "channels": channels,
        "samples": int(rendering.accumulator.pixel_counts()[row, column]),
        "error": error if math.isfinite(error) else None,
        **_seen(view.scene, x, y),
    }


def _seen(scene: Scene, x: int, y: int) -> Json:
    """The objects at the centre of a pixel, and their distance."""
    core = only_pixel(scene, x, y)
    shape, material, *_ = _core.ids_at_centres(core, 1)[0, 0].tolist()
    if shape < 0:
        return {"shape": None}
    names = names_by_entry(scene.params.objects)
    found: Json = {"shape": names.get(f"shapes[{shape}]", ""), "distance": distance(scene, x, y)}
    if found["shape"]:
        found["place"] = _place(scene, found["shape"])
    if material >= 0 and (bsdf := scene.params[f"{found['shape']}.bsdf"]) is not None:
        found |= {
            "material": bsdf,
            "model": scene.params.info(bsdf).plugin,
            "material_place": _place(scene, bsdf),
        }
    return found


def only_pixel(scene: Scene, x: int, y: int) -> _core.Scene:
    """The scene with a crop window of one pixel, without holes."""
    window = {"crop_offset_x": x, "crop_offset_y": y, "crop_width": 1, "crop_height": 1}
    core = with_film(scene, {**scene.description.core["film"], **window})
    return holes.without(core, scene.description.core)


def distance(scene: Scene, x: int, y: int) -> float | None:
    """Of what a pixel shows, along its ray; None if there is nothing."""
    output = {"integrator": {"type": "field", "field": "depth"}, "other_integrators": [], "channels": []}
    core = holes.without(scene.core.with_output(output), scene.description.core)
    found = float(_core.sample_radiance(core, core.seed, x, y, 0)[0])
    return found if found > 0 and math.isfinite(found) else None


def depth(scene: Scene, x: int, y: int) -> float | None:
    """Of what a pixel shows, along the axis of the camera: where a lens has its focus."""
    field = {"type": "field", "field": "rel_position"}
    output = {"integrator": field, "other_integrators": [], "channels": []}
    core = holes.without(scene.core.with_output(output), scene.description.core)
    found = float(_core.sample_radiance(core, core.seed, x, y, 0)[2])
    return found if found > 0 and math.isfinite(found) else None


def _distance_ahead(scene: Scene) -> float | None:
    """The distance of what is in the middle of the picture, or near it."""
    (left, top), width, height = scene.core.crop_offset, scene.width, scene.height
    for share in (0.5, 0.4, 0.6, 0.25, 0.75):
        for other in (0.5, 0.3, 0.7):
            found = distance(scene, left + int(other * width), top + int(share * height))
            if found is not None:
                return found
    return None
