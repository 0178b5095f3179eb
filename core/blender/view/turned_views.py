"""3D views turned to the viewer's camera for a while.

The screen stores their previous state, since undo ignores screens and files include them.
"""

from collections.abc import Callable
from typing import Any

import bpy

from ..data.camera_viewer import frame_of
from ..data.screens import areas_of, place_of, window_showing
from ..data.stored_records import Changed
from .view_framing import Window, image_framed

TURNED_MARK = "kiriko_turned"  # on a screen
POSE = ("view_location", "view_rotation", "view_distance")  # Blender moves them with the camera
FRAMING = ("view_camera_zoom", "view_camera_offset")  # of a camera view


def turn(
    area: bpy.types.Area, scene: bpy.types.Scene, camera: bpy.types.Object, window: Window
) -> None:
    """Show a camera's whole image in a 3D view; the view's first state is stored."""
    space = area.spaces.active
    framing = image_framed(frame_of(camera, scene.render).size, window)
    screen, place = place_of(area)
    changed = Changed.read(screen.get(TURNED_MARK, ""))
    if place not in {one[0] for one in changed.changes}:
        is_local = space.use_local_camera or scene.camera != camera
        before = _shown(space)
        _set(space.region_3d, FRAMING, framing)
        after = [is_local, camera.name, _values(space.region_3d, FRAMING)]
        screen[TURNED_MARK] = Changed("", [*changed.changes, [place, before, after]]).text()
    if space.use_local_camera or scene.camera != camera:
        space.use_local_camera, space.camera = True, camera
    space.region_3d.view_perspective = "CAMERA"


def put_back(is_held: Callable[[Any], bool] = lambda space: False) -> None:
    """Restore all turned views except held ones."""
    for screen in bpy.data.screens:
        if TURNED_MARK not in screen:
            continue
        held = []
        for place, before, after in Changed.read(screen[TURNED_MARK]).changes:
            space = _space(screen, place)
            if space is not None and is_held(space):
                held.append([place, before, after])
            elif space is not None:
                _show_again(space, before, after)
        if held:
            screen[TURNED_MARK] = Changed("", held).text()
        else:
            del screen[TURNED_MARK]


def pause() -> list[tuple[bpy.types.Screen, str, list[tuple[Any, list[Any]]]]]:
    """Restore all views before a file is saved. Pass the result to `go_on`."""
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
    """Turn the paused views again."""
    for screen, text, views in paused:
        screen[TURNED_MARK] = text
        for space, shown in views:
            _show(space, shown)


def _shown(space: Any) -> list[Any]:
    """State of a view: whether it has a local camera, camera, perspective, pose and framing."""
    view = space.region_3d
    camera = space.camera.name if space.camera else ""
    pose, framing = _values(view, POSE), _values(view, FRAMING)
    return [space.use_local_camera, camera, view.view_perspective, pose, framing]


def _values(view: bpy.types.RegionView3D, names: tuple[str, ...]) -> list[Any]:
    values = [getattr(view, name) for name in names]
    return [value if isinstance(value, float) else list(value) for value in values]


def _set(view: bpy.types.RegionView3D, names: tuple[str, ...], values: Any) -> None:
    for name, value in zip(names, values, strict=True):
        setattr(view, name, value)


def _show(space: Any, shown: list[Any]) -> None:
    is_local, camera, perspective, pose, framing = shown
    _have_camera(space, is_local, camera)
    space.region_3d.view_perspective = perspective
    _set(space.region_3d, POSE, pose)
    _set(space.region_3d, FRAMING, framing)


def _have_camera(space: Any, is_local: bool, camera: str) -> None:
    space.use_local_camera = is_local
    if is_local:
        space.camera = bpy.data.objects.get(camera)
        return
    # without a local camera, setting the view's camera would set the scene's
    window = window_showing(space)
    if window is not None:
        space.camera = window.scene.camera


def _show_again(space: Any, before: list[Any], after: list[Any]) -> None:
    """Restore a view's state, unless the artist has chosen another camera or turned away."""
    is_local, camera, fitted = after
    if is_local != space.use_local_camera:
        return
    # the camera may have been deleted or renamed since
    is_known = bpy.data.objects.get(camera) is not None
    if is_local and is_known and (space.camera is None or space.camera.name != camera):
        return
    view, framing = space.region_3d, before[-1]
    if (now := _values(view, FRAMING)) != fitted:
        framing = now  # the artist's own
    if view.view_perspective == "CAMERA":
        _show(space, [*before[:-1], framing])
    else:
        _have_camera(space, *before[:2])
        _set(view, FRAMING, framing)


def _space(screen: bpy.types.Screen, place: int) -> Any | None:
    """The 3D view of an area, by its place in the screen."""
    areas = areas_of(screen)[place : place + 1]
    spaces = [space for area in areas for space in area.spaces if space.type == "VIEW_3D"]
    return spaces[0] if spaces else None
