"""What the interface shows of a rig. Neither scenes nor results depend on it."""

import bpy


class KirikoView(bpy.types.PropertyGroup):
    """What the interface shows of a rig."""

    # show_overlay: see `register`


def redraw(_settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Have all viewports drawn again."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
