"""The first panel: the things to do, each with a button that does it."""

import bpy

from ..core.messages import Message
from ..operators import needed
from .add_menu import add_rig
from .words import Sidebar, sentence

FIRST = Message(
    "Select your glass and press Add Rig: display, picture and viewer are placed around it, and a"
    " plate where the picture is to be in the glass."
)


class VIEW3D_PT_kiriko_checklist(Sidebar, bpy.types.Panel):
    """The first step, or the things that are left to do."""

    bl_label = "Kiriko"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        """Is the light's way drawn over the viewport?"""
        if needed.has_rig(context.scene):
            shown = context.window_manager.kiriko
            self.layout.prop(shown, "show_overlay", text="", icon="OVERLAY", emboss=False)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        if not needed.has_rig(context.scene):
            sentence(layout, context, FIRST)
            column = layout.column(align=True)
            column.scale_y = 1.5
            add_rig(column, "Add Rig")
            return

        missing = needed.missing(context.scene)
        for phrase in missing:
            sentence(layout, context, Message("{reason}.", reason=phrase), icon="ERROR")
        if not missing:
            sentence(layout, context, "Ready.", icon="CHECKMARK")
