"""Reversible changes of settings of existing things.

A setting is identified by its path, for Blender's `path_resolve`. It is restored only while it has
the value set by Kiriko: a later change by the user stays.
"""

from typing import Any

import bpy

Change = tuple[str, Any, Any]  # path, value before and after: numbers, words, lists of them


def value_of(owner: bpy.types.bpy_struct, path: str) -> Any:
    """The value of a setting, as JSON can store it."""
    value = owner.path_resolve(path)
    return value if isinstance(value, str | int | float) else list(value)


def change(owner: bpy.types.bpy_struct, values: dict[str, Any]) -> list[Change]:
    """Set values in order; returns the actual changes."""
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
    """Undo changes, the last one first. Missing settings, as of a removed add-on, are skipped."""
    for path, before, after in reversed(changes):
        try:
            is_ours = value_of(owner, path) == after
        except ValueError:  # Blender's error for an unknown path
            continue
        if is_ours:
            _set(owner, path, before)


def _set(owner: bpy.types.bpy_struct, path: str, value: Any) -> None:
    group, _, name = path.rpartition(".")
    try:
        setattr(owner.path_resolve(group) if group else owner, name, value)
    except TypeError:  # a removed engine or other choice
        if value_of(owner, path) != value:
            raise
