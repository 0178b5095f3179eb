"""Export."""

import bpy

from .words import Sidebar


class VIEW3D_PT_kiriko_export(Sidebar, bpy.types.Panel):
    """The file the source image goes to."""

    bl_label = "Export"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        ours = context.scene.kiriko
        layout.prop(ours, "export_path")
        layout.prop(ours, "export_format")
        layout.prop(ours, "export_overwrite")
        layout.operator("kiriko.export", icon="EXPORT")
