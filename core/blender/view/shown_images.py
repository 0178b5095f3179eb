"""Images on a rig's flat parts in every 3D view: the picture in the glass, the source image on the
display.

Solid mode shows images only with Color: Texture, and only Cycles shows the picture in the glass. An
empty with an image would not follow the picture's plane. So both images are drawn over the view.
"""

from collections.abc import Iterator
from typing import NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from ..data.moving import number_at
from ..data.rigs import shown_settings
from ..read.plane import image_of, texture_showing
from ..read.read_mesh import column, uv_layer
from ..result.on_display import window_of


class ShownImage(NamedTuple):
    """An image on triangles.

    points : (n, 3) float32 world, Blender units
    uv : (n, 2) float32
    is_picture : also visible from behind and in front of its glass, unlike a display
    number : frame of a moving image; None for a still
    """

    image: bpy.types.Image
    points: NDArray[np.float32]
    uv: NDArray[np.float32]
    is_picture: bool
    number: int | None = None


def shown_images(
    scene: bpy.types.Scene, layer: bpy.types.ViewLayer, parts: list[bpy.types.Object]
) -> Iterator[ShownImage]:
    """The images of pictures and of displays with a source image among some objects, as last
    evaluated.
    """
    for thing in parts:
        if thing.type != "MESH" or thing.mode != "OBJECT":
            continue

        ours = shown_settings(scene, thing)
        is_picture = thing.kiriko.role == "PICTURE" and ours.picture_source == "PLANE"
        image = image_of(thing) if is_picture else None
        texture = texture_showing(thing, image) if is_picture else None
        uv_map = "" if texture is None else texture.uv_map
        if thing.kiriko.role in {"DISPLAY", "SCREEN"}:
            image = ours.result.source

        if image is not None:
            laid = _laid(thing.evaluated_get(layer.depsgraph), uv_map)
            if laid is not None:
                width, height, below = (1.0, 1.0, 0.0) if is_picture else window_of(thing)
                laid = laid[0], laid[1] * np.float32([width, height]) + np.float32([0, below])
                timing = None if texture is None else texture.timing
                number = number_at(image, timing, scene.frame_current)
                yield ShownImage(image, *laid, is_picture=is_picture, number=number)


def _laid(
    shown: bpy.types.Object, uv_map: str
) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
    """Corners (n, 3) of an evaluated object's triangles in the world, and their UV (n, 2)."""
    mesh = shown.data
    layer = uv_layer(mesh, uv_map)
    if layer is None or not len(mesh.polygons):
        return None

    mesh.calc_loop_triangles()
    loops = column(mesh.loop_triangles, "loops", 3, np.int32).ravel()
    vertices = column(mesh.loops, "vertex_index", 1, np.int32).ravel()
    points = column(mesh.vertices, "co", 3, np.float32)[vertices[loops]]
    uv = column(layer.uv, "vector", 2, np.float32)[loops]

    matrix = np.array(shown.matrix_world, np.float32)
    return points @ matrix[:3, :3].T + matrix[:3, 3], uv
