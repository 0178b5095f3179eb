"""Plate preset: make the active plate one that can be bought, its mirrors and its size."""

import bpy

from ..core.base.messages import Message
from ..core.blender.chosen_product import Given, give_plate
from ..core.rig.catalogue import PLATES
from .preset import GivesProduct

TIPS = {
    name: Message(
        "Two crossed layers, {pitch:g} mm from mirror to mirror, {side:g} mm a side",
        pitch=1e3 * product.array.pitch,
        side=1e3 * product.side,
    )
    for name, product in PLATES.items()
}


class KIRIKO_OT_plate_preset(GivesProduct, bpy.types.Operator):
    """Make the active plate one that can be bought: its mirrors and its size, about its middle"""

    bl_idname = "kiriko.plate_preset"
    bl_label = "Plate Preset"
    bl_options = {"REGISTER", "UNDO"}

    preset: bpy.props.EnumProperty(
        name="Preset",
        description="The plate whose mirrors and size the active one gets",
        items=[(name, name, tip) for name, tip in TIPS.items()],
    )

    role = "PLATE"

    def given(self, context: bpy.types.Context, thing: bpy.types.Object) -> Given:
        return give_plate(context, thing, PLATES[self.preset])
