"""What is found of an object apart from its mesh: its box, its materials, the picture it shows."""

from collections.abc import Iterable, Iterator, Mapping

import bpy
import numpy as np

from ..base.arrays import Floats
from ..base.errors import ImageError
from ..base.messages import Message
from .bodies import members_of
from .lost_data import find_lost, on_lost, placeholders_of
from .material import Bends, bends_light, refracts
from .moving import number_at
from .picture import check_at
from .plane import check_shown, image_of, own_materials
from .read_mesh import used_slots
from .shapes import used_materials
from .to_do import Named
from .viewer import seats_of

BOXLESS = {"CURVE", "FONT", "SURFACE"}  # Blender's box of them is not that of their surface


def named(thing: bpy.types.Object) -> Named:
    """An object's name and its file."""
    return Named(thing.name, "" if thing.library is None else thing.library.filepath)


def evaluated(scene: bpy.types.Scene, thing: bpy.types.Object) -> bpy.types.Object:
    """An object as its modifiers make it, by the last evaluation: after undo the object itself has
    the box of its mesh without them.
    """
    graph = _graph(scene)
    return thing if graph is None else thing.evaluated_get(graph)


def refracts_as_shown(
    scene: bpy.types.Scene, thing: bpy.types.Object, bends: Bends = bends_light
) -> bool:
    """Does any material of an object bend light, or, where modifiers give its faces materials, as
    geometry nodes do, any of these?
    """
    if not _has_made_faces(scene, thing):
        return refracts(thing, bends)
    return any(map(bends, materials_as_shown(scene, thing)))


def materials_as_shown(scene: bpy.types.Scene, thing: bpy.types.Object) -> list[bpy.types.Material]:
    """The materials on an object's faces as its modifiers make them, those on most faces first; of
    an instance of a collection those of its objects.
    """
    return list(each_material(scene, thing))


def each_material(scene: bpy.types.Scene, thing: bpy.types.Object) -> Iterator[bpy.types.Material]:
    """Those of `materials_as_shown`, one after the other."""
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
    """Those of what an instance shows, each once. Meshes are asked for as modifiers make them only
    where nodes may set materials: of many a Subdivision alone would take seconds.
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
    """Has an object faces that are made by modifiers, as evaluated last?"""
    is_made = thing.type == "MESH" and any(one.show_viewport for one in thing.modifiers)
    return is_made and len(evaluated(scene, thing).data.polygons) > 0


def _graph(scene: bpy.types.Scene) -> bpy.types.Depsgraph | None:
    """The last evaluation of a scene, in the view layer that is worked on; None where none was."""
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
    """Is a box with these sides one without a thickness, and no mere point, as that of no face?"""
    return min(sides, default=1.0) == 0 < max(sides, default=0.0)


def why_no_picture(scene: bpy.types.Scene, picture: bpy.types.Object) -> str:
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


def why_no_own_image(scene: bpy.types.Scene) -> str:
    """Why an image in the viewers' own pixels cannot be read; '' where all can."""
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
    """Sentences on data that a library lacks, and parts, viewers or the scene need; its name."""
    lost = find_lost()
    if not lost:
        return
    parts = [thing for members in found.values() for thing, by in members.items() if not by]
    shown = [x for seat in seats_of(scene) for x in (seat.camera, seat.image)]
    things = [*parts, scene.kiriko.picture_image, *shown, *placeholders_of(scene)]
    yield from on_lost(lost, things)
