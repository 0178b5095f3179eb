"""A 3D view that looks through the viewer, in Cycles; all settings that
are changed for it are kept in the scene as text, to be put back.
"""

from typing import Any

import bpy
import numpy as np

from .changes import Change, change, put_back
from .framing import Window
from .kept import Changed
from .preview_settings import BOUNCES
from .remove_rig import spaces
from .viewer import frame_of

SAMPLES = 16  # a pixel: the light of the display comes without noise, reflections with a little
FILLED = 0.9  # of the view, by the viewer's image
SQRT2 = np.sqrt(2.0)
SCENE = {
    "render.engine": "CYCLES",
    "cycles.preview_samples": SAMPLES,
    "cycles.use_preview_denoising": False,
    "cycles.use_preview_adaptive_sampling": False,
    "cycles.max_bounces": BOUNCES,
    "cycles.glossy_bounces": BOUNCES,
    "cycles.transmission_bounces": BOUNCES,
    "cycles.transparent_max_bounces": BOUNCES,
    "cycles.min_light_bounces": BOUNCES,
    "cycles.min_transparent_bounces": BOUNCES,
    "cycles.caustics_refractive": True,
    "cycles.caustics_reflective": True,
    "cycles.sample_clamp_direct": 0.0,
    "cycles.sample_clamp_indirect": 0.0,
    "view_settings.look": "None",
    "view_settings.view_transform": "Standard",
}
# of a picture's plane, which would stand before the light that makes the picture
PLANE = dict.fromkeys(
    (f"visible_{ray}" for ray in ("camera", "diffuse", "glossy", "transmission", "shadow")), False
)
POSE = ("view_location", "view_rotation", "view_distance")  # which Blender moves with the camera


def enter(scene: bpy.types.Scene, screen: str, space: Any, window: Window) -> None:
    """Have a 3D view of a screen look through the scene's viewer; all of it, or nothing."""
    viewer = scene.kiriko.viewer or scene.camera
    kept = []
    try:
        kept += [["", *one] for one in change(scene, SCENE)]
        for thing in scene.objects:
            if thing.kiriko.role == "PICTURE" and thing.is_editable:
                kept += [[f"object/{thing.name}", *one] for one in change(thing, PLANE)]
        if viewer.type == "CAMERA" and viewer.data.is_editable:
            frame = change(viewer, {"data.show_passepartout": False})
            kept += [[f"object/{viewer.name}", *one] for one in frame]
        kept += [[f"screen/{screen}", *one] for one in _enter_view(scene, viewer, space, window)]
    except BaseException:
        _put_back(scene, kept)
        raise
    scene.kiriko.looking = Changed("", kept).text()


def _enter_view(
    scene: bpy.types.Scene, viewer: bpy.types.Object, space: Any, window: Window
) -> list[Change]:
    """Change a 3D view alone: the scene's own camera stays what it is."""
    view = space.region_3d
    pose = [(f"region_3d.{name}", _plain(getattr(view, name)), None) for name in POSE]
    before = [space.use_local_camera, space.camera.name if space.camera else ""]
    space.use_local_camera, space.camera = True, viewer

    zoom, offset = _fitted(viewer, scene, window)
    changes = change(
        space,
        {
            "region_3d.view_perspective": "CAMERA",
            "region_3d.view_camera_zoom": zoom,
            "region_3d.view_camera_offset": (offset, 0.0),
            "shading.type": "RENDERED",
            "overlay.show_overlays": False,
        },
    )
    return [*pose, ("camera", before, viewer.name), *changes]


def _plain(value: Any) -> Any:
    return value if isinstance(value, float) else list(value)


def _fitted(
    viewer: bpy.types.Object, scene: bpy.types.Scene, window: Window
) -> tuple[float, float]:
    """Zoom and sideways offset of a camera view in which the viewer's whole image is seen.

    Blender shows as much along the window's longer side as the camera sees along its image's, times
    a factor that it keeps as a zoom.
    """
    width, height = frame_of(viewer, scene.render).size
    longer = max(width, height)
    free = max(window.width - window.left - window.right, 1)
    share = min(free * longer / width, window.height * longer / height)
    factor = FILLED * share / max(window.width, window.height)
    zoom = float(np.clip(50 * (2 * np.sqrt(factor) - SQRT2), -30, 600))
    return zoom, (window.right - window.left) / (4 * factor * window.width)


def leave(scene: bpy.types.Scene, is_loaded: bool = False) -> None:
    """Put everything back that nobody has changed since.

    is_loaded : from a file, in which Blender opens no view as Rendered, but as Solid
    """
    text, scene.kiriko.looking = scene.kiriko.looking, ""
    changes = Changed.read(text).changes
    if is_loaded:
        changes = [
            [place, path, before, "SOLID" if path == "shading.type" else after]
            for place, path, before, after in changes
        ]
    _put_back(scene, changes)


def views(scene: bpy.types.Scene) -> list[Any]:
    """The 3D views that look through the viewer now."""
    changes = Changed.read(scene.kiriko.looking).changes
    places = dict.fromkeys(place for place, *_ in changes if place.startswith("screen/"))
    return [space for place in places for space in _owners(scene, place, changes)]


def enter_again(scene: bpy.types.Scene, text: str, again: list[Any]) -> None:
    """Change scene and views once more, as after a file was saved without it."""
    scene.kiriko.looking = text
    changes = Changed.read(text).changes
    for place, path, _, after in changes:
        for owner in again if place.startswith("screen/") else _owners(scene, place, changes):
            if path == "camera":
                owner.use_local_camera, owner.camera = True, bpy.data.objects.get(after)
            elif after is not None:
                change(owner, {path: after})


def put_views_back(scene: bpy.types.Scene, text: str) -> None:
    """Put the 3D views back alone, where undo has put back the scene."""
    changes = Changed.read(text).changes
    _put_back(scene, [one for one in changes if one[0].startswith("screen/")])


def _put_back(scene: bpy.types.Scene, changes: list[list[Any]]) -> None:
    """By place, path, value before and after; the last one first.

    A view that is another camera's by now is left, and one that
    was turned away keeps the direction it has.
    """
    poses = [one for one in changes if one[3] is None]
    for place, path, before, after in reversed(changes):
        for owner in _owners(scene, place, changes):
            if path == "camera":
                owner.use_local_camera = before[0]
                owner.camera = bpy.data.objects.get(before[1])
            elif path == "region_3d.view_perspective":
                _turn_back(owner, before, [one for one in poses if one[0] == place])
            elif after is not None:
                put_back(owner, [(path, before, after)])


def _turn_back(space: Any, before: str, poses: list[list[Any]]) -> None:
    if space.region_3d.view_perspective == "CAMERA":
        space.region_3d.view_perspective = before
        for _, path, value, _ in poses:
            setattr(space.region_3d, path.removeprefix("region_3d."), value)


def _owners(scene: bpy.types.Scene, place: str, changes: list[list[Any]]) -> list[Any]:
    """All that a place of the record stands for: the scene, an
    object, or those 3D views of a screen that look through it.
    """
    kind, _, name = place.partition("/")
    if kind == "object":
        return [scene.objects[name]] if name in scene.objects else []
    if not kind:
        return [scene]

    # a viewer that was renamed, or deleted since, is known, too
    viewers = {None, scene.kiriko.viewer or scene.camera}
    viewers |= {bpy.data.objects.get(after) for _, path, _, after in changes if path == "camera"}
    return [s for s in spaces(name) if s.use_local_camera and s.camera in viewers]
