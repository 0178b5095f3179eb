"""Translation context of Kiriko's labels and names: Blender's own translations read "Display", a
part of the rig, as a verb.
"""

import bpy

from ...base.messages import CONTEXT

translations = bpy.app.translations


def data_name(name: str) -> str:
    """The name of a new datablock, translated if Blender translates names of new data."""
    return str(translations.pgettext_data(name, CONTEXT))


def in_own_words(cls: type) -> type:
    """Have Blender translate a class's name and property labels in Kiriko's context; call it before
    registration.
    """
    if not issubclass(cls, bpy.types.PropertyGroup | bpy.types.AddonPreferences):
        cls.bl_translation_context = CONTEXT
    for base in cls.__mro__:
        for declared in getattr(base, "__annotations__", {}).values():
            if hasattr(declared, "keywords"):
                declared.keywords.setdefault("translation_context", CONTEXT)
    return cls
