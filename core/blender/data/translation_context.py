"""Labels and names of ours are looked up with the meaning that they have here: Blender's own
translations have "Display", which is a part, as the verb.
"""

import bpy

from ...base.messages import CONTEXT

translations = bpy.app.translations


def data_name(name: str) -> str:
    """The name of a new datablock, translated where Blender translates names of new data."""
    return str(translations.pgettext_data(name, CONTEXT))


def in_own_words(cls: type) -> type:
    """Have Blender look up the name of a class, and of all properties that it declares, in our
    context, before it is registered.
    """
    if not issubclass(cls, bpy.types.PropertyGroup | bpy.types.AddonPreferences):
        cls.bl_translation_context = CONTEXT
    for base in cls.__mro__:
        for declared in getattr(base, "__annotations__", {}).values():
            if hasattr(declared, "keywords"):
                declared.keywords.setdefault("translation_context", CONTEXT)
    return cls
