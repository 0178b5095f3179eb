"""Solve and preview."""

import bpy

from ..operators import live, look_over, look_through, needed
from ..operators.wrapping import sentence
from .panel_text import OfRig


class VIEW3D_PT_kiriko_solve(OfRig, bpy.types.Panel):
    """The buttons that solve and show."""

    bl_label = "Solve"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        buttons = layout.column(align=True)
        buttons.scale_y = 1.3
        buttons.enabled = not look_over.have_moved(context.scene)
        buttons.operator("kiriko.solve", icon="LIGHT_SUN")
        is_on = live.follows(context.scene)
        buttons.operator("kiriko.live", icon="PAUSE" if is_on else "PLAY", depress=is_on)
        is_looking = bool(context.scene.kiriko_scene.looking)
        buttons.operator("kiriko.look_through", icon="VIEW_CAMERA", depress=is_looking)
        buttons.operator("kiriko.simulate", icon="IMAGE_DATA")
        buttons.operator("kiriko.preview", icon="RENDER_STILL")
        view = context.window_manager.kiriko
        buttons.operator(
            "kiriko.before_after", icon="ARROW_LEFTRIGHT", depress=view.show_comparison
        )
        if view.show_comparison:
            row = layout.row(align=True)
            row.prop(view, "left", text="")
            row.prop(view, "right", text="")
            layout.prop(view, "wipe")
            layout.operator("kiriko.save_comparison", icon="FILE_TICK")
        text, is_problem = live.status(context.scene)
        if text:
            sentence(layout, context, text, icon="ERROR" if is_problem else "INFO")
        otherwise = look_through.otherwise(context.scene)
        if otherwise is not None:
            sentence(layout, context, otherwise, icon="ERROR")


class VIEW3D_PT_kiriko_settings(OfRig, bpy.types.Panel):
    """How to solve."""

    bl_label = "Settings"
    bl_parent_id = "VIEW3D_PT_kiriko_solve"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        ours = context.scene.kiriko
        column = layout.column()
        column.prop(ours, "tolerance")
        column.prop(ours, "brightness")
        column.prop(ours, "ghosts")
        column.prop(ours, "only_through_glass")
        row = column.row()
        row.active = needed.has_part(context.scene, "PLATE")
        row.prop(ours, "only_through_plate")
        row = column.row()
        row.active = ours.only_through_glass
        row.prop(ours, "suppress_glare")

        column = layout.column()
        column.prop(ours, "margin")
        column.prop(ours, "max_events")
        column.prop(ours, "effort")


class VIEW3D_PT_kiriko_preview(OfRig, bpy.types.Panel):
    """Settings of the next preview, which the operator remembers from call to call."""

    bl_label = "Preview Settings"
    bl_parent_id = "VIEW3D_PT_kiriko_solve"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        remembered = context.window_manager.operator_properties_last("kiriko.preview")
        for name in ("samples", "percentage", "reflections", "surroundings"):
            layout.prop(remembered, name)
