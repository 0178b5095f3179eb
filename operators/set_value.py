"""Properties of the open file that the command line sets before its work, by their paths in Python
behind `bpy.data.` or `bpy.context.scene.`.
"""

from collections.abc import Iterable
from math import isfinite

import bpy

from ..core.errors import RigError
from ..core.messages import Message


def set_values(pairs: Iterable[tuple[str, str]]) -> list[Message]:
    """Set properties to values, both as text; a line on each.

    Raises
    ------
    RigError
        There is no such property, or it cannot have the value.
    """
    return [_set(path, text) for path, text in pairs]


def check_values(path: str, texts: Iterable[str]) -> None:
    """Raise RigError where a property could not be set to one of some values; it stays as it is."""
    for text in texts:
        owner, name = _found(path)
        was_set, before = owner.is_property_set(name), getattr(owner, name)
        try:
            _set(path, text)
        finally:
            if was_set:
                setattr(owner, name, before)
            else:
                owner.property_unset(name)


def _set(path: str, text: str) -> Message:
    """Set one: of the scene, else of the file's data."""
    owner, name = _found(path)
    try:
        setattr(owner, name, _read(owner.bl_rna.properties[name], text))
    except (TypeError, ValueError):
        raise RigError(
            "The property '{path}' cannot be '{text}': give it a value of its kind.",
            path=path,
            text=text,
        ) from None
    return Message("'{path}' is {value} now", path=path, value=getattr(owner, name))


def _found(path: str) -> tuple[bpy.types.bpy_struct, str]:
    """Whose property it is, and its name there."""
    place, _, name = path.rpartition(".")
    owner = _owner(place)
    known = None if owner is None else owner.bl_rna.properties.get(name)
    if known is None or known.is_readonly or getattr(known, "is_array", False):
        raise RigError(
            "The file has no property '{path}' that could be set: name it as in"
            ' objects["Glass"].kiriko.ior, or kiriko.tolerance of the scene.',
            path=path,
        )
    return owner, name


def _owner(place: str) -> bpy.types.bpy_struct | None:
    for data in (bpy.context.scene, bpy.data):
        try:
            owner = data.path_resolve(place) if place else data
        except ValueError:
            continue
        if hasattr(owner, "bl_rna"):
            return owner
    return None


def _read(known: bpy.types.Property, text: str) -> object:
    kinds = {"FLOAT": _finite, "INT": int}
    if known.type == "BOOLEAN":
        if text.lower() not in {"true", "false", "1", "0"}:
            raise ValueError(text)
        return text.lower() in {"true", "1"}
    if known.type in {"STRING", "ENUM"}:
        return text
    return kinds[known.type](text) if known.type in kinds else _refused(text)


def _finite(text: str) -> float:
    number = float(text)
    return number if isfinite(number) else _refused(text)


def _refused(text: str) -> object:
    raise ValueError(text)
