"""The interface: the tab Kiriko in the 3D viewport's sidebar, drawings over the viewport, and
menus.
"""

import bpy

from ..core.blender.data.translation_context import in_own_words
from . import (
    add_menu,
    calibration_panel,
    export_panel,
    main_panel,
    menus,
    object,
    overlay,
    part_images,
    preferences,
    range_view,
    result_panel,
    rig_panel,
    shown_pixels,
    solve_panel,
    viewers_panel,
    wipe,
)

# in the order of the sidebar
CLASSES = (
    main_panel.VIEW3D_PT_kiriko_main,
    result_panel.VIEW3D_PT_kiriko_result,
    result_panel.VIEW3D_MT_kiriko_result_images,
    viewers_panel.VIEW3D_PT_kiriko_seen_by,
    result_panel.VIEW3D_PT_kiriko_details,
    rig_panel.VIEW3D_MT_kiriko_rigs,
    rig_panel.VIEW3D_PT_kiriko_rig,
    object.VIEW3D_PT_kiriko_views,
    object.VIEW3D_MT_kiriko_images,
    object.OBJECT_PT_kiriko,
    export_panel.VIEW3D_PT_kiriko_export,
    solve_panel.VIEW3D_PT_kiriko_check,
    viewers_panel.KIRIKO_UL_viewers,
    viewers_panel.VIEW3D_MT_kiriko_scenes,
    viewers_panel.VIEW3D_PT_kiriko_viewers,
    viewers_panel.VIEW3D_PT_kiriko_pupil,
    export_panel.VIEW3D_PT_kiriko_more_exports,
    export_panel.VIEW3D_PT_kiriko_animation,
    export_panel.VIEW3D_PT_kiriko_report,
    calibration_panel.VIEW3D_PT_kiriko_calibration,
    calibration_panel.VIEW3D_PT_kiriko_expected,
    calibration_panel.VIEW3D_PT_kiriko_found,
    calibration_panel.VIEW3D_PT_kiriko_not_separated,
    solve_panel.VIEW3D_PT_kiriko_advanced,
    add_menu.VIEW3D_MT_kiriko_add,
    add_menu.VIEW3D_MT_kiriko_more,
    *menus.SUBMENUS,
    menus.VIEW3D_MT_kiriko,
    preferences.KIRIKO_preferences,
    wipe.KIRIKO_GGT_wipe,
)


def register() -> None:
    """Register all classes, menu entries and draw handlers."""
    for cls in CLASSES:
        bpy.utils.register_class(in_own_words(cls))
    bpy.types.VIEW3D_MT_add.append(add_menu.draw)
    bpy.types.VIEW3D_MT_object.append(menus.draw_in_object)
    bpy.types.TOPBAR_MT_file_export.append(menus.draw_in_export)
    bpy.types.TOPBAR_MT_help.append(menus.draw_in_help)
    part_images.register()
    overlay.register()
    wipe.register()
    shown_pixels.register()
    range_view.register()


def unregister() -> None:
    """Unregister them."""
    range_view.unregister()
    shown_pixels.unregister()
    wipe.unregister()
    overlay.unregister()
    part_images.unregister()
    bpy.types.TOPBAR_MT_help.remove(menus.draw_in_help)
    bpy.types.TOPBAR_MT_file_export.remove(menus.draw_in_export)
    bpy.types.VIEW3D_MT_object.remove(menus.draw_in_object)
    bpy.types.VIEW3D_MT_add.remove(add_menu.draw)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
