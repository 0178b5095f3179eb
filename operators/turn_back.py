"""Turn back: the smallest turn of the glass that brings a lost part of the picture back."""

from collections.abc import Generator

import bpy
import numpy as np

from ..core.base.arrays import Floats
from ..core.base.messages import Message
from ..core.base.steps import within
from ..core.base.words import percent
from ..core.bench.best_place import turn_back, turn_of
from ..core.blender.units import length_of_unit
from . import proposal, proposing, work

ALONG = 0.97  # cosine to an axis of the viewer, from which on it is named by it
WORTH_IT = 0.02  # share of the lost light, for which a turn is proposed that does not bring it all


class KIRIKO_OT_turn_back(proposing.Proposes, bpy.types.Operator):
    """Find the smallest turn of the glass that brings the lost part of the picture back, if any"""

    bl_idname = "kiriko.turn_back"
    bl_label = "Turn It Back"
    bl_options = {"REGISTER", "UNDO"}

    limit: bpy.props.FloatProperty(
        name="Turn up to",
        description="How far the glass may turn, about any axis",
        subtype="ANGLE",
        default=np.radians(30),
        min=np.radians(1),
        max=np.radians(90),
    )

    def proposed(
        self, context: bpy.types.Context
    ) -> Generator[float, None, proposal.Proposal | Message]:
        scene = context.scene
        rig = work.read(context).rig
        settings = work.settings_of(scene)
        things = proposal.glass_objects(scene)
        yield 0.02

        steps = turn_back(rig, lambda rig: work.session().plan(rig, settings), self.limit)
        found = yield from within(steps, 0.02, 1.0)
        values = {
            "angle": np.degrees(found.angle),
            "axis": _axis_words(found.turn, rig.viewer.axes),
            "brought": percent(found.brought),
            "after": percent(found.after),
            "before": percent(found.before),
        }
        if found.does_it:
            text = Message(
                "The glass turned {angle:.1f} degrees about {axis} brings the lost part back:"
                " {after} of the picture arrives, {before} now.",
                **values,
            )
        elif found.brought > WORTH_IT:
            self.level = "WARNING"
            text = Message(
                "No turn of the glass up to {limit:.0f} degrees was found that brings the lost part"
                " back; the best, {angle:.1f} degrees about {axis}, brings back {brought} of it:"
                " {after} of the picture arrives, {before} now.",
                limit=np.degrees(self.limit),
                **values,
            )
        else:
            self.level = "WARNING"
            return Message(
                "No turn of the glass up to {limit:.0f} degrees was found that brings the lost part"
                " back.",
                limit=np.degrees(self.limit),
            )

        motion = turn_of(rig, found.turn)
        metres = length_of_unit(scene)
        moves = tuple(proposal.move_of(thing, motion, metres) for thing in things)
        return proposal.Proposal(self.bl_label, text, moves)


def _axis_words(turn: Floats, axes: Floats) -> Message:
    """The axis of a turn (3,), as a viewer with axes (3, 3) sees it."""
    along = np.abs(axes @ turn) / max(float(np.linalg.norm(turn)), np.finfo(float).tiny)
    names = (
        Message("the horizontal axis across the view"),
        Message("the upright axis"),
        Message("the line of sight"),
    )
    n = int(along.argmax())
    return names[n] if along[n] > ALONG else Message("an axis askew to the view")
