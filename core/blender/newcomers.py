"""Rigs that came into a scene otherwise than by Add Rig: as a copy of a rig's collection, or from
another file. Each is made a rig of its own, with settings of its own, and no result.
"""

from collections.abc import Iterable
from secrets import token_hex

import bpy

from .active_rig import (
    clear_settings,
    copy_settings,
    has_settings,
    keep_as,
    make_active,
    set_settings,
    settings_of,
    settings_text,
)
from .rigs import active_rig, held_by, mark, mark_of, marked_key, rigs, stem, take_in
from .stored_records import Changed
from .viewer_list import bring_back_by_itself, have_viewer

NO_RESULT = [["kiriko.result.summary", "", ""]]  # as a rig notes that the scene had none before


def keep_settings(scene: bpy.types.Scene) -> None:
    """Have the collections of a scene's rigs hold their settings, too, as they are now: by these
    the rigs are appended to other files.
    """
    for rig in rigs(scene):
        if rig.is_editable and has_settings(scene, rig):
            rig.kiriko.settings = settings_text(settings_of(scene, rig))


def know_plates(scene: bpy.types.Scene) -> None:
    """Have rigs of files of before, which do not say it, know whether they have a plate: so one
    that is deleted from now on is missed.
    """
    for rig in rigs(scene):
        if rig.is_editable and not rig.kiriko.is_property_set("has_plate"):
            plates = (thing for thing in scene.objects if thing.kiriko.role == "PLATE")
            rig.kiriko.has_plate = any(marked_key(one) == rig.kiriko.key for one in plates)


def take_newcomers(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """Make rigs that came in since the last call rigs of their own; returns them."""
    if not scene.is_editable:
        return []
    know_plates(scene)
    bring_back_by_itself(scene)
    groups = [group for group in scene.collection.children_recursive if group.kiriko.key]
    groups = list(dict.fromkeys(groups))  # one may be in two others
    firsts = rigs(scene)
    brought = []
    for rig in firsts:
        if _is_brought(scene, rig):
            _settle_in(scene, rig)
            brought.append(rig)

    copies = [group for group in groups if group not in firsts and _has_own(group, firsts)]
    for copy in copies:
        part(scene, next(one for one in firsts if one.kiriko.key == copy.kiriko.key), copy)
    return [*brought, *copies]


def _has_own(copy: bpy.types.Collection, firsts: list[bpy.types.Collection]) -> bool:
    """Has a copy of a rig's collection, which can be changed, things that the rig has not?"""
    first = next(one for one in firsts if one.kiriko.key == copy.kiriko.key)
    is_ours = copy.is_editable and copy.override_library is None
    return is_ours and not set(held_by(copy)) <= set(held_by(first))


def part(
    scene: bpy.types.Scene,
    first: bpy.types.Collection,
    copy: bpy.types.Collection,
    is_around: bool = True,
) -> None:
    """Make a copy of a rig's collection a rig of its own, with the settings of the first.

    is_around : is glass that stands outside the collection of the first its glass, too?
    """
    active = active_rig(scene)
    make_active(scene, active)  # names it, where a file of before does not
    key, new, settings = first.kiriko.key, token_hex(8), settings_of(scene, first)
    held = list(held_by(first))
    before = set(held)
    own = [thing for thing in held_by(copy) if thing not in before]
    viewers = [settings.viewer, *(one.camera for one in settings.viewers)]
    twins = _twins([*held, *(one for one in viewers if one and one not in before)], own)
    around = [thing for thing in scene.objects if key in thing.kiriko.rigs.split()]
    around = [thing for thing in around if thing not in {*before, *own}]

    copy.kiriko.key = new
    copy.kiriko.property_unset("views")  # nothing was changed for it
    copy.kiriko.changed = Changed(new, NO_RESULT).text()
    _mark_anew([copy, *own, *_data_of(own)], key, new)
    for thing in own:
        _take_over(thing, key, new)
    for thing in around if is_around else ():
        take_in(thing, copy)

    kept = scene.kiriko_others.add()
    kept.key = new
    copy_settings(settings_of(scene, first), kept.settings)
    clear_settings(kept.settings.result)
    ours = kept.settings
    ours.is_of_rig = True
    have_viewer(ours, twins.get(ours.viewer, ours.viewer))
    for one in ours.viewers:
        one.camera = twins.get(one.camera, one.camera)


def _twins(things: list[bpy.types.Object], copies: list[bpy.types.Object]) -> dict:
    """The copy of each camera of a rig among copies of its things, by the camera.

    The mark of Add Rig tells it, which copies keep; an artist's own cameras have none, but a name
    of which Blender changes the number alone. Several that are alike were copied in their order.
    """
    twins: dict[bpy.types.Object, bpy.types.Object] = {}
    free = [thing for thing in copies if thing.type == "CAMERA"]
    for told_by in ((mark_of, lambda one: stem(one.name)), (mark_of,), ()):
        for camera in (thing for thing in things if thing.type == "CAMERA"):
            same = [one for one in free if all(by(one) == by(camera) for by in told_by)]
            if same and camera not in twins:
                twins[camera] = same[0]
                free.remove(same[0])
    return twins


def _data_of(things: list[bpy.types.Object]) -> list[bpy.types.ID]:
    """Data and materials of objects that no other objects have."""
    found = [thing.data for thing in things if thing.data is not None]
    found += [slot.material for thing in things for slot in thing.material_slots if slot.material]
    users = bpy.data.user_map(subset=found)
    return [block for block in dict.fromkeys(found) if users[block] <= {*things, *found}]


def _mark_anew(blocks: Iterable[bpy.types.ID], key: str, new: str) -> None:
    """Have datablocks that Add Rig made for one rig be those of another."""
    for block in blocks:
        if marked_key(block) == key:
            mark(block, new)


def _take_over(thing: bpy.types.Object, key: str, new: str) -> None:
    """Have an object that a rig took in, or changed, be that of another."""
    ours = thing.kiriko
    if key in ours.rigs.split():
        ours.rigs = " ".join(new if one == key else one for one in ours.rigs.split())
        ours.taken_as = thing.name
    if ours.changed and (kept := Changed.read(ours.changed)).rig == key:
        ours.changed = Changed(new, kept.changes).text()


def _is_brought(scene: bpy.types.Scene, rig: bpy.types.Collection) -> bool:
    """Has a rig no settings in this scene, since it is from another file?

    Files of before there were several do not name their rig; it is the one that has the viewer.
    """
    ours = scene.kiriko
    if ours.rig:
        return not has_settings(scene, rig)
    return ours.viewer is None and ours.result.source is None and not ours.is_of_rig


def _settle_in(scene: bpy.types.Scene, rig: bpy.types.Collection) -> None:
    """Give a rig settings in a scene: those that it brings, else the defaults, and its viewer.

    The first rig of a scene that brings none takes the scene's, as one of Add Rig does.
    """
    settings, text = scene.kiriko, rig.kiriko.settings
    if settings.rig:
        kept = scene.kiriko_others.add()
        kept.key, settings = rig.kiriko.key, kept.settings
    else:
        settings.rig = rig.kiriko.key
        if text:
            keep_as(scene, "")
    if text or settings != scene.kiriko:
        set_settings(settings, text)
        settings.is_of_rig = True
    cameras = [thing for thing in held_by(rig) if thing.type == "CAMERA"]
    viewers = [thing for thing in cameras if marked_key(thing) == rig.kiriko.key] or cameras
    settings.viewer = next(iter(viewers), None)
