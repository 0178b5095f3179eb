"""Before and After: the viewer's image without and with compensation."""

from collections.abc import Generator
from pathlib import Path

import bpy

from ..core.base.errors import ImageError
from ..core.base.messages import Message
from ..core.base.steps import run_steps, subprogress
from ..core.files import disk, image_io
from ..core.solve.comparison import Comparison, side_by_side
from . import compared, long_work, needed, reporting, work
from .export import use_bundled_modules
from .to_file import ToFile
from .windows import redraw

GAP = 8  # px, white, between the two saved images
NAME = "comparison.png"


def comparing(
    context: bpy.types.Context, is_for_file: bool = False
) -> Generator[float, None, compared.Compared]:
    """Solve the scene, quickly if it was solved before, and compare."""
    scene = context.scene
    rig = work.read(context).rig
    rig.check()
    settings = work.settings_of(scene)
    yield 0.0
    solution = yield from subprogress(work.session().solve(rig, settings), 0.0, 0.7)
    steps = compared.comparing(scene, rig, solution, settings, is_for_file)
    return (yield from subprogress(steps, 0.7, 1.0))


class KIRIKO_OT_before_after(long_work.LongWork, bpy.types.Operator):
    """Compare the view without and with correction, side by side; drag the handle to wipe"""

    bl_idname = "kiriko.before_after"
    bl_label = "Before and After"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        is_on = context.window_manager.kiriko.show_comparison
        scene = context.scene
        return is_on or needed.can_run(cls, needed.missing_parts(scene) + needed.pictureless(scene))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if context.window_manager.kiriko.show_comparison:
            compared.leave()
            redraw()
            return {"FINISHED"}
        return super().invoke(context, event)

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        yield from comparing(context)
        context.window_manager.kiriko.show_comparison = True
        compared.enter_view(context)
        redraw()
        return Message("Drag the handle in the camera view to compare.")


class KIRIKO_OT_wipe(bpy.types.Operator):
    """Drag to wipe between the two images"""

    bl_idname = "kiriko.wipe"
    bl_label = "Wipe"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.region_data is not None and compared.is_shown(context.scene)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.before = context.window_manager.kiriko.wipe
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        ours = context.window_manager.kiriko
        if event.type in {"ESC", "RIGHTMOUSE"}:
            ours.wipe = self.before
            return {"CANCELLED"}

        frame = compared.frame_in_region(context, context.scene)
        if frame is not None:
            left, right = frame[:, 0].min(), frame[:, 0].max()
            ours.wipe = (event.mouse_x - context.region.x - left) / max(right - left, 1.0)

        is_over = event.value == "RELEASE" and event.type in {"LEFTMOUSE", "RET", "SPACE"}
        return {"FINISHED"} if is_over else {"RUNNING_MODAL"}


class KIRIKO_OT_save_comparison(ToFile, bpy.types.Operator):
    """Write both images side by side to a PNG file"""

    bl_idname = "kiriko.save_comparison"
    bl_label = "Save Comparison"
    bl_options = {"REGISTER"}

    default_name = NAME

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, needed.missing_parts(context.scene))

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            self.end_with(context)
            use_bundled_modules()
            path = self.path()
            if disk.is_there(path) and not (self.overwrite or self.is_in_dialogue):
                raise ImageError(
                    "The file '{path}' already exists: choose another name or allow overwriting.",
                    path=path,
                )

            made = run_steps(comparing(context, is_for_file=True)).comparison
            written = write(path, made, context.window_manager.kiriko)
            reporting.report(self, "INFO", Message("Wrote '{written}'.", written=written))
            return {"FINISHED"}

        return {"CANCELLED"}


def write(path: Path, made: Comparison, ours: bpy.types.PropertyGroup) -> Path:
    """Write the two chosen images side by side."""
    left, right = (getattr(made, choice.lower()) for choice in (ours.left, ours.right))
    both = side_by_side(left, right, GAP)
    title = "Kiriko comparison"
    return image_io.write(path, both, "PNG8", title=title, overwrite=True)
