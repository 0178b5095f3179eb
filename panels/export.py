"""Export, and the report on accuracy and time."""

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


class VIEW3D_PT_kiriko_report(Sidebar, bpy.types.Panel):
    """What accuracy costs on this rig, measured."""

    bl_label = "Report"
    bl_parent_id = "VIEW3D_PT_kiriko_export"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        ours = context.scene.kiriko
        layout.prop(ours, "report_folder")
        layout.prop(context.window_manager.operator_properties_last("kiriko.report"), "seconds")
        layout.operator("kiriko.report", icon="GRAPH")
