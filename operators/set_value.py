"""Properties of the open file for the command line's --set, by Python path.

A path follows `bpy.data.` or `bpy.context.scene.`.
"""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from math import isfinite
from typing import NamedTuple

import bpy
import numpy as np

from ..core.base.errors import RigError
from ..core.base.messages import Message

# A name in double quotes, in single quotes, or bare in brackets (as shells leave ["Glass"]) unless
# it is a whole number.
NAMES = re.compile(
    r"""
    "(?: [^"\\] | \\. )*"
    | \[ ' ([^'"]+) ' \]
    | \[ (?! -?\d+ \] ) ([^'"\[\]]+) \]
    """,
    re.VERBOSE,
)
ONE_OF_SEVERAL = re.compile(r"(\w+)(?:\[(\d+)\])?")


class _FoundProperty(NamedTuple):
    """A settable property: its owner, its name, and the index of one of its numbers (None for a
    scalar).
    """

    owner: bpy.types.bpy_struct
    name: str
    index: int | None

    @property
    def value(self) -> object:
        """Present value."""
        value = getattr(self.owner, self.name)
        return value if self.index is None else value[self.index]

    def set_to(self, value: object) -> None:
        """Set it to a value of its type."""
        if self.index is None:
            setattr(self.owner, self.name, value)
            return
        numbers = list(getattr(self.owner, self.name))
        numbers[self.index] = value
        setattr(self.owner, self.name, numbers)


def set_values(pairs: Iterable[tuple[str, str]]) -> list[Message]:
    """Set properties from text; returns a line on each, and one on each without effect.

    Raises
    ------
    RigError
        There is no such property, or it cannot have the value.
    """
    pairs = list(pairs)
    messages = [_set(path, text) for path, text in pairs]
    return [*messages, *idle(path for path, _ in pairs)]


def idle(paths: Iterable[str]) -> list[Message]:
    """A line on each property that another one disables, such as an index without Override IOR."""
    messages = []
    for path in dict.fromkeys(paths):
        owner, name, _ = _found(path)
        if isinstance(owner, bpy.types.PropertyGroup) and not getattr(owner, f"use_{name}", True):
            switch = f"{path.rpartition('.')[0]}.use_{name}"
            messages.append(
                Message(
                    "'{path}' has no effect while '{switch}' is off: set '{switch}' to true as"
                    " well",
                    path=path,
                    switch=switch,
                )
            )
    return messages


def check_values(path: str, texts: Iterable[str]) -> None:
    """Raise RigError if a property cannot have one of some values; it stays unchanged."""
    for text in texts:
        with having(path, text):
            pass


@contextmanager
def having(path: str, text: str) -> Iterator[None]:
    """Set a property to a value for a while."""
    found = _found(path)
    was_set, before = found.owner.is_property_set(found.name), found.value
    try:
        _set(path, text)
        yield
    finally:
        if was_set:
            found.set_to(before)
        else:
            found.owner.property_unset(found.name)


def _set(path: str, text: str) -> Message:
    """Set a property of the scene, otherwise of the file's data."""
    found = _found(path)
    known = found.owner.bl_rna.properties[found.name]
    try:
        value = _read(known, text)
        _refuse_beyond(known, path, value)  # Blender would cut it silently
        found.set_to(value)
    except (TypeError, ValueError):
        raise RigError(
            "The property '{path}' can't be '{text}': use another type of value.",
            path=path,
            text=text,
        ) from None
    return Message("'{path}' is now {value}", path=path, value=found.value)


def _found(path: str) -> _FoundProperty:
    """The property at a path."""
    place, _, last = NAMES.sub(_in_quotes, path.removeprefix("bpy.data.")).rpartition(".")
    words = ONE_OF_SEVERAL.fullmatch(last)
    name, index = words.groups() if words else (last, None)
    owner = _owner(place)
    known = None if owner is None else owner.bl_rna.properties.get(name)
    n_numbers = getattr(known, "array_length", 0)
    has_rows = sum(n > 0 for n in getattr(known, "array_dimensions", ())) > 1
    if known is None or known.is_readonly or has_rows or (index and not n_numbers):
        raise RigError(
            "The property '{path}' doesn't exist: name it like objects[\"Glass\"].kiriko.ior, or"
            " kiriko.tolerance for the scene.",
            path=path,
        )
    if n_numbers and not (index and int(index) < n_numbers):
        whole = path.rpartition("[")[0] if index else path
        raise RigError(
            "The property '{path}' has {n} numbers: set '{path}[0]' to '{path}[{last}]' one by"
            " one.",
            path=whole,
            n=n_numbers,
            last=n_numbers - 1,
        )
    return _FoundProperty(owner, name, int(index) if index else None)


def _in_quotes(found: re.Match[str]) -> str:
    """A name in a path, unquoted."""
    name = found[1] or found[2]
    return f'["{name}"]' if name else found[0]


def _owner(place: str) -> bpy.types.bpy_struct | None:
    scene = bpy.context.scene
    places = [(scene, place), (bpy.data, place)]
    if place.partition(".")[0] == "kiriko":  # a Python property, which cannot be part of a path
        places = [(scene.kiriko, place.removeprefix("kiriko").removeprefix("."))]
    for data, rest in places:
        try:
            owner = data.path_resolve(rest) if rest else data
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


def _refuse_beyond(known: bpy.types.Property, path: str, value: object) -> None:
    """Raise RigError if a value is out of a property's range."""
    if known.type in {"FLOAT", "INT"}:
        stored = np.float32 if known.type == "FLOAT" else int
        with np.errstate(over="ignore"):  # beyond any range
            low, given, high = map(stored, (known.hard_min, value, known.hard_max))
        if not low <= given <= high:
            raise RigError(
                "The property '{path}' can't be {value}: use {low} to {high}.",
                path=path,
                value=value,
                low=str(low),
                high=str(high),
            )
    elif known.type == "STRING" and 0 < known.length_max <= len(str(value).encode()):
        raise RigError(
            "The property '{path}' can't hold {n} characters: use {most} at most.",
            path=path,
            n=len(str(value).encode()),
            most=known.length_max - 1,
        )


def _finite(text: str) -> float:
    number = float(text)
    return number if isfinite(number) else _refused(text)


def _refused(text: str) -> object:
    raise ValueError(text)
