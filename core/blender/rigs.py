"""The rigs of a scene, the one of them that is active, and the objects that are parts of each.

A rig is a collection with a key. An object is a part of the rigs whose collections hold it and of
those that Add Rig took it into as glass. One that is in none is a part of all: of a mirror that
stands there all the light knows. One whose rig lost its collection, as by Delete in the outliner,
goes on with that rig alone.
"""

import re
from collections.abc import Callable, Iterator

import bpy

from .stored_records import Changed, fields_of, text_of

RIG_MARK = "kiriko_rig"  # on all that Add Rig makes: key of the rig, and the name it was given
NUMBER = re.compile(r"\.\d{3,}$")


def rigs(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """Collections of a scene's rigs, the newest last.

    A copy of one, which has the same key, is none of its own as long as `newcomers.py` has not made
    it one. The one that has kept the name is the one that was made, else the first.
    """
    found: dict[str, bpy.types.Collection] = {}
    for group in scene.collection.children_recursive:  # one may be in two others
        key = group.kiriko.key
        if key and (key not in found or _is_first(group, found[key])):
            found[key] = group
    return list(found.values())


def _is_first(group: bpy.types.Collection, other: bpy.types.Collection) -> bool:
    return group.name == mark_of(group)[1] and other.name != mark_of(other)[1]


def active_rig(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """The rig that the scene's settings and result are of; None where it has no collection.

    Files of before there were several do not name it: there it is
    the newest whose parts have roles, else the newest.
    """
    found = rigs(scene)
    key = scene.kiriko.rig
    if key:
        return next((rig for rig in found if rig.kiriko.key == key), None)
    with_roles = [rig for rig in found if len(found) == 1 or has_roles(scene, rig)]
    return (with_roles or found or [None])[-1]


def has_roles(scene: bpy.types.Scene, rig: bpy.types.Collection) -> bool:
    """Has anything that was made for a rig a role? Else the rig was put out of use."""
    key = rig.kiriko.key
    return any(marked_key(one) == key for one in scene.objects if one.kiriko.role != "NONE")


def mark_of(block: bpy.types.ID) -> tuple[str, str]:
    """Key of the rig that a datablock was made for, and the name it got; '' if there is none.

    An object whose mark is unreadable was made for the rig whose collection holds it.
    """
    fields = fields_of(block.get(RIG_MARK))
    if not fields and RIG_MARK in block and isinstance(block, bpy.types.Object):
        groups = (group for group in bpy.data.collections if group.kiriko.key)
        holder = next((group for group in groups if block in set(held_by(group))), None)
        return ("", "") if holder is None else (holder.kiriko.key, stem(block.name))
    return fields.get("key", ""), fields.get("name", "")


def stem(name: str) -> str:
    """A datablock's name without the number that Blender gives to a further one of it."""
    return NUMBER.sub("", name)


def mark(block: bpy.types.ID, key: str) -> None:
    """Mark a datablock as made for the rig with this key."""
    block[RIG_MARK] = text_of({"key": key, "name": block.name})


def marked_key(block: bpy.types.ID) -> str:
    """Key of the rig that Add Rig made a datablock for, '' if none."""
    return mark_of(block)[0] if RIG_MARK in block else ""


def belongs_to(thing: bpy.types.Object, rig: bpy.types.Collection) -> bool:
    """Is an object in a rig's collection, was it made for the rig, or taken into it by Add Rig?"""
    return rig.kiriko.key in _keys(thing) or thing in set(held_by(rig))


def _keys(thing: bpy.types.Object) -> set[str]:
    """Keys of rigs that an object belongs to wherever it is."""
    keys = {marked_key(thing), *thing.kiriko.rigs.split()}
    if thing.kiriko.changed:  # as before there were several
        keys.add(Changed.read(thing.kiriko.changed).rig)
    return keys - {""}


def held_by(rig: bpy.types.Collection) -> Iterator[bpy.types.Object]:
    """Objects in a rig's collection and those below it that are no rigs."""
    yield from rig.objects
    for child in rig.children:
        if not child.kiriko.key:
            yield from held_by(child)


def rigs_of(scene: bpy.types.Scene) -> Callable[[bpy.types.Object], set[str]]:
    """A function that tells the keys of the scene's rigs that an object is in; where it is in none
    of them, those of rigs whose collection is gone.
    """
    found = rigs(scene)
    known = {rig.kiriko.key for rig in found}
    held: dict[bpy.types.Object, set[str]] = {}
    for rig in found:
        for thing in held_by(rig):
            held.setdefault(thing, set()).add(rig.kiriko.key)

    def keys_of(thing: bpy.types.Object) -> set[str]:
        keys = _keys(thing)
        return (keys & known) | held.get(thing, set()) or keys

    return keys_of


def is_left_over(scene: bpy.types.Scene, thing: bpy.types.Object) -> bool:
    """Is an object in none of a scene's rigs, since its own lost its collection beside others?"""
    known = {rig.kiriko.key for rig in rigs(scene)}
    keys = rigs_of(scene)(thing)
    return bool(known and keys) and not known & keys


def elsewhere(scene: bpy.types.Scene) -> Callable[[bpy.types.Object], bool]:
    """A function that tells whether an object is in other rigs only, and so no part of the
    active one.
    """
    active = active_rig(scene)
    # a rig whose collection is gone stays the active one as long as there is no other
    here = scene.kiriko.rig if active is None else active.kiriko.key
    if not here:
        return lambda thing: False
    keys = rigs_of(scene)

    def is_elsewhere(thing: bpy.types.Object) -> bool:
        found = keys(thing)
        return bool(found) and here not in found

    return is_elsewhere


def rig_of(scene: bpy.types.Scene, thing: bpy.types.Object | None) -> bpy.types.Collection | None:
    """The rig of an object: the active one where it is in several; None where in none."""
    if thing is None:
        return None
    own = [rig for rig in rigs(scene) if belongs_to(thing, rig)]
    active = active_rig(scene)
    return active if active in own else (own or [None])[-1]


def take_in(thing: bpy.types.Object, rig: bpy.types.Collection) -> None:
    """Have an object be a part of a rig wherever it is."""
    if thing.is_editable:
        thing.kiriko.rigs = " ".join([*thing.kiriko.rigs.split(), rig.kiriko.key])
        thing.kiriko.taken_as = thing.name


def is_copy(scene: bpy.types.Scene, thing: bpy.types.Object) -> bool:
    """Is an object, which lies in no rig's collection, a copy of one that Add Rig took into a rig?

    The one that has kept the name is the one that was taken, else the first.
    """
    ours = thing.kiriko
    if not ours.taken_as or any(thing in set(held_by(rig)) for rig in rigs(scene)):
        return False
    keys = set(ours.rigs.split())
    same = [
        one
        for one in scene.objects
        if one.kiriko.taken_as == ours.taken_as and keys & set(one.kiriko.rigs.split())
    ]
    return thing != next((one for one in same if one.name == ours.taken_as), same[0])


def let_go(thing: bpy.types.Object, rig: bpy.types.Collection) -> None:
    """Have an object be no part of a rig any more that Add Rig took it into."""
    keys = thing.kiriko.rigs.split()
    if rig.kiriko.key in keys:
        rest = [key for key in keys if key != rig.kiriko.key]
        thing.kiriko.rigs = " ".join(rest)
        if not rest:
            thing.kiriko.property_unset("rigs")
            thing.kiriko.property_unset("taken_as")
