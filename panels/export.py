"""Export."""

import bpy


class VIEW3D_PT_kiriko_export(bpy.types.Panel):
    """The file the source image goes to."""

    bl_label = "Export"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Kiriko"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        ours = context.scene.kiriko
        layout.prop(ours, "export_path")
        layout.prop(ours, "export_format")
        layout.prop(ours, "export_overwrite")
        layout.operator("kiriko.export", icon="EXPORT")
