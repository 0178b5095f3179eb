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
from ..operators.windows import camera_of
from .overlay.view_handlers import TINTED_SHADER, ViewHandlers

# how textures of images blend, by the mode of their alpha; that of others is no coverage
BLENDING = {"STRAIGHT": "ALPHA", "PREMUL": "ALPHA_PREMULT"}
SHARE = 20.0  # times as long as all objects of a scene took to look at they are not looked at again
ROLES = {"PICTURE", "DISPLAY"}
# how an image is drawn, pass by pass: the test against the depth of the view, and how opaque. A
# picture stands in its glass, and is drawn in front of all. A display stands behind glass or plate:
# in front of them it would hide the glass that it is seen through.
IN_FRONT = (("NONE", 1.0),)
IN_PLACE = (("GREATER", 0.65), ("LESS_EQUAL", 1.0))
NEARER = 1e-3  # of the distance: or rounding would draw by lot whether a display hides its image

_found: dict[int, tuple[float, list[str]]] = {}  # by scene: looked at next, names of the parts
_loaded: dict[int, int] = {}  # by moving image: number of the frame that its texture has


def draw() -> None:
    """Called by Blender for each 3D view. Nothing but the view is changed."""
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
    """Points (n, 3) a little nearer to who looks at them, and seen in the same places.

    view : from the world to the view; distance : of an orthographic one, to what it turns about
    """
    to_world = np.array(view.inverted())
    if is_perspective:
        return (points + NEARER * (to_world[:3, 3] - points)).astype(np.float32)
    return (points + NEARER * distance * to_world[:3, 2]).astype(np.float32)


def is_drawn(context: bpy.types.Context, role: str) -> bool:
    """Is the image of such a part drawn in this view?

    Where its material shows the display's, and where the light
    itself shows the picture to the viewer, it is not.
    """
    space, view = context.space_data, context.region_data
    if role == "DISPLAY":
        return space.shading.type == "SOLID" and space.shading.color_type != "TEXTURE"

    camera = camera_of(space, context.scene)
    is_seen = view.view_perspective == "CAMERA" and camera == viewer_of(context.scene)
    return not (space.shading.type == "RENDERED" and is_seen)


def parts_of(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Pictures and displays of a scene; where it has many
    objects they are not all looked at for each picture drawn.
    """
    started = perf_counter()
    due, names = _found.get(scene.session_uid, (0.0, []))
    if started >= due:
        names = [thing.name for thing in scene.objects if thing.kiriko.role in ROLES]
        ended = perf_counter()
        _found[scene.session_uid] = (ended + SHARE * (ended - started), names)

    things = (scene.objects.get(name) for name in names)
    return [thing for thing in things if thing is not None and thing.kiriko.role in ROLES]


def _texture(shown: ShownImage) -> gpu.types.GPUTexture:
    """The texture of an image; RuntimeError for one without pixels.

    Blender makes that of a moving image at the image's frame 0, which sequences lack, and a movie
    shows its first for. So it is loaded at its frame before Blender is asked for it.
    """
    image, number = shown.image, shown.number
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
        gpu.state.depth_mask_set(False)  # or a pass would be tested against the one before
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
    """Draw from now on."""
    _handlers.begin()


def unregister() -> None:
    """Draw no more."""
    _handlers.end()
    _found.clear()
    _loaded.clear()
