"""All windows of Blender, and what is drawn in them."""

import bpy


def all_windows() -> list[bpy.types.Window]:
    """All windows of Blender."""
    return [window for manager in bpy.data.window_managers for window in manager.windows]


def redraw() -> None:
    """Have panels, viewports and image editors drawn again."""
    for window in all_windows():
        for area in window.screen.areas:
            if area.type in {"VIEW_3D", "IMAGE_EDITOR"}:
                area.tag_redraw()
