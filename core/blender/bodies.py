"""Which objects have a surface, so that they can be a part of a rig?"""

import bpy

from ..messages import Message

SURFACELESS = {"ARMATURE", "CAMERA", "LATTICE", "LIGHT", "LIGHT_PROBE", "SPEAKER"}


def bodiless(thing: bpy.types.Object) -> str:
    """Why an object can have no role, as the end of a sentence; '' where it can."""
    if thing.type == "EMPTY":
        is_instance = thing.instance_type == "COLLECTION" and thing.instance_collection is not None
        return "" if is_instance else "an empty has no surface"

    if thing.type not in SURFACELESS:
        return ""

    word = thing.bl_rna.properties["type"].enum_items[thing.type].name.lower()
    return Message(
        "{article} {kind} has no surface",
        article="an" if word[0] in "aeiou" else "a",
        kind=word,
    )
