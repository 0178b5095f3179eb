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


def view_of(context: bpy.types.Context) -> bpy.types.Area | None:
    """The 3D view that is worked in: the one of the context, else the window's largest."""
    if context.window is None:
        return None
    if context.area is not None and context.area.type == "VIEW_3D":
        return context.area

    found = [area for area in context.window.screen.areas if area.type == "VIEW_3D"]
    return max(found, key=lambda area: area.width * area.height, default=None)
