"""Copies of a rig's parts that lie beside them in its collection, as Shift D makes them: which of
them were made as one, and a rig of their own for these.

No copy says with which others it was made. Where each part has one, all of them count as one set,
but for glass that went a way of its own: a copy of it alone may be meant for something else. Where
a part has several, the way from original to copy tells the sets apart: copies that were moved
as one have gone the same way. Sets that lie in one place are told by the numbers in their names, as
long as each has all parts. The names alone do not tell: a part that one set lacks leaves its number
to the next. Where nothing tells it, the selection does.
"""

from collections.abc import Iterable
from itertools import chain

import bpy
import numpy as np

from ..errors import RigError
from .active_rig import settings_of, settings_text
from .newcomers import part
from .rig_names import NUMBER, stem
from .rigs import active_rig, held_by, mark_of, marked_key, rigs_of

SAME_PLACE = 1e-4  # of distances and sizes: matrices of Blender have 24 bits
NEEDED = {"DISPLAY", "PICTURE"}  # roles of copies that make a rig
Pairs = dict[bpy.types.Object, bpy.types.Object]  # the copy of each original
Copies = dict[bpy.types.Object, list[bpy.types.Object]]  # all copies of each original


def copies_of(scene: bpy.types.Scene, rig: bpy.types.Collection) -> Copies:
    """Copies of things that were made for a rig, in its collection, or taken in as its glass, by
    their originals.

    Of things that were made or taken in as one, the original is that which has kept the name.
    """
    key = rig.kiriko.key
    alike: dict[str, list[bpy.types.Object]] = {}
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
        copies[original] = sorted((one for one in things if one != original), key=_number)
    return {original: things for original, things in copies.items() if things}


def is_doubled(scene: bpy.types.Scene) -> bool:
    """Was the active rig duplicated part by part, and not by its collection?"""
    rig = active_rig(scene)
    return rig is not None and _has_needed(copies_of(scene, rig))


def one_set(
    scene: bpy.types.Scene, rig: bpy.types.Collection, selected: Iterable[bpy.types.Object]
) -> Pairs:
    """Copies of a rig's parts that were made as one, the first of several sets, with those of the
    artist's own things that the rig uses.

    Raises RigError where neither their places nor the selection tells which belong together.
    """
    copies = copies_of(scene, rig)
    own = _own(scene, rig)
    for pairs in (_first_set(copies, own), _selected_set(copies, own, set(selected))):
        if pairs is not None:
            return pairs
    raise RigError(
        "The copies are of several sets, and nothing tells which of them belong together: select"
        " those of one set."
    )


def part_copies(scene: bpy.types.Scene, rig: bpy.types.Collection, pairs: Pairs) -> str:
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
    for thing in pairs.values():
        for group in held.intersection(thing.users_collection):
            group.objects.unlink(thing)
        new.objects.link(thing)

    part(scene, rig, new, pairs)
    return new.name


def _first_set(copies: Copies, own: list[bpy.types.Object]) -> Pairs | None:
    """The first of the sets that copies are of; None where places and names do not tell it."""
    if all(len(things) == 1 for things in copies.values()):
        pairs = {one: things[0] for one, things in copies.items()}
        others = {one: twin for one, twin in pairs.items() if one.kiriko.role != "GLASS"}
        if not all(_goes_with(others, one, pairs[one]) for one in pairs.keys() - others.keys()):
            return None
        return pairs | {one: things[0] for one, things in _own_copies(pairs, own).items()}

    ways: list[list[Pairs]] = []  # sets by the way that they have gone, the first one first
    for one, thing in ((one, thing) for one, things in copies.items() for thing in things):
        way = next((way for way in ways if _leads(way[0], one, thing)), None)
        if way is None:
            ways.append(way := [])
        taken = next((pairs for pairs in way if one not in pairs), None)
        if taken is None:
            way.append(taken := {})
        taken[one] = thing

    strays = {one for way in ways if not _has_needed(way[0]) for one in way[0]}
    for way in (way for way in ways if _has_needed(way[0])):
        first, n = way[0], len(way)
        beside = _own_copies(first, own)
        is_plain = all(pairs.keys() == first.keys() for pairs in way)
        if is_plain and strays <= first.keys() and all(len(c) == n for c in beside.values()):
            return first | {one: things[0] for one, things in beside.items()}
    return None


def _selected_set(
    copies: Copies, own: list[bpy.types.Object], chosen: set[bpy.types.Object]
) -> Pairs | None:
    """Copies that are selected; None where these are no set."""
    picked = {one: [c for c in things if c in chosen] for one, things in copies.items()}
    picked = {one: things for one, things in picked.items() if things}
    if not _has_needed(picked) or any(len(things) > 1 for things in picked.values()):
        return None
    pairs = {one: things[0] for one, things in picked.items()}
    for thing in own:
        before = [one for one in own if one not in chosen and _is_like(one, thing)]
        if thing in chosen and before and _number(before[0]) < _number(thing):
            pairs[before[0]] = thing
    return pairs


def _has_needed(originals: Iterable[bpy.types.Object]) -> bool:
    """Are the parts among these that a rig cannot do without?"""
    return {one.kiriko.role for one in originals} >= NEEDED


def _own(scene: bpy.types.Scene, rig: bpy.types.Collection) -> list[bpy.types.Object]:
    """The artist's own things that a rig uses, and those that may be copies of them: in its
    collection, or in that of no rig, as a mirror that stands there.
    """
    held, keys = set(held_by(rig)), rigs_of(scene)
    settings = settings_of(scene, rig)
    viewers = [settings.viewer or scene.camera, *(one.camera for one in settings.viewers)]

    def is_used(thing: bpy.types.Object) -> bool:
        has_role = thing.kiriko.role != "NONE"
        return has_role or any(_is_like(one, thing) for one in viewers if one is not None)

    found = [
        thing
        for thing in scene.objects
        if not (marked_key(thing) or thing.kiriko.taken_as)
        and (thing in held or (is_used(thing) and not keys(thing)))
    ]
    return sorted(found, key=_number)


def _own_copies(pairs: Pairs, own: list[bpy.types.Object]) -> Copies:
    """Copies of the artist's own things that have gone the same way as those of made parts."""
    found = {one: [twin for twin in own if _is_copy(pairs, one, twin)] for one in own}
    copies = {twin for things in found.values() for twin in things}
    return {one: things for one, things in found.items() if things and one not in copies}


def _is_copy(pairs: Pairs, one: bpy.types.Object, twin: bpy.types.Object) -> bool:
    """Is a thing the copy of another, which has gone the same way as a part?"""
    if one == twin or not _is_like(one, twin) or not _goes_with(pairs, one, twin):
        return False
    # a way that leads back as well, as none at all does, does not tell which was first
    return _number(one) < _number(twin) or not _goes_with(pairs, twin, one)


def _goes_with(pairs: Pairs, one: bpy.types.Object, twin: bpy.types.Object) -> bool:
    """Does the way of any part of a set lead from one thing to another? Some may have been moved
    since, by themselves.
    """
    return any(_leads({start: end}, one, twin) for start, end in pairs.items())


def _is_like(one: bpy.types.Object, other: bpy.types.Object) -> bool:
    """Do two things of the artist's differ in no more than a copy and its original?"""
    kinds = [(stem(x.name), x.type, x.kiriko.role) for x in (one, other)]
    return kinds[0] == kinds[1]


def _number(thing: bpy.types.Object) -> int:
    """The number that Blender has given to the name of a further thing of one name; 0 for none."""
    found = NUMBER.search(thing.name)
    return int(found.group()[1:]) if found else 0


def _leads(pairs: Pairs, one: bpy.types.Object, twin: bpy.types.Object) -> bool:
    """Does the way of a set of copies, by its first one, lead from one thing to another?"""
    if not pairs:
        return True
    start, end = next(iter(pairs.items()))
    a, b, c, d = (np.array(x.matrix_world, float) for x in (start, end, one, twin))
    if not np.linalg.det(a[:3, :3]):
        return False
    far = max(np.abs(x[:3, 3]).max() for x in (a, b, c, d))
    size = np.linalg.norm(d[:3, :3])
    off = np.abs(b @ np.linalg.inv(a) @ c - d)[:3]
    return bool(off[:, 3].max() <= SAME_PLACE * far and off[:, :3].max() <= SAME_PLACE * size)
