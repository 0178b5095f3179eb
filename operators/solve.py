"""Solve: compute the source image and show it on the display."""

from collections.abc import Generator

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.base.messages import Message
from ..core.base.steps import subprogress
from ..core.blender.result.conflict import write_conflict
from ..core.blender.result.write_result import (
    write_coarse,
    write_helps,
    write_legibility,
    write_solution,
    write_viewers,
)
from ..core.solve.first_picture import solve_in_sight
from . import live, long_work, look_over, needed, work
from .remedies import legible, remedies_for
from .viewer_reports import reports_of
from .windows import show_image, show_where_empty

SOLVED = 0.98  # progress after the solve itself; the rest covers viewers and remedies


class KIRIKO_OT_solve(long_work.LongWork, bpy.types.Operator):
    """Compute the image for your display"""

    bl_idname = "kiriko.solve"
    bl_label = "Solve"
    bl_options = {"REGISTER", "UNDO"}

    shown = 0  # session uid of the coarse source image

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(
            cls,
            [
                *needed.missing_parts(context.scene),
                *needed.pictureless(context.scene),
                *needed.sculpting(context),
            ],
        )

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        scene, self.shown = context.scene, 0
        live.forget_why()
        reading = look_over.read_to_solve(context)
        settings = work.settings_of(scene)

        def show(pixels: NDArray[np.float32]) -> None:
            nonlocal reading
            reading = write_coarse(scene, reading, pixels)
            self.shown = scene.kiriko.result.source.session_uid
            show_where_empty(scene.kiriko.result.source)

        yield 0.0
        # Live shows coarse images itself, and would take a remaining one for its own final image.
        if self.is_watched and not live.is_on():
            steps = solve_in_sight(work.session(), reading.rig, settings, show)
        else:
            steps = work.session().solve(reading.rig, settings)
        solution = yield from subprogress(steps, 0.0, SOLVED)
        reports = yield from subprogress(reports_of(solution, settings), SOLVED, SOLVED)
        helps = None
        if self.is_watched:  # scripts read no checklist
            helps = yield from subprogress(
                remedies_for(reading.rig, settings, solution), SOLVED, 0.99
            )
        seen = yield from subprogress(legible(reading.rig, settings, self.is_watched), 0.99, 1.0)

        text = write_solution(scene, reading, solution)
        write_viewers(scene, reports.numbers)
        write_conflict(scene, reports.conflict, is_packed=True)
        write_helps(scene, helps)
        write_legibility(scene, *seen)
        work.note_written(scene)
        show_image(scene.kiriko.result.source, scene.kiriko.result)
        return text

    def stays(self) -> str:
        # unless it was undone
        is_there = any(image.session_uid == self.shown for image in bpy.data.images)
        return Message("the rough image") if is_there else ""
