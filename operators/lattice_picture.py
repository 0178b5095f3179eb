"""Lattice picture: the lattice that calibrates a bench takes the picture's place."""

import bpy

from ..core.base.errors import RigError
from ..core.base.messages import Message, quoted
from ..core.blender.image import encoded_image
from ..core.blender.plane import plane_size
from ..core.lab.calibrate.drawn import Lattice
from . import needed, telling

NAME = "Kiriko Calibration"
SIDE = 2048  # px


def _pixels(context: bpy.types.Context, picture: bpy.types.Object) -> tuple[int, int]:
    """Pixels of a lattice that has the shape of its plane, so that its dots are round."""
    try:
        width, height = plane_size(context, picture)
    except RigError:
        return SIDE, SIDE
    longer = max(width, height)
    return max(1, round(SIDE * width / longer)), max(1, round(SIDE * height / longer))


class KIRIKO_OT_lattice_picture(bpy.types.Operator):
    """Make the lattice the picture: solve, show it on the real display, photograph the glass"""

    bl_idname = "kiriko.lattice_picture"
    bl_label = "Show Lattice"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        scene = context.scene
        is_there = scene.kiriko.picture_source == "IMAGE" or needed.has_part(scene, "PICTURE")
        return needed.can_run(
            cls, [] if is_there else [Message("No picture: set a plane's role to Picture")]
        )

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        ours = context.scene.kiriko.calibration

        with telling.told(self):
            lattice = Lattice(ours.columns, ours.rows, ours.margin)
            style = ours.style.lower()

            if scene.kiriko.picture_source == "IMAGE":
                image = encoded_image(NAME, lattice.image(SIDE, SIDE, style))
                scene.kiriko.picture_image = image
                for one in scene.kiriko.viewers:
                    one.image = one.image and image
                where = Message("the scene's picture")
            else:
                picture = next(iter(needed.parts(scene)["PICTURE"]))
                image = encoded_image(NAME, lattice.image(*_pixels(context, picture), style))
                picture.kiriko.image, where = image, quoted([picture.name])

            text = Message(
                "The lattice is in {where}: solve, show it on the display, and photograph"
                " the view.",
                where=where,
            )
            telling.report(self, "INFO", text)
            return {"FINISHED"}

        return {"CANCELLED"}
