"""Make Part: a new part for one that is missing, or another object in its place."""

from collections.abc import Generator
from dataclasses import replace

import bpy

from ..core.base.errors import KirikoError, RigError
from ..core.base.messages import Message
from ..core.base.steps import subprogress
from ..core.bench.part_sizes import fit_display, fit_picture
from ..core.bench.placement import Stand, rectangle, stand_of
from ..core.blender.data.camera_viewer import is_deleted
from ..core.blender.data.made_objects import Workbench
from ..core.blender.data.overridden import overridden
from ..core.blender.data.rigs import active_rig, mark_made
from ..core.blender.data.units import length_of_unit
from ..core.blender.lifecycle.rig_objects import (
    in_units,
    make_display,
    make_picture,
    make_plate,
    make_viewer,
)
from ..core.blender.read.places import PlaceCache, read_places
from ..core.rig.rig import ROLES, Display, PicturePlace, Rig
from . import long_work, needed, reporting, work
from .repair import RepairsPart

PIXELS = (1920, 1080)
MADE = ("DISPLAY", "PICTURE", "PLATE", "VIEWER")
ROLES_MADE = tuple((role.name, role.label, "") for role in ROLES if role.name in MADE)


class KIRIKO_OT_make_part(long_work.LongWork, bpy.types.Operator):
    """Make a new part in the right place and size"""

    bl_idname = "kiriko.make_part"
    bl_label = "Make Part"
    bl_options = {"REGISTER", "UNDO"}

    role: bpy.props.EnumProperty(name="Role", items=ROLES_MADE, options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, [] if context.mode == "OBJECT" else [needed.LEAVE_EDIT_MODE])

    def steps(self, context: bpy.types.Context) -> Generator[float, None, Message]:
        scene, metres = context.scene, length_of_unit(context.scene)
        context.view_layer.update()
        rig = read_places(context.evaluated_depsgraph_get(), scene, PlaceCache())
        role = next(role for role in ROLES if role.name == self.role)
        if rig.of(role):
            raise RigError("The rig already has a {noun}.", noun=role.noun)
        stand = stand_of(self.role, rig)
        source = scene.kiriko.result.source
        pixels = tuple(source.size) if source is not None and all(source.size) else PIXELS
        width = stand.side * max(pixels[0] / pixels[1], 1.0)
        yield 0.05

        side = width if self.role == "DISPLAY" else stand.side
        side *= yield from subprogress(self._fitted(scene, rig, stand, pixels, width), 0.05, 1.0)
        thing = self._made(scene, stand, side, pixels, metres)
        context.view_layer.update()
        return Message("Made '{name}'.", name=thing.name)

    def _fitted(
        self,
        scene: bpy.types.Scene,
        rig: Rig,
        stand: Stand,
        pixels: tuple[int, int],
        width: float,
    ) -> Generator[float, None, float]:
        """Factor for the size of a display or picture; 1 if unknown."""
        if self.role not in {"DISPLAY", "PICTURE"}:
            return 1.0
        settings = work.settings_of(scene)
        if self.role == "DISPLAY":
            mesh = rectangle(stand.frame, width, width * pixels[1] / pixels[0])
            rig = replace(rig, displays=(Display("display", mesh, *pixels),))
        else:
            mesh = rectangle(stand.frame, stand.side, stand.side)
            rig = replace(rig, pictures=(PicturePlace("picture", 1, 1, mesh),))
        fit = fit_display if self.role == "DISPLAY" else fit_picture
        try:
            rig.check()
            fitted = yield from fit(rig, lambda rig: work.session().plan(rig, settings))
        except KirikoError:  # the checklist reports whatever else is missing
            return 1.0
        # without a plate the display is at the picture, and as large
        return fitted.size if rig.plates or self.role == "PICTURE" else max(fitted.size, 1.0)

    def _made(
        self,
        scene: bpy.types.Scene,
        stand: Stand,
        side: float,
        pixels: tuple[int, int],
        metres: float,
    ) -> bpy.types.Object:
        """The object, linked to the rig's collection so that Remove Rig finds it."""
        rig = active_rig(scene)
        made = Workbench(scene, "", rig or scene.collection)
        at = in_units(stand.frame, metres)
        try:
            if self.role == "DISPLAY":
                thing = make_display(made, at, side / metres, pixels)
            elif self.role == "PICTURE":
                thing = make_picture(made, at, side / metres)
            elif self.role == "PLATE":
                thing = make_plate(made, at, side / metres)
            else:
                thing = make_viewer(made, at, stand.distance, stand.side, metres)
                scene.kiriko.viewer = thing
                if scene.camera is None or is_deleted(scene.camera):
                    scene.camera = thing
            if rig is not None:
                mark_made(made.made)
                rig.kiriko.has_plate |= self.role == "PLATE"
        except BaseException:
            made.clear()
            raise
        return thing


class KIRIKO_OT_use_part(RepairsPart, bpy.types.Operator):
    """Use this object as the rig's glass"""

    bl_idname = "kiriko.use_part"
    bl_label = "Use as Glass"

    may_be_linked = True

    def repair(self, context: bpy.types.Context, thing: bpy.types.Object) -> Message:
        (own,) = overridden(context.scene, (thing,))
        own.kiriko.role = "GLASS"
        return Message("'{name}' is now the rig's glass.", name=thing.name)


class KIRIKO_OT_go_without_plate(bpy.types.Operator):
    """Use no plate: light goes straight from the display to the glass"""

    bl_idname = "kiriko.go_without_plate"
    bl_label = "Remove Plate"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        is_lost = needed.has_lost_plate(context.scene)
        return needed.can_run(cls, [] if is_lost else [Message("The rig's plate isn't missing")])

    def execute(self, context: bpy.types.Context) -> set[str]:
        active_rig(context.scene).kiriko.has_plate = False
        reporting.report(self, "INFO", Message("The rig now works without a plate."))
        return {"FINISHED"}
