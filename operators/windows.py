"""Blender's windows, and redrawing them."""

import bpy

from ..core.blender.result.result_images import images_of


def all_windows() -> list[bpy.types.Window]:
    """All windows of Blender."""
    return [window for manager in bpy.data.window_managers for window in manager.windows]


def redraw() -> None:
    """Redraw panels, viewports, image editors and show windows."""
    for window in all_windows():
        for area in window.screen.areas:
            # the last for show windows
            is_ours = area.type in {"VIEW_3D", "IMAGE_EDITOR", "TEXT_EDITOR"}
            if is_ours or (area.type == "PROPERTIES" and area.spaces.active.context == "OBJECT"):
                area.tag_redraw()


def redraw_sidebars() -> None:
    """Redraw only the sidebars of all viewports."""
    for window in all_windows():
        for area in window.screen.areas:
            for region in area.regions if area.type == "VIEW_3D" else ():
                if region.type == "UI":
                    region.tag_redraw()


def image_editors() -> list[bpy.types.SpaceImageEditor]:
    """Image editors of all windows."""
    areas = (area for window in all_windows() for area in window.screen.areas)
    return [area.spaces.active for area in areas if area.type == "IMAGE_EDITOR"]


def show_image(image: bpy.types.Image, result: bpy.types.PropertyGroup) -> None:
    """Show an image of a result in the panel, and in image editors that are free for it.

    These show nothing, a render, or another image of the result.
    """
    result.shown = image
    ours = {None, *images_of(result)}
    for space in image_editors():
        if space.image in ours or space.image.type == "RENDER_RESULT":
            space.image = image


def show_where_empty(image: bpy.types.Image) -> None:
    """Show a preliminary image in empty image editors; an open render is left alone."""
    for space in image_editors():
        if space.image is None:
            space.image = image


def camera_of(space: bpy.types.SpaceView3D, scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Camera of a 3D view in camera view."""
    return space.camera if space.use_local_camera else scene.camera


def view_of(context: bpy.types.Context) -> bpy.types.Area | None:
    """The 3D view in use: of the context, otherwise the window's largest."""
    if context.window is None:
        return None
    if context.area is not None and context.area.type == "VIEW_3D":
        return context.area

    found = [area for area in context.window.screen.areas if area.type == "VIEW_3D"]
    return max(found, key=lambda area: area.width * area.height, default=None)
