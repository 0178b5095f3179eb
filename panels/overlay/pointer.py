"""The part under the pointer, whose name the overlay shows.

Blender reports the pointer's position only to gizmos. An invisible gizmo records it and is never
selected.
"""

from collections.abc import Iterator

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d

from ...core.base.arrays import Floats
from ...core.blender.data.rigs import active_rig
from ...operators import sketcher
from ...operators.framing import corners

# corners of each side of a box, in Blender's order
SIDES = np.array(
    [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
)

_pointed_at: dict[int, str] = {}  # name of the part, by address of the region


def pointed_at(region: bpy.types.Region) -> str:
    """The name of the part under the pointer in a region; '' for none."""
    return _pointed_at.get(region.as_pointer(), "")


def parts_of(scene: bpy.types.Scene) -> Iterator[bpy.types.Object]:
    """The visible parts of the active rig."""
    rig = active_rig(scene)
    for thing in rig.all_objects if rig is not None else ():
        if thing.kiriko.role != "NONE" and thing.visible_get():
            yield thing


def part_at(context: bpy.types.Context, place: Floats) -> str:
    """The name of the smallest part whose box covers a place (2,) px of the region."""
    found = []
    for thing in parts_of(context.scene):
        ends = [
            location_3d_to_region_2d(context.region, context.region_data, corner.tolist())
            for corner in corners(thing)
        ]
        if len(ends) < 8 or None in ends:
            continue
        box = np.array(ends, float)
        if any(_is_within(box[side], place) for side in SIDES):
            found.append((float(np.ptp(box, axis=0).prod()), thing.name))
    return min(found, default=(0.0, ""))[1]


def _is_within(polygon: Floats, place: Floats) -> bool:
    """Whether a place (2,) lies in a convex polygon (n, 2) with an area."""
    along = np.roll(polygon, -1, axis=0) - polygon
    to_place = place - polygon
    turn = along[:, 0] * to_place[:, 1] - along[:, 1] * to_place[:, 0]
    return bool((turn > 0).all() or (turn < 0).all())


class KIRIKO_GT_pointer(bpy.types.Gizmo):
    """Records the part under the pointer."""

    bl_idname = "KIRIKO_GT_pointer"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw nothing."""

    def test_select(self, context: bpy.types.Context, location: tuple[int, int]) -> int:
        region = context.region
        name = part_at(context, np.array(location, float))
        if name != pointed_at(region):
            _pointed_at[region.as_pointer()] = name
            context.area.tag_redraw()
        return -1


class KIRIKO_GGT_pointer(bpy.types.GizmoGroup):
    """Holds the invisible gizmo."""

    bl_label = "Kiriko Part Names"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options = {"PERSISTENT"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        is_shown = context.window_manager.kiriko.show_overlay and context.area is not None
        return is_shown and sketcher.is_looked_at(context.area)

    def setup(self, context: bpy.types.Context) -> None:
        self.gizmos.new(KIRIKO_GT_pointer.bl_idname)


CLASSES = (KIRIKO_GT_pointer, KIRIKO_GGT_pointer)


def register() -> None:
    """Start recording."""
    for one in CLASSES:
        bpy.utils.register_class(one)


def unregister() -> None:
    """Stop recording."""
    for one in reversed(CLASSES):
        bpy.utils.unregister_class(one)
    _pointed_at.clear()
