"""The artist's view: the tab Kiriko in the 3D viewport's sidebar, and the Add menu."""

import bpy

from . import add_menu, calibration, export, preferences, result, rig, solve

CLASSES = (
    rig.VIEW3D_MT_kiriko_images,
    rig.VIEW3D_PT_kiriko_rig,
    solve.VIEW3D_PT_kiriko_solve,
    solve.VIEW3D_PT_kiriko_preview,
    result.VIEW3D_PT_kiriko_result,
    result.VIEW3D_PT_kiriko_details,
    calibration.VIEW3D_PT_kiriko_calibration,
    calibration.VIEW3D_PT_kiriko_expected,
    calibration.VIEW3D_PT_kiriko_found,
    calibration.VIEW3D_PT_kiriko_not_told,
    export.VIEW3D_PT_kiriko_export,
    export.VIEW3D_PT_kiriko_report,
    add_menu.VIEW3D_MT_kiriko_add,
    preferences.KIRIKO_preferences,
)


def register() -> None:
    """Show them."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.VIEW3D_MT_add.append(add_menu.draw)


def unregister() -> None:
    """Take them away."""
    bpy.types.VIEW3D_MT_add.remove(add_menu.draw)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
