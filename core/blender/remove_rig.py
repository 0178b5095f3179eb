"""Removes a rig: all that Add Rig and results made for it goes, and what it
changed is put back. Things that are used elsewhere by now stay.
"""

import json
from typing import Any

import bpy

from ..errors import RigError
from .changes import put_back, value_of
from .kept import Changed
from .objects import OBJECT_MARK
from .result import MATERIAL_MARK, SOURCE
from .rig_record import KEPT_MARK, RIG_MARK

DATA = ("meshes", "cameras", "materials", "images")  # kinds that Add Rig makes beside objects
RESULT = "kiriko.result."  # path of the panel's numbers in the scene
IMAGES = ("source", "seen", "preview")  # of a result


def rigs(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """Collections of a scene's rigs, the newest last."""
    groups = dict.fromkeys(scene.collection.children_recursive)  # one may be in two others
    return [group for group in groups if group.kiriko.key]


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
    refuse_shared(scene, rig)
    made = made_objects(scene, rig)
    going = unused_elsewhere(scene, rig, [*made, *made_data(scene, rig, made)])
    stay = [thing for thing in made if thing not in going]

    _put_back(scene, rig, going)
    for thing in stay:
        if RIG_MARK in thing:
            del thing[RIG_MARK]
        thing.kiriko.role = "NONE"
    _empty(scene, rig, going)
    names = [thing.name for thing in stay]
    bpy.data.batch_remove([*going, *([] if rig.users > 0 else [rig])])

    return names


def refuse_shared(scene: bpy.types.Scene, rig: bpy.types.Collection) -> None:
    """Raise RigError where another scene, or an instance, shows
    the rig, too, which would lose its parts and roles.
    """
    for other in bpy.data.scenes:
        if other != scene and rig in other.collection.children_recursive:
            raise RigError(
                "The rig is in the scene '{other}', too: unlink its collection '{rig}' there"
                " first.",
                other=other.name,
                rig=rig.name,
            )

    for thing in bpy.data.objects:
        group = thing.instance_collection
        if thing.users and group is not None and rig in (group, *group.children_recursive):
            raise RigError(
                "The object '{name}' is an instance of the rig's collection '{rig}': delete it"
                " first.",
                name=thing.name,
                rig=rig.name,
            )

    for thing in _of_rig(scene, rig.kiriko.key):
        others = [other for other in thing.users_scene if other != scene]
        if others:
            raise RigError(
                "The rig's '{name}' is in the scene '{other}', too: unlink it there first.",
                name=thing.name,
                other=others[0].name,
            )


def made_objects(scene: bpy.types.Scene, rig: bpy.types.Collection) -> list[bpy.types.Object]:
    """Objects that Add Rig made for a rig, and those that show its results in the scene."""
    made = _of_rig(scene, rig.kiriko.key)
    if not _has_result(scene, rig):
        return made
    return made + [thing for thing in scene.objects if OBJECT_MARK in thing]


def _of_rig(scene: bpy.types.Scene, key: str) -> list[bpy.types.Object]:
    return _without_copies([thing for thing in scene.objects if _mark_of(thing)[0] == key])


def _mark_of(block: bpy.types.ID) -> tuple[str, str]:
    """Key of the rig that a datablock was made for, and the name it got; '' if there is none."""
    key, name = json.loads(block.get(RIG_MARK, '["", ""]'))
    return key, name


def _without_copies(marked: list[Any]) -> list[Any]:
    """A copy has the mark of the one that was made, too. It is the artist's,
    and the one that has kept the name is the one that was made.
    """
    by_name: dict[str, list[Any]] = {}
    for block in marked:
        by_name.setdefault(_mark_of(block)[1], []).append(block)
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
            [one for one in getattr(bpy.data, kind) if _mark_of(one)[0] == rig.kiriko.key]
        )
    ]
    shown = [
        slot.material
        for thing in objects
        for slot in thing.material_slots
        if slot.material is not None and MATERIAL_MARK in slot.material
    ]
    meshes = [thing.data for thing in objects if OBJECT_MARK in thing]
    images = [getattr(scene.kiriko.result, name) for name in IMAGES if _is_ours(scene, rig)]
    if _has_result(scene, rig):  # also one that a newer rig, gone by now, has left on the display
        images += [
            node.image
            for material in shown
            for node in material.node_tree.nodes
            if node.type == "TEX_IMAGE" and node.image is not None and node.image.name == SOURCE
        ]
    found = [*marked, *shown, *meshes, *images]
    return list(dict.fromkeys(block for block in found if block is not None))


def _has_result(scene: bpy.types.Scene, rig: bpy.types.Collection) -> bool:
    """Is a rig the one that the scene's results are of? Its parts
    have roles; where no rig's have, it is the newest.
    """
    found = rigs(scene)
    active = [
        one
        for one in found
        if any(thing.kiriko.role != "NONE" for thing in _of_rig(scene, one.kiriko.key))
    ]
    return rig == (active or found)[-1]


def _is_ours(scene: bpy.types.Scene, rig: bpy.types.Collection) -> bool:
    """Is the scene's result the rig's: another than when the rig was added, or was there none?"""
    changes = Changed.read(rig.kiriko.changed).changes
    lines = [one for one in changes if one[0].startswith(RESULT)]
    was_none = bool(lines) and not any(before for _, before, _ in lines)
    is_new = was_none or any(value_of(scene, path) != after for path, _, after in lines)
    return is_new and _has_result(scene, rig)


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


def _put_back(scene: bpy.types.Scene, rig: bpy.types.Collection, going: list[bpy.types.ID]) -> None:
    """Put back whatever Add Rig changed and nobody has changed since."""
    ours = rig.kiriko
    for owner in (*scene.objects, *bpy.data.materials):
        kept = Changed.read(owner.kiriko.changed) if owner.kiriko.changed else Changed()
        if kept.rig == ours.key and not _is_of_another_rig(scene, owner):
            put_back(owner, kept.changes)
            owner.kiriko.property_unset("changed")

    result = scene.kiriko.result
    is_solved = _is_ours(scene, rig)
    _put_settings_back(scene, rig)
    if is_solved:
        for name in set(result.bl_rna.properties.keys()) - {"rna_type", "name"}:
            result.property_unset(name)

    if scene.kiriko.viewer in going:
        scene.kiriko.viewer = ours.viewer_before
    for one in rigs(scene):
        if one.kiriko.viewer_before in going:
            one.kiriko.viewer_before = ours.viewer_before


def _put_settings_back(scene: bpy.types.Scene, rig: bpy.types.Collection) -> None:
    """Those of the scene and of 3D views; a newer rig, which needs them, takes them over."""
    found = rigs(scene)
    newer = found[found.index(rig) + 1 :]
    if newer:
        _hand_over(rig.kiriko, newer[0].kiriko)
        return

    put_back(scene, Changed.read(rig.kiriko.changed).changes)
    for screen, *change in Changed.read(rig.kiriko.views).changes:
        for space in spaces(screen):
            put_back(space, [tuple(change)])


def _is_of_another_rig(scene: bpy.types.Scene, owner: bpy.types.ID) -> bool:
    """Is an object or material part of another scene that has a rig, whose glass it may be?"""
    if isinstance(owner, bpy.types.Object):
        return any(other != scene and rigs(other) for other in owner.users_scene)
    users = bpy.data.user_map(subset=[owner])[owner]
    things = [thing for thing in bpy.data.objects if users & {thing, thing.data}]
    return any(_is_of_another_rig(scene, thing) for thing in things)


def _hand_over(ours: Any, newer: Any) -> None:
    """Give the changes of a rig that goes to the next newer one, which
    needs them, and which will put back the values of before both.
    """
    for name in ("changed", "views"):
        lines = {tuple(one[:-2]): one for one in Changed.read(getattr(newer, name)).changes}
        for *path, before, after in Changed.read(getattr(ours, name)).changes:
            line = lines.setdefault(tuple(path), [*path, before, after])
            # results between the two rigs are of the one that goes
            if line[-2] == after or path[0].startswith(RESULT):
                line[-2] = before
        setattr(newer, name, Changed(newer.key, list(lines.values())).text())


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
