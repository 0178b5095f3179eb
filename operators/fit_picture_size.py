"""Fit picture: make the picture as large as gets through."""

import bpy

from ..core.base.messages import Message
from ..core.bench.part_sizes import fit_picture
from . import fitting, needed


class KIRIKO_OT_fit_picture_size(fitting.FitsPart, bpy.types.Operator):
    """Make the picture as large as gets through the glass to the display, up to twice its size"""

    bl_idname = "kiriko.fit_picture_size"
    bl_label = "Fit Picture"
    bl_options = {"REGISTER", "UNDO"}

    role = "PICTURE"
    share: fitting.share(0.999)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.scene.kiriko.picture_source == "IMAGE":
            reason = Message("The picture is in the viewer's own pixels and has no size")
            return needed.can_run(cls, [reason])
        return super().poll(context)

    @staticmethod
    def fit(rig, plan_of, wanted, number):
        return fit_picture(rig, plan_of, wanted)
