"""Check, which simulates and renders the view, and Advanced, with all further settings."""

import bpy

from ..operators import needed
from .object import draw_object
from .panel_text import Closed, with_labels


class VIEW3D_PT_kiriko_check(Closed, bpy.types.Panel):
    """Simulate, Preview, and the settings of Before and After."""

    bl_label = "Check"

    def draw(self, context: bpy.types.Context) -> None:
        layout = with_labels(self.layout)
        layout.operator("kiriko.simulate", icon="IMAGE_DATA")
        layout.operator("kiriko.preview", icon="RENDER_STILL")
        remembered = context.window_manager.operator_properties_last("kiriko.preview")
        column = layout.column()
        for name in ("samples", "percentage", "reflections", "surroundings"):
            column.prop(remembered, name)

        view = context.window_manager.kiriko
        column = layout.column()
        for name in ("left", "right", "wipe"):
            column.prop(view, name)
        layout.operator("kiriko.save_comparison", icon="FILE_TICK")
        layout.prop(view, "show_overlay")
        remembered = context.window_manager.operator_properties_last("kiriko.draw_light_paths")
        layout.prop(remembered, "count")
        layout.operator("kiriko.draw_light_paths", icon="CURVE_PATH")


class VIEW3D_PT_kiriko_advanced(Closed, bpy.types.Panel):
    """Further settings of Solve, the settings of the active object, and Remove Rig."""

    bl_label = "Advanced"

    def draw(self, context: bpy.types.Context) -> None:
        layout = with_labels(self.layout)
        ours = context.scene.kiriko
        column = layout.column()
        for name in ("brightness", "sharpen", "ghosts", "only_through_glass"):
            column.prop(ours, name)
        row = column.row()
        row.active = needed.has_part(context.scene, "PLATE")
        row.prop(ours, "only_through_plate")
        row = column.row()
        row.active = ours.only_through_glass
        row.prop(ours, "suppress_glare")
        column.prop(ours, "margin")
        column.prop(ours, "max_events")

        thing = context.active_object
        if thing is not None:
            column = layout.box().column()
            column.label(text=thing.name, icon="OBJECT_DATA", translate=False)
            draw_object(column, context, thing)
        layout.operator_menu_enum("kiriko.add_rig", "kind", icon="ADD")
        layout.operator("kiriko.remove_rig", icon="TRASH")
