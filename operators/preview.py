"""Preview: the viewer's image rendered by Cycles, an independent renderer."""

from pathlib import Path

import bpy

from ..core.base.errors import ImageError, RigError
from ..core.base.messages import Message, joined
from ..core.blender.data.paths import RELATIVE_PATH
from ..core.blender.data.rigs import name_of_view
from ..core.blender.preview.cycles_preview import Preview
from ..core.blender.result.write_result import replace_image
from ..core.files import disk, image_io
from . import long_work, needed, reporting, watch, work
from .choose_rig import EndsWithRig
from .export import target, use_bundled_modules
from .windows import show_image

NAME = "Kiriko Preview"


class KIRIKO_OT_preview(EndsWithRig, bpy.types.Operator):
    """Render the viewer's view in Cycles, as the image Kiriko Preview"""

    bl_idname = "kiriko.preview"
    bl_label = "Preview"
    bl_options = {"REGISTER"}

    samples: bpy.props.IntProperty(
        name="Samples",
        description="Rays per pixel. Four times as many halve the noise",
        default=16,
        min=1,
        max=65536,
    )
    percentage: bpy.props.IntProperty(
        name="Resolution",
        description="Size of the preview, relative to the viewer's image",
        subtype="PERCENTAGE",
        default=100,
        min=1,
        max=400,
    )
    border: bpy.props.FloatVectorProperty(
        name="Border",
        description="Part to render: left, right, bottom, top of the frame",
        size=4,
        default=(0, 1, 0, 1),
        min=0,
        max=1,
    )
    reflections: bpy.props.BoolProperty(
        name="Reflections",
        description="Glass also reflects light, which adds noise",
        default=True,
    )
    surroundings: bpy.props.BoolProperty(
        name="Surroundings",
        description="Include the world, lights and objects without a role",
        default=True,
    )
    filepath: bpy.props.StringProperty(
        name="File",
        description="Also write the preview to this file (.png or .exr)",
        subtype="FILE_PATH",
        options={"SKIP_SAVE", *RELATIVE_PATH},
    )
    overwrite: bpy.props.BoolProperty(
        name="Overwrite",
        description="Replace existing files",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        scene = context.scene
        reasons = needed.linked(scene) + needed.unsolved(scene) + needed.missing_parts(scene)
        if not hasattr(scene, "cycles"):
            reasons.insert(0, needed.NO_CYCLES)
        if bpy.app.is_job_running("RENDER"):
            reasons.insert(0, Message("A render is running: wait for it or stop it"))
        return needed.can_run(cls, reasons)

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self), self._prepare(context) as preview:
            preview.render()
            self._finish(preview)
            return {"FINISHED"}
        return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if bpy.app.background or context.window is None:
            return self.execute(context)

        self._preview = None
        self._timer = context.window_manager.event_timer_add(long_work.TICK, window=context.window)
        context.window_manager.modal_handler_add(self)
        text = Message("Kiriko: preparing the preview ...")  # drawn before the next event
        context.workspace.status_text_set(reporting.in_words(text))
        return {"RUNNING_MODAL"}

    def _start(self, context: bpy.types.Context) -> None:
        """Start to render."""
        try:
            self._preview = self._prepare(context)
        finally:
            context.workspace.status_text_set(None)
        # Blender renders in its own job and restores no settings after Esc; a temporary scene needs
        # no restoring.
        self._preview.scene.render.use_lock_interface = True
        bpy.ops.render.render("INVOKE_DEFAULT", scene=self._preview.scene.name, write_still=True)

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self._preview is None:
            if event.type == "TIMER":
                with reporting.errors_reported(self):
                    self._start(context)
                    return {"RUNNING_MODAL"}
                self.cancel(context)
                return {"CANCELLED"}
            return {"RUNNING_MODAL"}  # so that a second click starts no second preview

        if event.type != "TIMER" or bpy.app.is_job_running("RENDER"):
            return {"PASS_THROUGH"}
        try:
            with reporting.errors_reported(self):
                if self._preview.is_rendered:
                    self._finish(self._preview)
                    return {"FINISHED"}
                reporting.report(self, "INFO", Message("Stopped. The scene is unchanged."))
            return {"CANCELLED"}
        finally:
            self.cancel(context)

    def cancel(self, context: bpy.types.Context) -> None:
        """Remove everything temporary; Blender also calls this when it closes or loads another
        file.
        """
        context.window_manager.event_timer_remove(self._timer)
        if self._preview is not None:
            self._preview.close()

    def _prepare(self, context: bpy.types.Context) -> Preview:
        scene = context.scene
        self.begin_with(scene)
        self._file()
        left, right, bottom, top = self.border
        if left >= right or bottom >= top:
            raise RigError(
                "The preview's border is empty: set left below right, and bottom below top."
            )

        self._remarks = [watch.CHANGED] if watch.has_changed(context) else []
        whole = tuple(self.border) == (0.0, 1.0, 0.0, 1.0)
        reading = work.read(context)
        self._rig = reading.rig
        return Preview(
            scene,
            reading,
            scene.kiriko.result.source,
            percentage=self.percentage,
            border=None if whole else tuple(self.border),
            samples=self.samples,
            fresnel=self.reflections,
            surroundings=self.surroundings,
        )

    def _file(self) -> Path | None:
        """Output path of the preview, if any; ImageError before the render if it cannot be
        written.
        """
        if not self.filepath:
            return None

        if Path(self.filepath).suffix.lower() not in {"", ".png", ".exr"}:
            raise ImageError(
                "The preview '{file}' would be neither .png nor .exr: choose one of these.",
                file=self.filepath,
            )

        path = target(self.filepath, image_io.format_for(self.filepath, "PNG8"))
        disk.check_new(path, self.overwrite)
        disk.check_folder(path.parent)
        return path

    def _finish(self, preview: Preview) -> None:
        pixels = preview.pixels()
        if self.filepath:
            use_bundled_modules()
            form = image_io.format_for(self.filepath, "PNG8")
            image_io.write(
                self._file(),
                pixels[..., :3],
                form,
                title=NAME,
                overwrite=self.overwrite,
            )

        self.end_with()
        scene = self.own_scene()
        result, name = scene.kiriko.result, name_of_view(scene, NAME, self._rig)
        result.preview = image = replace_image(result.preview, name, pixels)
        show_image(image, result)

        remarks = self._remarks + preview.notes
        if remarks:
            reporting.report(self, "WARNING", joined(remarks))
        else:
            reporting.report(
                self,
                "INFO",
                Message(
                    "The image '{image}' shows what the viewer sees{more}.",
                    image=image.name,
                    more="",
                ),
            )
