"""The rigs of a scene, the active one, and the objects of each.

A rig is a collection made by Add Rig; `collection.kiriko` has its settings, viewers and result. An
object belongs to the rigs whose collections hold it. An object in no rig belongs to all: a mirror
on the bench meets the light of each.
"""

import re
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import bpy

from ...base.messages import Message
from ...rig.rig import Rig
from .translation_context import data_name

RIG = Message("Kiriko Rig")
RIG_MARK = "kiriko_rig"  # on everything made by Add Rig: its original name
STORED_MARK = "kiriko_kept"  # on data made by a rig and kept in the file by Kiriko, not the artist
NUMBER = re.compile(r"\.\d{3,}$")


def rigs(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """Collections of a scene's rigs, the newest last."""
    groups = dict.fromkeys(scene.collection.children_recursive)  # a collection may have two parents
    return [group for group in groups if group.kiriko.is_rig]


def active_rig(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """The rig of panels and buttons: the chosen one, else the newest; None without a rig."""
    chosen = scene.kiriko_scene.rig
    if chosen is not None and scene.collection.children.get(chosen.name) == chosen:
        return chosen  # avoids walking thousands of collections, since every button calls this
    found = rigs(scene)
    return chosen if chosen in found else (found or [None])[-1]


def active_settings(scene: bpy.types.Scene) -> bpy.types.PropertyGroup:
    """Settings, viewers and result of the active rig, or of a scene without a rig: the value of
    `scene.kiriko`.
    """
    rig = active_rig(scene)
    return scene.kiriko_scene.own if rig is None else rig.kiriko


def all_settings() -> list[bpy.types.PropertyGroup]:
    """The settings of all rigs and scenes in the file."""
    groups = (group.kiriko for group in bpy.data.collections if group.kiriko.is_rig)
    return [*(scene.kiriko_scene.own for scene in bpy.data.scenes), *groups]


def rig_uid(scene: bpy.types.Scene) -> int:
    """Session uid of the active rig; 0 without a rig."""
    rig = active_rig(scene)
    return 0 if rig is None else rig.session_uid


def held_by(rig: bpy.types.Collection) -> Iterator[bpy.types.Object]:
    """Objects in a rig's collection and its subcollections, except those of other rigs."""
    yield from rig.objects
    for child in rig.children:
        if not child.kiriko.is_rig:
            yield from held_by(child)


def rigs_of(
    scene: bpy.types.Scene,
) -> Callable[[bpy.types.Object], list[bpy.types.Collection]]:
    """A function from an object to the scene's rigs that hold it."""
    held: dict[bpy.types.Object, list[bpy.types.Collection]] = {}
    for rig in rigs(scene):
        for thing in dict.fromkeys(held_by(rig)):
            held.setdefault(thing, []).append(rig)
    return lambda thing: held.get(thing, [])


def rig_of(scene: bpy.types.Scene, thing: bpy.types.Object | None) -> bpy.types.Collection | None:
    """The rig of an object: the active one if it is in several; None if in none."""
    own = rigs_of(scene)(thing)
    active = active_rig(scene)
    return active if active in own else (own or [None])[-1]


def elsewhere(scene: bpy.types.Scene) -> Callable[[bpy.types.Object], bool]:
    """A function that returns whether an object is in other rigs only."""
    if len(rigs(scene)) < 2:
        return lambda thing: False
    active, holders = active_rig(scene), rigs_of(scene)
    return lambda thing: bool(holders(thing)) and active not in holders(thing)


def shown_settings(scene: bpy.types.Scene, thing: bpy.types.Object) -> bpy.types.PropertyGroup:
    """Settings and result of an object's rig."""
    rig = rig_of(scene, thing)
    return scene.kiriko if rig is None else rig.kiriko


def has_roles(rig: bpy.types.Collection) -> bool:
    """Whether a rig's own objects still have roles; otherwise the rig is out of use."""
    return any(RIG_MARK in one and one.kiriko.role != "NONE" for one in held_by(rig))


def stem(name: str) -> str:
    """A datablock's name without Blender's number of a duplicate."""
    return NUMBER.sub("", name)


def mark_made(blocks: Iterable[bpy.types.ID]) -> None:
    """Mark datablocks as made by Add Rig."""
    for block in blocks:
        block[RIG_MARK] = block.name


def keep(block: bpy.types.ID) -> None:
    """Keep a replaced datablock in the file."""
    if RIG_MARK in block and not block.use_fake_user:
        block[STORED_MARK] = True
    block.use_fake_user = True


def mark_of(block: bpy.types.ID) -> str:
    """The name of a datablock when Add Rig made it, or added it as glass; '' if neither."""
    own = block.kiriko.taken_as if isinstance(block, bpy.types.Object) else ""
    return own or str(block.get(RIG_MARK, ""))


def with_copies(blocks: Iterable[Any]) -> dict[Any, list[Any]]:
    """Datablocks made or added by Add Rig, each with its copies, which have the same mark. The
    original is the one with the unchanged name, else the first.
    """
    alike: dict[str, list[Any]] = {}
    for block in blocks:
        if name := mark_of(block):
            alike.setdefault(name, []).append(block)
    found = {}
    for name, same in alike.items():
        original = next((one for one in same if one.name == name), same[0])
        found[original] = [one for one in same if one != original]
    return found


def is_copy(scene: bpy.types.Scene, thing: bpy.types.Object) -> bool:
    """Whether an object is a duplicate of a rig's part within the rig, as by Shift D."""
    return any(
        thing in copies
        for rig in rigs_of(scene)(thing)
        for copies in with_copies(held_by(rig)).values()
    )


def name_for(scene: bpy.types.Scene, name: str) -> str:
    """The name of a result of the active rig, with the number of the rig's collection, or its name
    if the artist renamed it.
    """
    rig = active_rig(scene)
    if rig is None:
        return name
    number = NUMBER.search(rig.name)
    own = rig.name[: number.start()] if number else rig.name
    if own in {RIG, data_name(RIG)}:
        return f"{name}{number.group() if number else ''}"
    return f"{name} {rig.name}"


def name_of_view(scene: bpy.types.Scene, name: str, rig: Rig) -> str:
    """The name of an image of a viewer's view, with the viewer's name if there are several."""
    own = name_for(scene, name)
    return own if len(rig.viewers) == 1 else f"{own} - {rig.viewers[0].name}"
