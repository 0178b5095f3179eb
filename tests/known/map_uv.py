"""Blender's own compositor as a reader of warp maps: the node Map UV, in the way that each
version wants it.
"""

from pathlib import Path

import bpy
import numpy as np


def float_image(name: str, pixels: np.ndarray) -> bpy.types.Image:
    """An image whose numbers (h, w, 4), row 0 at the top, stay as they are."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, float_buffer=True, alpha=True)
    image.colorspace_settings.name = "Non-Color"
    image.pixels.foreach_set(np.ascontiguousarray(pixels[::-1], np.float32).ravel())
    image.update()
    return image


def is_nearest() -> bool:
    """Does the node read the nearest pixel here? Before 5.0 it is that, or a wide filter."""
    return bpy.app.version < (5, 0, 0)


def warped(picture: np.ndarray, stmap: Path, folder: Path) -> np.ndarray:
    """A picture (h, w, 4) warped by an STMap's file, as rendered to a file in a folder and
    read again (h, w, 4): bilinear, or nearest (`is_nearest`).
    """
    of_map = bpy.data.images.load(str(stmap))
    scene = bpy.data.scenes.new("compositing")
    render = scene.render
    render.resolution_x, render.resolution_y = of_map.size
    render.resolution_percentage = 100
    render.engine = "CYCLES"
    scene.cycles.samples = 1
    scene.camera = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    scene.collection.objects.link(scene.camera)

    if is_nearest():
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
        last = tree.nodes.new("CompositorNodeComposite").inputs["Image"]
    else:
        tree = bpy.data.node_groups.new("warp", "CompositorNodeTree")
        scene.compositing_node_group = tree
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        last = tree.nodes.new("NodeGroupOutput").inputs[0]
        render.image_settings.media_type = "IMAGE"

    uv = tree.nodes.new("CompositorNodeMapUV")
    if is_nearest():
        uv.filter_type = "NEAREST"
    else:
        uv.inputs["Interpolation"].default_value = "Bilinear"
    for socket, image in (("Image", float_image("picture", picture)), ("UV", of_map)):
        node = tree.nodes.new("CompositorNodeImage")
        node.image = image
        tree.links.new(uv.inputs[socket], node.outputs["Image"])
    tree.links.new(last, uv.outputs[0])

    settings = render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGBA", "32"
    render.filepath = str(folder / "warped.exr")
    bpy.ops.render.render(write_still=True, scene=scene.name)

    found = bpy.data.images.load(render.filepath)
    pixels = np.empty(len(found.pixels), np.float32)
    found.pixels.foreach_get(pixels)
    bpy.data.scenes.remove(scene)
    return pixels.reshape(found.size[1], found.size[0], 4)[::-1]
