"""Assembles the description from a resolved scene, with defaults for missing objects."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ..schema import HARMLESS, ROBUST, Field
from ..syntax.errors import Diagnostics, SceneError, did_you_mean
from ..syntax.nodes import Node, Property, Rgb, below
from . import cameras
from .builder import Builder
from .default_camera import default_camera
from .entries import Objects, Places, View
from .inside import is_inside
from .instances import add_instance, check_size, plain_group
from .mapping import check_textures
from .outputs import description_of, repeated
from .plugin import Entry, FilmPart, Part, Slot
from .runs import add_run

ENVIRONMENTS = ("envmap", "constant", "sky", "sunsky")
NEVER_LIGHTS = ("sdfgrid",)
WITHOUT_MEDIA = ("path", "direct")


def assemble(builder: Builder, scene: Node) -> Entry:
    """The description of a scene; see docs/architecture.md.

    Raises:
        SceneError: something cannot be built, or there is no sensor.
    """
    builder.places["scene"] = scene.location
    builder.terminator = scene.unsaid.terminator
    for prop in scene.properties:
        if not isinstance(prop.value, Node) and prop.name not in (ROBUST, *HARMLESS["scene"]):
            hint = did_you_mean(prop.name, [ROBUST])
            builder.diagnostics.unknown(f'a scene has no property "{prop.name}"{hint}', prop.name_location)
    check_size(scene)
    builder.camera = partial(_given_view, builder, scene)
    for _, node in scene.children("shape"):
        _add_shape(builder, node)
    builder.camera = lambda: None  # only shapes ask for it; the cycle would stay until garbage is collected
    _warn_of_unused_area_lights(builder, scene)
    for _, node in scene.children("emitter"):
        if node.plugin.lower() != "area":  # declared here for shapes that refer to it
            _add_emitter(builder, node)
    _warn_of_several_environments(builder, scene)
    _warn_of_missing_attributes(builder)
    check_textures(builder)
    if not builder.emitters:
        _add_missing_light(builder, scene)
    sensor = _chosen(builder, scene)
    view = _given_view(builder, scene) or _view(builder, scene, None)
    output = _output(builder, _integrator(builder, scene))
    if builder.kept is None:
        builder.views.update(_other_views(builder, scene, sensor))
    builder.objects.finish()
    shown = sensor or _implied(scene, "sensor", "perspective")
    _warn_of_unseen_media(builder, output["integrator"]["type"], view["sensor"], shown)
    return {
        "textures": builder.textures.stored,
        "bsdfs": builder.bsdfs.stored,
        "adapters": builder.adapters.stored,
        "materials": builder.materials.stored,
        "emitters": builder.emitters.stored,
        "volumes": builder.volumes.stored,
        "phases": builder.phases.stored,
        "media": builder.media.stored,
        "shapes": builder.shapes.stored,
        "groups": builder.groups.stored,
        "instances": builder.instances.stored,
        **view,
        **output,
        **_ray_queries(builder, scene),
    }


def _ray_queries(builder: Builder, scene: Node) -> Entry:
    prop = scene.find(ROBUST)
    return {} if prop is None else {"robust": builder.convert(scene, prop, Field(ROBUST, "boolean", ""))}


def _chosen(builder: Builder, scene: Node) -> Node | None:
    return builder.once("chosen camera", lambda: cameras.chosen(builder, scene))


def _given_view(builder: Builder, scene: Node) -> Entry | None:
    """The view of the scene's own camera, which shapes may need before the others."""
    sensor = _chosen(builder, scene)
    return builder.once("view", lambda: _view(builder, scene, sensor)) if sensor else None


def _view(builder: Builder, scene: Node, sensor: Node | None) -> Entry:
    """What belongs to a camera: the entries "sensor", "film", "rfilter" and "sampler"."""
    camera = _one(builder, sensor) if sensor else _missing_sensor(builder, scene)
    sensor = sensor or _implied(scene, "sensor", "perspective")
    inside = _only(builder, sensor, "medium")
    if inside:
        camera["medium"] = builder.index(inside)
    film = _only(builder, sensor, "film") or _implied(sensor, "film", "hdrfilm")
    size = _film(builder, film)
    rfilter = _only(builder, film, "rfilter") or _implied(film, "rfilter", _default_filter(film))
    sampler = _only(builder, sensor, "sampler") or _implied(sensor, "sampler", "sobol")
    return {
        "sensor": camera,
        "film": size,
        "rfilter": _one(builder, rfilter),
        "sampler": _one(builder, sampler),
    }


def _other_views(builder: Builder, scene: Node, chosen: Node | None) -> Iterator[tuple[str, View]]:
    """The views of all cameras but one, by their names; what is wrong with them is told on use."""
    sensors = scene.outermost("sensor")
    for name, sensor in zip(cameras.names(scene), sensors, strict=True):
        if sensor is chosen:
            continue
        strict = builder.diagnostics.strict
        alone = replace(builder, diagnostics=Diagnostics(strict), places=Places(), objects=Objects())
        try:
            entries = _view(alone, scene, sensor)
            warnings = alone.diagnostics.warnings
            own = alone.objects
            yield name, View(entries, alone.film, own.plugins, alone.places, warnings, ids=own.ids)
        except SceneError as problem:
            yield name, View({}, builder.film, problem=problem)


def _default_filter(film: Node) -> str:
    return "box" if film.plugin.lower() == "mfilm" else "gaussian"


def _output(builder: Builder, integrator: Node) -> Entry:
    """The integrators and channels of the description."""
    builder.places["integrator"] = integrator.location
    description = description_of(builder.picture(integrator), alpha=builder.film.has_alpha)
    for index, _ in enumerate(description.get("other_integrators", ())):
        builder.places[f"other_integrators[{index}]"] = integrator.location
    labels = [channel["label"] for channel in description.get("channels", ())]
    twice = repeated([*(name for name in builder.film.names if name != "A"), *labels])
    if twice is not None:
        raise SceneError(f'there are two channels "{twice}"', integrator.location)
    return description


def _only(builder: Builder, parent: Node, kind: str) -> Node | None:
    """The one child of a kind; of several the first."""
    found = parent.outermost(kind)
    if len(found) > 1:
        message = f"{parent.kind} has {len(found)} of kind {kind}; only this one is used"
        builder.diagnostics.warn(message, found[0].location)
    return found[0] if found else None


def _one(builder: Builder, node: Node) -> Entry:
    """The entry of an object of which a scene has one."""
    builder.places[node.kind] = node.location
    entry = builder.construct(node)
    if not isinstance(entry, dict):
        raise SceneError(f"{node} is not supported", node.plugin_location)
    builder.objects.note(node.kind, entry, node)
    return entry


def _film(builder: Builder, node: Node) -> Entry:
    """The size of the picture; how it is written is the builder's."""
    builder.places["film"] = node.location
    part = builder.construct(node)
    if not isinstance(part, FilmPart):
        raise SceneError(f"{node} is not supported", node.plugin_location)
    builder.objects.note("film", part.entry, node)
    builder.film, builder.layers = part.film, part.layers
    return part.entry


def _implied(parent: Node, kind: str, plugin: str) -> Node:
    return Node(kind, plugin, parent.location, parent.location)


def _integrator(builder: Builder, scene: Node) -> Node:
    """The scene's integrator, or the requested one with those parameters of the file that it supports."""
    node = _only(builder, scene, "integrator")
    if builder.integrator is None:
        return node or _default_integrator(builder, scene)
    asked = _implied(scene, "integrator", builder.integrator)
    plugin = builder.plugin(asked)
    while node and plugin:
        fields = {field.name for field in plugin.fields}
        asked.properties += [prop for prop in node.properties if prop.name in fields]
        node = next((child for _, child in node.children("integrator")), None)
    return asked


def _default_integrator(builder: Builder, scene: Node) -> Node:
    """What the version of the file implies; else a path tracer, with a warning."""
    if scene.unsaid.integrator:
        return _implied(scene, "integrator", scene.unsaid.integrator)
    builder.diagnostics.unknown('the scene has no integrator; "path" is used', scene.location)
    return _implied(scene, "integrator", "path")


def _missing_sensor(builder: Builder, scene: Node) -> Entry:
    """A camera that sees everything where the version of the file implies one; other files must have one."""
    cameras.report_missing_camera(builder, scene)
    return default_camera(builder.shapes, builder.groups, builder.instances)


def _warn_of_unseen_media(builder: Builder, integrator: str, camera: Entry, sensor: Node) -> None:
    """Warns about media that the integrator ignores, and about a camera in a medium that it does not name."""
    if not builder.media:
        return
    if integrator in WITHOUT_MEDIA:
        message = f'the integrator "{integrator}" does not see the media of this scene; "volpath" does'
        builder.diagnostics.warn(message, builder.places["integrator"])
        return
    if camera.get("medium", -1) >= 0 or camera["type"] == "orthographic":
        return
    eye = np.asarray(camera.get("to_world", np.eye(4)), float)[:3, 3]
    for i, shape in builder.shapes.alike():
        if shape.get("interior", -1) >= 0 and is_inside(shape, eye):
            message = (
                f"the camera is inside the medium of this shape, but {sensor} does not name it, so "
                "camera rays start outside the medium; add it to the sensor"
            )
            builder.diagnostics.warn(message, builder.places[f"shapes[{i}]"])
            return


def _warn_of_missing_attributes(builder: Builder) -> None:
    known = {name for shape in builder.shapes.stored if "mesh" in shape for name in shape["mesh"].attributes}
    for i, texture in enumerate(builder.textures):
        name = texture.get("name", "vertex_color")
        if texture["type"] == "mesh_attribute" and name not in known:
            message = f'no mesh has the attribute "{name}"; it is black'
            hint = did_you_mean(name, known)
            builder.diagnostics.warn(message + hint, builder.places[f"textures[{i}]"])


def _media(builder: Builder, shape: Node) -> dict[str, int]:
    """The media on either side of a shape, by index."""
    for prop, _ in shape.children("subsurface"):
        builder.diagnostics.unknown("subsurface scattering is not supported; it is ignored", prop.location)
    sides: dict[str, int] = {}
    for prop, node in shape.children("medium"):
        if prop.name in ("interior", "exterior"):
            sides[prop.name] = builder.index(node)
        else:
            message = f'{node} of {shape} must be named "interior" or "exterior"; it is ignored'
            builder.diagnostics.unknown(message, prop.name_location)
    return sides


def _add_emitter(builder: Builder, node: Node) -> None:
    entries = builder.construct(node)
    for entry in entries if isinstance(entries, list) else [entries]:
        if isinstance(entry, dict):
            builder.add("emitters", entry, node)


def _warn_of_unused_area_lights(builder: Builder, scene: Node) -> None:
    lights = [node for _, node in scene.children("emitter") if node.plugin.lower() == "area"]
    used = set(below(shape for _, shape in scene.children("shape"))) if lights else set()
    for node in lights:
        if node not in used:
            builder.diagnostics.warn(f"no shape refers to {node}; it emits no light", node.location)


def _warn_of_several_environments(builder: Builder, scene: Node) -> None:
    found = [n for _, n in scene.children("emitter") if n.plugin.lower() in ENVIRONMENTS]
    if len(found) > 1 and not scene.unsaid.lights_add_up:
        builder.diagnostics.warn("several environment lights: they add up", found[1].location)


def _add_missing_light(builder: Builder, scene: Node) -> None:
    """Sun and sky where the version of the file implies them, as Mitsuba 0.6 adds them; else it is dark."""
    if not scene.unsaid.daylight or any(True for _ in scene.children("emitter")):
        builder.diagnostics.warn("the scene has no light and is black", scene.location)
        return
    builder.diagnostics.warn("the scene has no light; sun and sky are added", scene.location)
    angle = math.radians(-120)
    turn = np.eye(4)
    turn[0, [0, 2]] = math.cos(angle), math.sin(angle)
    turn[2, [0, 2]] = -math.sin(angle), math.cos(angle)
    node = _implied(scene, "emitter", "sunsky")
    daylight = {"to_world": turn, "scale": 2.0, "extend": True, "sun_radius_scale": 15.0}
    daylight |= {"up": "y", "sun_model": "preetham", "albedo": 0.2}
    for name, value in daylight.items():
        node.set_default(name, value)
    scene.properties.append(Property("", node, scene.location, scene.location))
    _add_emitter(builder, node)


def _add_shape(builder: Builder, node: Node) -> Sequence[int]:
    """Adds the shapes of a node to the scene; their indices, none for groups and instances."""
    if node.run is not None:
        added = add_run(builder, node, _add_material, plain_group(_add_shape))
        if added is not None:
            return added
        return [index for member in builder.members(node) for index in _add_shape(builder, member)]
    entry = builder.construct(node)
    if isinstance(entry, list):
        parts = [part for part in entry if isinstance(part, Part)]
        return [_add_part(builder, node, part.entry, part.bsdf) for part in parts]
    if not isinstance(entry, dict):
        return []
    if entry["type"] == "shapegroup":
        return []
    if entry["type"] == "instance":
        add_instance(builder, node, _add_shape)
        return []
    if entry["type"] == "merge":
        return [index for _, child in node.children("shape") for index in _add_shape(builder, child)]
    return [_add_part(builder, node, entry, _only(builder, node, "bsdf"))]


def _add_part(builder: Builder, node: Node, entry: Entry, bsdf: Node | None) -> int:
    """Adds one shape of the description, with its light, its media and its material."""
    emitter = -1 if entry["type"] in NEVER_LIGHTS else _area_light(builder, node)
    if entry["type"] in NEVER_LIGHTS and any(True for _ in node.children("emitter")):
        builder.diagnostics.warn(f"{node} cannot be a light; it emits no light", node.location)
    material = _add_material(builder, node, bsdf, emits=emitter >= 0)
    entry |= {"material": material, "emitter": emitter, **_media(builder, node)}
    return builder.add("shapes", entry, node)


def _area_light(builder: Builder, shape: Node) -> int:
    """The index of a shape's light, -1 without one. Every shape has a light of its own."""
    node = _only(builder, shape, "emitter")
    if node is None:
        return -1
    if node.plugin.lower() != "area":
        builder.diagnostics.unknown(f"{node} is not allowed inside a shape; it is ignored", node.location)
        return -1
    entry = builder.construct(node)
    assert isinstance(entry, dict)
    return builder.add("emitters", entry, node)


def _add_material(builder: Builder, shape: Node, bsdf: Node | None, *, emits: bool = False) -> int:
    return builder.add_material(_material(builder, shape, bsdf, emits=emits), shape)


def _material(builder: Builder, shape: Node, bsdf: Node | None, *, emits: bool) -> Slot:
    slot = builder.slot(bsdf) if bsdf else None
    if slot is None:
        slot = builder.slot(_default_bsdf(shape, emits=emits))
    assert slot is not None
    return slot


def _default_bsdf(shape: Node, *, emits: bool) -> Node:
    """Black on lights; around a medium what the version of the file implies; else grey."""
    location = shape.location
    if emits:
        black = Property("reflectance", Rgb((0.0, 0.0, 0.0)), location, location)
        return Node("bsdf", "diffuse", location, location, properties=[black])
    has_medium = any(True for _ in shape.children("medium"))
    return Node("bsdf", shape.unsaid.boundary if has_medium else "diffuse", location, location)
