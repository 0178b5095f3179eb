"""Plate preset: set the active plate's mirrors to those of a plate that can be bought."""

import bpy

from ..core.rig import PRESETS
from . import work


class KIRIKO_OT_plate_preset(bpy.types.Operator):
    """Set the mirrors of the active plate to those of a plate that can be bought"""

    bl_idname = "kiriko.plate_preset"
    bl_label = "Plate Preset"
    bl_options = {"REGISTER", "UNDO"}

    preset: bpy.props.EnumProperty(
        name="Preset",
        description="The plate whose mirrors the active one gets",
        items=[
            (name, name, f"Two crossed layers, {1e3 * array.pitch:g} mm from mirror to mirror")
            for name, array in PRESETS.items()
        ],
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        is_plate = context.active_object is not None and context.active_object.kiriko.role == "PLATE"
        return work.can_run(cls, [] if is_plate else ["Select a plate: an object whose role is Plate"])

    def execute(self, context: bpy.types.Context) -> set[str]:
        array, ours = PRESETS[self.preset], context.active_object.kiriko.plate
        ours.model = array.layout.upper()
        ours.pitch = 1e3 * array.pitch
        ours.height = array.height / array.pitch
        ours.ior, ours.reflectance = array.ior, array.reflectance
        ours.crossing_error, ours.fresnel, ours.phase = array.crossing_error, array.has_fresnel, array.phase
        return {"FINISHED"}
