"""Surfaces in the scene that tell of a rig as it was when they were made."""

from time import perf_counter

import bpy

from ..core.base.messages import Message
from ..core.blender.data.made_objects import made_surface

RANGE = "Kiriko Visible Range"
EYE_BOX = "Kiriko Eye Box"
LABELS = {RANGE: Message("Visible Range"), EYE_BOX: Message("Eye Box")}  # of their buttons
MADE_FOR = "kiriko_made_for"  # a surface's own property: the rig's fingerprint, as text
PAUSE = 0.5  # s between two looks at all objects of a scene

# by scene and name: looked at next, the object's name
_found: dict[tuple[int, str], tuple[float, str]] = {}


def looked_up(scene: bpy.types.Scene, name: str) -> bpy.types.Object | None:
    """A surface of a scene; all objects are looked at once in a while only."""
    key = scene.session_uid, name
    due, of_object = _found.get(key, (0.0, ""))
    if perf_counter() >= due:
        found = made_surface(scene, name)
        of_object = "" if found is None else found.name
        _found[key] = perf_counter() + PAUSE, of_object
    return scene.objects.get(of_object) if of_object else None


def made_for(scene: bpy.types.Scene, name: str) -> str:
    """The rig that a surface was made for, as text; empty where there is none, or it is of an
    earlier version.
    """
    thing = looked_up(scene, name)
    return "" if thing is None else str(thing.get(MADE_FOR, ""))


def rigs_made_for(scene: bpy.types.Scene) -> tuple[str, ...]:
    """The rigs that the scene's surfaces were made for, as text."""
    return tuple(filter(None, (made_for(scene, name) for name in LABELS)))


def forget() -> None:
    """Look at all objects anew."""
    _found.clear()
