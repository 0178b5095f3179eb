"""A 3D view through the viewer, in Cycles.

The scene stores the changed settings as text; objects and cameras store their own, so a rename does
not matter. Every object is changed, visible or not, because Blender's visibility is only as recent
as its last update.
"""

from collections.abc import Iterable
from contextlib import suppress
from secrets import token_hex
from typing import Any

import bpy

from ..data.camera_viewer import frame_of, no_camera, viewer_of
from ..data.changes import Change, change, put_back
from ..data.rigs import elsewhere
from ..data.screens import spaces, window_showing
from ..data.stored_records import Changed
from ..data.visibility import is_visible
from ..preview.preview_settings import BOUNCES
from .view_framing import Window, image_framed


def widen(space: bpy.types.SpaceView3D) -> tuple[list[str], list[str]]:
    """Show all objects in a view in local view.

    Returns the names shown before and the names shown now; none if the view is not in local view.
    """
    layer = _layer(space)
    things = [] if layer is None else list(layer.objects)
    own = [thing.name for thing in things if _shows(space, thing)]
    for thing in things:
        thing.local_view_set(space, True)
    return own, [thing.name for thing in things]


def narrow(space: bpy.types.SpaceView3D, names: Iterable[str], widened: Iterable[str]) -> None:
    """Show only the named objects in a view in local view; all objects if none of them is left.

    If the view now hides any of the objects in `widened`, the artist has entered another local
    view, which stays.
    """
    layer = _layer(space)
    if layer is None:
        return
    names_before, then = set(names), set(widened)
    for thing in layer.objects:
        # Blender 4.2 gives no answer for object types that the view hides
        is_seen_else = getattr(space, f"show_object_viewport_{thing.type.lower()}", True)
        is_ours = thing.name in then and is_seen_else and is_visible(thing, layer)
        if is_ours and not _shows(space, thing):
            return
    if not names_before.isdisjoint(layer.objects.keys()):
        for thing in layer.objects:
            thing.local_view_set(space, thing.name in names_before)


def _shows(space: bpy.types.SpaceView3D, thing: bpy.types.Object) -> bool:
    """Whether a view in local view shows an object. Blender 4.2 reports its visibility instead of
    its membership in the local view.
    """
    return thing.local_view_get(space) or thing.visible_get(viewport=space)


def _layer(space: bpy.types.SpaceView3D) -> bpy.types.ViewLayer | None:
    """The view layer of a view in local view; None if it is not in local view or in no window."""
    window = None if space.local_view is None else window_showing(space)
    return None if window is None else window.view_layer


def is_dark(scene: bpy.types.Scene) -> bool:
    """Whether a scene has no lights and a black world; emissive objects do not count."""
    if any(thing.type == "LIGHT" and is_visible(thing) for thing in scene.objects):
        return False
    return scene.world is None or _is_black(scene.world)


def _is_black(world: bpy.types.World) -> bool:
    """Whether a world emits nothing; worlds with more nodes than a background count as bright."""
    has_nodes = bpy.app.version >= (5, 0) or world.use_nodes
    if not has_nodes or world.node_tree is None:
        return not any(world.color)

    output = world.node_tree.get_output_node("CYCLES")
    links = () if output is None else output.inputs["Surface"].links
    if not links:
        return True
    node = links[0].from_node
    if node.type != "BACKGROUND":
        return False

    color, strength = node.inputs["Color"], node.inputs["Strength"]
    is_off = not strength.is_linked and strength.default_value == 0
    return is_off or (not color.is_linked and not any(color.default_value[:3]))


SAMPLES = 16  # a pixel: the display's light has no noise, and the denoiser cleans reflections
SCENE = {
    "render.engine": "CYCLES",
    "cycles.preview_samples": SAMPLES,
    "cycles.use_preview_denoising": True,
    "cycles.preview_denoising_start_sample": 1,
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
}
# colours as exported; a custom colour configuration has its own views
VIEW = {"view_settings.look": "None", "view_settings.view_transform": "Standard"}
# of the picture's plane, which would block the display's light
PLANE = dict.fromkeys(
    (f"visible_{ray}" for ray in ("camera", "diffuse", "glossy", "transmission", "shadow")), False
)
LOOKING_MARK = "kiriko_looking"  # key and changes, stored on an object or a camera
# a studio light for scenes without light, where only the picture would be visible
FAINT = {
    "shading.use_scene_world_render": False,
    "shading.studiolight_intensity": 0.1,
    "shading.studiolight_background_alpha": 0.0,
}
LOCAL = "local view"  # objects of the previous local view
POSE = ("view_location", "view_rotation", "view_distance")  # Blender moves them with the camera


def enter(scene: bpy.types.Scene, screen: str, space: Any, window: Window) -> None:
    """Turn a 3D view to the scene's viewer; on an error nothing is changed."""
    viewer = viewer_of(scene)
    if viewer is None:
        raise no_camera()
    key = token_hex(8)
    changed = []
    try:
        changed += [["", *one] for one in change(scene, SCENE)]
        with suppress(TypeError):
            changed += [["", *one] for one in change(scene, VIEW)]
        is_elsewhere = elsewhere(scene)
        for thing in scene.objects:
            if thing.kiriko.role == "NONE" or not thing.is_editable:
                continue
            if is_elsewhere(thing):  # it would block the light
                _change(key, thing, {"hide_viewport": True})
            elif thing.kiriko.role == "PICTURE":
                _change(key, thing, PLANE)
        _change(key, viewer, {})
        if viewer.type == "CAMERA" and viewer.data.is_editable:
            _change(key, viewer.data, {"show_passepartout": False})
        changed += [[f"screen/{screen}", *one] for one in _enter_view(scene, viewer, space, window)]
    except BaseException:
        _put_back(scene, Changed(key, changed))
        _put_things_back(key)
        raise
    scene.kiriko_scene.looking = Changed(key, changed).text()


def _change(key: str, thing: bpy.types.ID, values: dict[str, Any]) -> None:
    """Change an object or a camera, which stores the changes itself. A record of another scene's
    view is continued.
    """
    before = Changed.read(thing.get(LOOKING_MARK, "")).changes
    changes = [*before, *map(list, change(thing, values))]
    if thing.is_editable:
        thing[LOOKING_MARK] = Changed(key, changes).text()


def things(scene: bpy.types.Scene) -> list[tuple[bpy.types.ID, str]]:
    """Objects and cameras changed by the scene's view, with their stored texts."""
    return _marked(Changed.read(scene.kiriko_scene.looking).rig)


def _marked(key: str) -> list[tuple[bpy.types.ID, str]]:
    marked = [
        (thing, thing[LOOKING_MARK])
        for thing in (*bpy.data.objects, *bpy.data.cameras)
        if LOOKING_MARK in thing
    ]
    return [(thing, text) for thing, text in marked if Changed.read(text).rig == key]


def _put_things_back(key: str) -> None:
    """Restore objects and cameras, and copies made of them since."""
    for thing, text in _marked(key):
        put_back(thing, Changed.read(text).changes)
        del thing[LOOKING_MARK]


def _enter_view(
    scene: bpy.types.Scene, viewer: bpy.types.Object, space: Any, window: Window
) -> list[Change]:
    """Change only a 3D view; the scene keeps its camera."""
    view = space.region_3d
    pose = [(f"region_3d.{name}", _plain(getattr(view, name)), None) for name in POSE]
    before = [space.use_local_camera, space.camera.name if space.camera else ""]
    space.use_local_camera, space.camera = True, viewer
    own, widened = widen(space)  # the display has to be visible, too

    zoom, offset = image_framed(frame_of(viewer, scene.render).size, window)
    is_faint = space.shading.use_scene_world_render and is_dark(scene)
    changes = change(
        space,
        {
            "region_3d.view_perspective": "CAMERA",
            "region_3d.view_camera_zoom": zoom,
            "region_3d.view_camera_offset": offset,
            "shading.type": "RENDERED",
            "overlay.show_overlays": False,
            **(FAINT if is_faint else {}),
        },
    )
    local = [(LOCAL, own, widened)] if own else []
    return [*pose, ("camera", before, viewer.name), *local, *changes]


def _plain(value: Any) -> Any:
    return value if isinstance(value, float) else list(value)


def leave(scene: bpy.types.Scene, is_loaded: bool = False) -> None:
    """Restore every setting nobody has changed since.

    is_loaded : the scene is from a file; Blender opens Rendered views as Solid
    """
    text, scene.kiriko_scene.looking = scene.kiriko_scene.looking, ""
    changed = Changed.read(text)
    if is_loaded:
        changes = [
            [place, path, before, "SOLID" if path == "shading.type" else after]
            for place, path, before, after in changed.changes
        ]
        changed = Changed(changed.rig, changes)
    _put_back(scene, changed)
    _put_things_back(changed.rig)


def views(scene: bpy.types.Scene) -> list[tuple[Any, bpy.types.Object | None]]:
    """The 3D views through the viewer, with their cameras."""
    changed = Changed.read(scene.kiriko_scene.looking)
    places = dict.fromkeys(place for place, *_ in changed.changes if place.startswith("screen/"))
    return [(space, space.camera) for place in places for space in _owners(scene, place, changed)]


def enter_again(
    scene: bpy.types.Scene,
    text: str,
    again: list[tuple[Any, bpy.types.Object | None]],
    marked: list[tuple[bpy.types.ID, str]],
) -> None:
    """Repeat the changes of scene, views and objects after a save."""
    scene.kiriko_scene.looking = text
    for thing, own in marked:
        change(thing, {path: after for path, _, after in Changed.read(own).changes})
        thing[LOOKING_MARK] = own
    for space, camera in again:
        space.use_local_camera, space.camera = True, camera

    spaces_again = [space for space, _ in again]
    for place, path, _, after in Changed.read(text).changes:
        for owner in spaces_again if place.startswith("screen/") else [scene]:
            if path == LOCAL:
                widen(owner)
            elif path != "camera" and after is not None:
                change(owner, {path: after})


def put_views_back(scene: bpy.types.Scene, text: str) -> None:
    """Restore only the 3D views, after undo has restored the scene."""
    changed = Changed.read(text)
    views_only = [one for one in changed.changes if one[0].startswith("screen/")]
    _put_back(scene, Changed(changed.rig, views_only))


def _put_back(scene: bpy.types.Scene, changed: Changed) -> None:
    """Restore changes, the last one first. A view with another camera is left alone; a view that
    was turned away keeps its direction.
    """
    poses = [one for one in changed.changes if one[3] is None]
    for place, path, before, after in reversed(changed.changes):
        for owner in _owners(scene, place, changed):
            if path == "camera":
                owner.use_local_camera = before[0]
                # without a local camera, setting the view's camera would set the scene's
                is_local = before[0]
                owner.camera = bpy.data.objects.get(before[1]) if is_local else scene.camera
            elif path == LOCAL:
                narrow(owner, before, after)
            elif path == "region_3d.view_perspective":
                _turn_back(owner, before, [one for one in poses if one[0] == place])
            elif after is not None:
                put_back(owner, [(path, before, after)])


def _turn_back(space: Any, before: str, poses: list[list[Any]]) -> None:
    if space.region_3d.view_perspective == "CAMERA":
        space.region_3d.view_perspective = before
        for _, path, value, _ in poses:
            setattr(space.region_3d, path.removeprefix("region_3d."), value)


def _owners(scene: bpy.types.Scene, place: str, changed: Changed) -> list[Any]:
    """The owners at a place of the record: the scene, or the 3D views of a screen through the
    viewer.
    """
    if not place:
        return [scene]

    # the viewer may have been renamed, deleted or replaced since
    viewers = {None, viewer_of(scene)}
    viewers |= {thing for thing, _ in _marked(changed.rig) if isinstance(thing, bpy.types.Object)}
    viewers |= {bpy.data.objects.get(one[3]) for one in changed.changes if one[1] == "camera"}
    screen = place.removeprefix("screen/")
    return [s for s in spaces(screen) if s.use_local_camera and s.camera in viewers]
