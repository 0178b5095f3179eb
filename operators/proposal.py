"""A change of the bench that is proposed, with its gain, before it is made."""

from dataclasses import dataclass

import bpy
import numpy as np
from bpy.app.handlers import persistent
from mathutils import Matrix

from ..core.base.arrays import Floats
from ..core.base.errors import RigError
from ..core.base.messages import Message, as_message
from ..core.blender.resize import give_matrix
from ..core.glass.motion import Motion
from ..core.solve.solved_for import SolvedFor
from . import needed, telling, work, wrapping

NOTHING = Message("Nothing is proposed for the rig as it is")
WIDTH, BESIDE = 420, 40  # px of the dialogue, and beside its text
SAME = 1e-6  # of a matrix's numbers: so near an object is where it was


@dataclass(frozen=True)
class Move:
    """An object by name, its place when the proposal was made, and the place proposed."""

    name: str
    before: Matrix
    after: Matrix


@dataclass(frozen=True)
class Proposal:
    """Objects that would move, and the gain in a sentence.

    scene : the fingerprint of the scene that it was made for
    """

    label: str
    text: Message
    moves: tuple[Move, ...]
    scene: SolvedFor | None = None


_made: list[Proposal] = []


def propose(proposal: Proposal) -> None:
    """Show a proposal, in place of the last one."""
    _made[:] = [proposal]


def drop() -> None:
    """Forget the proposal."""
    _made.clear()


def current(scene: bpy.types.Scene) -> Proposal | None:
    """The proposal, where its objects are still in the places that it was made for."""
    if not _made:
        return None
    for move in _made[0].moves:
        thing = scene.objects.get(move.name)
        if thing is None:
            return None
        now, then = np.array(thing.matrix_world), np.array(move.before)
        if np.abs(now - then).max() > SAME * max(1.0, np.abs(then).max()):
            return None
    return _made[0]


def refuse_changed(context: bpy.types.Context, proposal: Proposal) -> None:
    """Raise RigError where the scene is another than a proposal was made for."""
    if not proposal.scene.is_same(work.scene_now(context)):
        raise RigError(
            "The scene has changed since '{label}' looked at it: press it again.",
            label=as_message(proposal.label),
        )


def move_of(thing: bpy.types.Object, motion: Motion, metres: float) -> Move:
    """An object's move by a motion in metres."""
    matrix = np.eye(4)
    matrix[:3, :3] = motion.rotation
    matrix[:3, 3] = motion.shift / metres
    before = thing.matrix_world.copy()
    return Move(thing.name, before, Matrix(matrix.tolist()) @ before)


def make(context: bpy.types.Context, proposal: Proposal) -> None:
    """Move the objects, all or none.

    Raises
    ------
    RigError : the scene has changed, or one of them cannot be moved; all are where they were
    """
    refuse_changed(context, proposal)
    things = [(context.scene.objects[move.name], move.after) for move in proposal.moves]
    things.sort(key=lambda pair: _depth(pair[0]))  # children after parents
    kept = [
        (thing, thing.matrix_basis.copy(), thing.matrix_parent_inverse.copy())
        for thing, _ in things
    ]

    for thing, matrix in things:
        try:
            give_matrix(context, thing, matrix)
        except RigError as why:
            for other, basis, way in kept:
                other.matrix_basis, other.matrix_parent_inverse = basis, way
            context.view_layer.update()
            raise RigError(
                "'{name}' keeps its place, for {why}.", name=thing.name, why=why
            ) from None
    work.forget_report(context.scene)


def _depth(thing: bpy.types.Object) -> int:
    return 0 if thing.parent is None else 1 + _depth(thing.parent)


def glass_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The objects of the scene that are glass and shown.

    Raises
    ------
    RigError : one of them is within an instance
    """
    things = [thing for thing, by in needed.parts(scene).get("GLASS", {}).items() if not by]
    for thing in things:
        if scene.objects.get(thing.name) != thing:
            raise RigError("'{name}' cannot be turned, for it is an instance.", name=thing.name)
    return things


def in_view(shift: Floats, axes: Floats) -> list[tuple[float, Message]]:
    """A shift (3,) m as the viewer with axes (3, 3) sees it: lengths and their ways in words."""
    across, up, _ = axes @ shift
    ways = (
        (across, Message("to the right"), Message("to the left")),
        (up, Message("up"), Message("down")),
    )
    return [(abs(way), there if way > 0 else back) for way, there, back in ways]


class KIRIKO_OT_take_proposal(bpy.types.Operator):
    """Move the parts as it is proposed"""

    bl_idname = "kiriko.take_proposal"
    bl_label = "Take It"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.mode != "OBJECT":
            return needed.can_run(cls, [needed.LEAVE_EDIT_MODE])
        return needed.can_run(cls, [NOTHING] if current(context.scene) is None else [])

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if bpy.app.background or context.window is None:
            return self.execute(context)
        with telling.told(self):
            proposal = current(context.scene)
            refuse_changed(context, proposal)
            return context.window_manager.invoke_props_dialog(
                self, width=WIDTH, title=proposal.label, confirm_text=self.bl_label
            )
        return {"CANCELLED"}

    def draw(self, context: bpy.types.Context) -> None:
        proposal = current(context.scene)
        if proposal is not None:
            text = telling.in_words(proposal.text)
            for line in wrapping.wrapped(text, WIDTH - BESIDE, wrapping.points_of(context)):
                self.layout.label(text=line, translate=False)

    def execute(self, context: bpy.types.Context) -> set[str]:
        with telling.told(self):
            proposal = current(context.scene)
            make(context, proposal)
            drop()
            telling.report(self, "INFO", proposal.text)
            return {"FINISHED"}
        return {"CANCELLED"}


class KIRIKO_OT_drop_proposal(bpy.types.Operator):
    """Leave the parts where they are"""

    bl_idname = "kiriko.drop_proposal"
    bl_label = "Leave It"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, [NOTHING] if current(context.scene) is None else [])

    def execute(self, context: bpy.types.Context) -> set[str]:
        drop()
        return {"FINISHED"}


@persistent
def on_load(*_: object) -> None:
    """Another file: what was proposed is for the one before."""
    drop()


HANDLERS = (("load_post", on_load),)


def register() -> None:
    """Begin to listen for other files."""
    work.listen(HANDLERS)


def unregister() -> None:
    """Listen no more."""
    work.stop_listening(HANDLERS)
    drop()
