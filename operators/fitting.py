"""Fit Display, Fit Plate, Fit Picture: resize a part to the picture's light."""

from collections.abc import Callable, Generator
from typing import Any

import bpy
import numpy as np

from ..core.base.errors import RigError
from ..core.base.messages import Message, joined
from ..core.base.steps import subprogress
from ..core.base.words import listed, percent
from ..core.bench.part_sizes import Fitted, Wanted, fit_display, fit_picture, fit_plate
from ..core.bench.picture_light import MOST
from ..core.blender.data.units import length_of_unit, length_text
from ..core.blender.read.resize import scale_by
from ..core.rig.rig import ROLES, Rig
from . import long_work, needed, work

SMALLER = 0.7  # of a part's width: smallest saving worth a hint
SAME = 2e-3  # of its size: smaller changes are not made


def share(default: float) -> bpy.props.FloatProperty:
    """Property for the fraction of light that must arrive."""
    return bpy.props.FloatProperty(
        name="Share",
        description="Part of the available light that must arrive",
        subtype="FACTOR",
        default=default,
        min=0.5,
        max=1.0,
        precision=4,
    )


class FitsPart(long_work.LongWork):
    """Mix-in for an operator that resizes a part of the rig.

    role : of the part
    fit : function like `fit_display`, which also gets the part's number
    """

    role: str
    fit: Callable[[Rig, Callable, Wanted, int], Generator[float, None, Fitted]]

    move: bpy.props.BoolProperty(
        name="Move",
        description="Also move it if that allows a better size",
        default=False,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.mode != "OBJECT":
            return needed.can_run(cls, [needed.LEAVE_EDIT_MODE])
        reasons = needed.missing_parts(context.scene)
        if not reasons and not needed.has_part(context.scene, cls.role):
            noun = next(role.noun for role in ROLES if role.name == cls.role)
            reasons = [Message("The rig has no {role}", role=noun)]
        return needed.can_run(cls, reasons)

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        scene = context.scene
        rig = work.read(context).rig
        number, thing = self.part(context, rig)
        settings = work.settings_of(scene)
        wanted = Wanted(share=self.share, moves=self.move)
        yield 0.05

        steps = type(self).fit(rig, lambda rig: work.session().plan(rig, settings), wanted, number)
        fitted = yield from subprogress(steps, 0.05, 1.0)
        metres = length_of_unit(scene)
        is_moved = bool(np.abs(fitted.shift).max() > SAME * fitted.width)
        if abs(fitted.size - 1) < SAME and not is_moved:
            return joined([self._unchanged(thing, fitted), *_limit(scene, fitted)])

        try:
            scale_by(context, thing, fitted.size, is_moved * fitted.shift / metres)
        except RigError as why:
            raise RigError("'{name}' keeps its size: {why}.", name=thing.name, why=why) from None
        work.forget_report(scene)
        changed = self._changed(scene, thing, fitted)
        return joined([changed, *_limit(scene, fitted)])

    def part(self, context: bpy.types.Context, rig: Rig) -> tuple[int, bpy.types.Object]:
        """Number of the part within its role, and its object: the active one, otherwise the
        first.
        """
        parts = parts_of(rig, self.role)
        names = [part.name for part in parts]
        active = context.active_object
        number = names.index(active.name) if active is not None and active.name in names else 0
        thing = context.scene.objects.get(names[number])
        if thing is None or thing.kiriko.role != self.role:
            raise RigError(
                "'{name}' keeps its size: {why}.",
                name=names[number],
                why=Message("it is an instance"),
            )
        if not thing.is_editable:
            raise RigError(
                "'{name}' keeps its size: {why}.",
                name=thing.name,
                why=Message("it is linked from another file"),
            )
        return number, thing

    def _unchanged(self, thing: bpy.types.Object, fitted: Fitted) -> Message:
        text = Message("'{name}' already has the right size.", name=thing.name)
        if not listed(fitted.lost):
            return text
        self.level = "WARNING"
        return joined([text, Message("Still {lost}.", lost=listed(fitted.lost))])

    def _changed(self, scene: bpy.types.Scene, thing: bpy.types.Object, fitted: Fitted) -> Message:
        """Report on the new size, and the fraction of the picture that arrives."""
        text = Message(
            "'{name}' is now {width} wide: {after} of the picture arrives ({before} before).",
            name=thing.name,
            width=length_text(scene, fitted.width),
            after=percent(fitted.after),
            before=percent(fitted.before),
        )
        if listed(fitted.lost):
            text = joined([text, Message("Still {lost}.", lost=listed(fitted.lost))])
        if 0 < fitted.for_most < SMALLER * fitted.width:
            hint = Message(
                "{share} of the light needs only {width}: lower Share.",
                share=percent(MOST),
                width=length_text(scene, fitted.for_most),
            )
            text = joined([text, hint])
        return text


def _limit(scene: bpy.types.Scene, fitted: Fitted) -> list[Message]:
    """A sentence on the limit, if it was reached."""
    if not fitted.limit:
        return []
    width = length_text(scene, fitted.limit)
    return [Message("Widths above {width} are not tried.", width=width)]


def parts_of(rig: Rig, role: str) -> tuple[Any, ...]:
    """Parts of a rig with a role, by the role's name."""
    return next(rig.of(one) for one in ROLES if one.name == role)


class KIRIKO_OT_fit_display(FitsPart, bpy.types.Operator):
    """Resize the display to just receive the picture's light"""

    bl_idname = "kiriko.fit_display"
    bl_label = "Fit Display"
    bl_options = {"REGISTER", "UNDO"}

    role = "DISPLAY"
    share: share(1.0)

    @staticmethod
    def fit(rig, plan_of, wanted, number):
        return fit_display(rig, plan_of, wanted)


class KIRIKO_OT_fit_plate(FitsPart, bpy.types.Operator):
    """Resize the plate to just pass the picture's light"""

    bl_idname = "kiriko.fit_plate"
    bl_label = "Fit Plate"
    bl_options = {"REGISTER", "UNDO"}

    role = "PLATE"
    share: share(1.0)
    fit = staticmethod(fit_plate)


class KIRIKO_OT_fit_picture_size(FitsPart, bpy.types.Operator):
    """Resize the picture to the largest that gets through the glass"""

    bl_idname = "kiriko.fit_picture_size"
    bl_label = "Fit Picture"
    bl_options = {"REGISTER", "UNDO"}

    role = "PICTURE"
    share: share(0.999)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.scene.kiriko.picture_source == "IMAGE":
            reason = needed.NO_PLANE
            return needed.can_run(cls, [reason])
        return super().poll(context)

    @staticmethod
    def fit(rig, plan_of, wanted, number):
        return fit_picture(rig, plan_of, wanted)
