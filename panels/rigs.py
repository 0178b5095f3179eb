"""The rigs of the scene: which one is shown, and the choice of another."""

import bpy

from ..core.blender.rigs import active_rig, rigs


class VIEW3D_MT_kiriko_rigs(bpy.types.Menu):
    """Rigs of the scene, to be shown."""

    bl_idname = "VIEW3D_MT_kiriko_rigs"
    bl_label = "Choose Rig"

    def draw(self, context: bpy.types.Context) -> None:
        active = active_rig(context.scene)
        for rig in rigs(context.scene):
            icon = "RADIOBUT_ON" if rig == active else "RADIOBUT_OFF"
            choice = self.layout.operator(
                "kiriko.choose_rig", text=rig.name, icon=icon, translate=False
            )
            choice.rig = rig.name


def draw_rigs(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The rig that is shown, by its collection's name, others to be chosen, and one to be added."""
    found, active = rigs(context.scene), active_rig(context.scene)
    if not found:
        return

    row = layout.row(align=True)
    if len(found) > 1:
        row.menu(VIEW3D_MT_kiriko_rigs.bl_idname, text="", icon="OUTLINER_COLLECTION")
    if active is not None:
        row.prop(active, "name", text="")
    row.operator_menu_enum("kiriko.add_rig", "kind", text="", icon="ADD")
