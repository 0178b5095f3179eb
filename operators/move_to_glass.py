"""Move to glass: picture and display where bent light spreads less."""

from collections.abc import Generator

import bpy
import numpy as np

from ..core.base.errors import RigError
from ..core.base.messages import Message
from ..core.bench.measured_remedies import shifts_by, way_to_glass
from ..core.blender.units import length_of_unit, length_text
from ..core.glass.motion import Motion
from . import proposal, proposing, work


class KIRIKO_OT_move_to_glass(proposing.Proposes, bpy.types.Operator):
    """Move the picture to the next side of the glass towards the viewer, and the display with it"""

    bl_idname = "kiriko.move_to_glass"
    bl_label = "Move to Glass"
    bl_options = {"REGISTER", "UNDO"}

    def proposed(
        self, context: bpy.types.Context
    ) -> Generator[float, None, proposal.Proposal | Message]:
        scene = context.scene
        rig = work.read(context).rig
        yield 0.5
        way = way_to_glass(rig)
        if not way:
            return Message("'{name}' is at the glass already.", name=rig.picture_place.name)

        metres = length_of_unit(scene)
        moves = []
        for part, shift in zip((rig.picture_place, rig.display), shifts_by(rig, way), strict=True):
            thing = scene.objects.get(part.name)
            if thing is None:
                raise RigError(
                    "'{name}' keeps its place, for {why}.",
                    name=part.name,
                    why=Message("it is an instance"),
                )
            moves.append(proposal.move_of(thing, Motion(np.eye(3), shift), metres))
        text = Message(
            "'{picture}' moves {way} towards the viewer, and '{display}' with it.",
            picture=rig.picture_place.name,
            way=length_text(scene, way),
            display=rig.display.name,
        )
        return proposal.Proposal(self.bl_label, text, tuple(moves))
