"""Changes of settings of things that were there before, so that they can be put back.

A setting is named by its path, as Blender's `path_resolve` takes it. It is put back only while it
has the value that Kiriko gave it: whoever has changed it since keeps his own.
"""

from typing import Any

import bpy

Change = tuple[str, Any, Any]  # path, value before and after: numbers, words, lists of them


def value_of(owner: bpy.types.bpy_struct, path: str) -> Any:
    """The value of a setting, as JSON can keep it."""
    value = owner.path_resolve(path)
    return value if isinstance(value, str | int | float) else list(value)


def change(owner: bpy.types.bpy_struct, values: dict[str, Any]) -> list[Change]:
    """Give settings other values, one after the other; returns those that are others now."""
    before = {path: value_of(owner, path) for path in values}

    try:
        for path, value in values.items():
            _set(owner, path, value)
    except BaseException:
        for path, value in reversed(before.items()):
            _set(owner, path, value)
        raise

    after = {path: value_of(owner, path) for path in values}
    return [(path, before[path], after[path]) for path in values if before[path] != after[path]]


def put_back(owner: bpy.types.bpy_struct, changes: list[Change]) -> None:
    """Take changes back, the last one first. Settings that
    are gone, as with an add-on of theirs, are passed by.
    """
    for path, before, after in reversed(changes):
        try:
            is_ours = value_of(owner, path) == after
        except ValueError:  # as Blender says that there is no such path
            continue
        if is_ours:
            _set(owner, path, before)


def _set(owner: bpy.types.bpy_struct, path: str, value: Any) -> None:
    group, _, name = path.rpartition(".")
    try:
        setattr(owner.path_resolve(group) if group else owner, name, value)
    except TypeError:  # an engine or another choice that is gone
        if value_of(owner, path) != value:
            raise
