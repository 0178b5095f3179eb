"""Kiriko's operators, one file for each subject."""

import bpy

from ..core.blender.data.translation_context import in_own_words
from . import (
    add_rig,
    before_after,
    bench_drawing,
    calibrate,
    choose_picture,
    choose_rig,
    compared,
    draw_light_paths,
    export,
    export_atlas,
    export_job,
    export_maps,
    export_views,
    eye_box,
    fitting,
    frames,
    framing,
    live,
    look_over,
    look_through,
    make_glass,
    make_part,
    map_drawing,
    open_example,
    open_manual,
    part_verbs,
    preset,
    preview,
    proposal,
    remove_rig,
    repair,
    report,
    show_window,
    simulate,
    sketcher,
    solve,
    viewer_images,
    viewer_list,
    watch,
    work,
)
from .cli import command_line

CLASSES = (
    add_rig.KIRIKO_OT_add_rig,
    remove_rig.KIRIKO_OT_remove_rig,
    choose_rig.KIRIKO_OT_choose_rig,
    choose_rig.KIRIKO_OT_part_copies,
    preset.KIRIKO_OT_add_plate_material,
    preset.KIRIKO_OT_add_asset_library,
    preset.KIRIKO_OT_plate_preset,
    preset.KIRIKO_OT_display_preset,
    preset.KIRIKO_OT_glass_preset,
    make_glass.KIRIKO_OT_make_glass,
    part_verbs.KIRIKO_OT_select_part,
    part_verbs.KIRIKO_OT_show_part,
    make_part.KIRIKO_OT_make_part,
    make_part.KIRIKO_OT_use_part,
    make_part.KIRIKO_OT_go_without_plate,
    repair.KIRIKO_OT_leave_out,
    repair.KIRIKO_OT_thicken,
    repair.KIRIKO_OT_turn_out,
    repair.KIRIKO_OT_fill_holes,
    repair.KIRIKO_OT_shade_smooth,
    repair.KIRIKO_OT_smooth_glass,
    repair.KIRIKO_OT_rescale_scene,
    open_example.KIRIKO_OT_open_example,
    open_manual.KIRIKO_OT_open_manual,
    choose_picture.KIRIKO_OT_choose_picture,
    choose_picture.KIRIKO_OT_open_picture,
    choose_picture.KIRIKO_OT_use_film,
    choose_picture.KIRIKO_OT_fit_picture,
    fitting.KIRIKO_OT_fit_picture_size,
    fitting.KIRIKO_OT_fit_display,
    fitting.KIRIKO_OT_fit_plate,
    proposal.KIRIKO_OT_best_place,
    proposal.KIRIKO_OT_move_to_glass,
    proposal.KIRIKO_OT_turn_back,
    proposal.KIRIKO_OT_take_proposal,
    proposal.KIRIKO_OT_drop_proposal,
    solve.KIRIKO_OT_solve,
    live.KIRIKO_OT_live,
    look_through.KIRIKO_OT_look_through,
    preview.KIRIKO_OT_preview,
    viewer_list.KIRIKO_OT_add_viewer,
    viewer_list.KIRIKO_OT_remove_viewer,
    viewer_list.KIRIKO_OT_move_viewer,
    viewer_list.KIRIKO_OT_two_eyes,
    viewer_list.KIRIKO_OT_viewer_grid,
    viewer_images.KIRIKO_OT_render_pictures,
    viewer_images.KIRIKO_OT_open_pictures,
    eye_box.KIRIKO_OT_visible_range,
    eye_box.KIRIKO_OT_remove_visible_range,
    eye_box.KIRIKO_OT_eye_box,
    eye_box.KIRIKO_OT_remove_eye_box,
    draw_light_paths.KIRIKO_OT_draw_light_paths,
    simulate.KIRIKO_OT_simulate,
    show_window.KIRIKO_OT_show_image,
    before_after.KIRIKO_OT_before_after,
    before_after.KIRIKO_OT_wipe,
    before_after.KIRIKO_OT_save_comparison,
    export.KIRIKO_OT_export,
    export_maps.KIRIKO_OT_export_maps,
    export_views.KIRIKO_OT_export_views,
    export_views.KIRIKO_OT_export_interlaced,
    export_atlas.KIRIKO_OT_export_atlas,
    export_job.KIRIKO_OT_export_job,
    show_window.KIRIKO_OT_show_window,
    frames.KIRIKO_OT_solve_animation,
    frames.KIRIKO_OT_export_movie,
    report.KIRIKO_OT_report,
    bench_drawing.KIRIKO_OT_bench_drawing,
    calibrate.KIRIKO_OT_lattice_picture,
    calibrate.KIRIKO_OT_calibrate,
    calibrate.KIRIKO_OT_apply_calibration,
    calibrate.KIRIKO_OT_remove_calibration,
)
# tooltips with values, which Blender translates as a whole
TIPS = tuple({**preset.PLATE_TIPS, **preset.DISPLAY_TIPS, **make_glass.GLASS_TIPS}.values())
_commands: list[object] = []


def register() -> None:
    """Register the operators and the command with Blender."""
    for cls in CLASSES:
        bpy.utils.register_class(in_own_words(cls))
    live.register()
    framing.register()
    look_through.register()
    show_window.register()
    _commands.append(bpy.utils.register_cli_command("kiriko", command_line.run))
    choose_rig.register()
    open_manual.register()
    open_example.register()
    watch.register()
    sketcher.register()
    look_over.register()
    proposal.register()
    compared.register()


def unregister() -> None:
    """Unregister them, end all running work, and empty the session."""
    sketcher.unregister()
    proposal.unregister()
    look_over.unregister()
    watch.unregister()
    open_manual.unregister()
    open_example.unregister()
    choose_rig.unregister()
    show_window.unregister()
    look_through.unregister()
    framing.unregister()
    live.unregister()
    compared.unregister()
    map_drawing.unregister()
    work.forget()
    while _commands:
        bpy.utils.unregister_cli_command(_commands.pop())
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
