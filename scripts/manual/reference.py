"""The part of the page *Buttons and settings* that is generated from the code, in each language.

Runs in Blender: `run.py` starts it, with the folder to write into.
"""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import bpy

from known.registered import registered
from manual.places import REFERENCE, full_name, place_of

CHECKLIST = {"en": "Checklist", "ja": "チェックリスト"}
OBJECT = {"en": "Selected object", "ja": "選択したオブジェクト"}
MENUS = {"en": "Other menus", "ja": "そのほかのメニュー"}
HEAD = {"en": ("Button or setting", "Effect"), "ja": ("ボタン、設定", "はたらき")}
MORE = {"en": "more", "ja": "詳しく"}
# the sidebar from top to bottom: panel or heading, and the buttons and settings in it
SECTIONS: tuple[tuple[str | dict[str, str], tuple[str, ...]], ...] = (
    ("main", (
        "kiriko.add_rig", "kiriko.open_example", "kiriko.open_manual", "kiriko.choose_rig",
        "kiriko.solve", "kiriko.live", "kiriko.look_through", "kiriko.open_picture",
    )),
    (CHECKLIST, (
        "kiriko.make_glass", "kiriko.thicken", "kiriko.fill_holes", "kiriko.turn_out",
        "kiriko.smooth_glass", "kiriko.shade_smooth", "kiriko.use_part", "kiriko.leave_out",
        "kiriko.show_part", "kiriko.make_part", "kiriko.go_without_plate",
        "kiriko.move_to_glass", "kiriko.rescale_scene", "kiriko.fit_picture_size",
        "kiriko.fit_display", "kiriko.fit_plate", "kiriko.part_copies",
    )),
    ("result", (
        "kiriko.best_place", "kiriko.turn_back", "kiriko.take_proposal", "kiriko.drop_proposal",
        "kiriko.before_after", "kiriko.show_image",
    )),
    ("rig", (
        "kiriko.select_part", "kiriko.glass_preset", "kiriko.plate_preset",
        "kiriko.display_preset", "KirikoRig.tolerance", "KirikoRig.effort",
    )),
    ("export", ("KirikoRig.export_path", "KirikoRig.export_format", "kiriko.export")),
    ("check", (
        "kiriko.simulate", "kiriko.preview", "KirikoView.left", "KirikoView.right",
        "KirikoView.wipe", "kiriko.save_comparison", "KirikoView.show_overlay",
        "kiriko.draw_light_paths",
    )),
    ("viewers", (
        "KirikoViewer.is_on", "KirikoViewer.weight", "kiriko.move_viewer", "KirikoRig.viewer",
        "KirikoViewer.camera", "KirikoObject.use_resolution", "KirikoObject.use_dof",
        "KirikoObject.pupil",
        "kiriko.add_viewer",
        "kiriko.remove_viewer", "kiriko.two_eyes", "kiriko.viewer_grid",
        "KirikoRig.disagreement", "KirikoRig.picture_source", "KirikoRig.picture_image",
        "KirikoViewer.image", "kiriko.open_pictures", "kiriko.render_pictures",
        "kiriko.visible_range", "kiriko.remove_visible_range", "kiriko.eye_box",
        "kiriko.remove_eye_box",
    )),
    ("more_exports", (
        "kiriko.export_views", "kiriko.export_interlaced",
        "kiriko.export_maps", "kiriko.export_atlas", "kiriko.export_job",
        "kiriko.bench_drawing", "kiriko.show_window", "kiriko.use_film",
        "KirikoRig.animation_path", "KirikoRig.animation_anew",
        "KirikoRig.animation_placeholders", "kiriko.solve_animation", "KirikoRig.movie_path",
        "KirikoRig.movie_codec", "KirikoRig.movie_card", "kiriko.export_movie",
        "KirikoRig.report_folder", "kiriko.report",
    )),
    ("calibration", (
        "KirikoCalibration.columns", "KirikoCalibration.rows", "KirikoCalibration.margin",
        "KirikoCalibration.style", "kiriko.lattice_picture", "KirikoCalibration.filepath",
        "KirikoCalibration.size", "KirikoCalibration.keep", "kiriko.calibrate",
        "kiriko.apply_calibration", "kiriko.remove_calibration", "KirikoCalibration.shift",
        "KirikoCalibration.turn", "KirikoCalibration.index", "KirikoCalibration.focal",
        "KirikoCalibration.crossing", "KirikoCalibration.mirror", "KirikoCalibration.noise",
    )),
    ("advanced", (
        "KirikoRig.brightness", "KirikoRig.sharpen", "KirikoRig.ghosts",
        "KirikoRig.only_through_glass",
        "KirikoRig.only_through_plate", "KirikoRig.suppress_glare", "KirikoRig.margin",
        "KirikoRig.max_events", "kiriko.remove_rig",
    )),
    (OBJECT, (
        "KirikoObject.role", "KirikoObject.use_ior", "KirikoObject.ior",
        "KirikoObject.dispersion", "KirikoObject.abbe", "KirikoObject.use_tint",
        "KirikoObject.tint", "KirikoObject.priority",
        "KirikoObject.surface", "KirikoObject.resolution", "KirikoPlate.model",
        "KirikoPlate.pitch", "KirikoPlate.height", "KirikoPlate.ior", "KirikoPlate.reflectance",
        "KirikoPlate.crossing_error", "KirikoPlate.fresnel", "KirikoPlate.phase",
        "KirikoDisplay.white", "KirikoDisplay.black_level", "KirikoDisplay.encoding",
        "KirikoDisplay.gamma", "KirikoDisplay.primaries", "KirikoDisplay.wavelengths",
        "KirikoViews.use", "KirikoViews.columns", "KirikoViews.rows", "KirikoViews.cone",
        "KirikoViews.overlap", "KirikoViews.distance",
        "kiriko.choose_picture", "kiriko.fit_picture",
        "KirikoPicture.brightness", "KirikoPicture.gamma", "KirikoPicture.black_level",
        "KirikoElement.reflects", "KirikoElement.prefers", "KirikoElement.reflectance",
        "KirikoElement.absorption", "KirikoElement.polarising", "KirikoElement.focal_length",
        "KirikoElement.spread", "KirikoElement.pitch", "KirikoElement.is_polarised",
        "KirikoElement.angle", "KirikoElement.extinction", "KirikoElement.retardance",
    )),
    (MENUS, ("kiriko.add_plate_material", "kiriko.add_asset_library")),
)  # fmt: skip
# for buttons that have another text than their operator's name, or only a symbol
LABELS = {
    "kiriko.choose_rig": {"en": "the rig's name", "ja": "リグの名前"},
    "kiriko.open_picture": {"en": "Choose Your Picture", "ja": "絵を選択"},
    "kiriko.open_manual": {"en": "?", "ja": "?"},
    "kiriko.use_part": {"en": "Add 'Wine' to Rig", "ja": "「ワイン」をリグに追加"},
    "kiriko.leave_out": {"en": "Leave Out 'Wine'", "ja": "「ワイン」を除外"},
    "kiriko.show_part": {"en": "Show", "ja": "表示"},
    "kiriko.make_part": {
        "en": "Make a Plate, Make a Picture ...",
        "ja": "プレートを作る、絵を作る…",
    },
    "kiriko.rescale_scene": {"en": "Scale Scene to 1/1000", "ja": "シーンを1/1000に縮小"},
    "kiriko.show_image": {"en": "the image's name", "ja": "画像の名前"},
    "kiriko.select_part": {"en": "the part's name", "ja": "部品の名前"},
    "kiriko.glass_preset": {"en": "the glass's product", "ja": "ガラスの製品"},
    "kiriko.plate_preset": {"en": "the plate's product", "ja": "プレートの製品"},
    "kiriko.display_preset": {"en": "the display's product", "ja": "ディスプレイの製品"},
    "kiriko.move_viewer": {"en": "▲ ▼", "ja": "▲ ▼"},
    "kiriko.add_viewer": {"en": "+", "ja": "+"},
    "kiriko.remove_viewer": {"en": "-", "ja": "-"},
    "kiriko.remove_visible_range": {"en": "x (Visible Range)", "ja": "x 可視範囲"},
    "kiriko.remove_eye_box": {"en": "x (Eye Box)", "ja": "x アイボックス"},
    "kiriko.choose_picture": {"en": "Image", "ja": "画像"},
}
LOCALES = {"en": "", "ja": "ja_JP"}
STYLE = (
    "<style>tr:has(:target) { outline: 2px solid var(--md-accent-fg-color); }"
    " tr > td:first-child { min-width: 9em; }</style>"
)


def is_setting(prop: bpy.types.Property) -> bool:
    """Whether people set a property: neither a group nor a record of the code."""
    if prop.is_hidden or prop.name == prop.identifier or prop.type == "COLLECTION":
        return False
    if prop.type == "STRING":
        return prop.subtype != "NONE"
    return prop.type != "POINTER" or issubclass(
        getattr(bpy.types, prop.fixed_type.identifier, bpy.types.PropertyGroup), bpy.types.ID
    )


def settings(cls: type) -> Iterator[bpy.types.Property]:
    """The settings of a class, in the order of its code."""
    base = cls.bl_rna.base
    inherited = set(base.properties.keys()) if base else set()
    for prop in cls.bl_rna.properties:
        if prop.identifier not in inherited and is_setting(prop):
            yield prop


def all_names(kiriko: ModuleType) -> dict[str, object]:
    """Each operator and setting as Blender describes it, by its name in `SECTIONS`."""
    operators = importlib.import_module(f"{kiriko.__name__}.operators")
    properties = importlib.import_module(f"{kiriko.__name__}.core.blender.properties")
    found: dict[str, object] = {}
    for cls in operators.CLASSES:
        verb = cls.bl_idname.partition(".")[2]
        found[cls.bl_idname] = getattr(bpy.ops.kiriko, verb).get_rna_type()
    for cls in properties.classes:
        found |= {f"{cls.__name__}.{prop.identifier}": prop for prop in settings(cls)}
    return found


def row(name: str, rna: object, language: str, translated: Callable[[str], str]) -> str:
    """A line of the table: the button's text, and its tooltip."""
    says = translated(rna.description)
    items = getattr(rna, "enum_items_static", ())
    if items:
        says += "<br>" + "<br>".join(
            f"*{translated(item.name)}*"
            + (f": {translated(item.description)}" if item.description else "")
            for item in items
        )
    place = place_of(full_name(name))
    if not place.startswith(REFERENCE):
        says += f" ([{MORE[language]}]({place}))"
    label = LABELS[name][language] if name in LABELS else translated(rna.name)
    return f'| <span id="{full_name(name)}">**{label}**</span> | {says.removeprefix("<br>")} |'


def sections(kiriko: ModuleType, language: str) -> Iterator[str]:
    """A heading, the panel's picture and a table for each of `SECTIONS`."""
    languages = importlib.import_module(f"{kiriko.__name__}.languages")
    texts = languages.texts_of(LOCALES[language]) if LOCALES[language] else {}
    found = all_names(kiriko)

    def translated(text: str) -> str:
        return texts.get(text, text).replace("|", r"\|").replace("\n", " ")

    for where, names in SECTIONS:
        if isinstance(where, str):
            title = translated(getattr(bpy.types, f"VIEW3D_PT_kiriko_{where}").bl_label)
            yield f"## {title}\n\n![{title}](pictures/panel_{where}.webp)\n"
        else:
            yield (
                f"### {where[language]}\n"
                if where in (CHECKLIST, OBJECT)
                else (f"## {where[language]}\n")
            )
        head = " | ".join(HEAD[language])
        lines = [row(name, found[name], language, translated) for name in names]
        yield "\n".join([f"| {head} |", "|---|---|", *lines, ""])


def main() -> None:
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    kiriko = registered()
    for language in LOCALES:
        page = "\n".join([STYLE, "", *sections(kiriko, language)])
        (folder / f"{language}.md").write_text(page, encoding="utf-8")

    rows = {name for _, names in SECTIONS for name in names}
    names = {full_name(name): name in rows for name in all_names(kiriko)}
    (folder / "names.json").write_text(json.dumps(names), encoding="utf-8")


if __name__ == "__main__":
    main()
