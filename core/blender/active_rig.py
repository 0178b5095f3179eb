"""Which rig of a scene is active: `scene.kiriko` holds its settings and its result, and those of
the other rigs are kept beside them.

All of it is the scene's own data, so that undo, which puts datablocks back one by one, never mixes
one rig's settings with another's.
"""

from typing import Any

import bpy

from .rigs import active_rig, rig_of, rigs
from .stored_records import fields_of, text_of

WITHOUT_TEXT = bpy.types.ID | bpy.types.bpy_prop_collection  # a list of viewers is one of cameras
OF_SCENE = {"rig", "followed", "followed_uid", "looking"}  # settings that no rig has for itself


def settings_of(scene: bpy.types.Scene, rig: bpy.types.Collection) -> bpy.types.PropertyGroup:
    """Settings and result of a rig; those of the scene where it has none of its own yet."""
    if rig != active_rig(scene):
        for one in scene.kiriko_others:
            if one.key == rig.kiriko.key:
                return one.settings
    return scene.kiriko


def has_settings(scene: bpy.types.Scene, rig: bpy.types.Collection) -> bool:
    """Are there settings and a result of a rig?"""
    return rig == active_rig(scene) or any(one.key == rig.kiriko.key for one in scene.kiriko_others)


def shown_settings(scene: bpy.types.Scene, thing: bpy.types.Object) -> bpy.types.PropertyGroup:
    """Settings and result of the rig that an object is a part of."""
    rig = rig_of(scene, thing) if len(scene.kiriko_others) else None
    return scene.kiriko if rig is None else settings_of(scene, rig)


def make_active(scene: bpy.types.Scene, rig: bpy.types.Collection) -> None:
    """Have a scene's settings be those of one of its rigs; those of the one before are kept."""
    ours = scene.kiriko
    before = active_rig(scene)
    if before == rig:
        ours.rig = rig.kiriko.key
        return

    key = ours.rig or ("" if before is None else before.kiriko.key)
    keep_as(scene, key)
    replace(scene, rig)


def keep_as(scene: bpy.types.Scene, key: str) -> None:
    """Keep the scene's settings as those of a rig, by its key; '': of the scene without any.

    A rig's own ones go with it. Those of the scene, which its first rig took, stay.
    """
    known = {"", *(group.kiriko.key for group in bpy.data.collections)}
    for n in reversed(range(len(scene.kiriko_others))):
        one = scene.kiriko_others[n]
        if one.key == key or (one.key not in known and one.settings.is_of_rig):
            scene.kiriko_others.remove(n)
    if key in known or not scene.kiriko.is_of_rig:
        kept = scene.kiriko_others.add()
        kept.key = key
        copy_settings(scene.kiriko, kept.settings)


def replace(scene: bpy.types.Scene, rig: bpy.types.Collection | None) -> None:
    """Put a rig's settings, or those of the scene without any, in the place of the scene's.

    A rig that has none kept takes those of the scene, or begins with the defaults.
    """
    key = "" if rig is None else rig.kiriko.key
    others = scene.kiriko_others
    places = [n for n, one in enumerate(others) if one.key == key]
    if rig is None:  # also those that a first rig took, whose collection is gone
        places += [n for n, one in enumerate(others) if not one.settings.is_of_rig]
    else:
        places += [n for n, one in enumerate(others) if not one.key]
    if places:
        copy_settings(others[places[0]].settings, scene.kiriko)
        others.remove(places[0])
    else:
        begin(scene, rig)
    scene.kiriko.rig = key


def begin(scene: bpy.types.Scene, rig: bpy.types.Collection | None) -> None:
    """Have a scene's settings be the defaults: those of a rig, or of no rig."""
    clear_settings(scene.kiriko)
    if rig is not None:
        scene.kiriko.is_of_rig = True


def follow(scene: bpy.types.Scene, thing: bpy.types.Object | None) -> bpy.types.Collection | None:
    """The rig that is to be active because another object is; None where it is already.

    The object is noted, so that a rig which was chosen by hand stays until another one is selected.
    """
    found = rigs(scene)
    active = active_rig(scene)
    if active is None and found and scene.kiriko.rig:  # its collection is gone
        return rig_of(scene, thing) or found[-1]
    if len(found) < 2 or thing is None:
        return None
    if not is_new(scene, thing):
        remember(scene, thing)  # it may have another name by now
        return None

    # files of before there were several are left as they are until something is selected
    is_first = not (scene.kiriko.rig or scene.kiriko.followed)
    remember(scene, thing)
    rig = rig_of(scene, thing)
    return None if is_first or rig == active else rig


def is_new(scene: bpy.types.Scene, thing: bpy.types.Object | None) -> bool:
    """Is an object another than the one whose rig was looked up last?

    It is known by its number, which renaming leaves, but which another session does not know: there
    it is known by its name.
    """
    ours = scene.kiriko
    if thing is None:
        return False
    if ours.followed_uid:
        return thing.session_uid != ours.followed_uid
    return thing.name != ours.followed


def remember(scene: bpy.types.Scene, thing: bpy.types.Object) -> None:
    """Keep which object is the one whose rig was looked up last."""
    ours = scene.kiriko
    if (ours.followed, ours.followed_uid) != (thing.name, thing.session_uid):
        ours.followed, ours.followed_uid = thing.name, thing.session_uid


def know_by_name(scene: bpy.types.Scene) -> None:
    """Forget the number of that object, which is of another session."""
    if scene.is_editable and scene.kiriko.followed_uid:
        scene.kiriko.property_unset("followed_uid")


def copy_settings(source: bpy.types.PropertyGroup, target: bpy.types.PropertyGroup) -> None:
    """Give one group of settings the values of another, and what is unset there is unset."""
    for name, value in _settings(source):
        if isinstance(value, bpy.types.PropertyGroup):
            copy_settings(value, getattr(target, name))
        elif isinstance(value, bpy.types.bpy_prop_collection):
            listed = getattr(target, name)
            listed.clear()
            for one in value:
                copy_settings(one, listed.add())
        elif source.is_property_set(name):
            setattr(target, name, value)
        else:
            target.property_unset(name)


def clear_settings(group: bpy.types.PropertyGroup) -> None:
    """Give a group of settings its defaults."""
    for name, value in _settings(group):
        if isinstance(value, bpy.types.PropertyGroup):
            clear_settings(value)
        elif isinstance(value, bpy.types.bpy_prop_collection):
            value.clear()
        else:
            group.property_unset(name)


def settings_text(group: bpy.types.PropertyGroup) -> str:
    """A group of settings as JSON, those that are set: without its result, and without datablocks
    and lists of them, which have no place in a text.
    """
    return text_of(_values(group))


def set_settings(group: bpy.types.PropertyGroup, text: str) -> None:
    """Give a group of settings the values of such a text; what is not in it gets its default.

    A value that this version does not know is passed by.
    """
    clear_settings(group)
    _set_values(group, fields_of(text))


def _values(group: bpy.types.PropertyGroup) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in _settings(group):
        if name == "result" or isinstance(value, WITHOUT_TEXT):
            continue
        if isinstance(value, bpy.types.PropertyGroup):
            found[name] = _values(value)
        elif group.is_property_set(name) and value is not None:
            found[name] = value if isinstance(value, str | int | float) else list(value)
    return found


def _set_values(group: bpy.types.PropertyGroup, values: dict[str, Any]) -> None:
    for name in values.keys() & group.bl_rna.properties.keys():
        if isinstance(values[name], dict):
            _set_values(getattr(group, name), values[name])
            continue
        try:
            setattr(group, name, values[name])
        except (TypeError, ValueError):
            continue


def _settings(group: bpy.types.PropertyGroup) -> list[tuple[str, object]]:
    names = set(group.bl_rna.properties.keys()) - {"rna_type", "name"} - OF_SCENE
    return [(name, getattr(group, name)) for name in sorted(names)]
