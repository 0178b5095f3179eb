"""Add > Kiriko."""

import bpy

from ..core.messages import Message, as_message
from ..operators.add_rig import KINDS
from ..operators.telling import in_words


def add_rig(layout: bpy.types.UILayout, words: str) -> None:
    """A button for each kind of rig, with words before its name."""
    icons = {"IN_GLASS": "MATSPHERE", "BEHIND_GLASS": "RESTRICT_VIEW_OFF"}
    for kind, label, _ in KINDS:
        text = in_words(Message("{words}: {kind}", words=as_message(words), kind=as_message(label)))
        button = layout.operator("kiriko.add_rig", text=text, icon=icons[kind])
        button.kind = kind


class VIEW3D_MT_kiriko_add(bpy.types.Menu):
    """Kiriko's entries in the Add menu."""

    bl_label = "Kiriko"

    def draw(self, context: bpy.types.Context) -> None:
        add_rig(self.layout, "Rig")
        self.layout.operator("kiriko.add_plate_material", text="Plate Material", icon="MATERIAL")


def draw(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    """One line in the Add menu."""
    if context.mode == "OBJECT":
        menu.layout.menu("VIEW3D_MT_kiriko_add", icon="MATSPHERE")
