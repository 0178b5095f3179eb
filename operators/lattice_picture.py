"""Lattice picture: what is shown to calibrate a bench takes the picture's place."""

import bpy

from ..core.blender_image import encoded_image
from ..core.lattice import Lattice
from . import work

NAME = "Kiriko Calibration"
SIDE = 2048  # px


class KIRIKO_OT_lattice_picture(bpy.types.Operator):
    """Make the lattice the picture: solve, show the source image on the real display, photograph what is seen"""

    bl_idname = "kiriko.lattice_picture"
    bl_label = "Show Lattice"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        scene = context.scene
        is_there = scene.kiriko.picture_source == "IMAGE" or work.parts(scene).get("PICTURE")
        return work.can_run(cls, [] if is_there else ["No picture: set a plane's role to Picture"])

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene, ours = context.scene, context.scene.kiriko.calibration
        with work.told(self):
            lattice = Lattice(ours.columns, ours.rows, ours.margin)
            image = encoded_image(NAME, lattice.image(SIDE, SIDE, ours.style.lower()))
            if scene.kiriko.picture_source == "IMAGE":
                scene.kiriko.picture_image, where = image, "the scene's picture"
            else:
                picture = work.parts(scene)["PICTURE"][0]
                picture.kiriko.image, where = image, f"'{picture.name}'"
            text = f"The lattice is in {where}: solve, show it on the display, and photograph what is seen."
            self.report({"INFO"}, text)
            return {"FINISHED"}
        return {"CANCELLED"}
