"""Move a calibration's offset into the scene, or remove it."""

import bpy

from ..core.base.messages import Message
from ..core.blender.calibration import put_into_scene
from ..core.blender.stored_records import Offset
from . import needed, telling, watch, work


def without_offset(scene: bpy.types.Scene) -> list[str]:
    """The reason why nothing can be done with an offset, where there is none."""
    return (
        [] if scene.kiriko.calibration.offset else [Message("No calibration is kept as an offset")]
    )


class KIRIKO_OT_apply_calibration(bpy.types.Operator):
    """Move the objects and set their optics as the calibration's offset says; the offset goes"""

    bl_idname = "kiriko.apply_calibration"
    bl_label = "Apply to Scene"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, without_offset(context.scene) + needed.lacking(context.scene))

    def execute(self, context: bpy.types.Context) -> set[str]:
        n = len(Offset.read(context.scene.kiriko.calibration.offset).sets)
        with telling.told(self):
            reading = work.read(context)
            reading.rig.check()
            is_current = not watch.has_changed(context)

            with put_into_scene(context.scene, reading, lambda: work.read(context)):
                result = context.scene.kiriko.result
                # it is the same rig as before, written another way
                if result.solved_for and is_current:
                    result.solved_for = work.scene_now(context).as_text()

                telling.report(
                    self,
                    "INFO",
                    Message(
                        "The scene is now as {n} calibration{s} found the bench.",
                        n=n,
                        s="s" if n > 1 else "",
                    ),
                )

            return {"FINISHED"}

        return {"CANCELLED"}


class KIRIKO_OT_remove_calibration(bpy.types.Operator):
    """Forget the calibration's offset: the rig is as the scene shows it"""

    bl_idname = "kiriko.remove_calibration"
    bl_label = "Remove Offset"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, without_offset(context.scene))

    def execute(self, context: bpy.types.Context) -> set[str]:
        ours = context.scene.kiriko.calibration
        ours.offset = ours.found = ""
        telling.report(self, "INFO", Message("The offset is gone: solve again."))
        return {"FINISHED"}
