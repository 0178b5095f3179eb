"""Add > Kiriko."""

import bpy

from ..core.base.messages import Message, as_message
from ..operators.add_rig import KINDS, MORE
from ..operators.reporting import in_words

ICONS = {"IN_GLASS": "MATSPHERE", "BEHIND_GLASS": "RESTRICT_VIEW_OFF"}


def labels_of(words: str) -> list[str]:
    """Labels of the buttons that add a rig, one for each kind: `words: kind`."""
    texts = (
        Message("{part}: {amount}", part=as_message(words), amount=as_message(label))
        for _, label, _ in KINDS
    )
    return [in_words(text) for text in texts]


def add_rig(layout: bpy.types.UILayout, labels: list[str]) -> None:
    """A button for each kind of rig, with its label."""
    for (kind, _, _), text in zip(KINDS, labels, strict=True):
        button = layout.operator("kiriko.add_rig", text=text, icon=ICONS[kind])
        button.kind = kind


class VIEW3D_MT_kiriko_add(bpy.types.Menu):
    """Kiriko's entries in the Add menu."""

    bl_label = "Kiriko"

    def draw(self, context: bpy.types.Context) -> None:
        add_rig(self.layout, labels_of("Rig"))
        self.layout.menu("VIEW3D_MT_kiriko_more", text="Rig: More", icon="ADD")
        self.layout.operator("kiriko.add_plate_material", icon="MATERIAL")


class VIEW3D_MT_kiriko_more(bpy.types.Menu):
    """Rigs that bring all their parts."""

    bl_label = "More Rigs"

    def draw(self, context: bpy.types.Context) -> None:
        for kind, label, _ in MORE:
            button = self.layout.operator("kiriko.add_rig", text=in_words(label), translate=False)
            button.kind = kind


def draw(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Add a line to the Add menu."""
    if context.mode == "OBJECT":
        menu.layout.menu("VIEW3D_MT_kiriko_add", icon="MATSPHERE")
