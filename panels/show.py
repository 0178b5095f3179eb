"""The show: a window with the source image alone."""

import bpy

from ..core.base.messages import Message
from ..core.blender.rigs import rigs
from ..operators import show_window
from ..operators.wrapping import sentence
from .words import OfRig


class VIEW3D_PT_kiriko_show(OfRig, bpy.types.Panel):
    """The source image on its display, from within Blender."""

    bl_label = "Show"
    bl_parent_id = "VIEW3D_PT_kiriko_export"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        if len(rigs(context.scene)) > 1:
            layout.prop(context.window_manager.kiriko, "show_rig")
        layout.operator("kiriko.show_window", icon="WINDOW")

        image = show_window.shown_result(context.scene).source
        for window in show_window.show_windows():
            size = show_window.size_of(window)
            if image is not None:
                is_whole = size == tuple(image.size)
                icon = "CHECKMARK" if is_whole else "ERROR"
                sentence(layout, context, words_on(size, tuple(image.size), _keys(context)), icon)


def _keys(context: bpy.types.Context) -> str:
    return show_window.key_of_full_screen(context) or Message("Window > Toggle Window Fullscreen")


def words_on(size: tuple[int, int], image: tuple[int, int], keys: str) -> Message:
    """A sentence on a show window of so many pixels, and an image of so many."""
    width, height = image
    if size == image:
        return Message(
            "The window has the image's {width} x {height} pixels.", width=width, height=height
        )
    return Message(
        "The window has {across} x {down} pixels, the image {width} x {height}: drag the window to"
        " the display and press {keys}.",
        across=size[0],
        down=size[1],
        width=width,
        height=height,
        keys=keys,
    )
