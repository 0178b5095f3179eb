"""Inspects a scene for its checklist. Fast, except for meshes, which are cached.

Objects are inspected with their modifiers, as last evaluated.
"""

from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

import bpy
import numpy as np

from ...base.arrays import Floats
from ...base.errors import ImageError
from ...base.messages import Message
from ...bench.measured_remedies import Help
from ..data.bodies import (
    NO_PART,
    bodiless,
    has_no_place,
    members_of,
    no_part,
    shows_instances_alone,
    tools_of,
)
from ..data.camera_viewer import seats_of
from ..data.lost_data import find_lost, on_lost, placeholders_of
from ..data.made_objects import OBJECT_MARK
from ..data.moving import number_at
from ..data.rigs import RIG_MARK, active_rig, elsewhere
from ..data.stored_records import StoredNumbers
from ..data.units import length_of_unit
from ..data.visibility import VisibleObjects, is_visible
from ..lifecycle.copies import is_doubled
from ..lifecycle.given_glass import has_place
from ..materials.material import Bends, bends_light, refracts
from ..read.plane import check_shown, image_of, own_materials
from ..read.read_mesh import column, mesh_of, used_slots
from ..read.scene_picture import check_at
from ..read.shapes import used_materials
from ..result.result_images import is_missing_numbers
from .faults import counts_of
from .to_do import FaultCounts, Inspection, Named, Thing

BOXLESS = {"CURVE", "FONT", "SURFACE"}  # Blender's bounding box is not that of their surface
CHECKED = ("GLASS", "MIRROR", "HALF_MIRROR")  # roles whose mesh light meets
Found = Mapping[str, Mapping[bpy.types.Object, str]]


class InspectedMesh(NamedTuple):
    """An inspected mesh: its faults as read and before modifiers, and the sides (3,) of its box in
    the object's own space.
    """

    as_read: FaultCounts
    own: FaultCounts
    sides: tuple[float, ...] = ()


def inspect(
    scene: bpy.types.Scene,
    found: Found,
    missing: Mapping[str, str],
    meshes: Mapping[int, InspectedMesh],
    is_stale: bool = False,
) -> Inspection:
    """A scene as its checklist needs it.

    Parameters
    ----------
    found : objects by role, each with the setting that hides it; NO_PART for objects
        unfit as parts
    missing : phrases on missing roles
    meshes : inspected meshes by session uid of the object
    is_stale : the result is out of date
    """
    result = scene.kiriko.result
    is_solved = result.source is not None
    numbers = StoredNumbers.read(result.details).by_name  # Add Rig stores the legibility alone
    details = numbers if is_solved else {}
    helps = details.get("helps")
    bends = cache(bends_light)  # thousands of objects may have the same material
    things = [
        _thing(scene, thing, role, by, meshes.get(thing.session_uid), bends)
        for role, members in found.items()
        for thing, by in members.items()
        if role != NO_PART
    ]
    return Inspection(
        things=tuple(things),
        missing=tuple(missing.items()),
        **_around(scene, missing),
        no_parts=tuple((no_part(thing), named(thing)) for thing in found.get(NO_PART, ())),
        lost=tuple(lost_parts(scene, found)),
        in_glass=tuple(_in_glass(scene, found.get("GLASS", {}), bends)),
        misses=details.get("misses", {}),
        misses_of_others=details.get("misses_of_others", {}),
        helps=None if helps is None else tuple(Help(**help) for help in helps),
        legibility=numbers.get("legibility"),
        legible_by=tuple(Help(**help) for help in numbers.get("legible_by", ())),
        is_doubled=len(found.get("DISPLAY", ())) > 1 and is_doubled(scene),
        is_coarse=result.is_coarse,
        is_missing_numbers=is_missing_numbers(result),
        is_stale=is_stale,
        is_solved=is_solved,
        for_most=0.0 if is_solved or not result.summary else result.for_most,
    )


def _around(scene: bpy.types.Scene, missing: Mapping[str, str]) -> dict[str, Any]:
    """The rig and its surroundings, for missing parts."""
    rig = active_rig(scene)
    cameras = [thing for thing in scene.objects if thing.type == "CAMERA"]
    is_elsewhere = elsewhere(scene)
    made = [one for one in cameras if rig and RIG_MARK in one and not is_elsewhere(one)]
    cameras = [*made, *(thing for thing in cameras if thing not in made)]
    return {
        "has_rig": rig is not None,
        "has_own_camera": bool(made),
        "cameras": tuple(camera.name for camera in cameras),
        "solids": tuple(_solids(scene)) if "GLASS" in missing else (),
    }


def _solids(scene: bpy.types.Scene) -> Iterator[Named]:
    """Possible glass: objects without a role, the active one first."""
    active = bpy.context.view_layer.objects.active
    for thing in sorted(scene.objects, key=lambda thing: thing != active):
        is_free = thing.kiriko.role == "NONE" and OBJECT_MARK not in thing
        if is_free and not bodiless(thing) and is_visible(thing) and min(thing.dimensions) > 0:
            yield named(thing)


def _thing(
    scene: bpy.types.Scene,
    thing: bpy.types.Object,
    role: str,
    by: str,
    looked: InspectedMesh | None,
    bends: Bends,
) -> Thing:
    sides = () if has_no_place(thing.matrix_world) else sides_of(scene, thing, looked)
    has_mesh = has_own_faces(scene, thing)
    is_glass = has_mesh and role == "GLASS" and not thing.kiriko.use_ior
    has_thickness = looked is not None and not (has_mesh and is_flat(sides))
    return Thing(
        named=named(thing),
        role=role,
        hidden_by=by,
        width=max(sides, default=0.0) * length_of_unit(scene),
        is_mesh=thing.type == "MESH",
        is_opaque=is_glass and not refracts_as_shown(scene, thing, bends),
        has_place=has_place(thing),
        has_no_scale=min(map(abs, thing.scale)) == 0,
        is_flat=has_mesh and is_flat(sides),
        no_picture=why_no_picture(scene, thing) if role == "PICTURE" else "",
        faults=_worth_reporting(scene, looked.as_read) if has_thickness else FaultCounts(),
        own_faults=looked.own if has_thickness else FaultCounts(),
        has_facets=thing.kiriko.surface == "FACETS",
    )


def _worth_reporting(scene: bpy.types.Scene, faults: FaultCounts) -> FaultCounts:
    """The faults to report. Inward normals of closed glass matter only to Cycles, which separates
    inside from outside by them.
    """
    is_reported = faults.n_open > 0 or bool(scene.kiriko_scene.looking)
    return faults._replace(is_inside_out=faults.is_inside_out and is_reported)


def has_own_faces(scene: bpy.types.Scene, thing: bpy.types.Object) -> bool:
    """Whether an object has a surface of its own, not only instances."""
    if thing.data is None or thing.type == "EMPTY":
        return False
    shown = evaluated(scene, thing)
    if thing.type == "META":  # one metaball has the surface of its whole family
        return max(shown.dimensions) > 0
    return not shows_instances_alone(shown)


def sides_of(
    scene: bpy.types.Scene, thing: bpy.types.Object, looked: InspectedMesh | None = None
) -> tuple[float, ...]:
    """The sides of an object's box, Blender units; () if not computed yet."""
    if thing.type not in BOXLESS:
        return tuple(evaluated(scene, thing).dimensions)
    if looked is None or not looked.sides:
        return ()
    return tuple(np.multiply(looked.sides, np.abs(thing.matrix_world.to_scale())).tolist())


def _in_glass(
    scene: bpy.types.Scene, glasses: Mapping[bpy.types.Object, str], bends: Bends
) -> Iterator[Named]:
    """Refractive objects without a role whose box overlaps that of a glass, except tools of its
    Boolean modifiers.
    """
    boxes = [box_of(scene, glass) for glass, by in glasses.items() if not by]
    if not boxes:
        return
    shown = VisibleObjects(scene, bpy.context.view_layer)
    found = []
    for thing in scene.objects:
        if thing.kiriko.role != "NONE" or OBJECT_MARK in thing or bodiless(thing):
            continue
        if not refracts(thing, bends):
            continue
        low, high = box_of(scene, thing)
        is_in = any((low < top).all() and (bottom < high).all() for bottom, top in boxes)
        if is_in and not shown.hidden_by(thing):
            found.append(thing)
    tools = tools_of([*glasses, *found]) if found else ()
    yield from (named(thing) for thing in found if thing not in tools)


def is_checked(thing: bpy.types.Object, layer: bpy.types.ViewLayer) -> bool:
    """Whether an object's mesh is to be inspected, and is up to date."""
    return (
        thing.kiriko.role in CHECKED
        and thing.type not in {"EMPTY", "META"}
        and not bodiless(thing)
        and thing.mode == "OBJECT"
        and thing.name in layer.objects
        and is_visible(thing, layer)
    )


def inspect_mesh(thing: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> InspectedMesh:
    """An object's mesh as read, and the faults before modifiers."""
    with mesh_of(thing.evaluated_get(depsgraph)) as mesh:
        as_read = counts_of(mesh)
        points = column(mesh.vertices, "co", 3, np.float32)
        sides = tuple(np.ptp(points, axis=0).tolist()) if len(points) else ()
    own = FaultCounts()
    if thing.type == "MESH":
        is_made = thing.data.shape_keys or any(m.show_viewport for m in thing.modifiers)
        own = counts_of(thing.data) if is_made else as_read
    return InspectedMesh(as_read, own, sides)


def named(thing: bpy.types.Object) -> Named:
    """An object's name and its file."""
    return Named(thing.name, "" if thing.library is None else thing.library.filepath)


def evaluated(scene: bpy.types.Scene, thing: bpy.types.Object) -> bpy.types.Object:
    """An object with its modifiers, as last evaluated: after undo the original has the box of its
    unmodified mesh.
    """
    graph = _graph(scene)
    return thing if graph is None else thing.evaluated_get(graph)


def refracts_as_shown(
    scene: bpy.types.Scene, thing: bpy.types.Object, bends: Bends = bends_light
) -> bool:
    """Whether any material of an object refracts; if modifiers such as geometry nodes assign
    materials, any of these.
    """
    if not _has_made_faces(scene, thing):
        return refracts(thing, bends)
    return any(map(bends, materials_as_shown(scene, thing)))


def materials_as_shown(scene: bpy.types.Scene, thing: bpy.types.Object) -> list[bpy.types.Material]:
    """The materials of an object with its modifiers, the most used first; for an instance of a
    collection those of its objects.
    """
    return list(each_material(scene, thing))


def each_material(scene: bpy.types.Scene, thing: bpy.types.Object) -> Iterator[bpy.types.Material]:
    """The materials of `materials_as_shown`, one by one."""
    if thing.instance_type == "COLLECTION" and thing.instance_collection is not None:
        yield from _materials_of(scene, members_of(thing))
    elif not _has_made_faces(scene, thing):
        yield from own_materials(thing)
    else:
        shown = evaluated(scene, thing)
        found = used_materials(shown, used_slots(shown.data))
        yield from (one.original for one in found if one is not None)


def _materials_of(
    scene: bpy.types.Scene, members: Iterable[bpy.types.Object]
) -> Iterator[bpy.types.Material]:
    """The materials of instanced objects, each once. Meshes are evaluated only if nodes may set
    materials: many Subdivision modifiers would take seconds.
    """
    found: set[bpy.types.Material | None] = {None}
    for member in members:
        if any(one.type == "NODES" and one.show_viewport for one in member.modifiers):
            materials = materials_as_shown(scene, member)
        else:
            is_known = all(slot.material in found for slot in member.material_slots)
            materials = [] if is_known else own_materials(member)
        yield from (one for one in materials if one not in found)
        found.update(materials)


def _has_made_faces(scene: bpy.types.Scene, thing: bpy.types.Object) -> bool:
    """Whether modifiers make an object's faces, as last evaluated."""
    is_made = thing.type == "MESH" and any(one.show_viewport for one in thing.modifiers)
    return is_made and len(evaluated(scene, thing).data.polygons) > 0


def _graph(scene: bpy.types.Scene) -> bpy.types.Depsgraph | None:
    """The last evaluation of a scene, in the active view layer if the scene is active."""
    is_here = bpy.context.scene == scene
    layer = bpy.context.view_layer if is_here else scene.view_layers[0]
    return layer.depsgraph


def box_of(scene: bpy.types.Scene, thing: bpy.types.Object) -> tuple[Floats, Floats]:
    """The lowest and the highest corner (3,) of an object's box in the world."""
    shown = thing if thing.type in BOXLESS else evaluated(scene, thing)
    matrix = np.array(shown.matrix_world)
    corners = np.array(shown.bound_box) @ matrix[:3, :3].T + matrix[:3, 3]
    return corners.min(axis=0), corners.max(axis=0)


def is_flat(sides: tuple[float, ...]) -> bool:
    """Whether a box with these sides is flat, and not a mere point."""
    return min(sides, default=1.0) == 0 < max(sides, default=0.0)


def why_no_picture(scene: bpy.types.Scene, picture: bpy.types.Object) -> str:
    """Why a plane shows no picture; '' if it shows one."""
    if scene.kiriko.picture_source == "IMAGE":
        return ""
    image = image_of(picture)
    if image is None:
        return Message("'{name}' shows no image. Choose one.", name=picture.name)
    try:
        check_shown(picture, image, scene)
    except ImageError as error:
        return error.message
    return ""


def why_no_own_image(scene: bpy.types.Scene) -> str:
    """Why an image in the viewers' own pixels cannot be read; '' if all can."""
    own = [
        (seat.image, Message("the viewer '{viewer}'", viewer=seat.camera.name))
        for seat in seats_of(scene)
        if seat.image is not None and seat.camera is not None
    ]
    for image, owner in own or [(scene.kiriko.picture_image, Message("the scene's picture"))]:
        try:
            check_at(image, number_at(image, None, scene.frame_current), owner)
        except ImageError as error:
            return error.message
    return ""


def lost_parts(
    scene: bpy.types.Scene, found: Mapping[str, Mapping[bpy.types.Object, str]]
) -> Iterator[tuple[str, str]]:
    """Sentences on data missing from a library that parts, viewers or the scene need, each with the
    library's name.
    """
    lost = find_lost()
    if not lost:
        return
    parts = [thing for members in found.values() for thing, by in members.items() if not by]
    shown = [x for seat in seats_of(scene) for x in (seat.camera, seat.image)]
    things = [*parts, scene.kiriko.picture_image, *shown, *placeholders_of(scene)]
    yield from on_lost(lost, things)
