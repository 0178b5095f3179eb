"""Operators that write a file of one kind: chosen in Blender's dialogue, never replaced unasked."""

from pathlib import Path

import bpy

from ..core.base.errors import ImageError
from ..core.base.messages import as_message
from ..core.blender.paths import RELATIVE_PATH, absolute
from .of_rig import OfRig

# of kinds of files, which say nothing where a file is of another kind
OTHERS = {".bmp", ".exr", ".gif", ".jpeg", ".jpg", ".pdf", ".png", ".svg", ".tif", ".tiff", ".webp"}


class ToFile(OfRig):
    """Mix-in for an operator that writes a file.

    default_name : of the file, whose suffix all have
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
        description="Replace what is there already",
        options={"SKIP_SAVE", "HIDDEN"},
    )
    # the file dialogue asks an operator for these
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
        """Called by the file dialogue: complete the name, so that one that is taken is red."""
        named = self._named()
        is_other = named != self.filepath
        self.filepath = named
        return is_other

    def path(self) -> Path:
        """The file, absolute, with its suffix; ImageError where none was chosen."""
        if not self.filepath:
            raise ImageError(
                "{button} has no path: choose a file.", button=as_message(self.bl_label)
            )
        return absolute(self._named())

    def _named(self) -> str:
        """The name with its suffix, in place of another kind's, such as .pdf."""
        name, suffix = Path(self.filepath), Path(self.default_name).suffix
        if name.suffix.lower() in OTHERS - {suffix}:
            return self.filepath.removesuffix(name.suffix) + suffix
        return bpy.path.ensure_ext(self.filepath, suffix)
