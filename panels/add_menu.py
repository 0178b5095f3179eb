"""Add > Kiriko."""

import bpy


class VIEW3D_MT_kiriko_add(bpy.types.Menu):
    """Kiriko's entries in the Add menu."""

    bl_label = "Kiriko"

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.operator("kiriko.add_rig", text="Rig", icon="MATSPHERE")
        self.layout.operator("kiriko.add_plate_material", text="Plate Material", icon="MATERIAL")


def draw(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    """One line in the Add menu."""
    if context.mode == "OBJECT":
        menu.layout.menu("VIEW3D_MT_kiriko_add", icon="MATSPHERE")
