"""Visible range: an object in the scene, made of the places from which the picture is seen."""

from collections.abc import Generator

import bpy
import numpy as np

from ..core.base.errors import RigError
from ..core.base.messages import Message
from ..core.base.words import percent
from ..core.blender.objects import made_surface, shown_quads, surface_object
from ..core.blender.scene import length_of_unit
from ..core.lab.calibrate.visible_range import SURVEY, visible_range
from . import framing, long_work, needed, work
from .surfaces import MADE_FOR
from .surfaces import RANGE as NAME


class Remove:
    """Mix-in for an operator that removes a surface.

    surface : its name, as `made_surface` knows it
    lacking : the reason why nothing can be removed, where there is none
    """

    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        is_there = made_surface(context.scene, cls.surface) is not None
        return needed.can_run(cls, [] if is_there else [cls.lacking])

    def execute(self, context: bpy.types.Context) -> set[str]:
        thing = made_surface(context.scene, self.surface)
        mesh = thing.data
        bpy.data.objects.remove(thing)
        if mesh is not None and mesh.users == 0:
            bpy.data.meshes.remove(mesh)
        return {"FINISHED"}


class KIRIKO_OT_remove_visible_range(Remove, bpy.types.Operator):
    """Remove the surface of the visible range"""

    bl_idname = "kiriko.remove_visible_range"
    bl_label = "Remove Visible Range"
    surface = NAME
    lacking = Message("There is no visible range")


class KIRIKO_OT_visible_range(long_work.LongWork, bpy.types.Operator):
    """Add a surface that shows where the picture is seen, at the viewer's distance, how bright"""

    bl_idname = "kiriko.visible_range"
    bl_label = "Visible Range"
    bl_options = {"REGISTER", "UNDO"}

    share: bpy.props.FloatProperty(
        name="Share",
        description="Share of the picture that has to be seen from a place for it to count",
        subtype="FACTOR",
        default=0.95,
        min=0.01,
        max=1.0,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, needed.lacking(context.scene))

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
                "No place within {angle:.0f} degrees shows {share} of the picture, the best"
                " one {best}: enlarge the display{plate}, or ask for less.",
                angle=np.degrees(SURVEY.farthest_rad),
                share=percent(self.share),
                best=percent(found.best),
                plate=Message(" or the plate") if rig.plates else "",
            )

        positions = found.positions.reshape(-1, 3) / length_of_unit(scene)
        brightness = {"brightness": found.brightness.ravel()}
        thing = surface_object(scene, NAME, positions, shown_quads(is_seen), brightness)
        thing[MADE_FOR] = made_for
        if not bpy.app.background:
            framing.bring_into_sight(context, thing)  # it is around the viewer, far from the bench
        left, right, down, up = np.degrees(found.extent)
        if np.isnan(left):
            return Message(
                "'{name}' marks the places that see {share} of the picture; the viewer is"
                " at none of them.",
                name=thing.name,
                share=percent(self.share),
            )

        return Message(
            "{share} of the picture is seen from {left:.1f} degrees left of the viewer to"
            " {right:.1f} right, and from {down:.1f} below to {up:.1f} above: '{name}'.",
            share=percent(self.share),
            left=left,
            right=right,
            down=down,
            up=up,
            name=thing.name,
        )
