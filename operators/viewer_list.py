"""The list of viewers: add, remove and move entries; two eyes, and a grid of heads."""

from collections.abc import Iterator

import bpy
import numpy as np

from ..core.base.arrays import Floats
from ..core.base.errors import RigError
from ..core.base.messages import Message
from ..core.blender.data.camera_viewer import Seat, camera_at, number_shown
from ..core.blender.data.units import length_of_unit
from ..core.blender.lifecycle.eyes import EyePlace, heads, make_viewers, two_eyes
from ..core.blender.lifecycle.listed_viewers import add, changing
from ..core.blender.read.places import PlaceCache, read_places
from ..core.blender.read.scene import read_seat
from ..core.lab.atlas.heads import AXES, check_perspective, evenly, middle_of, viewer_about
from ..core.rig.rig import Viewer
from . import compared, look_through, needed, reporting

NO_LIST = Message("There is only one viewer: add another")
MOST = 1000  # heads of a grid
BOX = (0.12, 0.06, 0.06)  # m
MOST_LENGTH = 1e4  # m, of a box, or between two eyes


class _OfList:
    """Mix-in for an operator on the scene's list of viewers."""

    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        is_there = camera_at(context.scene, 0) is not None
        return needed.can_run(cls, [] if is_there else [needed.NEEDED["VIEWER"]])

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            self.change(context)
            return {"FINISHED"}
        return {"CANCELLED"}


class KIRIKO_OT_add_viewer(_OfList, bpy.types.Operator):
    """Add the active camera, or a new one, as another viewer"""

    bl_idname = "kiriko.add_viewer"
    bl_label = "Add Viewer"

    def change(self, context: bpy.types.Context) -> None:
        scene, active = context.scene, context.active_object
        known = [camera_at(scene, n) for n in range(max(len(scene.kiriko.viewers), 1))]
        is_new = active is not None and active.type == "CAMERA" and active not in known
        add(scene, [active if is_new else None])


class _OfSeveral(_OfList):
    """Mix-in for an operator on the active entry of a non-empty list."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, [] if len(context.scene.kiriko.viewers) else [NO_LIST])


class KIRIKO_OT_remove_viewer(_OfSeveral, bpy.types.Operator):
    """Remove the viewer from the list; its camera stays"""

    bl_idname = "kiriko.remove_viewer"
    bl_label = "Remove Viewer"

    number: bpy.props.IntProperty(
        default=-1,
        min=-1,
        options={"SKIP_SAVE", "HIDDEN"},
    )

    def change(self, context: bpy.types.Context) -> None:
        with changing(context.scene) as listed:
            here = number_shown(context.scene) if self.number < 0 else self.number
            listed.remove(min(here, len(listed) - 1))


class KIRIKO_OT_move_viewer(_OfSeveral, bpy.types.Operator):
    """Move the viewer in the list; the first one is the main viewer"""

    bl_idname = "kiriko.move_viewer"
    bl_label = "Move Viewer"

    step: bpy.props.IntProperty(default=1, options={"SKIP_SAVE", "HIDDEN"})

    def change(self, context: bpy.types.Context) -> None:
        with changing(context.scene) as listed:
            here = number_shown(context.scene)
            there = min(max(here + self.step, 0), len(listed) - 1)
            listed.move(here, there)
            context.scene.kiriko.viewer_shown = there


class _InPlace(_OfList):
    """Mix-in for an operator that replaces the first viewer by new cameras."""

    def change(self, context: bpy.types.Context) -> None:
        camera = camera_at(context.scene, 0)
        context.view_layer.update()
        viewer = read_seat(Seat(camera), context.evaluated_depsgraph_get(), context.scene)
        check_perspective(viewer)

        places = list(self.places(context, camera, viewer))
        if compared.is_shown(context.scene):
            compared.leave()
        with look_through.apart(context.scene):  # a view keeps its camera
            made = make_viewers(context.scene, camera, places)
        context.view_layer.update()
        text = Message(
            "Added {n} viewers around '{viewer}', which is now off.",
            n=len(made),
            viewer=camera.name,
        )
        reporting.report(self, "INFO", text)


class KIRIKO_OT_two_eyes(_InPlace, bpy.types.Operator):
    """Add a left and a right eye, from the camera's stereo settings"""

    bl_idname = "kiriko.two_eyes"
    bl_label = "Two Eyes"

    def places(
        self, context: bpy.types.Context, camera: bpy.types.Object, viewer: Viewer
    ) -> Iterator[EyePlace]:
        """Places and directions of the eyes; RigError if their distances are invalid."""
        stereo, metres = camera.data.stereo, length_of_unit(context.scene)
        apart, away = (
            metres * x for x in (stereo.interocular_distance, stereo.convergence_distance)
        )
        if not (0 < apart < MOST_LENGTH and away > 0):  # true for NaN as well
            raise RigError(
                "The eyes of '{viewer}' are {apart:g} m apart and converge at {away:g} m: set both"
                " in its camera's Stereoscopy.",
                viewer=camera.name,
                apart=apart,
                away=away,
            )
        return two_eyes(camera)


class KIRIKO_OT_viewer_grid(_InPlace, bpy.types.Operator):
    """Add a grid of viewers around this one, all aimed at the picture"""

    bl_idname = "kiriko.viewer_grid"
    bl_label = "Grid"

    heads: bpy.props.IntVectorProperty(
        name="Heads",
        description="To the right, up and forward",
        size=3,
        default=(3, 1, 1),
        min=1,
        soft_max=9,
        max=100,
    )
    box: bpy.props.FloatVectorProperty(
        name="Box",
        description="To the right, up and forward",
        size=3,
        default=BOX,
        min=0.0,
        subtype="XYZ",
        unit="LENGTH",
    )

    def places(
        self, context: bpy.types.Context, camera: bpy.types.Object, viewer: Viewer
    ) -> Iterator[EyePlace]:
        """Places and directions of the heads; RigError if one is at the picture."""
        n = int(np.prod(self.heads))
        if not 1 < n <= MOST:
            raise RigError("The grid has {n} heads: set 2 to {most} in all.", n=n, most=MOST)
        metres = length_of_unit(context.scene)
        if not self.properties.is_property_set("box"):
            self.box = [length / metres for length in BOX]
        sizes = metres * np.array(self.box)
        if not (sizes < MOST_LENGTH).all():  # true for NaN as well
            raise RigError(
                "The grid measures {right:g} x {up:g} x {forward:g} m: set three lengths.",
                **dict(zip(AXES, sizes, strict=True)),
            )
        offsets = evenly(self.heads, sizes)
        middle, name = _looked_at(context, camera, viewer)
        others = [viewer_about(viewer, middle, name, offset) for offset in offsets]
        return heads(camera, viewer, others, metres)


def _looked_at(
    context: bpy.types.Context, camera: bpy.types.Object, viewer: Viewer
) -> tuple[Floats, Message]:
    """The point (3,) m that heads look at, and its name.

    It is the picture's centre, or for a picture in the viewers' pixels the point straight ahead at
    which two eyes converge.
    """
    scene = context.scene
    if scene.kiriko.picture_source == "IMAGE":
        away = length_of_unit(scene) * camera.data.stereo.convergence_distance
        if not away > 0:  # NaN from a script
            raise RigError(
                "The eyes of '{viewer}' are {apart:g} m apart and converge at {away:g} m: set both"
                " in its camera's Stereoscopy.",
                viewer=camera.name,
                apart=length_of_unit(scene) * camera.data.stereo.interocular_distance,
                away=away,
            )
        return viewer.position + away * viewer.axes[2], Message("its Convergence Plane Distance")
    pictures = read_places(context.evaluated_depsgraph_get(), scene, PlaceCache()).pictures
    if not pictures:
        raise RigError("{reason}.", reason=needed.NEEDED["PICTURE"])
    return middle_of(pictures[0])
