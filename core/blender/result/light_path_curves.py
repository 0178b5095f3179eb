"""Light paths as curves in the scene, which artists can render: one object for each outcome."""

from collections.abc import Sequence

import bpy
import numpy as np
from mathutils import Matrix

from ...base.arrays import Floats
from ...base.messages import Message
from ...light.light_paths import LightPath
from ...light.rays import Reason
from ..data.made_objects import OBJECT_MARK, find_made
from ..data.rigs import active_rig, mark_made, name_for
from ..data.translation_context import data_name
from ..data.units import length_of_unit
from ..materials import shaders

COUNT = "kiriko_count"  # custom property of a curve object: number of rays
THICKNESS = 3e-4  # radius of a new curve, relative to the rig's size
# the objects by their names: linear colour, and the ends of light they show
OUTCOMES = {
    Message("Light Paths: Arrived"): ((0.05, 0.7, 0.1), {Reason.ARRIVED}),
    Message("Light Paths: Missed"): (
        (0.9, 0.05, 0.03),
        {Reason.MISSED_GLASS, Reason.MISSED_PLATE, Reason.MISSED_DISPLAY, Reason.OUTSIDE_CONE},
    ),
    Message("Light Paths: Lost in Glass"): (
        (1.0, 0.3, 0.02),
        {Reason.LOST_INSIDE, Reason.CUT_OFF},
    ),
    Message("Light Paths: Blocked"): ((0.35, 0.08, 0.8), {Reason.BLOCKED}),
}


def drawn_count(scene: bpy.types.Scene) -> int:
    """Number of rays of the active rig's drawn paths; 0 if there are none."""
    counts = (thing.get(COUNT) for name in OUTCOMES if (thing := _curve_of(scene, name)))
    return max((count for count in counts if isinstance(count, int)), default=0)


def draw_paths(
    scene: bpy.types.Scene, paths: Sequence[LightPath], count: int, rig_size: float
) -> None:
    """Draw paths as curves of the active rig, in place of those drawn before.

    count : number of rays, which later updates follow, too
    rig_size : m, for the thickness of new curves
    """
    for name in OUTCOMES:
        thing = _curve_of(scene, name)
        if thing is None:
            thing = _new_curve(scene, name, THICKNESS * rig_size / length_of_unit(scene))
        thing[COUNT] = count
    update_paths(scene, paths)


def update_paths(scene: bpy.types.Scene, paths: Sequence[LightPath]) -> None:
    """Give the curves that exist the points of new paths. Their looks stay as they are."""
    metres = length_of_unit(scene)
    points = [path.points / metres for path in paths]
    centre = np.concatenate(points).mean(axis=0) if paths else np.zeros(3)
    for name, (_, reasons) in OUTCOMES.items():
        thing = _curve_of(scene, name)
        if thing is not None and thing.mode == "OBJECT" and thing.data.is_editable:
            some = zip(points, paths, strict=True)
            _fill(thing.data, [at - centre for at, one in some if one.reason in reasons])
            thing.matrix_world = Matrix.Translation(centre)


def _curve_of(scene: bpy.types.Scene, name: Message) -> bpy.types.Object | None:
    """The curve object of an outcome; None if there is none, or it was converted."""
    thing = find_made(scene, name)
    return thing if thing is not None and thing.type == "CURVE" else None


def _new_curve(scene: bpy.types.Scene, outcome: Message, radius: float) -> bpy.types.Object:
    """An empty curve object in the active rig's collection; radius in Blender units."""
    name = name_for(scene, data_name(outcome))
    curve, material = bpy.data.curves.new(name, "CURVE"), bpy.data.materials.new(name)
    mark_made([material])  # so that it goes with the rig
    shaders.glow(material, OUTCOMES[outcome][0])
    curve.dimensions, curve.bevel_depth, curve.use_fill_caps = "3D", radius, True
    curve.materials.append(material)
    thing = bpy.data.objects.new(name, curve)
    thing[OBJECT_MARK] = str(outcome)
    for kind in ("diffuse", "volume_scatter", "shadow"):
        setattr(thing, f"visible_{kind}", False)  # so that it neither lights nor shades the scene
    (active_rig(scene) or scene.collection).objects.link(thing)
    return thing


def _fill(curve: bpy.types.Curve, lines: Sequence[Floats]) -> None:
    """Replace a curve's splines by polylines (k, 3), in its own space.

    They taper to the viewer's position, which would otherwise be inside all of them.
    """
    curve.splines.clear()
    for points in lines:
        spline = curve.splines.new("POLY")
        spline.points.add(len(points) - 1)
        homogeneous = np.insert(points, 3, 1.0, axis=1).astype(np.float32)
        spline.points.foreach_set("co", homogeneous.ravel())
        spline.points[0].radius = 0.0
