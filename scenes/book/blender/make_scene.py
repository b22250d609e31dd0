"""Makes the scene of this folder in Blender: a ring, a rounded block and a cone below an area light.

python make_scene.py FOLDER        with Blender's Python, or a Python with the package bpy
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy

sys.path.append(str(Path(__file__).resolve().parent))
from export import export


def painted(
    name: str, colour: tuple[float, float, float], metallic: float, roughness: float
) -> bpy.types.Object:
    """Gives the active object a name and a material."""
    thing, material = bpy.context.object, bpy.data.materials.new(name)
    thing.name = name
    bsdf = material.node_tree.nodes["Principled BSDF"].inputs
    bsdf["Base Color"].default_value = (*colour, 1)
    bsdf["Metallic"].default_value = metallic
    bsdf["Roughness"].default_value = roughness
    thing.data.materials.append(material)
    return thing


def make() -> None:
    """Replaces what is open."""
    bpy.ops.wm.read_factory_settings(use_empty=False)
    for name in ("Cube", "Light"):
        bpy.data.objects.remove(bpy.data.objects[name])
    bpy.ops.mesh.primitive_plane_add(size=24)
    painted("floor", (0.35, 0.35, 0.37), 0, 0.6)
    bpy.ops.mesh.primitive_torus_add(
        location=(-0.2, 0.3, 0.4), major_radius=1.1, minor_radius=0.4, major_segments=40, minor_segments=16
    )
    bpy.ops.object.shade_smooth()
    painted("ring", (0.75, 0.42, 0.22), 1, 0.25)
    bpy.ops.mesh.primitive_cube_add(size=1.4, location=(1.7, -0.9, 0.7), rotation=(0, 0, math.radians(20)))
    block = painted("block", (0.12, 0.30, 0.42), 0, 0.35)
    bevel = block.modifiers.new("bevel", "BEVEL")
    bevel.width, bevel.segments = 0.16, 4
    bpy.ops.object.shade_smooth()
    bpy.ops.mesh.primitive_cone_add(location=(-2.1, -0.6, 0.8), radius1=0.7, depth=1.6, vertices=40)
    painted("cone", (0.55, 0.12, 0.08), 0, 0.5)
    bpy.ops.object.light_add(type="AREA", location=(3, -2.5, 5))
    lamp = bpy.context.object
    lamp.data.size, lamp.data.energy = 2.5, 420
    lamp.rotation_euler = (math.radians(35), 0, math.radians(40))
    scene = bpy.context.scene
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.2, 0.22, 0.26, 1)
    scene.camera.location, scene.camera.rotation_euler = (
        (0.6, -8.2, 4.4),
        (math.radians(64), 0, math.radians(3)),
    )
    scene.render.resolution_x, scene.render.resolution_y = 600, 400


if __name__ == "__main__":
    make()
    export(Path(sys.argv[-1]).resolve())
