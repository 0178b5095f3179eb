"""Remove Rig: removes everything Add Rig made, and restores what it changed."""

import bpy

from ..core.base.messages import Message, joined
from ..core.blender.data.rigs import active_rig, rig_of
from ..core.blender.lifecycle.rig_removal import refuse_shared, remove_rig
from . import compared, live, look_through, needed, reporting, work
from .choose_rig import is_new

NO_COLLECTION = Message("Add Rig didn't make this rig: delete its parts by hand")


def rig_to_remove(context: bpy.types.Context) -> bpy.types.Collection | None:
    """The rig of an object just selected, otherwise the active one; None if there is none."""
    scene, thing = context.scene, context.active_object
    # A rig that is looked through stays active, whatever is selected.
    is_followed = not scene.kiriko_scene.looking and is_new(scene, thing)
    return (rig_of(scene, thing) if is_followed else None) or active_rig(scene)


class KIRIKO_OT_remove_rig(bpy.types.Operator):
    """Remove everything Add Rig made and restore what it changed; your objects stay"""

    bl_idname = "kiriko.remove_rig"
    bl_label = "Remove Rig"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reasons = [] if context.mode == "OBJECT" else [needed.LEAVE_EDIT_MODE]
        if rig_to_remove(context) is None:
            has_parts = any(thing.kiriko.role != "NONE" for thing in context.scene.objects)
            reasons.append(NO_COLLECTION if has_parts else needed.NO_RIG)
        if work.is_busy():
            reasons.append(needed.AT_WORK)
        return needed.can_run(cls, reasons)

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            rig = rig_to_remove(context)
            refuse_shared(context.scene, rig)
            if context.scene.kiriko_scene.looking:
                look_through.leave(context.scene)
            if compared.is_shown(context.scene):
                compared.leave()
            if live.follows(context.scene):
                live.stop()

            names = remove_rig(context.scene, rig)
            stays = [
                Message("'{name}' was kept because something else uses it.", name=name)
                for name in names
            ]
            reporting.report(self, "INFO", joined([Message("Rig removed."), *stays]))
            return {"FINISHED"}
        return {"CANCELLED"}
