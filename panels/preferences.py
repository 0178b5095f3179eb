"""Kiriko's lines in Preferences > Add-ons."""

import bpy

from ..core.base.messages import Message
from ..operators import preset
from ..operators.telling import in_words


class KIRIKO_preferences(bpy.types.AddonPreferences):
    """Buttons: nothing is set here, and no asset library is added unasked."""

    bl_idname = __package__.rpartition(".")[0]

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.operator("kiriko.open_manual", icon="HELP")
        path = preset.library_path()
        self.layout.label(text="Plate materials for Cycles, in the asset browser:")
        if path:
            self.layout.label(
                text=in_words(Message("In your asset libraries: {path}", path=path)),
                icon="CHECKMARK",
            )
        else:
            self.layout.operator("kiriko.add_asset_library", icon="ASSET_MANAGER")
