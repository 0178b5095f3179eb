"""Removes a rig: all that Add Rig and results made for it goes, and what it
changed is put back. Things that are used elsewhere by now stay.
"""

import json
from typing import Any

import bpy

from .changes import put_back, value_of
from .kept import Changed
from .objects import OBJECT_MARK
from .result import MATERIAL_MARK
from .rig_record import RIG_MARK

DATA = ("meshes", "cameras", "materials", "images")  # kinds that Add Rig makes beside objects
IMAGES = ("source", "seen", "preview")  # of a result


def rigs(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """Collections of a scene's rigs, the newest last."""
    return [group for group in scene.collection.children_recursive if group.kiriko.key]


def rig_of(scene: bpy.types.Scene, active: bpy.types.Object | None) -> bpy.types.Collection | None:
    """The rig of the active object, else the scene's newest; None where it has none."""
    found = rigs(scene)
    own = [rig for rig in found if active is not None and belongs_to(active, rig)]
    return (own or found or [None])[-1]


def belongs_to(thing: bpy.types.Object, rig: bpy.types.Collection) -> bool:
    """Was an object made for a rig, or taken into it by Add Rig?"""
    is_made = RIG_MARK in thing and json.loads(thing[RIG_MARK])[0] == rig.kiriko.key
    return is_made or Changed.read(thing.kiriko.changed).rig == rig.kiriko.key


def remove_rig(scene: bpy.types.Scene, rig: bpy.types.Collection) -> list[str]:
    """Remove a rig from a scene. Returns names of objects of
    it that stay, because other things use them.
    """
    made = made_objects(scene, rig.kiriko.key)
    going = unused_elsewhere(scene, rig, [*made, *made_data(scene, rig, made)])
    stay = [thing for thing in made if thing not in going]

    _put_back(scene, rig, going)
    for thing in stay:
        del thing[RIG_MARK]
        thing.kiriko.role = "NONE"
    _empty(scene, rig, going)
    names = [thing.name for thing in stay]
    is_shared = any(rig in other.collection.children_recursive for other in bpy.data.scenes)
    bpy.data.batch_remove([*going, *([] if is_shared or rig.users > 0 else [rig])])

    return names


def made_objects(scene: bpy.types.Scene, key: str) -> list[bpy.types.Object]:
    """Objects that Add Rig made for a rig, and those that show its results in the scene.

    A copy of one has its mark, too. It is the artist's, and
    the one that has kept the name is the one that was made.
    """
    by_name: dict[str, list[bpy.types.Object]] = {}
    for thing in scene.objects:
        rig, name = json.loads(thing.get(RIG_MARK, '["", ""]'))
        if rig == key:
            by_name.setdefault(name, []).append(thing)

    made = [
        next((thing for thing in things if thing.name == name), things[0])
        for name, things in by_name.items()
    ]
    return made + [thing for thing in scene.objects if OBJECT_MARK in thing]


def made_data(
    scene: bpy.types.Scene, rig: bpy.types.Collection, objects: list[bpy.types.Object]
) -> list[bpy.types.ID]:
    """Meshes, cameras, materials and images that were made for a rig and its results."""
    marked = [
        block
        for kind in DATA
        for block in getattr(bpy.data, kind)
        if json.loads(block.get(RIG_MARK, '[""]'))[0] == rig.kiriko.key
    ]
    shown = [
        slot.material
        for thing in objects
        for slot in thing.material_slots
        if slot.material is not None and MATERIAL_MARK in slot.material
    ]
    meshes = [thing.data for thing in objects if OBJECT_MARK in thing]
    images = [getattr(scene.kiriko.result, name) for name in IMAGES if _is_ours(scene, rig)]
    found = [*marked, *shown, *meshes, *images]
    return list(dict.fromkeys(block for block in found if block is not None))


def _is_ours(scene: bpy.types.Scene, rig: bpy.types.Collection) -> bool:
    """Is the scene's result another than when the rig was added?"""
    changes = Changed.read(rig.kiriko.changed).changes
    lines = [one for one in changes if one[0].startswith("kiriko.result.")]
    return any(value_of(scene, path) != after for path, _, after in lines)


def unused_elsewhere(
    scene: bpy.types.Scene, rig: bpy.types.Collection, blocks: list[bpy.types.ID]
) -> list[bpy.types.ID]:
    """Those of these datablocks that only the rig, the scene and each other use."""
    here = {scene, rig, *scene.collection.children_recursive}
    users = bpy.data.user_map(subset=blocks)
    going = set(blocks)

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


def _put_back(scene: bpy.types.Scene, rig: bpy.types.Collection, going: list[bpy.types.ID]) -> None:
    """Put back whatever Add Rig changed and nobody has changed since."""
    ours = rig.kiriko
    for owner in (*scene.objects, *bpy.data.materials):
        kept = Changed.read(owner.kiriko.changed) if owner.kiriko.changed else Changed()
        if kept.rig == ours.key:
            put_back(owner, kept.changes)
            owner.kiriko.property_unset("changed")

    result = scene.kiriko.result
    is_solved = _is_ours(scene, rig)
    put_back(scene, Changed.read(ours.changed).changes)
    if is_solved:
        for name in set(result.bl_rna.properties.keys()) - {"rna_type", "name"}:
            result.property_unset(name)

    if scene.kiriko.viewer in going:
        scene.kiriko.viewer = ours.viewer_before
    for screen, *change in Changed.read(ours.views).changes:
        for space in spaces(screen):
            put_back(space, [tuple(change)])


def spaces(screen: str) -> list[Any]:
    """The 3D views of a screen, by its name."""
    areas = bpy.data.screens[screen].areas if screen in bpy.data.screens else ()
    return [space for area in areas for space in area.spaces if space.type == "VIEW_3D"]


def _empty(scene: bpy.types.Scene, rig: bpy.types.Collection, going: list[bpy.types.ID]) -> None:
    """Take a collection out of a scene; all that stays of it moves to where it was."""
    parents = [
        group
        for group in (scene.collection, *scene.collection.children_recursive)
        if rig.name in group.children and group.children[rig.name] == rig
    ]
    for parent in parents:
        for thing in rig.objects:
            if thing not in going and thing.name not in parent.objects:
                parent.objects.link(thing)
        for child in rig.children:
            if child.name not in parent.children:
                parent.children.link(child)
        parent.children.unlink(rig)
