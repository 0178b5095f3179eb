"""Export and More Exports: files, the source image in a window, animations and the report."""

import bpy

from ..core.base.messages import Message
from ..core.blender.data.rigs import rigs
from ..core.blender.result.write_result import quilt_in, sections_in
from ..operators import choose_picture, show_window
from ..operators.export import unwritable
from ..operators.reporting import in_words
from ..operators.wrapping import sentence
from .panel_text import Closed, OfRig, with_labels


class VIEW3D_PT_kiriko_export(OfRig, bpy.types.Panel):
    """The file of the source image."""

    bl_label = "Export"

    def draw(self, context: bpy.types.Context) -> None:
        layout = with_labels(self.layout)
        ours = context.scene.kiriko
        column = layout.column(align=True)
        column.prop(ours, "export_path")
        column.prop(ours, "export_format")
        column.operator("kiriko.export", icon="EXPORT")
        for reason in unwritable(ours.export_format):
            sentence(layout, context, Message("{reason}.", reason=reason), icon="ERROR")


class VIEW3D_PT_kiriko_more_exports(Closed, bpy.types.Panel):
    """All other files, and the source image in a window."""

    bl_label = "More Exports"

    def draw(self, context: bpy.types.Context) -> None:
        layout = with_labels(self.layout)
        layout.operator("kiriko.export_maps", icon="UV")
        layout.operator("kiriko.export_atlas", icon="VIEW_PAN")
        layout.operator("kiriko.export_job", icon="NETWORK_DRIVE")
        layout.operator("kiriko.bench_drawing", icon="GREASEPENCIL")
        if len(rigs(context.scene)) > 1:
            layout.prop(context.window_manager.kiriko, "show_rig")
        image = show_window.shown_result(context.scene).source
        if image is not None and quilt_in(image) is not None:
            layout.operator("kiriko.export_views", icon="RENDERLAYERS")
            layout.operator("kiriko.export_interlaced", icon="ALIGN_JUSTIFY")
        for section in sections_in(image) if image is not None else ():
            label = Message("Show Window: {part}", part=section.name)
            text = {"text": in_words(label), "translate": False} if section.name else {}
            layout.operator("kiriko.show_window", icon="WINDOW", **text).part = section.name
        if image is None:
            layout.operator("kiriko.show_window", icon="WINDOW")
        for window in show_window.show_windows():
            size = show_window.size_of(window)
            if image is not None:
                shown = show_window.shown_section(window, image)
                wanted = shown.width, shown.height
                icon = "CHECKMARK" if size == wanted else "ERROR"
                sentence(layout, context, words_on(size, wanted, _keys(context)), icon)


class VIEW3D_PT_kiriko_animation(Closed, bpy.types.Panel):
    """The frames of an animation, as files and as a movie."""

    bl_label = "Animation"
    bl_parent_id = "VIEW3D_PT_kiriko_more_exports"

    def draw(self, context: bpy.types.Context) -> None:
        layout = with_labels(self.layout)
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


class VIEW3D_PT_kiriko_report(Closed, bpy.types.Panel):
    """The report on accuracy and time."""

    bl_label = "Report"
    bl_parent_id = "VIEW3D_PT_kiriko_more_exports"

    def draw(self, context: bpy.types.Context) -> None:
        layout = with_labels(self.layout)
        layout.prop(context.scene.kiriko, "report_folder")
        layout.prop(context.window_manager.operator_properties_last("kiriko.report"), "seconds")
        layout.operator("kiriko.report", icon="GRAPH")


def _keys(context: bpy.types.Context) -> str:
    return show_window.key_of_full_screen(context) or Message("Window > Toggle Window Fullscreen")


def words_on(size: tuple[int, int], image: tuple[int, int], keys: str) -> Message:
    """A sentence on a show window and an image, both with their sizes (width, height), px."""
    width, height = image
    if size == image:
        return Message(
            "The window matches the image: {width} x {height} pixels.", width=width, height=height
        )
    return Message(
        "The window has {across} x {down} pixels, the image {width} x {height}. Drag the window to"
        " the display and press {keys}.",
        across=size[0],
        down=size[1],
        width=width,
        height=height,
        keys=keys,
    )
