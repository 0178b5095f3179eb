"""Where the manual explains a button or a setting, for F1 over it.

A place is a heading of a page that has the same anchor in each language, as in `## Export it
{ #export }`. All other buttons and settings lead to *Buttons and settings*. A new page adds its
headings.
"""

from __future__ import annotations

import shutil
from pathlib import Path

REFERENCE = "reference.md"
FOLDER = "at"  # of pages that lead on, one for each button and setting: operators/open_manual.py
# names as Blender has them, without bpy.ops or bpy.types
PLACES = {
    "index.md#add": ("kiriko.add_rig",),
    "index.md#picture": ("kiriko.open_picture", "kiriko.choose_picture"),
    "index.md#see": ("kiriko.look_through", "kiriko.live"),
    "index.md#export": ("kiriko.export",),
    "goblet.md#glass": ("kiriko.make_glass", "kiriko.thicken", "kiriko.shade_smooth"),
    "goblet.md#solve": (
        "kiriko.solve", "kiriko.fit_picture_size", "kiriko.fit_display", "kiriko.fit_plate",
        "kiriko.best_place", "kiriko.turn_back", "kiriko.take_proposal",
        "kiriko.drop_proposal",
    ),
    "goblet.md#see": ("kiriko.before_after", "kiriko.save_comparison"),
    "bench.md#measure": (
        "kiriko.rescale_scene", "kiriko.select_part", "kiriko.show_part",
        "kiriko.display_preset", "kiriko.plate_preset", "kiriko.glass_preset",
    ),
    "several_rigs.md#several": ("kiriko.choose_rig", "kiriko.part_copies"),
    "bench.md#viewers": (
        "kiriko.add_viewer", "kiriko.remove_viewer", "kiriko.move_viewer",
        "kiriko.two_eyes", "kiriko.viewer_grid", "kiriko.eye_box", "kiriko.remove_eye_box",
        "kiriko.show_image", "kiriko.render_pictures", "kiriko.open_pictures",
        "KirikoRig.disagreement", "KirikoViewer.image", "kiriko.visible_range",
        "kiriko.remove_visible_range",
    ),
    "bench.md#pupil": (
        "KirikoObject.pupil", "KirikoObject.use_dof", "KirikoRig.sharpen",
    ),
    "bench.md#views": ("kiriko.export_views", "kiriko.export_interlaced"),
    "bench.md#drawing": ("kiriko.bench_drawing",),
    "bench.md#paths": ("kiriko.draw_light_paths",),
    "bench.md#plate": ("kiriko.simulate", "kiriko.go_without_plate"),
    "calibration.md#lattice": ("kiriko.lattice_picture",),
    "calibration.md#calibrate": (
        "kiriko.calibrate", "kiriko.apply_calibration", "kiriko.remove_calibration",
    ),
    "formats.md#source": ("KirikoRig.export_format",),
    "formats.md#files": ("kiriko.export_maps", "kiriko.export_atlas", "kiriko.report"),
    "show.md#window": ("kiriko.show_window", "KirikoView.show_rig"),
    "show.md#farm": ("kiriko.export_job",),
}  # fmt: skip
LEADING = """<!doctype html>
<meta charset="utf-8">
<meta http-equiv="refresh" content="0; url={url}">
<title>Kiriko</title>
<a href="{url}">{name}</a>
"""


def full_name(name: str) -> str:
    """A name as Blender looks it up: in small letters."""
    return f"bpy.{'ops' if name.startswith('kiriko.') else 'types'}.{name.lower()}"


def place_of(name: str) -> str:
    """The page and the anchor that explain the button or setting of this full name."""
    for place, names in PLACES.items():
        if name in map(full_name, names):
            return place
    return f"{REFERENCE}#{name}"


def lead(site: Path, names: dict[str, bool]) -> None:
    """Give a built site of one language a page for each name, which leads to its place.

    names : full names, and whether each has a row in *Buttons and settings*
    """
    folder = site / FOLDER
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name, has_row in names.items():
        page, _, anchor = place_of(name).partition("#")
        url = f"../{Path(page).stem}.html"
        if has_row or page != REFERENCE:
            url += f"#{anchor}"
        (folder / f"{name}.html").write_text(LEADING.format(url=url, name=name), encoding="utf-8")
