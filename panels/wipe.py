"""Draws Before and After over the camera view, with a handle that wipes between them."""

from typing import Any

import blf
import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix

from ..operators import compared
from ..operators.reporting import in_words
from .overlay.view_handlers import IMAGE_SHADER, ViewHandlers, for_shader

LINE = (1.0, 1.0, 1.0, 0.9)
LETTERS = 11.0  # px at a scale of 1
HANDLE = 14.0  # px at a scale of 1, half of its width

# by id of the comparison: it and its textures
_textures: dict[int, tuple[object, dict[str, gpu.types.GPUTexture]]] = {}


def draw() -> None:
    """Draw the comparison. Blender calls it for every 3D view."""
    context = bpy.context
    scene = context.scene
    # Look Through Viewer switches Blender's overlays off
    is_wanted = context.space_data.overlay.show_overlays or scene.kiriko_scene.looking
    if not (compared.is_shown(scene) and is_wanted):
        return
    frame = compared.frame_in_region(context, scene)
    if frame is None:
        return

    ours = context.window_manager.kiriko
    made = compared.found(scene).comparison
    before = gpu.state.blend_get()
    try:
        gpu.state.blend_set("NONE")
        _draw(frame, _texture(made, ours.left), 0.0, ours.wipe)
        _draw(frame, _texture(made, ours.right), ours.wipe, 1.0)
        scale = context.preferences.system.ui_scale
        _draw_line(frame, ours.wipe, scale)
        _write_names(frame, ours, scale)
    finally:
        gpu.state.blend_set(before)


def _texture(made: object, choice: str) -> gpu.types.GPUTexture:
    """An image of a comparison on the graphics card, row 0 at the bottom."""
    if id(made) not in _textures:
        _textures.clear()  # at most one
        _textures[id(made)] = made, {}
    textures = _textures[id(made)][1]

    if choice not in textures:
        image = np.flipud(for_shader(getattr(made, choice.lower())))
        height, width = image.shape[:2]
        opaque = np.dstack([image, np.ones((height, width), np.float32)])
        numbers = gpu.types.Buffer("FLOAT", opaque.size, np.ascontiguousarray(opaque).ravel())
        textures[choice] = gpu.types.GPUTexture((width, height), format="RGBA16F", data=numbers)
    return textures[choice]


def _between(frame: np.ndarray, part: float) -> tuple[Any, Any]:
    """Upper and lower end (2,), px, of a vertical line at a fraction of the frame's width."""
    upper = frame[0] + part * (frame[1] - frame[0])
    lower = frame[3] + part * (frame[2] - frame[3])
    return upper, lower


def _draw(frame: np.ndarray, texture: gpu.types.GPUTexture, start: float, stop: float) -> None:
    if stop <= start:
        return
    upper, lower = _between(frame, start)
    upper_end, lower_end = _between(frame, stop)
    shader = gpu.shader.from_builtin(IMAGE_SHADER)
    corners = [(*point, 0.0) for point in (lower, lower_end, upper_end, upper)]
    uv = [(start, 0.0), (stop, 0.0), (stop, 1.0), (start, 1.0)]
    batch = batch_for_shader(
        shader, "TRIS", {"pos": corners, "texCoord": uv}, indices=[(0, 1, 2), (0, 2, 3)]
    )
    shader.bind()
    shader.uniform_sampler("image", texture)
    batch.draw(shader)


def _draw_line(frame: np.ndarray, part: float, scale: float) -> None:
    """Draw the line between the images, with an arrow to each side."""
    upper, lower = _between(frame, part)
    middle = (upper + lower) / 2
    arrows = [
        (*(middle + scale * HANDLE * np.array([sign * x, y])), 0.0)
        for sign in (-1, 1)
        for x, y in ((0.3, 0.5), (0.3, -0.5), (0.9, 0.0))
    ]

    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    shader.bind()
    shader.uniform_float("color", LINE)
    batch_for_shader(shader, "LINES", {"pos": [(*upper, 0.0), (*lower, 0.0)]}).draw(shader)
    batch_for_shader(shader, "TRIS", {"pos": arrows}).draw(shader)


def _write_names(frame: np.ndarray, ours: bpy.types.PropertyGroup, scale: float) -> None:
    """Write the images' names into the upper corners of the frame."""
    blf.size(0, LETTERS * scale)
    blf.color(0, *LINE)
    room = LETTERS * scale
    for side, corner in (("left", frame[0]), ("right", frame[1])):
        name = in_words(ours.bl_rna.properties[side].enum_items[getattr(ours, side)].name)
        width, _ = blf.dimensions(0, name)
        x = corner[0] + room if side == "left" else corner[0] - room - width
        blf.position(0, x, corner[1] - 2 * room, 0.0)
        blf.draw(0, name)


class KIRIKO_GGT_wipe(bpy.types.GizmoGroup):
    """The handle."""

    bl_label = "Kiriko Wipe"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options = {"PERSISTENT", "SCALE"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return (
            compared.is_shown(context.scene)
            and compared.frame_in_region(context, context.scene) is not None
        )

    def setup(self, context: bpy.types.Context) -> None:
        handle = self.gizmos.new("GIZMO_GT_button_2d")
        # `draw` covers it with its own arrows
        handle.icon = "ARROW_LEFTRIGHT"
        handle.scale_basis = HANDLE
        handle.color, handle.alpha = (0.1, 0.1, 0.1), 0.6
        handle.color_highlight, handle.alpha_highlight = (0.3, 0.3, 0.3), 0.9
        handle.target_set_operator("kiriko.wipe")
        self.handle = handle

    def draw_prepare(self, context: bpy.types.Context) -> None:
        frame = compared.frame_in_region(context, context.scene)
        if frame is not None:
            upper, lower = _between(frame, context.window_manager.kiriko.wipe)
            self.handle.matrix_basis = Matrix.Translation((*((upper + lower) / 2), 0.0))


_handlers = ViewHandlers(POST_PIXEL=draw)


def register() -> None:
    """Add the draw handler."""
    _handlers.begin()


def unregister() -> None:
    """Remove the draw handler."""
    _handlers.end()
    _textures.clear()
