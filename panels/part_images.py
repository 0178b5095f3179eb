"""Draws the picture in the glass and the source image on the display, in all 3D views."""

from time import perf_counter

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix

from ..core.base.arrays import Floats
from ..core.blender.data.camera_viewer import viewer_of
from ..core.blender.view.shown_images import ShownImage, shown_images
from ..operators import map_drawing
from ..operators.windows import camera_of
from .overlay.view_handlers import TINTED_SHADER, ViewHandlers

# blend modes by an image's alpha mode; the alpha of other modes is not coverage
BLENDING = {"STRAIGHT": "ALPHA", "PREMUL": "ALPHA_PREMULT"}
SHARE = 20.0  # a scene is searched again after this many times the duration of the last search
ROLES = {"PICTURE", "DISPLAY", "SCREEN"}
# Passes of an image: depth test and opacity. A picture is inside its glass, so it is drawn in front
# of everything. A display is behind glass or plate, and in front it would hide them.
IN_FRONT = (("NONE", 1.0),)
IN_PLACE = (("GREATER", 0.65), ("LESS_EQUAL", 1.0))
NEARER = 1e-3  # of the distance, so that an image is not hidden by its own display

_found: dict[
    int, tuple[float, list[str]]
] = {}  # by scene: time of the next search, names of the parts
_loaded: dict[int, int] = {}  # by moving image: the frame in its texture


def draw() -> None:
    """Draw the images. Blender calls it for every 3D view."""
    context = bpy.context
    space = context.space_data
    if not space.overlay.show_overlays:
        return

    parts = [thing for thing in parts_of(context.scene) if thing.visible_get(viewport=space)]
    parts = [thing for thing in parts if is_drawn(context, thing.kiriko.role)]

    draw_parts(context, parts)


def draw_parts(context: bpy.types.Context, parts: list[bpy.types.Object]) -> None:
    """Draw the images of these parts, pictures last."""
    found = shown_images(context.scene, context.view_layer, parts)
    view = context.region_data
    for shown in sorted(found, key=lambda shown: shown.is_picture):
        points = nearer(shown.points, view.view_matrix, view.is_perspective, view.view_distance)
        _draw(shown, points)


def nearer(points: Floats, view: Matrix, is_perspective: bool, distance: float) -> Floats:
    """Points (n, 3) moved slightly towards the eye, along their lines of sight.

    view : from the world to the view; distance : of an orthographic view from its pivot
    """
    to_world = np.array(view.inverted())
    if is_perspective:
        return (points + NEARER * (to_world[:3, 3] - points)).astype(np.float32)
    return (points + NEARER * distance * to_world[:3, 2]).astype(np.float32)


def is_drawn(context: bpy.types.Context, role: str) -> bool:
    """Whether the image of such a part is drawn in this view.

    It is not if the display's material or the light itself shows it.
    """
    space, view = context.space_data, context.region_data
    if role != "PICTURE":
        return space.shading.type == "SOLID" and space.shading.color_type != "TEXTURE"

    camera = camera_of(space, context.scene)
    is_seen = view.view_perspective == "CAMERA" and camera == viewer_of(context.scene)
    return not (space.shading.type == "RENDERED" and is_seen)


def parts_of(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Pictures and displays of a scene. Not every redraw searches a scene of many objects."""
    started = perf_counter()
    due, names = _found.get(scene.session_uid, (0.0, []))
    if started >= due:
        names = [thing.name for thing in scene.objects if thing.kiriko.role in ROLES]
        ended = perf_counter()
        _found[scene.session_uid] = (ended + SHARE * (ended - started), names)

    things = (scene.objects.get(name) for name in names)
    return [thing for thing in things if thing is not None and thing.kiriko.role in ROLES]


def _texture(shown: ShownImage) -> gpu.types.GPUTexture:
    """The texture of an image; RuntimeError if it has no pixels.

    Blender creates the texture of a moving image at frame 0: sequences have none, and a movie shows
    its first frame. So the image is loaded at its own frame first.
    """
    image, number = shown.image, shown.number
    texture = map_drawing.texture_for(image)
    if texture is not None:
        return texture
    if number is not None:
        if _loaded.get(image.session_uid) != number:
            image.gl_free()
            _loaded[image.session_uid] = number
        image.gl_load(frame=number)
    return gpu.texture.from_image(image)


def _draw(shown: ShownImage, points: Floats) -> None:
    try:
        texture = _texture(shown)
    except RuntimeError:  # an image without pixels
        return

    shader = gpu.shader.from_builtin(TINTED_SHADER)
    batch = batch_for_shader(shader, "TRIS", {"pos": points, "texCoord": shown.uv})
    before = gpu.state.depth_test_get(), gpu.state.blend_get(), gpu.state.depth_mask_get()

    try:
        gpu.state.depth_mask_set(False)  # or the depth of one pass would hide the next
        gpu.state.face_culling_set("NONE" if shown.is_picture else "BACK")
        shader.bind()
        shader.uniform_sampler("image", texture)
        for depth, opacity in IN_FRONT if shown.is_picture else IN_PLACE:
            mode = BLENDING.get(shown.image.alpha_mode, "NONE")
            gpu.state.depth_test_set(depth)
            gpu.state.blend_set(mode if opacity == 1 else "ALPHA")
            shader.uniform_float("color", (1.0, 1.0, 1.0, opacity))
            batch.draw(shader)
    finally:
        gpu.state.face_culling_set("NONE")
        gpu.state.depth_test_set(before[0])
        gpu.state.blend_set(before[1])
        gpu.state.depth_mask_set(before[2])


_handlers = ViewHandlers(POST_VIEW=draw)


def register() -> None:
    """Add the draw handler."""
    _handlers.begin()


def unregister() -> None:
    """Remove the draw handler."""
    _handlers.end()
    _found.clear()
    _loaded.clear()
