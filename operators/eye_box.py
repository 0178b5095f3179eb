"""Eye box: how far the viewer's head may go, as numbers and as a surface in the scene."""

from collections.abc import Generator
from dataclasses import asdict
from typing import Any

import bpy

from ..core.blender.kept import Numbers
from ..core.blender.objects import surface_object
from ..core.blender.units import length_of_unit, length_text
from ..core.errors import RigError
from ..core.measure.eye_box import LEAST, LIMIT, EyeBox, Walk
from ..core.measure.eye_box_surface import surface_of
from ..core.messages import Message, joined
from ..core.numbers import number
from ..core.steps import within
from . import long_work, needed, work
from .surfaces import EYE_BOX as NAME
from .surfaces import MADE_FOR
from .visible_range import Remove

DISPLACEMENT = "displacement"  # arcmin, at the surface's points
NUMBERS = "kiriko_eye_box"  # the surface's own property that keeps them, as text
FOUND = 0.7  # of the progress: the rest is the surface


class KIRIKO_OT_remove_eye_box(Remove, bpy.types.Operator):
    """Remove the surface of the eye box, and its numbers"""

    bl_idname = "kiriko.remove_eye_box"
    bl_label = "Remove Eye Box"
    surface = NAME
    lacking = Message("There is no eye box")


class KIRIKO_OT_eye_box(long_work.LongWork, bpy.types.Operator):
    """Tell how far the viewer's head may go each way, and add a surface through these places"""

    bl_idname = "kiriko.eye_box"
    bl_label = "Eye Box"
    bl_options = {"REGISTER", "UNDO"}

    limit: bpy.props.FloatProperty(
        name="Limit",
        description="Minutes of arc by which a point of the picture may be off",
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
        description="Share of the picture that has to be seen, of that which the viewer sees from"
        " its own place",
        subtype="FACTOR",
        default=LEAST,
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
        walk = Walk(work.session().plan(rig, work.settings_of(scene)), self.limit, self.share)
        yield 0.0
        box = yield from within(walk.box(), 0.0, FOUND)
        viewer = rig.viewers[0].name
        if not walk.n_seen:
            raise RigError(
                "The viewer '{viewer}' sees nothing of the picture from its own place: move it, or"
                " enlarge the display.",
                viewer=viewer,
            )
        if not any(box.ends):
            raise RigError(
                "From its own place the viewer '{viewer}' sees the picture off by more than {limit}"
                " arcmin, as others ask for it elsewhere: raise Limit, or its weight.",
                viewer=viewer,
                limit=number(self.limit),
            )

        surface = yield from within(surface_of(walk, box), FOUND, 1.0)
        positions = surface.positions / length_of_unit(scene)
        off = {DISPLACEMENT: surface.off}
        thing = surface_object(scene, NAME, positions, surface.triangles, off)
        numbers = numbers_of(box, viewer)
        thing[NUMBERS], thing[MADE_FOR] = Numbers(numbers).text(), made_for
        return Message(
            "Within {limit} arcmin the head of '{viewer}' may go {ways}: '{name}'.",
            limit=number(self.limit),
            viewer=viewer,
            ways=joined(ways_in_words(scene, numbers), ", "),
            name=thing.name,
        )


def numbers_of(box: EyeBox, viewer: str) -> dict[str, Any]:
    """The numbers of an eye box, and whose it is, as its surface keeps them."""
    return {**asdict(box), "viewer": viewer}


def box_of(surface: bpy.types.Object | None) -> dict[str, Any] | None:
    """The numbers that a surface keeps; None where there is none."""
    return None if surface is None else Numbers.read(surface.get(NUMBERS, "")).by_name or None


def ways_in_words(scene: bpy.types.Scene, box: dict[str, Any]) -> list[Message]:
    """How far the head may go, in three lines, in the scene's unit."""
    names = ("left", "right", "up", "down", "nearer", "farther")
    lengths = {
        name: Message("{length} and more", length=text) if is_open else text
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
