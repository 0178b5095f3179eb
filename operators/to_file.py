"""Operators that write to a file or a folder chosen in Blender's dialogue."""

from pathlib import Path

import bpy

from ..core.base.errors import ImageError
from ..core.base.messages import Message, as_message
from ..core.blender.data.paths import RELATIVE_PATH, absolute
from . import long_work, needed, reporting
from .choose_rig import EndsWithRig

# File suffixes that are wrong for a file of another type.
OTHERS = {".bmp", ".exr", ".gif", ".jpeg", ".jpg", ".pdf", ".png", ".svg", ".tif", ".tiff", ".webp"}


class ToFile(EndsWithRig):
    """Mix-in for an operator that writes a file.

    default_name : of the file, with its suffix
    """

    default_name = ""

    filepath: bpy.props.StringProperty(
        name="File",
        description="Where to write",
        subtype="FILE_PATH",
        options={"SKIP_SAVE", *RELATIVE_PATH},
    )
    overwrite: bpy.props.BoolProperty(
        name="Overwrite",
        description="Replace existing files",
        options={"SKIP_SAVE", "HIDDEN"},
    )
    # properties the file dialogue expects
    check_existing: bpy.props.BoolProperty(default=True, options={"SKIP_SAVE", "HIDDEN"})
    filter_glob: bpy.props.StringProperty(options={"SKIP_SAVE", "HIDDEN"})

    is_in_dialogue = False

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.filepath = self.filepath or self.default_name
        self.filter_glob = f"*{Path(self.default_name).suffix}"
        self.is_in_dialogue = True
        self.begin_with(context.scene)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def check(self, context: bpy.types.Context) -> bool:
        """Called by the file dialogue: complete the name, so that an existing one turns red."""
        named = self._named()
        is_other = named != self.filepath
        self.filepath = named
        return is_other

    def path(self) -> Path:
        """Absolute path of the file with its suffix; ImageError if none was chosen."""
        if not self.filepath:
            raise ImageError(
                "{button} has no path: choose a file.", button=as_message(self.bl_label)
            )
        return absolute(self._named())

    def _named(self) -> str:
        """The name with its suffix, replacing that of another type, such as .pdf."""
        name, suffix = Path(self.filepath), Path(self.default_name).suffix
        if name.suffix.lower() in OTHERS - {suffix}:
            return self.filepath.removesuffix(name.suffix) + suffix
        return bpy.path.ensure_ext(self.filepath, suffix)


FOR_SCRIPTS = "pass overwrite=True"  # only scripts read it: a window asks


class AsksToReplace(long_work.LongWork):
    """Mix-in for an operator with long work that asks in a window before it replaces files.

    in_question : names of the settings that the work after the question needs
    """

    in_question: tuple[str, ...] = ()

    overwrite: bpy.props.BoolProperty(options={"SKIP_SAVE", "HIDDEN"})

    is_to_ask = False

    def existing(self, context: bpy.types.Context) -> list[Path]:
        """Files that the work would replace."""
        raise NotImplementedError

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        with reporting.errors_reported(self):
            is_sure = self.overwrite or not long_work.has_window(context)
            files = [] if is_sure else self.existing(context)
            if not files:
                return super().invoke(context, event)
            self.is_to_ask = True
            return context.window_manager.invoke_confirm(
                self,
                event,
                title=Message("Replace existing files?"),
                message=", ".join(map(str, [files[0], *(path.name for path in files[1:])])),
                confirm_text="Replace",
            )
        return {"CANCELLED"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not self.is_to_ask:
            return super().execute(context)
        # a dialogue's operator cannot continue in steps, so start another one
        again = getattr(bpy.ops.kiriko, type(self).__name__.partition("_OT_")[2])
        settings = {name: getattr(self, name) for name in self.in_question}
        again("INVOKE_DEFAULT", overwrite=True, **settings)
        return {"FINISHED"}


class IntoFolder(EndsWithRig, long_work.LongWork):
    """Mix-in for an operator with long work that writes to a folder.

    in_dialogue : names of the settings in the dialogue
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
        return needed.can_run(cls, needed.missing_parts(context.scene))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.directory or not long_work.has_window(context):
            return super().invoke(context, event)
        self.is_in_dialogue = True
        self.begin_with(context.scene)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not self.is_in_dialogue:
            return super().execute(context)

        # An operator of a dialogue cannot continue in steps; a second one can.
        with reporting.errors_reported(self):
            self.end_with(context)
            again = getattr(bpy.ops.kiriko, type(self).__name__.partition("_OT_")[2])
            settings = {name: getattr(self, name) for name in self.in_dialogue}
            again("INVOKE_DEFAULT", directory=self.directory, **settings)
            return {"FINISHED"}
        return {"CANCELLED"}
