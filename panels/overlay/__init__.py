"""The overlay: light paths through the rig, drawn over the viewport while the Kiriko tab is open.

`operators/sketcher.py` keeps its plain data up to date. This room only hands them to the GPU:
nothing is read, traced or changed while a viewport is drawn.
"""

from collections.abc import Callable

import bpy

from ...core.base.messages import Message
from ...operators import reporting, sketcher
from ...operators.sketcher import SketchDrawing
from . import batches, colours, lines, overlay_text, pointer
from .view_handlers import ViewHandlers

_failed: list[str] = []  # errors that switched the overlay off, until Kiriko is enabled again


def draw_in_space() -> None:
    """Draw within the scene; Blender calls it for each viewport."""
    _draw(lines.draw)
    _draw(lines.draw_contours, sketcher.looks_through)


def draw_in_pixels() -> None:
    """Draw over the pixels; Blender calls it for each viewport."""
    _draw(overlay_text.draw)


def _draw(
    function: Callable[[bpy.types.Context, SketchDrawing, float], None],
    is_wanted: Callable[[bpy.types.Scene, bpy.types.Area], bool] = (
        lambda scene, area: sketcher.is_looked_at(area)
    ),
) -> None:
    """Draw in a viewport that wants it. An error ends the overlay, not Blender's drawing."""
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
        # also prints unexpected errors
        _failed.append(reporting.sentence(error, Message("The overlay")))


def draw_toggle(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Add a line to the viewport's Overlays menu."""
    menu.layout.prop(context.window_manager.kiriko, "show_overlay")


_handlers = ViewHandlers(POST_VIEW=draw_in_space, POST_PIXEL=draw_in_pixels)


def register() -> None:
    """Start drawing."""
    _failed.clear()
    pointer.register()
    _handlers.begin()
    bpy.types.VIEW3D_PT_overlay.append(draw_toggle)


def unregister() -> None:
    """Stop drawing."""
    bpy.types.VIEW3D_PT_overlay.remove(draw_toggle)
    _handlers.end()
    pointer.unregister()
    batches.forget()
