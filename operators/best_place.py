"""Best place: where most of the picture arrives, proposed with its gain."""

from collections.abc import Generator

import bpy
import numpy as np

from ..core.base.messages import Message, joined
from ..core.base.steps import within
from ..core.base.words import percent
from ..core.bench.best_place import BestPlace, Limits, best_place, turn_of
from ..core.bench.part_sizes import plane_of
from ..core.blender.units import length_of_unit, length_text
from ..core.rig.rig import Rig
from . import automatic, needed, proposal, proposing, work
from .needed import the_picture

FAR = 1e-3  # of the picture's side: a smaller shift is not told
REACH = 0.5  # of the picture's side: so far it may move by itself
AT_LIMIT = 0.98  # of the shift that is allowed: who comes so far may find more beyond
ENOUGH = 0.995  # of the picture: more is not worth a further look
_taken: automatic.Taken = {}


class KIRIKO_OT_best_place(proposing.Proposes, bpy.types.Operator):
    """Find where the most of the picture arrives with the least blur; you see the gain first"""

    bl_idname = "kiriko.best_place"
    bl_label = "Best Place"
    bl_options = {"REGISTER", "UNDO"}

    shift: automatic.length("Move up to", "How far the picture may move in its plane")
    auto_shift: automatic.checkbox("shift", _taken, "Up to half of the picture's side")
    turn: bpy.props.FloatProperty(
        name="Turn up to",
        description="How far the picture may turn in its plane",
        subtype="ANGLE",
        default=np.radians(15),
        min=0.0,
        max=np.radians(90),
    )
    turn_glass: bpy.props.BoolProperty(
        name="Turn Glass", description="The glass may turn, too", default=False
    )
    glass_limit: bpy.props.FloatProperty(
        name="Glass up to",
        description="How far the glass may turn, about any axis",
        subtype="ANGLE",
        default=np.radians(15),
        min=np.radians(1),
        max=np.radians(90),
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.scene.kiriko.picture_source == "IMAGE":
            reason = Message("The picture is in the viewer's own pixels and has no place")
            return needed.can_run(cls, [reason])
        return super().poll(context)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        automatic.draw(layout, context, self, "shift", _taken)
        layout.prop(self, "turn")
        layout.prop(self, "turn_glass")
        if self.turn_glass:
            layout.prop(self, "glass_limit")

    def proposed(
        self, context: bpy.types.Context
    ) -> Generator[float, None, proposal.Proposal | Message]:
        scene = context.scene
        metres = length_of_unit(scene)
        rig = work.read(context).rig
        settings = work.settings_of(scene)
        side = float(np.linalg.norm(plane_of(rig).sides, axis=1).max())
        _taken["shift"] = REACH * side / metres
        limits = Limits(
            shift=self.shift * metres or REACH * side,
            turn=self.turn,
            glass=self.glass_limit if self.turn_glass else 0.0,
        )
        yield 0.02

        steps = best_place(rig, lambda rig: work.session().plan(rig, settings), limits)
        found = yield from within(steps, 0.02, 1.0)
        if not found.is_better:
            return Message(
                "The picture stands in the best place within these limits: {share} of it arrives.",
                share=percent(found.before),
            )

        moves = [proposal.move_of(the_picture(context), found.motion, metres)]
        if found.glass_turn.any():
            turn = turn_of(rig, found.glass_turn)
            moves += [proposal.move_of(g, turn, metres) for g in proposal.glass_objects(scene)]
        told = _told(scene, rig, found, side)
        is_at_limit = np.abs(found.shift).max() > AT_LIMIT * limits.shift
        if is_at_limit and found.after < ENOUGH:
            told = joined(
                [told, Message("That is as far as it may move: raise Move up to for more.")]
            )
        return proposal.Proposal(self.bl_label, told, tuple(moves))


def _told(scene: bpy.types.Scene, rig: Rig, found: BestPlace, side: float) -> Message:
    """The gain, and the motions it takes."""
    axes = plane_of(rig).sides
    shift = found.shift @ (axes / np.linalg.norm(axes, axis=1)[:, None])
    ways = [
        Message("{length} {way}", length=length_text(scene, length), way=way)
        for length, way in proposal.in_view(shift, rig.viewer.axes)
        if length > FAR * side
    ]
    if abs(found.turn) > np.radians(0.1):
        ways.append(Message("turned {angle:.1f} degrees", angle=abs(np.degrees(found.turn))))
    parts = [Message("the picture {ways}", ways=joined(ways, ", "))] if ways else []
    if found.glass_turn.any():
        angle = np.degrees(np.linalg.norm(found.glass_turn))
        parts.append(Message("the glass turned {angle:.1f} degrees", angle=angle))

    return Message(
        "{before} of the picture arrives; {after} with {parts}.",
        before=percent(found.before),
        after=percent(found.after),
        parts=joined(parts, "; "),
    )
