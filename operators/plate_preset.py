"""Plate preset: make the active plate one that can be bought, its mirrors and its size."""

import bpy

from ..core.blender.chosen_product import give_plate
from ..core.catalogue import PLATES
from ..core.messages import Message
from . import needed, telling


class KIRIKO_OT_plate_preset(bpy.types.Operator):
    """Make the active plate one that can be bought: its mirrors and its size, about its middle"""

    bl_idname = "kiriko.plate_preset"
    bl_label = "Plate Preset"
    bl_options = {"REGISTER", "UNDO"}

    preset: bpy.props.EnumProperty(
        name="Preset",
        description="The plate whose mirrors and size the active one gets",
        items=[
            (
                name,
                name,
                Message(
                    "Two crossed layers, {pitch:g} mm from mirror to mirror, {side:g} mm a side",
                    pitch=1e3 * product.array.pitch,
                    side=1e3 * product.side,
                ),
            )
            for name, product in PLATES.items()
        ],
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        thing = context.active_object
        reasons = []
        if thing is None or thing.kiriko.role != "PLATE":
            reasons.append("Select a plate: an object whose role is Plate")
        elif not thing.is_editable:
            reasons.append("The plate is linked from another file: choose its preset there")
        return needed.can_run(cls, reasons)

    def execute(self, context: bpy.types.Context) -> set[str]:
        with telling.told(self):
            given = give_plate(context, context.active_object, PLATES[self.preset])
            telling.report(self, "INFO" if given.is_whole else "WARNING", given.text)
            return {"FINISHED"}

        return {"CANCELLED"}
