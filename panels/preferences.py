"""Kiriko's lines in Preferences > Add-ons."""

import bpy

from ..core.base.messages import Message
from ..operators import preset
from ..operators.reporting import in_words


class KIRIKO_preferences(bpy.types.AddonPreferences):
    """The manual, and the asset library, which only its button adds."""

    bl_idname = __package__.rpartition(".")[0]

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.operator("kiriko.open_manual", icon="HELP")
        path = preset.library_path()
        if path:
            text = Message("Plate materials for Cycles: {path}", path=path)
            self.layout.label(text=in_words(text), icon="CHECKMARK")
        else:
            self.layout.operator("kiriko.add_asset_library", icon="ASSET_MANAGER")
