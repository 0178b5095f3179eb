"""Objects of other files: what is set on them stays in this file only where they are library
overrides.
"""

import bpy
from bpy.app.handlers import persistent

from ..errors import RigError
from .changes import change, value_of

OVERRIDE = {"LIBRARY_OVERRIDABLE"}
# one setting of each group that an object has
OF_GROUPS = ("kiriko.role", "kiriko.plate.pitch", "kiriko.picture.gamma", "kiriko.display.gamma")


def be_overridable(cls: type) -> None:
    """Have Blender keep all properties of a class on overrides, before it is registered."""
    for declared in cls.__annotations__.values():
        declared.keywords["override"] = OVERRIDE


def overridden(
    scene: bpy.types.Scene, things: tuple[bpy.types.Object, ...]
) -> tuple[bpy.types.Object, ...]:
    """Objects of this file themselves, and library overrides in place of linked ones.

    Raises RigError where none can take an object's place, as in a collection that is linked, too.
    """
    own: list[bpy.types.Object] = []
    for thing in things:
        one = thing if thing.library is None else thing.override_create(remap_local_usages=True)
        own += [] if one is None else [one]
        if one not in set(scene.objects):
            take_away(set(own) - set(things))
            raise RigError(
                "'{name}' is linked from another file with its collection, and would not stay"
                " glass in this file: make it a library override first, by Object > Library"
                " Override > Make.",
                name=thing.name,
            )
    return tuple(own)


def take_away(overrides: set[bpy.types.Object]) -> None:
    """Have linked objects in place of overrides of them."""
    for one in overrides:
        one.override_library.destroy()


@persistent
def on_save(*_: object) -> None:
    """Have overrides and their linked objects have the same groups of settings: Blender 5 does not
    save the settings of a group that one of both alone has.
    """
    for thing in bpy.data.objects:
        override = thing.override_library
        if override is None or override.reference is None or not thing.is_property_set("kiriko"):
            continue
        for one in (thing, override.reference):
            change(one, {path: value_of(one, path) for path in OF_GROUPS})
