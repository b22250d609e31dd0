"""Writes the scene that is open in Blender as a scene file: meshes, materials, area lights, sky and camera.

    blender -b room.blend -P export.py -- FOLDER

Written for Blender 5. Of materials it writes the colour, the metallic part and the roughness of the first
Principled BSDF; textures, other lights and other nodes are left out.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import bpy

FLAT = ("SQUARE", "RECTANGLE")  # shapes of area lights


def add(parent: ET.Element, tag: str, name: str, value: object) -> None:
    """Adds a property; `value` is a number, a text or a sequence of numbers."""
    text = value if isinstance(value, (str, int, float)) else " ".join(f"{x:.6g}" for x in value)
    ET.SubElement(parent, tag, name=name, value=str(text))


def add_matrix(parent: ET.Element, rows: Iterable[Sequence[float]]) -> None:
    transform = ET.SubElement(parent, "transform", name="to_world")
    ET.SubElement(transform, "matrix", value=" ".join(f"{x:.6g}" for row in rows for x in row))


def facing(matrix: Iterable[Sequence[float]], width: float = 1, height: float = 1) -> list[tuple[float, ...]]:
    """Cameras and lights of Blender look along -z, those of scene files along +z: a turn by 180 degrees."""
    return [(-row[0] * width, row[1] * height, -row[2], row[3]) for row in matrix]


def node_of(owner: bpy.types.World | bpy.types.Material | None, kind: str) -> bpy.types.Node | None:
    """The first shader node of a kind."""
    nodes = owner.node_tree.nodes if owner and owner.node_tree else []
    return next((node for node in nodes if node.type == kind), None)


def add_camera(scene: ET.Element, camera: bpy.types.Object, film: bpy.types.RenderSettings) -> None:
    sensor = ET.SubElement(scene, "sensor", type="perspective")
    add(sensor, "string", "fov_axis", "larger")
    add(sensor, "float", "fov", math.degrees(camera.data.angle))
    add_matrix(sensor, facing(camera.matrix_world))
    picture = ET.SubElement(sensor, "film", type="hdrfilm")
    add(picture, "integer", "width", film.resolution_x)
    add(picture, "integer", "height", film.resolution_y)


def add_sky(scene: ET.Element, world: bpy.types.World | None) -> None:
    node = node_of(world, "BACKGROUND")
    if not node:
        return
    background = node.inputs
    strength = background["Strength"].default_value
    emitter = ET.SubElement(scene, "emitter", type="constant")
    add(emitter, "rgb", "radiance", [strength * x for x in list(background["Color"].default_value)[:3]])


def add_area_light(scene: ET.Element, lamp: bpy.types.Object) -> None:
    """A rectangle that sends out the lamp's power in watts: radiance = power / (pi area)."""
    width = lamp.data.size
    height = lamp.data.size_y if lamp.data.shape == "RECTANGLE" else width
    shape = ET.SubElement(scene, "shape", type="rectangle", id=lamp.name)
    add_matrix(shape, facing(lamp.matrix_world, width / 2, height / 2))
    radiance = lamp.data.energy / (math.pi * width * height)
    add(
        ET.SubElement(shape, "emitter", type="area"),
        "rgb",
        "radiance",
        [radiance * x for x in lamp.data.color],
    )


def add_material(shape: ET.Element, material: bpy.types.Material | None) -> None:
    sides = ET.SubElement(shape, "bsdf", type="twosided")
    bsdf = ET.SubElement(sides, "bsdf", type="principled")
    found = node_of(material, "BSDF_PRINCIPLED")
    if found:
        add(bsdf, "rgb", "base_color", list(found.inputs["Base Color"].default_value)[:3])
        add(bsdf, "float", "metallic", found.inputs["Metallic"].default_value)
        add(bsdf, "float", "roughness", found.inputs["Roughness"].default_value)


def add_mesh(scene: ET.Element, mesh: bpy.types.Object, folder: Path) -> None:
    """With its modifiers applied, in world space."""
    bpy.ops.object.select_all(action="DESELECT")
    mesh.select_set(True)
    name = f"{bpy.path.clean_name(mesh.name)}.ply"
    path = str(folder / name)
    bpy.ops.wm.ply_export(
        filepath=path, export_selected_objects=True, export_normals=True, forward_axis="Y", up_axis="Z"
    )
    shape = ET.SubElement(scene, "shape", type="ply", id=mesh.name)
    add(shape, "string", "filename", name)
    add_material(shape, mesh.active_material)


def export(folder: Path) -> None:
    """Writes scene.xml and the meshes into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    bpy.context.view_layer.update()  # of matrices
    opened = bpy.context.scene
    scene = ET.Element("scene", version="3.0.0")
    ET.SubElement(scene, "integrator", type="path")
    add_camera(scene, opened.camera, opened.render)
    add_sky(scene, opened.world)
    for thing in opened.objects:
        if thing.type == "MESH":
            add_mesh(scene, thing, folder)
        elif thing.type == "LIGHT" and thing.data.type == "AREA" and thing.data.shape in FLAT:
            add_area_light(scene, thing)
        elif thing.type != "CAMERA":
            print(f"left out: {thing.name} ({thing.type.lower()})")
    ET.indent(scene, "    ")
    ET.ElementTree(scene).write(folder / "scene.xml", encoding="utf-8", xml_declaration=True)


if __name__ == "__main__":
    export(Path(sys.argv[-1]).resolve())
