"""The rig: what each object is, and what is still missing."""

import bpy

from ..operators import work
from .settings import ROLES
from .words import Sidebar, sentence


class VIEW3D_PT_kiriko_rig(Sidebar, bpy.types.Panel):
    """What each object is in the rig, and what the rig still lacks."""

    bl_label = "Rig"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.operator("kiriko.add_rig", icon="ADD")
        if context.active_object is not None:
            self._draw_object(layout.box(), context.active_object)
        ours = context.scene.kiriko
        column = layout.column()
        column.prop(ours, "viewer")
        column.prop(ours, "picture_source")
        if ours.picture_source == "IMAGE":
            column.template_ID(ours, "picture_image", open="image.open")
        self._draw_parts(layout.column(align=True), context)
        layout.operator("kiriko.visible_range", icon="HIDE_OFF")

    def _draw_object(self, box: bpy.types.UILayout, thing: bpy.types.Object) -> None:
        ours = thing.kiriko
        box.label(text=thing.name, icon="OBJECT_DATA")
        box.prop(ours, "role")
        if ours.role == "GLASS":
            row = box.row(heading="Override IOR")
            row.prop(ours, "use_ior", text="")
            value = row.row()
            value.active = ours.use_ior
            value.prop(ours, "ior", text="")
            box.prop(ours, "priority")
        if ours.role == "PLATE":
            self._draw_plate(box, ours.plate)
        if ours.role in {"GLASS", "MIRROR"}:
            box.prop(ours, "surface")
        elif ours.role == "DISPLAY":
            box.prop(ours, "resolution")
        elif ours.role == "PICTURE":
            box.template_ID(ours, "image", open="image.open")

    def _draw_plate(self, box: bpy.types.UILayout, plate: bpy.types.PropertyGroup) -> None:
        box.prop(plate, "model")
        box.operator_menu_enum("kiriko.plate_preset", "preset", text="Preset", icon="PRESET")
        if plate.model == "IDEAL":
            return
        column = box.column(align=True)
        for name in ("pitch", "height", "ior", "reflectance"):
            column.prop(plate, name)
        if plate.model == "CROSSED":
            column.prop(plate, "crossing_error")
        box.prop(plate, "fresnel")
        box.prop(plate, "phase")

    def _draw_parts(self, column: bpy.types.UILayout, context: bpy.types.Context) -> None:
        found = work.parts(context.scene)
        for role, name, _, icon, _ in ROLES:
            if role in found:
                column.label(text=f"{name}: {', '.join(thing.name for thing in found[role])}", icon=icon)
        for phrase in work.missing(context.scene):
            sentence(column, context, f"{phrase}.", icon="ERROR")
