"""Add rig: plate, display, picture and viewer around the selected glass, or around a new ball."""

from typing import Any

import bpy
import numpy as np

from ..core import blender_shaders as shaders
from ..core.blender_image import encoded_image
from ..core.blender_objects import Workbench, resize_rectangle, world_bounds
from ..core.blender_result import listed, percent
from ..core.blender_scene import length_of_unit
from ..core.errors import RigError
from ..core.placement import Placement, lattice, place, reach_of_picture
from ..core.plan import make_plan
from . import work

# The rig of Kiriko's reference (docs): what 0 means, for a glass up to LARGE wide; a larger one scales all of them
DISTANCE, VIEWER_DISTANCE, PLATE_SIZE = 0.15, 1.0, 0.488  # m
LARGE = 0.1  # m
SURFACES = {"MESH", "CURVE", "SURFACE", "FONT", "META"}  # what has faces once evaluated
BALL_RADIUS = 0.025  # m
PICTURE_SHARE = 0.6  # of the glass's smaller side, as the viewer sees it
DISPLAY_LIMIT = 10  # times the picture
ROOM = 1.01  # a display is a little larger than what was traced to its edge


def _length(name: str, description: str) -> bpy.props.FloatProperty:
    return bpy.props.FloatProperty(
        name=name, description=description, subtype="DISTANCE", default=0.0, min=0.0, precision=4
    )


def _values(context: bpy.types.Context) -> list[tuple[Any, str, Any]]:
    """All that is changed of what is there already, to be put back when something fails: owner, name, value."""
    scene = context.scene
    names = (
        (scene, ("camera",)),
        (scene.kiriko, ("viewer", "picture_source")),
        (scene.render, ("resolution_x", "resolution_y", "resolution_percentage")),
        *((thing.kiriko, ("role",)) for thing in context.selected_objects),
    )
    return [(owner, name, getattr(owner, name)) for owner, group in names for name in group]


class KIRIKO_OT_add_rig(bpy.types.Operator):
    """Build plate, display, picture and viewer around the selected glass objects, or around a new ball of glass"""

    bl_idname = "kiriko.add_rig"
    bl_label = "Add Rig"
    bl_options = {"REGISTER", "UNDO"}

    distance: _length("Distance", "From the glass's centre to the plate's; 0: 0.15 m, or more for large glass")
    tilt: bpy.props.FloatProperty(
        name="Tilt",
        description="Of the plate about the horizontal; at 45 degrees the display lies straight below the plate",
        subtype="ANGLE",
        default=np.pi / 4,
        min=np.radians(5),
        max=np.radians(85),
    )
    picture_size: _length("Picture", "Side of the picture; 0: six tenths of the glass")
    viewer_distance: _length(
        "Viewer Distance", "From the glass's centre to the viewer; 0: 1 m, or more for large glass"
    )
    azimuth: bpy.props.FloatProperty(
        name="Azimuth",
        description="How far the viewer goes round the glass; at 0 it looks along +Y",
        subtype="ANGLE",
        default=0.0,
    )
    field: _length("Field", "Width the viewer sees at the glass; 0: as wide as the glass")
    viewer_resolution: bpy.props.IntProperty(
        name="Viewer Resolution",
        description="Pixels a side of the scene's render; 0: leave it as it is",
        default=512,
        min=0,
        max=16384,
    )
    plate_size: _length("Plate", "Side of the plate; 0: 0.488 m, or more for large glass")
    display_size: _length("Display", "Width of the display; 0: large enough for every ray that carries the picture")
    max_display_size: _length("Display Limit", "Widest automatic display; 0: ten times the picture")
    display_resolution: bpy.props.IntVectorProperty(
        name="Display Resolution",
        description="Pixels of the display, across and down",
        size=2,
        default=(512, 512),
        min=1,
        max=16384,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.mode != "OBJECT":
            cls.poll_message_set("Leave edit mode first.")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        before = _values(context)
        bench = None
        with work.told(self):
            try:
                self._refuse_second(context.scene)
                bench = Workbench(context.scene, "Kiriko Rig")
                level, text = self._build(context, bench)
            except BaseException:
                if bench is not None:
                    bench.clear()
                for owner, name, value in before:
                    setattr(owner, name, value)
                raise
            context.scene.kiriko.result.summary = text
            self.report({level}, text)
            return {"FINISHED"}
        return {"CANCELLED"}

    def _refuse_second(self, scene: bpy.types.Scene) -> None:
        for role in ("DISPLAY", "PICTURE"):
            found = work.parts(scene).get(role)
            if found:
                raise RigError(
                    f"The scene has a {role.lower()} already ('{found[0].name}'): set its role to None first."
                )

    def _build(self, context: bpy.types.Context, bench: Workbench) -> tuple[str, str]:
        """Make everything; returns how good and a sentence about it. All lengths in Blender units."""
        scene = context.scene
        unit = length_of_unit(scene)
        glasses = [t for t in context.selected_objects if t.type in SURFACES and t.kiriko.role in {"NONE", "GLASS"}]
        if not glasses:
            glasses = [self._ball(scene, bench, BALL_RADIUS / unit)]
        for glass in glasses:
            glass.kiriko.role = "GLASS"
        context.view_layer.update()
        low, high = world_bounds(glasses, context.evaluated_depsgraph_get())
        if not np.isfinite([low, high]).all() or not (high > low).any():
            raise RigError(f"The glass '{glasses[0].name}' has no size: give it faces.")
        corners = np.stack(np.meshgrid(*np.stack([low, high], axis=1)), axis=-1).reshape(-1, 3)
        across = corners @ np.array([np.cos(self.azimuth), np.sin(self.azimuth), 0.0])
        width, height = np.ptp(across), high[2] - low[2]
        wide = max(width, height)
        grow = max(1.0, wide * unit / LARGE) / unit
        picture_size = self.picture_size or PICTURE_SHARE * (min(width, height) or wide)
        viewer_distance = self.viewer_distance or VIEWER_DISTANCE * grow
        placement = place((low + high) / 2, self.distance or DISTANCE * grow, self.tilt, viewer_distance, self.azimuth)

        plate_size = self.plate_size or PLATE_SIZE * grow
        plate = bench.rectangle("Kiriko Plate", placement.plate, plate_size, plate_size)
        plate.kiriko.role, plate.display_type = "PLATE", "WIRE"
        plate.data.materials.append(bench.material("Kiriko Ideal Plate", shaders.be_plate))
        picture = bench.rectangle("Kiriko Picture", placement.picture, picture_size, picture_size)
        picture.kiriko.role, scene.kiriko.picture_source = "PICTURE", "PLANE"
        image = bench.keep(encoded_image("Kiriko Lattice", lattice()))
        picture.data.materials.append(bench.material("Kiriko Picture", lambda m: shaders.show_picture(m, image)))
        for kind in ("camera", "diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
            setattr(picture, f"visible_{kind}", False)  # a guide: in the artist's own renders the light itself is there
        viewer = bench.camera("Kiriko Viewer", placement.viewer, viewer_distance, self.field or wide)
        scene.kiriko.viewer = viewer
        scene.camera = scene.camera or viewer
        if self.viewer_resolution:
            scene.render.resolution_x = scene.render.resolution_y = self.viewer_resolution
            scene.render.resolution_percentage = 100
        return self._display(context, bench, placement, picture_size)

    def _ball(self, scene: bpy.types.Scene, bench: Workbench, radius: float) -> bpy.types.Object:
        at = np.eye(4)
        at[:3, 3] = scene.cursor.location
        ball = bench.ball("Kiriko Ball", at, radius)
        ball.data.materials.append(bench.material("Kiriko Glass", lambda m: shaders.be_glass(m, 1.49, True)))
        return ball

    def _display(
        self, context: bpy.types.Context, bench: Workbench, placement: Placement, picture: float
    ) -> tuple[str, str]:
        """Make the display as large as the light of the picture needs, within the limit."""
        columns, rows = self.display_resolution
        limit = self.display_size or self.max_display_size or DISPLAY_LIMIT * picture
        display = bench.rectangle("Kiriko Display", placement.display, limit, limit * rows / columns)
        display.kiriko.role = "DISPLAY"
        display.kiriko.resolution = self.display_resolution

        unit = length_of_unit(context.scene)
        frame = placement.display.copy()
        frame[:3, 3] *= unit
        plan = make_plan(work.read(context).rig, work.settings_of(context.scene))
        reach, lost = reach_of_picture(plan, frame)
        reach /= unit
        width = limit
        if not self.display_size and reach.any():
            width = min(limit, ROOM * 2 * max(reach[0], reach[1] * columns / rows))
            resize_rectangle(display.data, width, width * rows / columns)
        side = f"{1000 * width * unit:.4g} mm wide"
        if not lost:
            return "INFO", f"The display, {side}, takes all the light of the picture."
        taken = percent(1 - sum(lost.values()))
        return "WARNING", f"The display, {side}, takes {taken} of the picture: {listed(lost)}."
