"""Copies of a rig's parts that lie beside them in its collection, as Shift D makes them: which of
them are meant to be one rig, and a rig of their own for these.

No copy says with which others it was made, but after Shift D they are selected. Where they are not,
and each part has one copy, all are meant; but glass that went a way of its own may be meant for
something else. All else is asked for.
"""

from collections.abc import Iterable
from itertools import chain

import bpy
import numpy as np

from ..base.errors import RigError
from ..base.messages import quoted
from .active_rig import settings_of, settings_text
from .newcomers import part
from .rigs import active_rig, held_by, mark_of, marked_key, rigs_of, stem

SAME_PLACE = 1e-4  # of distances and sizes: matrices of Blender have 24 bits
NEEDED = {"DISPLAY", "PICTURE"}  # roles of copies that make a rig
Things = list[bpy.types.Object]
Copies = dict[bpy.types.Object, Things]  # all copies of each original


def copies_of(scene: bpy.types.Scene, rig: bpy.types.Collection) -> Copies:
    """Copies of things that were made for a rig, in its collection, or taken in as its glass, by
    their originals.

    Of things that were made or taken in as one, the original is that which has kept the name.
    """
    key = rig.kiriko.key
    alike: dict[str, Things] = {}
    held = set(held_by(rig))
    for thing in scene.objects:
        ours = thing.kiriko
        if marked_key(thing) == key and thing in held:
            alike.setdefault(mark_of(thing)[1], []).append(thing)
        elif ours.taken_as and key in ours.rigs.split():
            alike.setdefault(ours.taken_as, []).append(thing)
    copies = {}
    for name, things in alike.items():
        original = next((one for one in things if one.name == name), things[0])
        copies[original] = [one for one in things if one != original]
    return {original: things for original, things in copies.items() if things}


def is_doubled(scene: bpy.types.Scene) -> bool:
    """Was the active rig duplicated part by part, and not by its collection?"""
    rig = active_rig(scene)
    return rig is not None and {x.kiriko.role for x in copies_of(scene, rig)} >= NEEDED


def meant_copies(
    scene: bpy.types.Scene, rig: bpy.types.Collection, selected: Iterable[bpy.types.Object]
) -> Things:
    """Copies of a rig's parts that are meant to be one rig: those selected, with what is selected
    of the artist's own things that the rig uses; or else all.

    Raises RigError where neither tells it.
    """
    copies, own, chosen = copies_of(scene, rig), _own(scene, rig), set(selected)
    picked = {one: [c for c in things if c in chosen] for one, things in copies.items()}
    if _is_set(picked) and chosen.isdisjoint(copies):
        return [*chain(*picked.values()), *(thing for thing in own if thing in chosen)]

    # of the artist's own things nothing tells which are copies
    are_own_single = len({_kind(thing) for thing in own}) == len(own)
    if _is_set(copies) and are_own_single and _is_glass_along(copies):
        return [*chain(*copies.values())]
    raise RigError(
        "Select the copies of {names} that belong together, and nothing else, then make them a"
        " rig.",
        names=quoted(sorted(one.name for one in copies)),
    )


def part_copies(scene: bpy.types.Scene, rig: bpy.types.Collection, things: Things) -> str:
    """Move copies of a rig's parts to a collection beside that of the rig, wherever that is linked,
    and make it a rig of its own: around their glass, if there is any among them. Returns its name.
    """
    new = bpy.data.collections.new(rig.name)
    new.kiriko.key, new.kiriko.has_plate = rig.kiriko.key, rig.kiriko.has_plate
    # another scene that has the rig gets settings by these
    new.kiriko.settings = settings_text(settings_of(scene, rig))
    for group in chain(bpy.data.collections, (one.collection for one in bpy.data.scenes)):
        if rig in group.children.values() and group.library is None:
            group.children.link(new)

    held = {rig, *rig.children_recursive}
    for thing in things:
        for group in held.intersection(thing.users_collection):
            group.objects.unlink(thing)
        new.objects.link(thing)

    has_glass = any(thing.kiriko.role == "GLASS" for thing in things)
    part(scene, rig, new, is_around=not has_glass)
    return new.name


def _is_set(copies: Copies) -> bool:
    """Is there one copy of each part, and of all that a rig cannot do without?"""
    roles = {one.kiriko.role for one, things in copies.items() if things}
    return roles >= NEEDED and all(len(things) < 2 for things in copies.values())


def _own(scene: bpy.types.Scene, rig: bpy.types.Collection) -> Things:
    """The artist's own things that a rig uses, and those that may be copies of them: in its
    collection, or in that of no rig, as a mirror that stands there.
    """
    held, keys, settings = set(held_by(rig)), rigs_of(scene), settings_of(scene, rig)
    viewers = [settings.viewer or scene.camera, *(one.camera for one in settings.viewers)]
    kinds = {_kind(one) for one in viewers if one is not None}

    def is_used(thing: bpy.types.Object) -> bool:
        return thing.kiriko.role != "NONE" or _kind(thing) in kinds

    things = (x for x in scene.objects if not (marked_key(x) or x.kiriko.taken_as))
    return [one for one in things if one in held or (is_used(one) and not keys(one))]


def _kind(thing: bpy.types.Object) -> tuple[str, str, str]:
    """What a thing of the artist's and its copy have in common."""
    return stem(thing.name), thing.type, thing.kiriko.role


def _is_glass_along(copies: Copies) -> bool:
    """Did each copy of glass go the way of some other part's? One that was
    made alone may be meant for something else.
    """
    pairs = [(one, twin) for one, things in copies.items() for twin in things]
    glass = [pair for pair in pairs if pair[0].kiriko.role == "GLASS"]
    others = [pair for pair in pairs if pair not in glass]
    return all(any(_leads(other, *pair) for other in others) for pair in glass)


def _leads(
    way: tuple[bpy.types.Object, ...], one: bpy.types.Object, twin: bpy.types.Object
) -> bool:
    """Does the way from an original to its copy lead from one thing to another?"""
    a, b, c, d = (thing.matrix_world for thing in (*way, one, twin))
    off = np.abs(np.array(b @ a.inverted_safe() @ c) - np.array(d))[:3]
    far = max(x.translation.length for x in (a, b, c, d))
    size = np.linalg.norm(np.array(d)[:3, :3])
    return bool(off[:, 3].max() <= SAME_PLACE * far and off[:, :3].max() <= SAME_PLACE * size)
