"""Open Pictures: each viewer's own image, by the viewers' names in the names of files."""

import bpy

from ..core.base.errors import ImageError
from ..core.base.messages import Message
from ..core.blender.paths import RELATIVE_PATH, absolute, is_chosen
from ..core.blender.viewer import viewer_of
from . import needed, telling
from .of_rig import OfRig
from .viewer_images import names_of, open_images


class KIRIKO_OT_open_pictures(OfRig, bpy.types.Operator):
    """Open an image for each viewer: by a file with a viewer's name in its own, or a folder"""

    bl_idname = "kiriko.open_pictures"
    bl_label = "Open Pictures"
    bl_options = {"REGISTER", "UNDO"}

    filepath: bpy.props.StringProperty(
        name="File",
        description="The image file, or a folder of images",
        subtype="FILE_PATH",
        options={"SKIP_SAVE", *RELATIVE_PATH},
    )
    filter_image: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        is_there = viewer_of(context.scene) is not None or names_of(context.scene)
        return needed.can_run(cls, [] if is_there else [needed.NEEDED["VIEWER"]])

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.begin_with(context.scene)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        with telling.told(self):
            self.end_with(context)
            if not is_chosen(self.filepath):
                raise ImageError("No file is chosen: choose an image.")
            n = open_images(context.scene, str(absolute(self.filepath)))
            telling.report(self, "INFO", Message("{n} viewers have images of their own.", n=n))
            return {"FINISHED"}
        return {"CANCELLED"}
