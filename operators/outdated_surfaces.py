"""Surfaces of visible range and eye box, and the rig each was made for."""

from time import perf_counter

import bpy

from ..core.base.messages import Message
from ..core.blender.data.made_objects import find_made

RANGE = "Kiriko Visible Range"
EYE_BOX = "Kiriko Eye Box"
LABELS = {RANGE: Message("Visible Range"), EYE_BOX: Message("Eye Box")}  # labels of their buttons
MADE_FOR = "kiriko_made_for"  # custom property of a surface: the rig's fingerprint, as text
PAUSE = 0.5  # s between searches of all objects of a scene

# by scene and surface: time of the next search, and the object's name
_found: dict[tuple[int, str], tuple[float, str]] = {}


def looked_up(scene: bpy.types.Scene, name: str) -> bpy.types.Object | None:
    """A surface of a scene; all objects are searched only once in a while."""
    key = scene.session_uid, name
    due, of_object = _found.get(key, (0.0, ""))
    if perf_counter() >= due:
        found = find_made(scene, name)
        of_object = "" if found is None else found.name
        _found[key] = perf_counter() + PAUSE, of_object
    return scene.objects.get(of_object) if of_object else None


def made_for(scene: bpy.types.Scene, name: str) -> str:
    """Fingerprint of the rig a surface was made for, as text; empty if unknown."""
    thing = looked_up(scene, name)
    return "" if thing is None else str(thing.get(MADE_FOR, ""))


def rigs_made_for(scene: bpy.types.Scene) -> tuple[str, ...]:
    """Fingerprints of the rigs the scene's surfaces were made for, as text."""
    return tuple(filter(None, (made_for(scene, name) for name in LABELS)))


def forget() -> None:
    """Search all objects again."""
    _found.clear()
