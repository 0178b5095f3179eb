"""Framing: select a new rig and show all of it in the 3D view, if there is a window."""

from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent
from mathutils import Matrix

from ..core.base.arrays import Floats
from ..core.blender.data.changes import Change, change, put_back
from ..core.blender.data.rigs import elsewhere
from ..core.blender.data.screens import place_of, spaces
from ..core.blender.view.view_framing import Framed, Window, framed, in_sight, turned
from ..core.rig.rig import ROLES
from . import work
from .windows import view_of

BENCH = {role.name for role in ROLES if role.number is not None} - {"PROJECTOR", "BLOCKER"}
LEAST_SEEN = 0.5  # of a new object's corners: with more in view, the view does not move
_before: list[list[Any]] = []  # view changes stored by rigs, before undo or redo


def select(context: bpy.types.Context, things: tuple[bpy.types.Object, ...]) -> None:
    """Select only these objects. The active object stays active if it is one of them."""
    for thing in context.selected_objects:
        thing.select_set(False)
    for thing in things:
        thing.select_set(True)
    if context.view_layer.objects.active not in things:
        context.view_layer.objects.active = things[0]


def frame_rig(context: bpy.types.Context) -> list[tuple[str, list[Change]]]:
    """Show all parts in the active 3D view.

    Returns the changes of its clip distances, with the name of its screen.
    """
    area = view_of(context)
    if area is None:
        return []

    context.view_layer.update()
    things = _bench(context.scene)
    points = np.concatenate([corners(thing) for thing in things])
    space = area.spaces.active
    views = list(space.region_quadviews) or [space.region_3d]
    start, end = space.clip_start, space.clip_end
    front = next((front_of(thing) for thing in things if thing.kiriko.role == "PICTURE"), None)

    for view in views:
        if view.view_perspective == "CAMERA":
            view.view_perspective = "PERSP"
        window = window_of(area, view.view_perspective == "PERSP")
        axes = np.array(view.view_rotation.to_matrix()).T
        if front is not None and window.is_perspective and not view.lock_rotation:
            axes = turned(axes, front)
            view.view_rotation = Matrix(axes.T.tolist()).to_quaternion()
        found = framed(points, axes, window)
        view.view_location, view.view_distance = found.centre.tolist(), found.distance
        start, end = min(start, found.clip_start), max(end, found.clip_end)

    area.tag_redraw()
    changes = change(space, {"clip_start": start, "clip_end": end})
    return [(place_of(area)[0].name, changes)]


def bring_into_sight(context: bpy.types.Context, thing: bpy.types.Object) -> None:
    """Frame a new object and the other parts in the active 3D view if less than half of it is
    visible. The view's direction stays; camera views do not move.
    """
    area = view_of(context)
    if area is None or area.spaces.active.region_quadviews:
        return
    space = area.spaces.active
    view = space.region_3d
    if view.view_perspective == "CAMERA":
        return

    context.view_layer.update()
    window = window_of(area, view.view_perspective == "PERSP")
    axes = np.array(view.view_rotation.to_matrix()).T
    ends = space.clip_start, space.clip_end
    stands = Framed(np.array(view.view_location), view.view_distance, *ends)
    points = corners(thing)
    if in_sight(points, axes, stands, window).mean() >= LEAST_SEEN:
        return
    points = np.concatenate([points, *map(corners, _bench(context.scene))])
    found = framed(points, axes, window)
    view.view_location, view.view_distance = found.centre.tolist(), found.distance
    area.tag_redraw()


def _bench(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The parts of the active rig without the viewer."""
    is_elsewhere = elsewhere(scene)
    return [t for t in scene.objects if t.kiriko.role in BENCH and not is_elsewhere(t)]


def window_of(area: bpy.types.Area, is_perspective: bool = True) -> Window:
    """The window of a 3D view, and the margins under sidebars and headers."""
    region = next(region for region in area.regions if region.type == "WINDOW")
    width, height = max(region.width, 1), max(region.height, 1)
    covered = dict.fromkeys(("LEFT", "RIGHT", "BOTTOM", "TOP"), 0)

    for other in area.regions:
        if min(other.width, other.height) > 1 and other.alignment in covered:
            x, y = other.x - region.x, other.y - region.y
            reach = {
                "LEFT": min(x + other.width, width),
                "RIGHT": min(width - x, width),
                "BOTTOM": min(y + other.height, height),
                "TOP": min(height - y, height),
            }[other.alignment]
            covered[other.alignment] = max(covered[other.alignment], reach)

    return Window(width, height, *covered.values(), area.spaces.active.lens, is_perspective)


def front_of(plane: bpy.types.Object) -> Floats:
    """The direction (3,) of a new picture's front."""
    axis = np.array(plane.matrix_world)[:3, 2]
    return axis / np.linalg.norm(axis)


def corners(thing: bpy.types.Object) -> Floats:
    """Corners (8, 3) of an object's bounding box, world; only its location if it has none."""
    box = np.array(thing.bound_box) if thing.data is not None else np.zeros((1, 3))
    matrix = np.array(thing.matrix_world)
    return box @ matrix[:3, :3].T + matrix[:3, 3]


def _changes_of_views() -> list[list[Any]]:
    """View changes stored by all rigs: screen, path, value before and after."""
    rigs = (group for group in bpy.data.collections if group.library is None)
    views = (view for rig in rigs for view in rig.kiriko.views)
    return [[view.screen, view.path, view.before, view.after] for view in views]


@persistent
def before_undo(*_: object) -> None:
    """Remember the view changes of rigs."""
    _before[:] = _changes_of_views()


@persistent
def on_undo(*_: object) -> None:
    """Restore the clip distances after undo, which does not change views: those before a removed
    rig, or with a restored one.
    """
    there = _changes_of_views()
    gone = [one for one in reversed(_before) if one not in there]
    back = [one for one in there if one not in _before]
    turned_round = [[screen, path, after, before] for screen, path, before, after in back]
    for screen, *one in gone + turned_round:
        for space in spaces(screen):
            put_back(space, [tuple(one)])


HANDLERS = (
    ("undo_pre", before_undo),
    ("redo_pre", before_undo),
    ("undo_post", on_undo),
    ("redo_post", on_undo),
)


def register() -> None:
    """Start following undo."""
    work.listen(HANDLERS)


def unregister() -> None:
    """Stop following undo."""
    work.stop_listening(HANDLERS)
