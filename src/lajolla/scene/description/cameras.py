"""The cameras of a scene, and the selection of one."""

from __future__ import annotations

from collections.abc import Iterator

from ..schema import HARMLESS
from ..syntax.errors import Diagnostics, SceneError, did_you_mean
from ..syntax.nodes import Node, Property, below
from .builder import Builder

INHERITED = ("film", "sampler", "medium")  # by the cameras in a batch
DEFAULT_WIDTH = 768  # of a film


def spread(scene: Node, diagnostics: Diagnostics) -> None:
    """Replaces every `batch` by its cameras in the scene's node."""
    own = scene.outermost("sensor")
    properties: list[Property] = []
    for prop in scene.properties:
        if not (isinstance(prop.value, Node) and prop.value.kind == "sensor"):
            properties.append(prop)
        elif prop.value in own:
            cameras = _without_batches(prop.value, diagnostics)
            properties += [Property("", c, prop.location, prop.name_location) for c in cameras]
            own.remove(prop.value)
    scene.properties = properties


def _without_batches(sensor: Node, diagnostics: Diagnostics) -> Iterator[Node]:
    if sensor.plugin.lower() != "batch":
        yield sensor
        return
    inner = [child for _, child in sensor.children("sensor")]
    if not inner:
        raise SceneError(f"{sensor} needs sensors inside", sensor.location)
    for prop in sensor.properties:
        kind = prop.value.kind if isinstance(prop.value, Node) else ""
        if kind not in ("sensor", *INHERITED) and prop.name not in HARMLESS["sensor"]:
            diagnostics.unknown(f'{sensor} has no property "{prop.name}"', prop.name_location)
    for _, film in sensor.children("film"):
        if any(prop.name.startswith("crop_") for prop in film.properties):
            diagnostics.unknown(f"the window of the {film} of {sensor} is ignored", film.location)
    for child in inner:
        yield from _without_batches(_in_batch(sensor, child, len(inner)), diagnostics)


def _in_batch(batch: Node, camera: Node, count: int) -> Node:
    """A camera with the properties of its batch. As in Mitsuba, the batch's film holds all, side by side."""
    common = [p for p in batch.properties if isinstance(p.value, Node) and p.value.kind in INHERITED]
    given = {p.value.kind for p in common if isinstance(p.value, Node)}
    own = [p for p in camera.properties if not (isinstance(p.value, Node) and p.value.kind in given)]
    shared = [
        Property("", _share_of_film(p.value, count), p.location, p.name_location)
        if isinstance(p.value, Node) and p.value.kind == "film"
        else p
        for p in common
    ]
    return Node("sensor", camera.plugin, camera.location, camera.plugin_location, camera.id, [*own, *shared])


def _share_of_film(film: Node, count: int) -> Node:
    width = getattr(film.find("width"), "value", DEFAULT_WIDTH)
    share = max(1, int(width) // count) if isinstance(width, int | float) else width
    place = film.property_location("width")
    kept = [p for p in film.without(["width"]) if not p.name.startswith("crop_")]
    properties = [*kept, Property("width", share, place, place)]
    return Node("film", film.plugin, film.location, film.plugin_location, "", properties)


def names(scene: Node) -> tuple[str, ...]:
    """The id of each camera, or its number, from zero, if it has none."""
    return tuple(camera.id or str(i) for i, camera in enumerate(scene.outermost("sensor")))


def first_name(scene: Node) -> str:
    """The name of the camera that is used unless another is asked for; "" if there is none."""
    known = names(scene)
    return known[-1 if scene.unsaid.last_sensor else 0] if known else ""


def chosen(builder: Builder, scene: Node) -> Node | None:
    """The camera selected by number or id; by default the first, or the last for files before version 2.

    Raises:
        SceneError: there is no camera of that number or id.
    """
    cameras = scene.outermost("sensor")
    if builder.sensor is not None:
        return cameras[_position(scene, builder.sensor)]
    if len(cameras) < 2:
        return cameras[0] if cameras else None
    position = len(cameras) - 1 if scene.unsaid.last_sensor else 0
    listed = ", ".join(names(scene))
    message = f'the scene has {len(cameras)} sensors, {listed}; "{first_name(scene)}" is used'
    builder.diagnostics.warn(message, cameras[position].location)
    return cameras[position]


def _position(scene: Node, wanted: int | str) -> int:
    known = names(scene)
    if isinstance(wanted, str) and wanted in known:
        return known.index(wanted)
    number = int(wanted) if str(wanted).isdecimal() else -1
    if not 0 <= number < len(known):
        listed = f"; the scene's sensors are: {', '.join(known)}" if known else "; the scene has none"
        hint = did_you_mean(str(wanted), known, limit=0) or listed
        raise SceneError(f'unknown sensor "{wanted}"{hint}', scene.location)
    return number


def report_missing_camera(builder: Builder, scene: Node) -> None:
    """Reports that a scene has no camera, and cameras inside shapes, which are not supported.

    Raises:
        SceneError: the version of the file implies none.
    """
    message, place = "the scene has no sensor", scene.location
    shapes = [shape for _, shape in scene.children("shape")]
    for node in (*shapes, *below(shapes)):
        sensor = next((child for _, child in node.children("sensor")), None)
        if sensor is not None:
            message += f" of its own; {sensor} inside of {node} cannot be used"
            place = sensor.location
            break
    if not scene.unsaid.camera:
        raise SceneError(message, place)
    builder.diagnostics.warn(f"{message}; one that sees the whole scene is added", place)
