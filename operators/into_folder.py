"""Operators that write files to a folder by long work: it is chosen in Blender's dialogue."""

import bpy

from ..core.blender.paths import RELATIVE_PATH
from . import long_work, needed, telling
from .of_rig import OfRig


class IntoFolder(OfRig, long_work.LongWork):
    """Mix-in for an operator with long work that writes to a folder.

    in_dialogue : names of the settings that the dialogue shows
    """

    in_dialogue: tuple[str, ...] = ()

    directory: bpy.props.StringProperty(
        name="Folder",
        description="Where to write",
        subtype="DIR_PATH",
        options={"SKIP_SAVE", *RELATIVE_PATH},
    )
    filter_folder: bpy.props.BoolProperty(default=True, options={"SKIP_SAVE", "HIDDEN"})

    is_in_dialogue = False

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, needed.lacking(context.scene))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.directory or bpy.app.background or context.window is None:
            return super().invoke(context, event)
        self.is_in_dialogue = True
        self.begin_with(context.scene)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not self.is_in_dialogue:
            return super().execute(context)

        # an operator of a dialogue cannot go on in steps: another one can
        with telling.told(self):
            self.end_with(context)
            again = getattr(bpy.ops.kiriko, type(self).__name__.partition("_OT_")[2])
            settings = {name: getattr(self, name) for name in self.in_dialogue}
            again("INVOKE_DEFAULT", directory=self.directory, **settings)
            return {"FINISHED"}
        return {"CANCELLED"}
