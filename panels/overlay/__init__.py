"""The overlay: the light's way through the rig, drawn over the viewport while the Kiriko tab is
open.

All of it is plain data that `operators/sketcher.py` keeps up to date; here it is only handed to the
GPU. Nothing is read, traced or changed while a viewport is drawn.
"""

from collections.abc import Callable

import bpy

from ...core.base.messages import Message
from ...operators import sketcher, telling
from ...operators.sketcher import SketchDrawing
from . import batches, colours, lines, overlay_text, pointer
from .view_handlers import ViewHandlers

_failed: list[str] = []  # reasons why it is not drawn any more, until Kiriko is enabled anew


def draw_in_space() -> None:
    """Called by Blender for each viewport, within the scene."""
    _draw(lines.draw)
    _draw(lines.draw_contours, sketcher.looks_through)


def draw_in_pixels() -> None:
    """Called by Blender for each viewport, over it."""
    _draw(overlay_text.draw)


def _draw(
    function: Callable[[bpy.types.Context, SketchDrawing, float], None],
    is_wanted: Callable[[bpy.types.Scene, bpy.types.Area], bool] = (
        lambda scene, area: sketcher.is_looked_at(area)
    ),
) -> None:
    """Draw in a viewport that wants it. An error ends the overlay, not the drawing of Blender."""
    context = bpy.context
    if _failed or not context.window_manager.kiriko.show_overlay:
        return
    if not is_wanted(context.scene, context.area):
        return

    drawing = sketcher.drawing_of(context.scene)
    if drawing is None:
        return
    try:
        function(context, drawing, colours.FAINT if sketcher.is_faint(context.scene) else 1.0)
    except Exception as error:
        # which prints errors that were not foreseen
        _failed.append(telling.sentence(error, Message("The overlay")))


def draw_toggle(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    """One line in the viewport's overlays."""
    menu.layout.prop(context.window_manager.kiriko, "show_overlay")


_handlers = ViewHandlers(POST_VIEW=draw_in_space, POST_PIXEL=draw_in_pixels)


def register() -> None:
    """Begin to draw."""
    _failed.clear()
    pointer.register()
    _handlers.begin()
    bpy.types.VIEW3D_PT_overlay.append(draw_toggle)


def unregister() -> None:
    """Draw no more."""
    bpy.types.VIEW3D_PT_overlay.remove(draw_toggle)
    _handlers.end()
    pointer.unregister()
    batches.forget()
