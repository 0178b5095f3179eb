"""Solve: compute the source image and put it on the display."""

from collections.abc import Generator

import bpy

from ..core.blender_result import write_solution
from . import work


class KIRIKO_OT_solve(work.LongWork, bpy.types.Operator):
    """Compute what the display has to show so that the viewer sees the picture undistorted inside the glass"""

    bl_idname = "kiriko.solve"
    bl_label = "Solve"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return work.can_run(cls, work.lacking(context.scene))

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        scene = context.scene
        reading = work.read_to_solve(context)
        yield 0.0
        solution = yield from work.session().solve(reading.rig, work.settings_of(scene))
        return write_solution(scene, reading, solution)
