"""Remove rig: all that Add Rig made goes, and what it changed is put back."""

import bpy

from ..core.blender.remove_rig import remove_rig, rig_of
from ..core.messages import Message, joined
from . import live, look_through, needed, telling, work


class KIRIKO_OT_remove_rig(bpy.types.Operator):
    """Remove all that was made for the rig, and put back what was changed; your own things stay"""

    bl_idname = "kiriko.remove_rig"
    bl_label = "Remove Rig"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reasons = [] if context.mode == "OBJECT" else [Message("Leave edit mode first")]
        if rig_of(context.scene, context.active_object) is None:
            reasons.append(Message("The scene has no rig that Add Rig made"))
        if work.is_busy():
            reasons.append(Message("Kiriko is at work: wait for it or press Esc"))
        return needed.can_run(cls, reasons)

    def execute(self, context: bpy.types.Context) -> set[str]:
        with telling.told(self):
            if context.scene.kiriko.looking:
                look_through.leave(context.scene)
            followed = live.followed()
            if followed is not None and followed.uid == context.scene.session_uid:
                live.stop()

            rig = rig_of(context.scene, context.active_object)
            names = remove_rig(context.scene, rig)
            stays = [
                Message("'{name}' stays, because other things use it.", name=name) for name in names
            ]
            telling.report(self, "INFO", joined([Message("The rig is removed."), *stays]))
            return {"FINISHED"}
        return {"CANCELLED"}
