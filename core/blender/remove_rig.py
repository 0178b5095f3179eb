"""Removes a rig: all that Add Rig and results made for it goes, and what it
changed is put back. Things that are used elsewhere by now stay.
"""

from collections.abc import Callable
from typing import Any

import bpy

from ..base.errors import RigError
from .active_rig import has_settings, is_new, keep_as, make_active, replace
from .changes import put_back
from .given_glass import take_back
from .made_for_rig import (
    RESULT,
    has_result,
    made_data,
    made_objects,
    objects_of,
    unused_elsewhere,
)
from .rigs import RIG_MARK, active_rig, let_go, mark, marked_key, rig_of, rigs, rigs_of
from .screens import spaces
from .stored_records import Changed
from .viewer import camera_at
from .viewer_list import bring_back, have_viewer, is_there, take_out
from .viewer_render import remove_unused

# paths of the settings that Add Rig can have changed; a record is text, which anything may write
OF_THINGS = {"kiriko.role", "display_type", "diffuse_color"}
OF_SCENE = {
    "kiriko.picture_source",
    *(
        f"{RESULT}{name}"
        for name in ("summary", "seen_summary", "notes", "sentences", "details", "for_most")
    ),
}
OF_VIEWS = {"clip_start", "clip_end"}


def rig_to_remove(
    scene: bpy.types.Scene, thing: bpy.types.Object | None
) -> bpy.types.Collection | None:
    """The rig of an object that was just selected, else the active one; None if there is none."""
    active = active_rig(scene)
    # one that is looked through stays the shown one, whatever is selected
    is_followed = not scene.kiriko.looking and (active is None or is_new(scene, thing))
    own = rig_of(scene, thing) if is_followed else None
    return own or active


def remove_rig(scene: bpy.types.Scene, rig: bpy.types.Collection) -> list[str]:
    """Remove a rig from a scene. Returns names of objects of
    it that stay, because other things use them.
    """
    refuse_shared(scene, rig)
    before = active_rig(scene)
    if has_settings(scene, rig):
        make_active(scene, rig)
    made = made_objects(scene, rig)
    blocks = made_data(scene, rig, made)
    going = unused_elsewhere(scene, rig, [*made, *blocks])
    _bequeath(scene, rig, [block for block in blocks if block not in going])
    stay = [thing for thing in made if thing not in going]

    _put_back(scene, rig, going)
    for thing in stay:
        if RIG_MARK in thing:
            del thing[RIG_MARK]
        thing.kiriko.role = "NONE"
    _empty(scene, rig, going)
    _go_on_with(scene, rig, before)
    names = [thing.name for thing in stay]
    bpy.data.batch_remove([*going, *([] if rig.users > 0 else [rig])])
    remove_unused()

    return names


def _bequeath(
    scene: bpy.types.Scene, rig: bpy.types.Collection, blocks: list[bpy.types.ID]
) -> None:
    """Have data of a rig that another one of the scene uses, as its duplicate does, be that one's
    from now on.
    """
    living = {one.kiriko.key for one in rigs(scene)} - {rig.kiriko.key}
    users = bpy.data.user_map(subset=blocks)
    left = [block for block in blocks if marked_key(block) == rig.kiriko.key]
    is_done = False
    while not is_done:  # an image goes with its material
        is_done = True
        for block in left:
            heirs = {marked_key(user) for user in users[block]} & living
            if heirs and marked_key(block) not in living:
                mark(block, min(heirs))
                is_done = False


def _go_on_with(
    scene: bpy.types.Scene, gone: bpy.types.Collection, before: bpy.types.Collection | None
) -> None:
    """Have another rig, or the scene without any, have its settings again after one is gone.

    before : the rig that was active
    """
    left = rigs(scene)
    has_own = scene.kiriko.is_of_rig
    if scene.kiriko.rig == gone.kiriko.key and (left or has_own):
        if not has_own:  # they are the scene's, as they were before any rig
            keep_as(scene, "")
        replace(scene, before if before in left else (left or [None])[-1])

    if len(left) < 2:
        scene.kiriko.property_unset("followed")
        scene.kiriko.property_unset("followed_uid")
    if not left:
        scene.kiriko.property_unset("rig")
        scene.kiriko_others.clear()


def refuse_shared(scene: bpy.types.Scene, rig: bpy.types.Collection) -> None:
    """Raise RigError where the rig is another file's, or where another scene, or an instance, shows
    it, too, which would lose its parts and roles.
    """
    if not rig.is_editable:
        raise RigError(
            "The rig '{rig}' is linked from another file: unlink its collection, or make it local"
            " first.",
            rig=rig.name,
        )

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

    for thing in objects_of(scene, rig.kiriko.key):
        others = [other for other in thing.users_scene if other != scene]
        if others:
            raise RigError(
                "The rig's '{name}' is in the scene '{other}', too: unlink it there first.",
                name=thing.name,
                other=others[0].name,
            )


def _put_back(scene: bpy.types.Scene, rig: bpy.types.Collection, going: list[bpy.types.ID]) -> None:
    """Put back whatever Add Rig changed and nobody has changed since."""
    ours = rig.kiriko
    take_back(scene, ours.key)
    keys = rigs_of(scene)
    living = {one.kiriko.key for one in rigs(scene)} - {ours.key}
    for owner in (*scene.objects, *bpy.data.materials):
        kept = Changed.read(owner.kiriko.changed) if owner.kiriko.changed else Changed()
        is_lost = _is_unreadable(owner) and keys(owner) == {ours.key}
        if not (is_lost or kept.rig == ours.key) or _is_of_another_rig(scene, owner):
            continue
        if is_lost:
            owner.kiriko.role = "NONE"
        heirs = _keys_of(scene, owner, keys) & living
        if heirs:
            owner.kiriko.changed = Changed(min(heirs), kept.changes).text()
        else:
            put_back(owner, [one for one in kept.changes if one[0] in OF_THINGS])
            owner.kiriko.property_unset("changed")
    for thing in scene.objects:
        let_go(thing, rig)

    result = scene.kiriko.result
    is_solved = has_result(scene, rig)
    _put_settings_back(scene, rig)
    if is_solved:
        for name in set(result.bl_rna.properties.keys()) - {"rna_type", "name"}:
            result.property_unset(name)

    _put_viewers_back(scene, rig, going)


def _is_unreadable(owner: bpy.types.ID) -> bool:
    """Does a record say what a rig changed of an object, but cannot be read?"""
    if not isinstance(owner, bpy.types.Object) or not owner.is_editable:
        return False
    return bool(owner.kiriko.changed) and not Changed.read(owner.kiriko.changed).rig


def _put_viewers_back(
    scene: bpy.types.Scene, rig: bpy.types.Collection, going: list[bpy.types.ID]
) -> None:
    """The viewer and the list as they were before; those who came since stay in it."""
    ours = scene.kiriko
    is_own = rig == active_rig(scene)
    before = ours.viewer_before if is_own and is_there(ours.viewer_before) else None
    is_first_gone = camera_at(scene, 0) in (None, *going)
    if scene.camera in going:
        scene.camera = None  # no viewer of what stays
    if ours.viewer in going:
        have_viewer(ours, before)
    take_out(scene, going, is_first_gone)
    if is_own:
        bring_back(scene)
    for other in scene.kiriko_others:
        if other.settings.viewer_before in going:
            other.settings.viewer_before = before


def _put_settings_back(scene: bpy.types.Scene, rig: bpy.types.Collection) -> None:
    """Those of the scene and of 3D views; a newer rig, which needs them, takes them over."""
    found = rigs(scene)
    newer = found[found.index(rig) + 1 :]
    # as before there were several, the newer one may have its settings
    has_own = rig == active_rig(scene)
    if has_own:
        changes = Changed.read(rig.kiriko.changed).changes
        put_back(scene, [one for one in changes if one[0] in OF_SCENE])
    if newer:
        _hand_over(rig.kiriko, newer[0].kiriko, ("views",) if has_own else ("changed", "views"))
        return

    for screen, *change in Changed.read(rig.kiriko.views).changes:
        for space in spaces(screen) if change[0] in OF_VIEWS else ():
            put_back(space, [tuple(change)])


def _keys_of(
    scene: bpy.types.Scene,
    owner: bpy.types.ID,
    keys: Callable[[bpy.types.Object], set[str]],
) -> set[str]:
    """Keys of the scene's rigs that an object with a role is in, or glass of a material."""
    things = [owner] if isinstance(owner, bpy.types.Object) else scene.objects
    users = [
        thing
        for thing in things
        if thing.kiriko.role != "NONE"
        and (thing == owner or any(slot.material == owner for slot in thing.material_slots))
    ]
    return set().union(*map(keys, users))


def _is_of_another_rig(scene: bpy.types.Scene, owner: bpy.types.ID) -> bool:
    """Is an object or material part of another scene that has a rig, whose glass it may be?"""
    if isinstance(owner, bpy.types.Object):
        return any(other != scene and rigs(other) for other in owner.users_scene)
    users = bpy.data.user_map(subset=[owner])[owner]
    things = [thing for thing in bpy.data.objects if users & {thing, thing.data}]
    return any(_is_of_another_rig(scene, thing) for thing in things)


def _hand_over(ours: Any, newer: Any, names: tuple[str, ...]) -> None:
    """Give the changes of a rig that goes to the next newer one, which
    needs them, and which will put back the values of before both.
    """
    for name in names:
        lines = {tuple(one[:-2]): one for one in Changed.read(getattr(newer, name)).changes}
        for *path, before, after in Changed.read(getattr(ours, name)).changes:
            line = lines.setdefault(tuple(path), [*path, before, after])
            # results between the two rigs are of the one that goes
            if line[-2] == after or path[0].startswith(RESULT):
                line[-2] = before
        setattr(newer, name, Changed(newer.key, list(lines.values())).text())


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
