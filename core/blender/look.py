"""Looks at a scene for its checklist: cheap, but for the meshes, which are kept."""

from collections.abc import Iterator, Mapping
from typing import Any

import bpy
import numpy as np

from ..bench.helps import Help
from ..errors import ImageError
from ..messages import Message
from .bodies import bodiless
from .cuts import cut_polygons
from .facets import n_facets
from .faults import faults_of
from .kept import Numbers
from .material import refracts
from .objects import OBJECT_MARK
from .plane import check_shown, image_of
from .result_images import images_of, lacks_numbers
from .rigs import active_rig, marked_key
from .to_do import Counts, Look, Named, Thing
from .units import length_of_unit
from .viewer import camera_at

CHECKED = ("GLASS", "MIRROR")  # roles whose mesh is light's way
Found = Mapping[str, Mapping[bpy.types.Object, str]]


def look_at(
    scene: bpy.types.Scene,
    found: Found,
    missing: Mapping[str, str],
    meshes: Mapping[int, tuple[Counts, Counts]],
    is_stale: bool = False,
) -> Look:
    """A scene as its checklist needs it.

    Parameters
    ----------
    found : objects by role, each with what hides it
    missing : phrases on roles that are not there
    meshes : faults of objects by their session uid, as read and before modifiers
    is_stale : is the result that of another scene?
    """
    result = scene.kiriko.result
    details = Numbers.read(result.details).by_name
    helps = details.get("helps")
    things = [
        _thing(scene, thing, role, by, meshes.get(thing.session_uid))
        for role, members in found.items()
        for thing, by in members.items()
    ]
    return Look(
        things=tuple(things),
        missing=tuple(missing.items()),
        **_around(scene, missing),
        misses=details.get("misses", {}),
        misses_of_others=details.get("misses_of_others", {}),
        helps=None if helps is None else tuple(Help(**help) for help in helps),
        is_coarse=result.is_coarse,
        lacks_numbers=lacks_numbers(result),
        is_stale=is_stale,
        is_solved=result.source is not None,
    )


def _around(scene: bpy.types.Scene, missing: Mapping[str, str]) -> dict[str, Any]:
    """What is there of the rig and beside it, where something is missing."""
    listed = scene.kiriko.viewers
    rig = active_rig(scene)
    cameras = [thing for thing in scene.objects if thing.type == "CAMERA"]
    made = [thing for thing in cameras if rig and marked_key(thing) == rig.kiriko.key]
    cameras = [*made, *(thing for thing in cameras if thing not in made)]
    seated = [(n, camera_at(scene, n)) for n, one in enumerate(listed) if one.is_on]
    known = {camera for _, camera in seated}
    gone = [(n, c) for n, c in seated if c is None or not c.users_scene]
    return {
        "has_rig": rig is not None,
        "has_own_camera": bool(made),
        "cameras": tuple(camera.name for camera in cameras),
        "free_cameras": tuple(camera.name for camera in cameras if camera not in known),
        "empty_seats": tuple((n, "" if c is None else c.name) for n, c in gone),
        "are_viewers_off": bool(listed) and not seated,
        "solids": tuple(_solids(scene)) if "GLASS" in missing else (),
        "images": tuple(_images(scene)) if "IMAGE" in missing else (),
    }


def _solids(scene: bpy.types.Scene) -> Iterator[Named]:
    """Objects without a role that may be glass, the active one first."""
    active = bpy.context.view_layer.objects.active
    for thing in sorted(scene.objects, key=lambda thing: thing != active):
        is_free = thing.kiriko.role == "NONE" and OBJECT_MARK not in thing
        if is_free and not bodiless(thing) and thing.visible_get() and min(thing.dimensions) > 0:
            yield Named(thing.name, "" if thing.library is None else thing.library.filepath)


def _images(scene: bpy.types.Scene) -> Iterator[str]:
    """Images of this file that are no results."""
    ours = images_of(scene.kiriko.result)
    for image in bpy.data.images:
        is_made = image.type in {"RENDER_RESULT", "COMPOSITING"} or image in ours
        if image.library is None and not is_made and any(image.size):
            yield image.name


def _thing(
    scene: bpy.types.Scene,
    thing: bpy.types.Object,
    role: str,
    by: str,
    faults: tuple[Counts, Counts] | None,
) -> Thing:
    sides = evaluated(scene, thing).dimensions
    has_mesh = thing.data is not None and thing.type not in {"EMPTY", "META"}
    return Thing(
        named=Named(thing.name, "" if thing.library is None else thing.library.filepath),
        role=role,
        hidden_by=by,
        width=max(sides) * length_of_unit(scene),
        is_opaque=has_mesh and role == "GLASS" and not (thing.kiriko.use_ior or refracts(thing)),
        has_no_scale=min(map(abs, thing.scale)) == 0,
        is_flat=has_mesh and min(sides) == 0,
        is_pictureless=_why_no_picture(scene, thing) if role == "PICTURE" else "",
        faults=None if faults is None else faults[0],
        own_faults=None if faults is None else faults[1],
        has_facets=thing.kiriko.surface == "FACETS",
    )


def evaluated(scene: bpy.types.Scene, thing: bpy.types.Object) -> bpy.types.Object:
    """An object as its modifiers make it, by the last evaluation: after undo the object itself has
    the box of its mesh without them.
    """
    is_here = bpy.context.scene == scene
    layer = bpy.context.view_layer if is_here else scene.view_layers[0]
    graph = layer.depsgraph
    return thing if graph is None else thing.evaluated_get(graph)


def _why_no_picture(scene: bpy.types.Scene, picture: bpy.types.Object) -> str:
    """Why a plane shows no picture; '' where it does."""
    if scene.kiriko.picture_source == "IMAGE":
        return ""
    image = image_of(picture)
    if image is None:
        return Message("'{picture}' shows no image.", picture=picture.name)
    try:
        check_shown(picture, image, scene)
    except ImageError as error:
        return error.message
    return ""


def is_checked(thing: bpy.types.Object, layer: bpy.types.ViewLayer) -> bool:
    """Is an object one whose mesh is worth a look, and evaluated as it stands?"""
    return (
        thing.kiriko.role in CHECKED
        and thing.type not in {"EMPTY", "META"}
        and thing.mode == "OBJECT"
        and thing.name in layer.objects
        and thing.visible_get(view_layer=layer)
    )


def mesh_faults(thing: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[Counts, Counts]:
    """Faults of an object's mesh as it is read, and of the one before modifiers."""
    is_glass = thing.kiriko.role == "GLASS"
    shown = thing.evaluated_get(depsgraph)
    try:
        as_read = counts_of(shown.to_mesh(), is_glass)
    finally:
        shown.to_mesh_clear()
    if thing.type != "MESH":
        return as_read, Counts()
    if not any(m.show_viewport for m in thing.modifiers) and thing.data.shape_keys is None:
        return as_read, as_read
    return as_read, counts_of(thing.data, is_glass)


def counts_of(mesh: bpy.types.Mesh, is_glass: bool) -> Counts:
    """How many there are."""
    faults = faults_of(mesh)
    return Counts(
        n_open=int(np.count_nonzero(faults.is_open)),
        n_flat=faults.n_flat,
        is_inside_out=faults.is_inside_out,
        n_cut=int(np.count_nonzero(cut_polygons(mesh))) if is_glass else 0,
        n_facets=n_facets(mesh),
    )
