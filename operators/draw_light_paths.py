"""Draw Light Paths: the paths of a few dozen rays as curves, which artists can render."""

from collections.abc import Generator

import bpy

from ..core.base.errors import RigError
from ..core.base.messages import Message
from ..core.base.steps import hold_progress
from ..core.bench.sketch import size_of, spread_paths
from ..core.blender.result.light_path_curves import draw_paths
from . import long_work, needed, work


class KIRIKO_OT_draw_light_paths(long_work.LongWork, bpy.types.Operator):
    """Draw paths of light from the viewer as curves, which you can render; Live updates them"""

    bl_idname = "kiriko.draw_light_paths"
    bl_label = "Draw Light Paths"
    bl_options = {"REGISTER", "UNDO"}

    count: bpy.props.IntProperty(
        name="Count",
        description="Number of rays, spread over the picture as the viewer sees it",
        default=48,
        min=1,
        max=100000,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reasons = [needed.LEAVE_EDIT_MODE] if context.mode == "EDIT_CURVE" else []
        return needed.can_run(cls, reasons + needed.missing_parts(context.scene))

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        scene = context.scene
        rig = work.read(context).rig
        plan = work.session().plan(rig, work.settings_of(scene))
        paths = yield from hold_progress(0.0, spread_paths(plan, self.count))
        if not paths:
            raise RigError(
                "The viewer '{viewer}' can't see the picture: turn it towards the picture.",
                viewer=rig.viewers[0].name,
            )

        draw_paths(scene, paths, self.count, size_of(rig))
        return Message(
            "{arrived} of {n} light paths arrive at the display.",
            arrived=sum(path.has_arrived for path in paths),
            n=len(paths),
        )
