"""The things that were made for a rig and its results, and those of them that nothing else uses."""

from typing import Any

import bpy

from ..solve.solved_for import OF_NO_SCENE
from .changes import value_of
from .image import is_out_of_date, read_anew
from .objects import OBJECT_MARK
from .on_display import MATERIAL_MARK
from .result import SOURCE
from .result_images import images_of
from .rig_names import name_for
from .rig_record import KEPT_MARK
from .rigs import RIG_MARK, active_rig, mark_of, rigs_of
from .stored_records import Changed

DATA = ("meshes", "cameras", "materials", "images")  # kinds that Add Rig makes beside objects
RESULT = "kiriko.result."  # path of the panel's numbers in the scene


def read_images_anew(scene: bpy.types.Scene) -> None:
    """Have the images of a scene's results be those that are packed, after undo.

    A step made while Live had newer pixels than it had packed has the numbers of those: they are of
    no scene any more.
    """
    for settings in (scene.kiriko, *(one.settings for one in scene.kiriko_others)):
        result = settings.result
        if result.source is not None and is_out_of_date(result.source):
            result.solved_for = OF_NO_SCENE.as_text()
        for image in images_of(result):
            read_anew(image)


def made_objects(scene: bpy.types.Scene, rig: bpy.types.Collection) -> list[bpy.types.Object]:
    """Objects that Add Rig made for a rig, and those that show its results in the scene."""
    made = objects_of(scene, rig.kiriko.key)
    if rig != active_rig(scene):
        return made
    keys = rigs_of(scene)
    return made + [
        thing for thing in scene.objects if OBJECT_MARK in thing and keys(thing) <= {rig.kiriko.key}
    ]


def objects_of(scene: bpy.types.Scene, key: str) -> list[bpy.types.Object]:
    """Objects that Add Rig made, by the rig's key."""
    return _without_copies([thing for thing in scene.objects if mark_of(thing)[0] == key])


def _without_copies(marked: list[Any]) -> list[Any]:
    """A copy has the mark of the one that was made, too. It is the artist's,
    and the one that has kept the name is the one that was made.
    """
    by_name: dict[str, list[Any]] = {}
    for block in marked:
        by_name.setdefault(mark_of(block)[1], []).append(block)
    return [
        next((block for block in blocks if block.name == name), blocks[0])
        for name, blocks in by_name.items()
    ]


def made_data(
    scene: bpy.types.Scene, rig: bpy.types.Collection, objects: list[bpy.types.Object]
) -> list[bpy.types.ID]:
    """Meshes, cameras, materials and images that were made for a rig and its results."""
    marked = [
        block
        for kind in DATA
        for block in _without_copies(
            [one for one in getattr(bpy.data, kind) if mark_of(one)[0] == rig.kiriko.key]
        )
    ]
    materials = [
        slot.material
        for thing in objects
        for slot in thing.material_slots
        if slot.material is not None
    ]
    shown = [material for material in materials if MATERIAL_MARK in material]
    used = [*(thing.data for thing in objects), *materials, *_images_in(materials)]
    # the mark is unreadable, but the objects tell the rig
    marked += [one for one in used if one is not None and RIG_MARK in one and not mark_of(one)[0]]
    meshes = [thing.data for thing in objects if OBJECT_MARK in thing]
    images = images_of(scene.kiriko.result) if has_result(scene, rig) else []
    names = {SOURCE, name_for(scene, SOURCE)}
    if rig == active_rig(scene):  # also one that a newer rig, gone by now, has left on the display
        images += [image for image in _images_in(shown) if image.name in names]
    found = [*marked, *shown, *meshes, *images]
    return list(dict.fromkeys(block for block in found if block is not None))


def _images_in(materials: list[bpy.types.Material]) -> list[bpy.types.Image]:
    """Images of the texture nodes of materials."""
    return [
        node.image
        for material in materials
        if material.node_tree is not None
        for node in material.node_tree.nodes
        if node.type == "TEX_IMAGE" and node.image is not None
    ]


def unused_elsewhere(
    scene: bpy.types.Scene, rig: bpy.types.Collection, blocks: list[bpy.types.ID]
) -> list[bpy.types.ID]:
    """Those of these datablocks that only the rig, the scene and each other use.

    One that the artist keeps by a fake user stays, too.
    """
    here = {scene, rig, *scene.collection.children_recursive}
    users = bpy.data.user_map(subset=blocks)
    going = {block for block in blocks if not block.use_fake_user or KEPT_MARK in block}

    while True:
        used = {block for block in going if _others(users[block], here | going)}
        used |= {b for b in going if isinstance(b, bpy.types.Object) and len(b.users_scene) > 1}
        if not used:
            return [block for block in blocks if block in going]
        going -= used


def _others(users: set[bpy.types.ID], known: set[bpy.types.ID]) -> set[bpy.types.ID]:
    """Users that would miss a thing; windows that show it do not."""
    shown = bpy.types.Screen | bpy.types.WorkSpace | bpy.types.WindowManager
    return {user for user in users - known if not isinstance(user, shown)}


def has_result(scene: bpy.types.Scene, rig: bpy.types.Collection) -> bool:
    """Is the scene's result the rig's: another than when the rig was added, or was there none?"""
    changes = Changed.read(rig.kiriko.changed).changes
    lines = [one for one in changes if one[0].startswith(RESULT)]
    was_none = not any(before for _, before, _ in lines)  # or the record is unreadable
    is_new = was_none or any(value_of(scene, path) != after for path, _, after in lines)
    return is_new and rig == active_rig(scene)
