"""Plate preset: make the active plate one that can be bought, its mirrors and its size."""

import bpy

from ..core.blender.resize import give_side
from ..core.blender.units import length_of_unit, length_text
from ..core.errors import RigError
from ..core.messages import Message
from ..core.rig import PRESET_SIDES, PRESETS
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
                    pitch=1e3 * array.pitch,
                    side=1e3 * PRESET_SIDES[name],
                ),
            )
            for name, array in PRESETS.items()
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
        plate = context.active_object
        side = PRESET_SIDES[self.preset]
        length = length_text(context.scene, side)

        with telling.told(self):
            try:
                give_side(context, plate, side / length_of_unit(context.scene))
            except RigError as why:
                level = "WARNING"
                text = Message(
                    "'{plate}' has the mirrors of {preset} now, but not its size of"
                    " {length}: {why}.",
                    plate=plate.name,
                    preset=self.preset,
                    length=length,
                    why=why,
                )
            else:
                level = "INFO"
                text = Message(
                    "'{plate}' has the mirrors of {preset} now, and its size: {length} a side.",
                    plate=plate.name,
                    preset=self.preset,
                    length=length,
                )

            _set_mirrors(plate, self.preset)
            telling.report(self, level, text)
            return {"FINISHED"}

        return {"CANCELLED"}


def _set_mirrors(plate: bpy.types.Object, preset: str) -> None:
    array = PRESETS[preset]
    ours = plate.kiriko.plate
    ours.model = array.layout.upper()
    ours.pitch = 1e3 * array.pitch
    ours.height = array.height / array.pitch
    ours.ior = array.ior
    ours.reflectance = array.reflectance
    ours.crossing_error = array.crossing_error
    ours.fresnel = array.has_fresnel
    ours.phase = array.phase
