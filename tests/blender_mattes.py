"""Reads a picture of layers with Blender's compositor; the Python that runs this has Blender's module.

The argument is a JSON file with the fields "picture", an EXR file, "size", its width and height, "mattes", a
list of Cryptomattes and names of objects, and "folder". The matte of entry i is written to FOLDER/i.exr.
FOLDER/found.json has the fields "layers", the types of the sockets of layers, "cryptomattes", their names,
and "picked", the names that Blender's eyedropper shows for the entries.
"""

import json
import sys

import bpy


def cryptomatte_node(picture: str, size: tuple[int, int]) -> bpy.types.CompositorNodeCryptomatteV2:
    """A Cryptomatte node of a picture; its matte is what the compositor renders."""
    scene = bpy.context.scene
    tree = bpy.data.node_groups.new("mattes", "CompositorNodeTree")
    scene.compositing_node_group = tree
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    node, result = tree.nodes.new("CompositorNodeCryptomatteV2"), tree.nodes.new("NodeGroupOutput")
    tree.links.new(node.outputs["Matte"], result.inputs[0])
    node.source, node.image = "IMAGE", bpy.data.images.load(picture)
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    settings = scene.render.image_settings
    settings.file_format, settings.color_depth, settings.color_mode = "OPEN_EXR", "32", "RGB"
    return node


def cryptomattes(node: bpy.types.CompositorNodeCryptomatteV2) -> list[str]:
    """The Cryptomattes of the image; Blender tells them only in the message of an error."""
    try:
        node.layer_name = "?"
    except TypeError as error:
        found = str(error).partition(" not found in ")[2]
    return list(json.loads(found.translate(str.maketrans("()'", '[]"')).replace(",]", "]")))


def picked(node: bpy.types.CompositorNodeCryptomatteV2) -> str:
    """What the manifest says about the only selected object; selects it by its id instead of its name."""
    (entry,) = node.entries
    wanted = entry.encoded_hash
    node.matte_id = ""
    node.add = (wanted, 0, 0)
    (entry,) = node.entries
    return entry.name


def sockets(image: bpy.types.Image) -> dict[str, str]:
    """The types of the sockets of an image node."""
    node = bpy.context.scene.compositing_node_group.nodes.new("CompositorNodeImage")
    node.image = image
    return {socket.name: socket.type for socket in node.outputs}


def main(job: dict) -> None:
    node, names = cryptomatte_node(job["picture"], job["size"]), []
    for index, (layer, name) in enumerate(job["mattes"]):
        node.layer_name, node.matte_id = layer, name
        names.append(picked(node))
        bpy.context.scene.render.filepath = f"{job['folder']}/{index}.exr"
        bpy.ops.render.render(write_still=True)
    with open(f"{job['folder']}/found.json", "w", encoding="utf-8") as file:
        found = {"layers": sockets(node.image), "cryptomattes": cryptomattes(node), "picked": names}
        json.dump(found, file)


with open(sys.argv[1], encoding="utf-8") as file:
    main(json.load(file))
