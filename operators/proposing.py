"""Shared by the operators that propose a change of the bench: it is made by a second click."""

from collections.abc import Generator
from dataclasses import replace

import bpy

from ..core.base.messages import Message, joined
from . import long_work, needed, proposal, work


class Proposes(long_work.LongWork):
    """Mix-in for an operator whose result is proposed, and made at once where `take` is on.

    `proposed` yields progress 0..1 and returns the proposal, or a sentence where there is none.
    """

    take: bpy.props.BoolProperty(
        name="Take It",
        description="Move the parts at once, without asking",
        default=False,
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.mode != "OBJECT":
            return needed.can_run(cls, [needed.LEAVE_EDIT_MODE])
        return needed.can_run(cls, needed.lacking(context.scene))

    def proposed(
        self, context: bpy.types.Context
    ) -> Generator[float, None, proposal.Proposal | Message]:
        raise NotImplementedError

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        seen = work.scene_now(context)
        found = yield from self.proposed(context)
        proposal.drop()
        if not isinstance(found, proposal.Proposal):
            return found
        found = replace(found, scene=seen)
        if self.take:
            proposal.make(context, found)
            return found.text

        proposal.propose(found)
        return joined([found.text, Message("Nothing is moved yet: Take It moves the parts.")])

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        state = super().modal(context, event)
        if "FINISHED" in state and proposal.current(context.scene) is not None:
            bpy.ops.kiriko.take_proposal("INVOKE_DEFAULT")
        return state
