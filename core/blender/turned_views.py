"""3D views that were turned to the viewer's camera for a while.

What a view showed before is kept on its screen: undo leaves both alone, and a file has both.
"""

from collections.abc import Callable
from typing import Any

import bpy

from .kept import Changed

TURNED_MARK = "kiriko_turned"  # on a screen
POSE = ("view_location", "view_rotation", "view_distance")  # which Blender moves with the camera


def turn(
    screen: bpy.types.Screen, area: bpy.types.Area, scene: bpy.types.Scene, camera: Any
) -> None:
    """Have a 3D view of a screen show a camera; what it showed at first is kept."""
    space = area.spaces.active
    kept = Changed.read(screen.get(TURNED_MARK, ""))
    place = list(screen.areas).index(area)
    if place not in {one[0] for one in kept.changes}:
        is_local = scene.camera != camera
        before = _shown(space)
        changes = [*kept.changes, [place, before, [is_local, camera.name]]]
        screen[TURNED_MARK] = Changed("", changes).text()
    if scene.camera != camera:
        space.use_local_camera, space.camera = True, camera
    space.region_3d.view_perspective = "CAMERA"


def put_back(is_held: Callable[[Any], bool] = lambda space: False) -> None:
    """Have all turned views show again what they showed before, but for those that are held."""
    for screen in bpy.data.screens:
        if TURNED_MARK not in screen:
            continue
        held = []
        for place, before, after in Changed.read(screen[TURNED_MARK]).changes:
            space = _space(screen, place)
            if space is not None and is_held(space):
                held.append([place, before, after])
            elif space is not None:
                _show_again(screen, space, before, after)
        if held:
            screen[TURNED_MARK] = Changed("", held).text()
        else:
            del screen[TURNED_MARK]


def pause() -> list[tuple[bpy.types.Screen, str, list[tuple[Any, list[Any]]]]]:
    """Put all views back, as for a file that is saved; `go_on` takes what is returned."""
    paused = []
    for screen in bpy.data.screens:
        if TURNED_MARK in screen:
            text = screen[TURNED_MARK]
            spaces = [_space(screen, place) for place, *_ in Changed.read(text).changes]
            views = [(space, _shown(space)) for space in spaces if space is not None]
            paused.append((screen, text, views))
    put_back()
    return paused


def go_on(paused: list[tuple[bpy.types.Screen, str, list[tuple[Any, list[Any]]]]]) -> None:
    """Turn the views that were paused once more."""
    for screen, text, views in paused:
        screen[TURNED_MARK] = text
        for space, shown in views:
            _show(screen, space, shown)


def _shown(space: Any) -> list[Any]:
    """What a view shows: whether by a camera of its own, which, perspective and pose."""
    view = space.region_3d
    pose = [view.view_location[:], view.view_rotation[:], view.view_distance]
    camera = space.camera.name if space.camera else ""
    return [space.use_local_camera, camera, view.view_perspective, pose]


def _show(screen: bpy.types.Screen, space: Any, shown: list[Any]) -> None:
    is_local, camera, perspective, pose = shown
    _have_camera(screen, space, is_local, camera)
    space.region_3d.view_perspective = perspective
    for name, value in zip(POSE, pose, strict=True):
        setattr(space.region_3d, name, value)


def _have_camera(screen: bpy.types.Screen, space: Any, is_local: bool, camera: str) -> None:
    space.use_local_camera = is_local
    if is_local:
        space.camera = bpy.data.objects.get(camera)
        return
    # a view without a camera of its own has, and would set, the scene's
    windows = [window for manager in bpy.data.window_managers for window in manager.windows]
    scene = next((window.scene for window in windows if window.screen == screen), None)
    if scene is not None:
        space.camera = scene.camera


def _show_again(screen: bpy.types.Screen, space: Any, before: list[Any], after: list[Any]) -> None:
    """What was shown before, as far as the artist has not chosen another camera or turned away."""
    is_local, camera = after
    if is_local != space.use_local_camera:
        return
    # one that has no name any more was deleted or renamed meanwhile
    is_known = bpy.data.objects.get(camera) is not None
    if is_local and is_known and (space.camera is None or space.camera.name != camera):
        return
    if space.region_3d.view_perspective == "CAMERA":
        _show(screen, space, before)
    else:
        _have_camera(screen, space, *before[:2])


def _space(screen: bpy.types.Screen, place: int) -> Any | None:
    """The 3D view of an area, by its place in the screen."""
    areas = list(screen.areas)[place : place + 1]
    spaces = [space for area in areas for space in area.spaces if space.type == "VIEW_3D"]
    return spaces[0] if spaces else None
