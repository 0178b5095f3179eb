"""Buttons that bring back the lost part of the picture, and the change that is proposed."""

import bpy

from ..operators import needed, proposal
from ..operators.wrapping import sentence

WHOLE = 0.999  # share of the picture from which on nothing needs a remedy


def draw_remedies(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The proposal where there is one; else the remedies where some of the picture is lost."""
    scene = context.scene
    proposed = proposal.current(scene)
    if proposed is not None:
        sentence(layout, context, proposed.text, icon="QUESTION")
        row = layout.row(align=True)
        row.operator_context = "EXEC_DEFAULT"  # the panel has the sentence already
        row.operator("kiriko.take_proposal", icon="CHECKMARK")
        row.operator("kiriko.drop_proposal", icon="X")
    elif not needed.unsolved(scene) and scene.kiriko.result.coverage < WHOLE:
        row = layout.row(align=True)  # those that fit a part stand in the checklist
        row.operator("kiriko.best_place")
        row.operator("kiriko.turn_back")
