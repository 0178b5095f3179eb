"""Export, and the report on accuracy and time."""

import bpy

from ..core.base.messages import Message
from ..operators import choose_picture, watch
from ..operators.export import unwritable
from ..operators.wrapping import sentence
from .words import OfRig


class VIEW3D_PT_kiriko_export(OfRig, bpy.types.Panel):
    """The file the source image goes to."""

    bl_label = "Export"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        ours = context.scene.kiriko
        layout.prop(ours, "export_path")
        layout.prop(ours, "export_format")
        for reason in unwritable(ours.export_format):
            sentence(layout, context, Message("{reason}.", reason=reason), icon="ERROR")

        layout.prop(ours, "export_overwrite")
        if ours.result.source is not None and watch.is_told_changed(context.scene):
            sentence(layout, context, watch.CHANGED, icon="ERROR")

        layout.operator("kiriko.export", icon="EXPORT")
        layout.operator("kiriko.export_maps", icon="UV")
        layout.operator("kiriko.export_atlas", icon="VIEW_PAN")
        layout.operator("kiriko.export_job", icon="NETWORK_DRIVE")
        layout.operator("kiriko.bench_drawing", icon="GREASEPENCIL")


class VIEW3D_PT_kiriko_animation(OfRig, bpy.types.Panel):
    """The frames of an animation, as files and as a movie."""

    bl_label = "Animation"
    bl_parent_id = "VIEW3D_PT_kiriko_export"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        ours = context.scene.kiriko
        if choose_picture.film_shown(context):
            layout.operator("kiriko.use_film", icon="FILE_MOVIE")
        layout.prop(ours, "animation_path")
        column = layout.column()
        column.prop(ours, "animation_anew")
        column.prop(ours, "animation_placeholders")
        layout.operator("kiriko.solve_animation", icon="RENDER_ANIMATION")
        layout.prop(ours, "movie_path")
        layout.prop(ours, "movie_codec")
        layout.prop(ours, "movie_card")
        layout.operator("kiriko.export_movie", icon="FILE_MOVIE")


class VIEW3D_PT_kiriko_report(OfRig, bpy.types.Panel):
    """The cost of accuracy on this rig, measured."""

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
