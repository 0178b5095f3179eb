"""Show Image: one of the result's images, in the panel and in image editors."""

import bpy

from ..core.base.errors import RigError
from ..core.base.messages import Message
from ..core.blender.result_images import images_of
from . import needed, telling, windows

NO_IMAGE = Message("The result has no image: solve")


class KIRIKO_OT_show_image(bpy.types.Operator):
    """Show one of the result's images in the panel, and in image editors that show another of it"""

    bl_idname = "kiriko.show_image"
    bl_label = "Show Image"
    bl_options = {"REGISTER", "UNDO"}

    image: bpy.props.StringProperty(name="Image", description="Name of the image")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        found = images_of(context.scene.kiriko.result)
        return needed.can_run(cls, [] if found else [NO_IMAGE])

    def execute(self, context: bpy.types.Context) -> set[str]:
        result = context.scene.kiriko.result
        with telling.told(self):
            found = [image for image in images_of(result) if image.name == self.image]
            if not found:
                raise RigError(
                    "The result has no image '{image}': choose another in its menu.",
                    image=self.image,
                )
            windows.show_image(found[0], result)
            return {"FINISHED"}
        return {"CANCELLED"}
