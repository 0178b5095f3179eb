"""Makes a new rig of duplicated parts in a rig's collection, as after Shift D.

A copy does not record which others were made with it, but after Shift D they are selected.
Otherwise, if each part has one copy, all are meant, unless a copied glass moved separately. In all
other cases the artist has to select.
"""

from collections.abc import Iterable
from itertools import chain

import bpy
import numpy as np

from ...base.errors import RigError
from ...base.messages import quoted
from ..data.rigs import active_rig, held_by, mark_of, rigs_of, stem, with_copies
from .listed_viewers import have_viewer

SAME_PLACE = 1e-4  # of distances and sizes: Blender's matrices have 24 bits
NEEDED = {"DISPLAY", "PICTURE"}  # roles that copies need to make a rig
Things = list[bpy.types.Object]
Copies = dict[bpy.types.Object, Things]  # all copies of each original


def copies_of(rig: bpy.types.Collection) -> Copies:
    """Copies of a rig's parts in its collection, by their originals."""
    found = with_copies(dict.fromkeys(held_by(rig)))
    return {original: things for original, things in found.items() if things}


def is_doubled(scene: bpy.types.Scene) -> bool:
    """Whether the active rig's parts were duplicated, and not its collection."""
    rig = active_rig(scene)
    return rig is not None and {x.kiriko.role for x in copies_of(rig)} >= NEEDED


def meant_copies(
    scene: bpy.types.Scene, rig: bpy.types.Collection, selected: Iterable[bpy.types.Object]
) -> Things:
    """Copies of a rig's parts for one new rig: the selected ones, with selected objects of the
    artist's own that the rig uses; else all.

    Raises RigError if neither is clear.
    """
    copies, own, chosen = copies_of(rig), _own(scene, rig), set(selected)
    picked = {one: [c for c in things if c in chosen] for one, things in copies.items()}
    if _is_set(picked) and chosen.isdisjoint(copies):
        return [*chain(*picked.values()), *(thing for thing in own if thing in chosen)]

    # the artist's own objects have no mark of a copy
    are_own_single = len({_kind(thing) for thing in own}) == len(own)
    if _is_set(copies) and are_own_single and _is_glass_along(copies):
        return [*chain(*copies.values())]
    raise RigError(
        "Select only the copies of {names} that belong together, then press Duplicate Rig.",
        names=quoted(sorted(one.name for one in copies)),
    )


def part_copies(rig: bpy.types.Collection, things: Things) -> str:
    """Move copies of a rig's parts to a collection next to the rig's, wherever it is linked, and
    make it a rig around their glass, or the original glass if none was copied. Returns its name.
    """
    twins, new = _twins(rig, things), _empty_copy(rig)
    for group in chain(bpy.data.collections, (one.collection for one in bpy.data.scenes)):
        if rig in group.children.values() and group.library is None:
            group.children.link(new)

    for thing in things:
        for group in {rig, *rig.children_recursive}.intersection(thing.users_collection):
            group.objects.unlink(thing)
        new.objects.link(thing)
    around = [thing for thing in held_by(rig) if thing.kiriko.role == "GLASS"]
    for thing in around if not any(thing.kiriko.role == "GLASS" for thing in things) else ():
        new.objects.link(thing)

    ours = new.kiriko
    have_viewer(ours, twins.get(ours.viewer, ours.viewer))
    for one in ours.viewers:
        one.camera = twins.get(one.camera, one.camera)
    return new.name


def _empty_copy(rig: bpy.types.Collection) -> bpy.types.Collection:
    """A collection with a rig's settings, without its parts and its result."""
    new = rig.copy()
    for thing in list(new.objects):
        new.objects.unlink(thing)
    for child in list(new.children):
        new.children.unlink(child)
    new.kiriko.property_unset("views")  # no view was changed for it
    new.kiriko.property_unset("result")
    return new


def _twins(rig: bpy.types.Collection, things: Things) -> dict[bpy.types.Object, bpy.types.Object]:
    """The copy of each camera of a rig, by the camera.

    Copies keep the mark of Add Rig. An artist's own cameras have none: Blender changes only the
    number in their names. Equal candidates were copied in their order.
    """
    seated = [rig.kiriko.viewer, *(one.camera for one in rig.kiriko.viewers)]
    cameras = [one for one in dict.fromkeys([*held_by(rig), *seated]) if one not in (None, *things)]
    twins: dict[bpy.types.Object, bpy.types.Object] = {}
    free = [thing for thing in things if thing.type == "CAMERA"]
    for known_by in ((mark_of, lambda one: stem(one.name)), (mark_of,), ()):
        for camera in (thing for thing in cameras if thing.type == "CAMERA"):
            same = [one for one in free if all(by(one) == by(camera) for by in known_by)]
            if same and camera not in twins:
                twins[camera] = same[0]
                free.remove(same[0])
    return twins


def _is_set(copies: Copies) -> bool:
    """Whether each part has at most one copy, and all needed roles have one."""
    roles = {one.kiriko.role for one, things in copies.items() if things}
    return roles >= NEEDED and all(len(things) < 2 for things in copies.values())


def _own(scene: bpy.types.Scene, rig: bpy.types.Collection) -> Things:
    """The artist's own objects used by a rig, and their possible copies: in its collection or in no
    rig's, such as a mirror on the bench.
    """
    held, holders, settings = set(held_by(rig)), rigs_of(scene), rig.kiriko
    viewers = [settings.viewer or scene.camera, *(one.camera for one in settings.viewers)]
    kinds = {_kind(one) for one in viewers if one is not None}

    def is_used(thing: bpy.types.Object) -> bool:
        return thing.kiriko.role != "NONE" or _kind(thing) in kinds

    things = (thing for thing in scene.objects if not mark_of(thing))
    return [one for one in things if one in held or (is_used(one) and not holders(one))]


def _kind(thing: bpy.types.Object) -> tuple[str, str, str]:
    """Common properties of an artist's object and its copy."""
    return stem(thing.name), thing.type, thing.kiriko.role


def _is_glass_along(copies: Copies) -> bool:
    """Whether each copied glass moved together with another copied part. One copied alone may have
    another purpose.
    """
    pairs = [(one, twin) for one, things in copies.items() for twin in things]
    glass = [pair for pair in pairs if pair[0].kiriko.role == "GLASS"]
    others = [pair for pair in pairs if pair not in glass]
    return all(any(_leads(other, *pair) for other in others) for pair in glass)


def _leads(
    pair: tuple[bpy.types.Object, ...], one: bpy.types.Object, twin: bpy.types.Object
) -> bool:
    """Whether the motion from an original to its copy also takes one object to another."""
    a, b, c, d = (thing.matrix_world for thing in (*pair, one, twin))
    off = np.abs(np.array(b @ a.inverted_safe() @ c) - np.array(d))[:3]
    far = max(x.translation.length for x in (a, b, c, d))
    size = np.linalg.norm(np.array(d)[:3, :3])
    return bool(off[:, 3].max() <= SAME_PLACE * far and off[:, :3].max() <= SAME_PLACE * size)
