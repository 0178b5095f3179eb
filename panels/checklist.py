"""The first panel: the things to do, each with a button that does it."""

import bpy

from ..core.messages import Message
from ..operators import needed
from .words import Sidebar, sentence

FIRST = Message(
    "Select your glass and press Add Rig: plate, display, picture and viewer are placed around it."
)


class VIEW3D_PT_kiriko_checklist(Sidebar, bpy.types.Panel):
    """The first step, or the things that are left to do."""

    bl_label = "Kiriko"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        if not needed.has_rig(context.scene):
            sentence(layout, context, FIRST)
            row = layout.row()
            row.scale_y = 1.5
            row.operator("kiriko.add_rig", icon="ADD")
            return

        missing = needed.missing(context.scene)
        for phrase in missing:
            sentence(layout, context, Message("{reason}.", reason=phrase), icon="ERROR")
        if not missing:
            sentence(layout, context, "Ready.", icon="CHECKMARK")
