"""Proposed changes of the bench with their gain: Best Place, Rotate to Recover, Move to Glass."""

from collections.abc import Generator
from dataclasses import dataclass, replace

import bpy
import numpy as np
from bpy.app.handlers import persistent
from mathutils import Matrix

from ..core.base.arrays import Floats
from ..core.base.errors import RigError
from ..core.base.messages import Message, as_message, joined
from ..core.base.steps import subprogress
from ..core.base.words import percent
from ..core.bench.best_place import BestPlace, Limits, best_place, turn_back, turn_of
from ..core.bench.measured_remedies import shifts_by, way_to_glass
from ..core.bench.part_sizes import plane_of
from ..core.blender.data.units import length_of_unit, length_text
from ..core.blender.read.resize import give_matrix
from ..core.glass.motion import Motion
from ..core.rig.rig import Rig
from ..core.solve.solved_for import SolvedFor
from . import automatic, long_work, needed, reporting, work, wrapping
from .needed import the_picture

WIDTH, SPACE = 420, 40  # px of the dialogue, and of the space next to its text
SAME = 1e-6  # of a matrix's entries: smaller differences count as unmoved


@dataclass(frozen=True)
class Move:
    """An object by name, its transform when the proposal was made, and the proposed one."""

    name: str
    before: Matrix
    after: Matrix


@dataclass(frozen=True)
class ProposedChange:
    """Objects to move, and the gain as a sentence.

    scene : fingerprint of the scene it was made for
    """

    label: str
    text: Message
    moves: tuple[Move, ...]
    scene: SolvedFor | None = None


_made: list[ProposedChange] = []


def propose(proposal: ProposedChange) -> None:
    """Show a proposal, replacing the last one."""
    _made[:] = [proposal]


def drop() -> None:
    """Discard the proposal."""
    _made.clear()


def current(scene: bpy.types.Scene) -> ProposedChange | None:
    """The proposal, if its objects are still unmoved."""
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


def refuse_changed(context: bpy.types.Context, proposal: ProposedChange) -> None:
    """Raise RigError if the scene differs from the proposal's."""
    if not proposal.scene.is_same(work.scene_now(context)):
        raise RigError(
            "{label} is outdated: press it again.",
            label=as_message(proposal.label),
        )


def move_of(thing: bpy.types.Object, motion: Motion, metres: float) -> Move:
    """Move of an object by a motion in metres."""
    matrix = np.eye(4)
    matrix[:3, :3] = motion.rotation
    matrix[:3, 3] = motion.shift / metres
    before = thing.matrix_world.copy()
    return Move(thing.name, before, Matrix(matrix.tolist()) @ before)


def make(context: bpy.types.Context, proposal: ProposedChange) -> None:
    """Move the objects, all or none.

    Raises
    ------
    RigError : the scene has changed, or an object cannot be moved; nothing has moved then
    """
    refuse_changed(context, proposal)
    things = [(context.scene.objects[move.name], move.after) for move in proposal.moves]
    things.sort(key=lambda pair: _depth(pair[0]))  # children after parents
    before = [
        (thing, thing.matrix_basis.copy(), thing.matrix_parent_inverse.copy())
        for thing, _ in things
    ]

    for thing, matrix in things:
        try:
            give_matrix(context, thing, matrix)
        except RigError as why:
            for other, basis, way in before:
                other.matrix_basis, other.matrix_parent_inverse = basis, way
            context.view_layer.update()
            raise RigError("'{name}' can't be moved: {why}.", name=thing.name, why=why) from None
    work.forget_report(context.scene)


def _depth(thing: bpy.types.Object) -> int:
    return 0 if thing.parent is None else 1 + _depth(thing.parent)


def glass_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Visible glass objects of the scene.

    Raises
    ------
    RigError : one of them is inside an instance
    """
    things = [thing for thing, by in needed.parts(scene).get("GLASS", {}).items() if not by]
    for thing in things:
        if scene.objects.get(thing.name) != thing:
            raise RigError(
                "'{name}' can't be moved: {why}.",
                name=thing.name,
                why=Message("it is an instance"),
            )
    return things


def in_view(shift: Floats, axes: Floats) -> list[tuple[float, Message]]:
    """A shift (3,) m in the viewer's axes (3, 3): lengths and their directions in words."""
    across, up, _ = axes @ shift
    ways = (
        (across, Message("to the right"), Message("to the left")),
        (up, Message("up"), Message("down")),
    )
    return [(abs(way), there if way > 0 else back) for way, there, back in ways]


class KIRIKO_OT_take_proposal(bpy.types.Operator):
    """Move the parts as proposed"""

    bl_idname = "kiriko.take_proposal"
    bl_label = "Apply"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.mode != "OBJECT":
            return needed.can_run(cls, [needed.LEAVE_EDIT_MODE])
        return needed.can_run(cls, [needed.NOTHING] if current(context.scene) is None else [])

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if bpy.app.background or context.window is None:
            return self.execute(context)
        with reporting.errors_reported(self):
            proposal = current(context.scene)
            refuse_changed(context, proposal)
            return context.window_manager.invoke_props_dialog(
                self, width=WIDTH, title=proposal.label, confirm_text=self.bl_label
            )
        return {"CANCELLED"}

    def draw(self, context: bpy.types.Context) -> None:
        proposal = current(context.scene)
        if proposal is not None:
            text = reporting.in_words(proposal.text)
            for line in wrapping.wrapped(text, WIDTH - SPACE, wrapping.points_of(context)):
                self.layout.label(text=line, translate=False)

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            proposal = current(context.scene)
            make(context, proposal)
            drop()
            reporting.report(self, "INFO", proposal.text)
            return {"FINISHED"}
        return {"CANCELLED"}


class KIRIKO_OT_drop_proposal(bpy.types.Operator):
    """Discard the proposal"""

    bl_idname = "kiriko.drop_proposal"
    bl_label = "Discard"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, [needed.NOTHING] if current(context.scene) is None else [])

    def execute(self, context: bpy.types.Context) -> set[str]:
        drop()
        return {"FINISHED"}


@persistent
def on_load(*_: object) -> None:
    """Discard the proposal of the file before."""
    drop()


HANDLERS = (("load_post", on_load),)


def register() -> None:
    """Start listening for file loads."""
    work.listen(HANDLERS)


def unregister() -> None:
    """Stop listening."""
    work.stop_listening(HANDLERS)
    drop()


class Proposes(long_work.LongWork):
    """Mix-in for an operator that proposes its result, or applies it at once with `take`.

    `proposed` yields progress 0..1 and returns the proposal, or a sentence if there is none.
    """

    take: bpy.props.BoolProperty(
        name="Apply",
        default=False,
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.mode != "OBJECT":
            return needed.can_run(cls, [needed.LEAVE_EDIT_MODE])
        return needed.can_run(cls, needed.missing_parts(context.scene))

    def proposed(
        self, context: bpy.types.Context
    ) -> Generator[float, None, ProposedChange | Message]:
        raise NotImplementedError

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        seen = work.scene_now(context)
        found = yield from self.proposed(context)
        drop()
        if not isinstance(found, ProposedChange):
            return found
        found = replace(found, scene=seen)
        if self.take:
            make(context, found)
            return found.text

        propose(found)
        return joined([found.text, Message("Nothing has moved yet: press Apply.")])

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        state = super().modal(context, event)
        if "FINISHED" in state and current(context.scene) is not None:
            bpy.ops.kiriko.take_proposal("INVOKE_DEFAULT")
        return state


FAR = 1e-3  # of the picture's side: smaller shifts are not mentioned
REACH = 0.5  # of the picture's side: default limit of a shift
AT_LIMIT = 0.98  # of the allowed shift: beyond this a higher limit may gain more
ENOUGH = 0.995  # of the picture: above this a further search is not worth it
_taken: automatic.Taken = {}


class KIRIKO_OT_best_place(Proposes, bpy.types.Operator):
    """Find the place where most of the picture arrives, and show the gain"""

    bl_idname = "kiriko.best_place"
    bl_label = "Best Place"
    bl_options = {"REGISTER", "UNDO"}

    shift: automatic.length("Move up to", "How far the picture may move in its plane")
    auto_shift: automatic.checkbox("shift", _taken, "Up to half of the picture's side")
    turn: bpy.props.FloatProperty(
        name="Turn up to",
        description="Largest rotation to try",
        subtype="ANGLE",
        default=np.radians(15),
        min=0.0,
        max=np.radians(90),
    )
    turn_glass: bpy.props.BoolProperty(name="Turn Glass", default=False)
    glass_limit: bpy.props.FloatProperty(
        name="Glass up to",
        description="Largest rotation to try",
        subtype="ANGLE",
        default=np.radians(15),
        min=np.radians(1),
        max=np.radians(90),
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.scene.kiriko.picture_source == "IMAGE":
            reason = needed.NO_PLANE
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
    ) -> Generator[float, None, ProposedChange | Message]:
        scene = context.scene
        metres = length_of_unit(scene)
        rig = work.read(context).rig
        settings = work.settings_of(scene)
        side = float(np.linalg.norm(plane_of(rig).sides, axis=1).max())
        _taken["shift"] = REACH * side / metres
        limits = Limits(
            shift=self.shift * metres or REACH * side,
            turn=self.turn,
            glass=self.glass_limit if self.turn_glass and rig.glasses else 0.0,
        )
        yield 0.02

        steps = best_place(rig, lambda rig: work.session().plan(rig, settings), limits)
        found = yield from subprogress(steps, 0.02, 1.0)
        if not found.is_better:
            return Message(
                "The picture is already in the best place: {share} of it arrives.",
                share=percent(found.before),
            )

        moves = [move_of(the_picture(context), found.motion, metres)]
        if found.glass_turn.any():
            turn = turn_of(rig, found.glass_turn)
            moves += [move_of(g, turn, metres) for g in glass_objects(scene)]
        text = _description(scene, rig, found, side)
        is_at_limit = np.abs(found.shift).max() > AT_LIMIT * limits.shift
        if is_at_limit and found.after < ENOUGH:
            text = joined([text, Message("It moved as far as allowed: raise 'Move up to'.")])
        return ProposedChange(self.bl_label, text, tuple(moves))


def _description(scene: bpy.types.Scene, rig: Rig, found: BestPlace, side: float) -> Message:
    """The gain, and the motions it needs."""
    axes = plane_of(rig).sides
    shift = found.shift @ (axes / np.linalg.norm(axes, axis=1)[:, None])
    ways = [
        Message("{length} {way}", length=length_text(scene, length), way=way)
        for length, way in in_view(shift, rig.viewer.axes)
        if length > FAR * side
    ]
    if abs(found.turn) > np.radians(0.1):
        ways.append(Message("turned {angle:.1f} degrees", angle=abs(np.degrees(found.turn))))
    parts = [Message("the picture {ways}", ways=joined(ways, ", "))] if ways else []
    if found.glass_turn.any():
        angle = np.degrees(np.linalg.norm(found.glass_turn))
        parts.append(Message("the glass turned {angle:.1f} degrees", angle=angle))

    return Message(
        "{before} of the picture arrives now, {after} with {parts}.",
        before=percent(found.before),
        after=percent(found.after),
        parts=joined(parts, "; "),
    )


ALONG = 0.97  # cosine to an axis of the viewer above which the axis is named
WORTH_IT = 0.02  # fraction of the lost light above which a partial rotation is proposed


class KIRIKO_OT_turn_back(Proposes, bpy.types.Operator):
    """Find the smallest rotation of the glass that recovers the lost part of the picture"""

    bl_idname = "kiriko.turn_back"
    bl_label = "Rotate to Recover"
    bl_options = {"REGISTER", "UNDO"}

    limit: bpy.props.FloatProperty(
        name="Turn up to",
        description="Largest rotation to try",
        subtype="ANGLE",
        default=np.radians(30),
        min=np.radians(1),
        max=np.radians(90),
    )

    def proposed(
        self, context: bpy.types.Context
    ) -> Generator[float, None, ProposedChange | Message]:
        scene = context.scene
        rig = work.read(context).rig
        settings = work.settings_of(scene)
        things = glass_objects(scene)
        yield 0.02

        steps = turn_back(rig, lambda rig: work.session().plan(rig, settings), self.limit)
        found = yield from subprogress(steps, 0.02, 1.0)
        if not found.does_it:
            self.level = "WARNING"
        if not found.does_it and found.brought <= WORTH_IT:
            return Message(
                "No rotation up to {limit:.0f} degrees recovers the lost part.",
                limit=np.degrees(self.limit),
            )

        text = Message(
            "Rotating the glass by {angle:.1f} degrees about {axis} recovers {brought} of the lost"
            " part: {after} of the picture arrives ({before} now).",
            angle=np.degrees(found.angle),
            axis=_axis_words(found.turn, rig.viewer.axes),
            brought=percent(found.brought),
            after=percent(found.after),
            before=percent(found.before),
        )
        if not found.does_it:
            limit = Message(
                "No rotation up to {limit:.0f} degrees recovers the whole lost part.",
                limit=np.degrees(self.limit),
            )
            text = joined([limit, text])
        motion = turn_of(rig, found.turn)
        metres = length_of_unit(scene)
        moves = tuple(move_of(thing, motion, metres) for thing in things)
        return ProposedChange(self.bl_label, text, moves)


def _axis_words(turn: Floats, axes: Floats) -> Message:
    """Name of the axis of a turn (3,), in the viewer's axes (3, 3)."""
    along = np.abs(axes @ turn) / max(float(np.linalg.norm(turn)), np.finfo(float).tiny)
    names = (
        Message("the horizontal axis across the view"),
        Message("the vertical axis"),
        Message("the line of sight"),
    )
    n = int(along.argmax())
    return names[n] if along[n] > ALONG else Message("an oblique axis")


class KIRIKO_OT_move_to_glass(Proposes, bpy.types.Operator):
    """Move picture and display from behind the glass to its back, or from inside it to its front"""

    bl_idname = "kiriko.move_to_glass"
    bl_label = "Move to Glass"
    bl_options = {"REGISTER", "UNDO"}

    def proposed(
        self, context: bpy.types.Context
    ) -> Generator[float, None, ProposedChange | Message]:
        scene = context.scene
        rig = work.read(context).rig
        yield 0.5
        way = way_to_glass(rig)
        if not way:
            return Message("'{name}' is already at the glass.", name=rig.picture_place.name)

        metres = length_of_unit(scene)
        moves = []
        for part, shift in zip((rig.picture_place, rig.display), shifts_by(rig, way), strict=True):
            thing = scene.objects.get(part.name)
            if thing is None:
                raise RigError(
                    "'{name}' can't be moved: {why}.",
                    name=part.name,
                    why=Message("it is an instance"),
                )
            moves.append(move_of(thing, Motion(np.eye(3), shift), metres))
        text = Message(
            "'{picture}' moves {way} towards the viewer, and '{display}' with it.",
            picture=rig.picture_place.name,
            way=length_text(scene, way),
            display=rig.display.name,
        )
        return ProposedChange(self.bl_label, text, tuple(moves))
