"""The active rig: one list of its parts, its accuracy, and the choice among several rigs."""

import bpy

from ..core.blender.data.camera_viewer import viewer_of
from ..core.blender.data.rigs import active_rig, rigs
from ..core.blender.properties.object_settings import ROLE_ITEMS
from ..operators import needed
from ..operators.part_verbs import name_part
from .object import PRODUCTS, draw_product, labelled
from .panel_text import OfRig, with_labels

NAME = 7.0  # units of Blender's interface, the width of a rig's name in the panel's head


class VIEW3D_PT_kiriko_rig(OfRig, bpy.types.Panel):
    """The parts, each with a button that selects it, and the accuracy of a solve."""

    bl_label = "Rig"

    def draw(self, context: bpy.types.Context) -> None:
        layout = with_labels(self.layout)
        self._draw_parts(layout.column(align=True), context)
        column = layout.column(align=True)
        column.use_property_split = False  # half of the sidebar would cut the names
        column.prop(context.scene.kiriko, "tolerance")
        column.prop(context.scene.kiriko, "effort")

    def _draw_parts(self, column: bpy.types.UILayout, context: bpy.types.Context) -> None:
        """One line for each part, and one for its product."""
        viewer = viewer_of(context.scene)
        if viewer is not None:
            draw_part(column, context, "Viewer", viewer, "OUTLINER_OB_CAMERA")

        found = needed.parts(context.scene)
        for role, name, _, icon, _ in ROLE_ITEMS:
            if role == "PICTURE" and context.scene.kiriko.picture_source == "IMAGE":
                continue  # the plane is not used
            for thing, by in found.get(role, {}).items():
                draw_part(column, context, name, thing, icon, by)


def draw_part(
    column: bpy.types.UILayout,
    context: bpy.types.Context,
    role: str,
    thing: bpy.types.Object,
    icon: str,
    by: str = "",
) -> None:
    """A button that selects a part, pressed if it is active and grey if it is hidden; its product.

    by : the part is hidden by this; '' for nothing
    """
    row = labelled(column, role)
    one = row.row(align=True)
    one.active = not by
    button = one.operator(
        "kiriko.select_part",
        text=thing.name,
        icon="HIDE_ON" if by else icon,
        depress=thing == context.active_object,
        translate=False,
    )
    name_part(button, thing)
    if by:
        name_part(row.operator("kiriko.show_part", text="", icon="HIDE_OFF"), thing)
    elif thing.kiriko.role in PRODUCTS:
        draw_product(labelled(column, ""), context, thing)


class VIEW3D_MT_kiriko_rigs(bpy.types.Menu):
    """The rigs of the scene."""

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
    """The name of the active rig, and a menu of several rigs."""
    found, active = rigs(context.scene), active_rig(context.scene)
    row = layout.row(align=True)
    if len(found) > 1:
        row.menu(VIEW3D_MT_kiriko_rigs.bl_idname, text="", icon="OUTLINER_COLLECTION")
    if active is not None:
        name = row.row()
        name.ui_units_x = NAME
        name.prop(active, "name", text="")
