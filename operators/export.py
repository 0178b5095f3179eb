"""Export: write the source image to a file for the display."""

import json
from pathlib import Path

import bpy

from ..core import image_io
from ..core.blender_image import pixels_from_image
from ..core.errors import ImageError
from . import work


def use_bundled_modules() -> None:
    """Let Python import the modules that Blender ships (needed from 5.0 in the bpy module)."""
    if hasattr(bpy.utils, "expose_bundled_modules"):
        bpy.utils.expose_bundled_modules()


def absolute(path: str) -> Path:
    """The place that a path from the interface means; ImageError when it is relative to a .blend never saved."""
    if path.startswith("//") and not bpy.data.filepath:
        raise ImageError(
            f"The path '{path}' is relative to this file, which was never saved: save it or choose another."
        )
    return Path(bpy.path.abspath(path))


def target(path: str, form: str) -> Path:
    """The file that a path from the interface means: absolute, with the format's suffix.

    Raises
    ------
    ImageError
        There is no path, or it is relative to a .blend that has not been saved.
    """
    if not path:
        raise ImageError("The export has no path: choose a file.")
    full = absolute(path)
    if (image_io.is_there(full) and full.is_dir()) or path.endswith(("/", "\\")):
        full = full / "source"
    return image_io.named_for(full, form)


class KIRIKO_OT_export(bpy.types.Operator):
    """Write the source image to a file, at the display's own resolution, with colour space and physical size"""

    bl_idname = "kiriko.export"
    bl_label = "Export Source Image"
    bl_options = {"REGISTER"}

    filepath: bpy.props.StringProperty(
        name="File",
        description="Where to write; empty: the path in the panel",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )
    overwrite: bpy.props.BoolProperty(
        name="Overwrite", description="Replace the file if there is one already", options={"SKIP_SAVE"}
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return work.can_run(cls, work.unsolved(context.scene))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        ours = context.scene.kiriko
        if not bpy.data.filepath and (self.filepath or ours.export_path or "//").startswith("//"):
            self.filepath = str(image_io.named_for("source", ours.export_format))
            context.window_manager.fileselect_add(self)  # the path is relative to a file that was never saved: ask
            return {"RUNNING_MODAL"}
        with work.told(self):
            path = target(self.filepath or ours.export_path, image_io.format_for(self.filepath, ours.export_format))
            if image_io.is_there(path) and not (self.overwrite or ours.export_overwrite):
                self.overwrite = True  # only an answer of yes leads to execute
                return context.window_manager.invoke_confirm(
                    self, event, title="Replace the file?", message=str(path), confirm_text="Replace"
                )
            return self.execute(context)
        return {"CANCELLED"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        ours = context.scene.kiriko
        with work.told(self):
            details = json.loads(ours.result.details or "{}")
            size = details.get("display_size_m")
            use_bundled_modules()
            form = image_io.format_for(self.filepath, ours.export_format)
            written = image_io.write(
                target(self.filepath or ours.export_path, form),
                pixels_from_image(ours.result.source)[..., :3],
                form,
                size=tuple(size) if size else None,
                overwrite=self.overwrite or ours.export_overwrite,
            )
            self.report({"INFO"}, f"Wrote '{written}'.")
            return {"FINISHED"}
        return {"CANCELLED"}
