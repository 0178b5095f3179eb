"""Object > Kiriko and its submenus: all operators, for search, shortcuts and Quick Favourites."""

import bpy

from ..core.blender.data.rigs import rigs
from ..operators import live, needed
from . import add_menu
from .result_panel import VIEW3D_MT_kiriko_result_images


class VIEW3D_MT_kiriko(bpy.types.Menu):
    """All operators, or the submenus with them."""

    bl_label = "Kiriko"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        add_menu.add_rig(layout, add_menu.labels_of("Add Rig"))
        layout.operator("kiriko.part_copies", icon="DUPLICATE")
        layout.operator("kiriko.remove_rig", icon="TRASH")
        if len(rigs(context.scene)) > 1:
            layout.menu("VIEW3D_MT_kiriko_rigs", icon="OUTLINER_COLLECTION")
        layout.operator_menu_enum("kiriko.open_example", "example")
        layout.separator()
        layout.operator("kiriko.solve", icon="LIGHT_SUN")
        icon = "PAUSE" if live.follows(context.scene) else "PLAY"
        layout.operator("kiriko.live", icon=icon)
        layout.operator("kiriko.look_through", icon="VIEW_CAMERA")
        layout.operator("kiriko.simulate", icon="IMAGE_DATA")
        layout.operator("kiriko.preview", icon="RENDER_STILL")
        layout.menu(VIEW3D_MT_kiriko_result_images.bl_idname, icon="IMAGE_DATA")
        layout.operator("kiriko.before_after", icon="ARROW_LEFTRIGHT")
        layout.operator("kiriko.save_comparison", icon="FILE_TICK")
        layout.operator("kiriko.visible_range", icon="HIDE_OFF")
        layout.operator("kiriko.remove_visible_range", icon="X")
        layout.operator("kiriko.eye_box", icon="MOD_LATTICE")
        layout.operator("kiriko.remove_eye_box", icon="X")
        layout.operator("kiriko.draw_light_paths", icon="CURVE_PATH")
        layout.separator()
        for menu in SUBMENUS:
            layout.menu(menu.__name__)
        layout.separator()
        layout.operator("kiriko.open_manual", icon="HELP")


class VIEW3D_MT_kiriko_parts(bpy.types.Menu):
    """Operators that choose images, materials and products."""

    bl_label = "Picture and Glass"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("kiriko.open_picture", icon="FILE_FOLDER")
        layout.operator_menu_enum("kiriko.make_glass", "product", icon="MATSPHERE")
        layout.operator_menu_enum("kiriko.make_part", "role", icon="ADD")
        layout.operator("kiriko.go_without_plate")
        for preset in ("glass_preset", "plate_preset", "display_preset"):
            layout.operator_menu_enum(f"kiriko.{preset}", "preset", icon="PRESET")


class VIEW3D_MT_kiriko_fit(bpy.types.Menu):
    """Operators that resize or move parts."""

    bl_label = "Fit and Place"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("kiriko.fit_picture", icon="FULLSCREEN_EXIT")
        for fit in ("fit_picture_size", "fit_display", "fit_plate"):
            layout.operator(f"kiriko.{fit}", icon="FULLSCREEN_ENTER")
        layout.separator()
        for verb in ("best_place", "turn_back", "move_to_glass", "take_proposal", "drop_proposal"):
            layout.operator(f"kiriko.{verb}")


class VIEW3D_MT_kiriko_viewers(bpy.types.Menu):
    """Operators on the list of viewers."""

    bl_label = "Viewers"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("kiriko.add_viewer", icon="OUTLINER_OB_CAMERA")
        layout.operator("kiriko.two_eyes", icon="CAMERA_STEREO")
        layout.operator("kiriko.viewer_grid", icon="LIGHTPROBE_VOLUME")
        layout.operator("kiriko.render_pictures", icon="RENDER_STILL")
        layout.operator("kiriko.open_pictures", icon="FILE_FOLDER")
        layout.operator("kiriko.move_viewer")
        layout.operator("kiriko.remove_viewer", icon="X")


class VIEW3D_MT_kiriko_calibration(bpy.types.Menu):
    """Operators for a real bench."""

    bl_label = "Calibration"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("kiriko.bench_drawing", icon="GREASEPENCIL")
        layout.operator("kiriko.lattice_picture", icon="LIGHTPROBE_VOLUME")
        layout.operator("kiriko.calibrate", icon="TRACKER")
        layout.operator("kiriko.apply_calibration")
        layout.operator("kiriko.remove_calibration")


class VIEW3D_MT_kiriko_export(bpy.types.Menu):
    """Operators that write files, and the show window."""

    bl_label = "Export"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("kiriko.export", icon="EXPORT").choose = True
        layout.operator("kiriko.export_maps", icon="UV")
        layout.operator("kiriko.export_views", icon="RENDERLAYERS")
        layout.operator("kiriko.export_interlaced", icon="ALIGN_JUSTIFY")
        layout.operator("kiriko.export_atlas", icon="VIEW_PAN")
        layout.operator("kiriko.export_job", icon="NETWORK_DRIVE")
        layout.separator()
        layout.operator("kiriko.use_film", icon="FILE_MOVIE")
        layout.operator("kiriko.solve_animation", icon="RENDER_ANIMATION")
        layout.operator("kiriko.export_movie", icon="FILE_MOVIE")
        layout.operator("kiriko.show_window", icon="WINDOW")
        layout.separator()
        layout.operator("kiriko.report", icon="GRAPH")


SUBMENUS = (
    VIEW3D_MT_kiriko_parts,
    VIEW3D_MT_kiriko_fit,
    VIEW3D_MT_kiriko_viewers,
    VIEW3D_MT_kiriko_calibration,
    VIEW3D_MT_kiriko_export,
)


def draw_in_object(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Add the last line of the Object menu."""
    menu.layout.separator()
    menu.layout.menu("VIEW3D_MT_kiriko", icon="MATSPHERE")


def draw_in_export(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    """A line of File > Export, where there is an image to be exported."""
    if needed.has_rig(context.scene):
        text = "Kiriko Source Image (.png, .tif, .exr)"
        menu.layout.operator("kiriko.export", text=text).choose = True
        text = "Kiriko Warp Maps (.exr, .pgm, .obj, .data, .npz, .png)"
        menu.layout.operator("kiriko.export_maps", text=text)


def draw_in_help(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Add a line to the Help menu."""
    menu.layout.operator("kiriko.open_manual", text="Kiriko Manual", icon="HELP")
