"""Visible range and eye box: surfaces of where the picture is seen from, and how far a head may
move.
"""

from collections.abc import Generator
from dataclasses import asdict
from typing import Any

import bpy
import numpy as np

from ..core.base.errors import RigError, out_of_range
from ..core.base.messages import Message, joined
from ..core.base.numbers import number
from ..core.base.steps import Steps, hold_progress, subprogress
from ..core.base.words import percent
from ..core.blender.data.camera_viewer import seats_of
from ..core.blender.data.made_objects import find_made, shown_quads, surface_object
from ..core.blender.data.stored_records import StoredNumbers
from ..core.blender.data.units import length_of_unit, length_text
from ..core.lab.calibrate.visible_range import SURVEY, visible_range
from ..core.lab.measure.head_box import as_data, check_box, head_box
from ..core.lab.measure.head_range import LEAST, LIMIT, EyeBox, Walk, surface_of
from ..core.light.plan import Plan
from . import framing, long_work, needed, work
from .outdated_surfaces import EYE_BOX, MADE_FOR, RANGE


class Remove:
    """Mix-in for an operator that removes a surface.

    surface : its name for `find_made`
    """

    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        is_there = find_made(context.scene, cls.surface) is not None
        return needed.can_run(cls, [] if is_there else [needed.NOTHING])

    def execute(self, context: bpy.types.Context) -> set[str]:
        thing = find_made(context.scene, self.surface)
        mesh = thing.data
        bpy.data.objects.remove(thing)
        if mesh is not None and mesh.users == 0:
            bpy.data.meshes.remove(mesh)
        return {"FINISHED"}


class KIRIKO_OT_remove_visible_range(Remove, bpy.types.Operator):
    """Remove the surface of the visible range"""

    bl_idname = "kiriko.remove_visible_range"
    bl_label = "Remove Visible Range"
    surface = RANGE


class KIRIKO_OT_visible_range(long_work.LongWork, bpy.types.Operator):
    """Show where the picture is visible from, and how bright it is, as a surface"""

    bl_idname = "kiriko.visible_range"
    bl_label = "Visible Range"
    bl_options = {"REGISTER", "UNDO"}

    share: bpy.props.FloatProperty(
        name="Share",
        description="Part of the picture that must be visible",
        subtype="FACTOR",
        default=0.95,
        min=0.01,
        max=1.0,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, needed.missing_parts(context.scene))

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        scene = context.scene
        rig = work.read(context).rig
        made_for = work.rig_now(context).as_text()
        plan = work.session().plan(rig, work.settings_of(scene))
        yield 0.0
        found = yield from visible_range(plan, self.share)
        is_seen = found.share >= self.share
        if not (is_seen[:-1, :-1] & is_seen[1:, :-1] & is_seen[:-1, 1:] & is_seen[1:, 1:]).any():
            raise RigError(
                "Nowhere within {angle:.0f} degrees is {share} of the picture visible, only"
                " {best}: enlarge the display{plate}, or lower Share.",
                angle=np.degrees(SURVEY.farthest_rad),
                share=percent(self.share),
                best=percent(found.best),
                plate=Message(" or the plate") if rig.plates else "",
            )

        positions = found.positions.reshape(-1, 3) / length_of_unit(scene)
        brightness = {"brightness": found.brightness.ravel()}
        thing = surface_object(scene, RANGE, positions, shown_quads(is_seen), brightness)
        thing[MADE_FOR] = made_for
        if not bpy.app.background:
            framing.bring_into_sight(
                context, thing
            )  # the surface is around the viewer, far from the bench
        left, right, down, up = np.degrees(found.extent)
        if np.isnan(left):
            return Message(
                "'{name}' marks where {share} of the picture is visible. The viewer is outside it.",
                name=thing.name,
                share=percent(self.share),
            )

        return Message(
            "{share} of the picture is visible from {left:.1f} degrees left to {right:.1f} right"
            " of the viewer, and {down:.1f} below to {up:.1f} above: '{name}'.",
            share=percent(self.share),
            left=left,
            right=right,
            down=down,
            up=up,
            name=thing.name,
        )


DISPLACEMENT = "displacement"  # attribute in arcmin, at the surface's points
SERVED = "head_box"  # key among the figures
BLENDED = Message(
    "Blended shows double edges. The figures refer to the middle between them, where Sharp shows"
    " the edge."
)
NUMBERS = "kiriko_eye_box"  # custom property of the surface with the figures, as text
# Progress when the box is found, and when its surface is; the rest is the viewers' box.
FOUND, SURFACE = 0.5, 0.7


class OffFromStartError(RigError):
    """The picture exceeds the limit already at the viewer's place.

    Other figures of the rig are still useful.
    """


class KIRIKO_OT_remove_eye_box(Remove, bpy.types.Operator):
    """Remove the eye box's surface and figures"""

    bl_idname = "kiriko.remove_eye_box"
    bl_label = "Remove Eye Box"
    surface = EYE_BOX


class KIRIKO_OT_eye_box(long_work.LongWork, bpy.types.Operator):
    """Find how far the viewer's head may move, and show the range as a surface"""

    bl_idname = "kiriko.eye_box"
    bl_label = "Eye Box"
    bl_options = {"REGISTER", "UNDO"}

    limit: bpy.props.FloatProperty(
        name="Limit",
        description="Allowed error of a point of the picture, in arcminutes",
        default=LIMIT,
        min=1e-3,
        soft_min=0.1,
        soft_max=60.0,
        max=3600.0,
        precision=2,
        step=10,
    )
    share: bpy.props.FloatProperty(
        name="Share",
        description="Part of the picture that must stay visible, relative to the part visible from"
        " the viewer's own position",
        subtype="FACTOR",
        default=LEAST,
        min=0.01,
        max=1.0,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, needed.missing_parts(context.scene))

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        check_limit(self.limit)
        check_share(self.share)
        scene = context.scene
        rig = work.read(context).rig
        made_for = work.rig_now(context).as_text()
        walk = Walk(work.session().plan(rig, work.settings_of(scene)), self.limit, self.share)
        yield 0.0
        viewer = rig.viewers[0].name
        yield from hold_progress(0.02, begin(walk))
        box = yield from subprogress(walk.box(), 0.02, FOUND)
        surface = yield from subprogress(surface_of(walk, box), FOUND, SURFACE)
        served = yield from subprogress(_served(walk.plan), SURFACE, 1.0)
        positions = surface.positions / length_of_unit(scene)
        off = {DISPLACEMENT: surface.off}
        thing = surface_object(scene, EYE_BOX, positions, surface.triangles, off)
        numbers = {**numbers_of(box, viewer), **served}
        thing[NUMBERS], thing[MADE_FOR] = StoredNumbers(numbers).text(), made_for
        if not bpy.app.background:
            framing.bring_into_sight(
                context, thing
            )  # the surface is around the viewer, far from the bench
        text = Message(
            "The head of '{viewer}' may move {ways} within {limit} arcmin: '{name}'.",
            limit=number(self.limit),
            viewer=viewer,
            ways=joined(ways_in_words(scene, numbers), ", "),
            name=thing.name,
        )
        return joined([text, *of_blended(scene)])


def check_limit(limit: float) -> None:
    """Raise RigError unless a limit, arcmin, is above 0; scripts may set any value."""
    if not 0 < limit < float("inf"):  # true for NaN as well
        raise out_of_range(Message("The rig"), "Limit", limit, 0)


def check_share(share: float) -> None:
    """Raise RigError unless a fraction of the picture is above 0, up to 1; scripts may set any
    value.
    """
    if not 0 < share <= 1:  # true for NaN as well
        raise out_of_range(Message("The rig"), "Share", share, 0, 1)


def of_blended(scene: bpy.types.Scene) -> list[Message]:
    """Note on a box of several viewers whose colours are blended; otherwise none."""
    is_blended = scene.kiriko.disagreement == "BLENDED" and len(seats_of(scene)) > 1
    return [BLENDED] if is_blended else []


def begin(walk: Walk) -> Steps[None]:
    """Begin a head range.

    RigError if nothing is visible at the start, OffFromStartError if the limit is exceeded there.
    """
    yield from walk.begin()
    viewer = walk.plan.viewer.name
    if not walk.seen:
        raise RigError(
            "The viewer '{viewer}' can't see the picture: move it, or enlarge the display.",
            viewer=viewer,
        )
    if walk.begun > 1:
        raise OffFromStartError(
            "Even at its own position, the viewer '{viewer}' sees the picture more than {limit}"
            " arcmin off, because other viewers need it elsewhere: raise Limit, or this viewer's"
            " weight.",
            viewer=viewer,
            limit=number(walk.limit),
        )


def _served(plan: Plan) -> Generator[float, None, dict[str, Any]]:
    """Comparison of solving for all viewers with solving for the centre of their box.

    By the key under which a surface stores it; empty if the viewers span no box. Yields progress
    0..1.
    """
    try:
        check_box(plan.rig)
    except RigError:
        return {}
    found = as_data((yield from head_box(plan)))
    for way in ("for_all", "for_middle"):
        del found[way]["curves"]
    return {SERVED: found}


def numbers_of(box: EyeBox, viewer: str) -> dict[str, Any]:
    """Figures of an eye box and its viewer, as its surface stores them."""
    return {**asdict(box), "viewer": viewer}


def box_of(surface: bpy.types.Object | None) -> dict[str, Any] | None:
    """Figures stored by a surface; None without one."""
    return None if surface is None else StoredNumbers.read(surface.get(NUMBERS, "")).by_name or None


def served_in_words(box: dict[str, Any]) -> list[Message]:
    """Errors in the viewers' box, in three lines; none if they span no box."""
    served = box.get(SERVED)
    if served is None or None in (*served["for_all"].values(), *served["for_middle"].values()):
        return []
    everyone, middle = served["for_all"], served["for_middle"]
    return [
        Message(
            "In the box of {n} viewers the error is {mean} arcmin on average, {largest} at most.",
            n=served["n_viewers"],
            mean=number(everyone["mean_arcmin"]),
            largest=number(everyone["largest_arcmin"]),
        ),
        Message(
            "Solved for its centre only: {mean} arcmin, {largest} at most.",
            mean=number(middle["mean_arcmin"]),
            largest=number(middle["largest_arcmin"]),
        ),
        Message(
            "At the centre the error is {mean} arcmin, or {alone} if solved for it only.",
            mean=number(everyone["middle_mean_arcmin"]),
            alone=number(round(middle["middle_mean_arcmin"], 6)),  # 0 up to rounding
        ),
    ]


def ways_in_words(scene: bpy.types.Scene, box: dict[str, Any]) -> list[Message]:
    """Range of the head in three lines, in the scene's unit."""
    names = ("left", "right", "up", "down", "nearer", "farther")
    lengths = {
        name: Message("over {length}", length=text) if is_open else text
        for name, is_open in zip(names, box["is_open"], strict=True)
        for text in [length_text(scene, box[name])]
    }
    return [
        Message("{left} left, {right} right", left=lengths["left"], right=lengths["right"]),
        Message("{up} up, {down} down", up=lengths["up"], down=lengths["down"]),
        Message(
            "{nearer} nearer, {farther} farther",
            nearer=lengths["nearer"],
            farther=lengths["farther"],
        ),
    ]
