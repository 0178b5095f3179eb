"""Fit to image: give the picture's plane the shape of its image."""

import bpy

from ..core.base.errors import ImageError, RigError
from ..core.base.messages import Message
from ..core.blender.plane import fit, shown_as, squeezed_words
from . import needed, telling
from .choose_picture import lacking
from .needed import the_picture


class KIRIKO_OT_fit_picture(bpy.types.Operator):
    """Give the picture's plane the shape of its image, its area kept"""

    bl_idname = "kiriko.fit_picture"
    bl_label = "Fit to Image"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reasons = lacking(context)
        if not reasons:
            try:
                if not squeezed_words(shown_as(context, the_picture(context))):
                    reasons.append(Message("The picture has the shape of its image already"))
            except (RigError, ImageError):
                pass  # told when it is pressed
        return needed.can_run(cls, reasons)

    def execute(self, context: bpy.types.Context) -> set[str]:
        picture = the_picture(context)
        with telling.told(self):
            try:
                before = fit(context, picture)
            except RigError as why:
                raise RigError(
                    "'{picture}' keeps its shape, for {why}.", picture=picture.name, why=why
                ) from None

            telling.report(
                self,
                "INFO",
                Message(
                    "'{picture}' has the shape of its image now; it was {squeezed}.",
                    picture=picture.name,
                    squeezed=squeezed_words(before),
                ),
            )
            return {"FINISHED"}

        return {"CANCELLED"}
