"""Writes the part of the page *Buttons and settings* that the code itself tells, in each language.

Runs in Blender: `run.py` starts it, with the folder to write into.
"""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import bpy

from known.registered import registered
from manual.places import REFERENCE, full_name, place_of

BUTTONS = {"en": "Buttons", "ja": "ボタン"}
MORE = {"en": "more", "ja": "詳しく"}
# classes of settings, each with a heading
SETTINGS = {
    "KirikoRig": {"en": "Solve, picture and export", "ja": "計算、絵、エクスポート"},
    "KirikoViewer": {"en": "One of several viewers", "ja": "複数の視点の一つ"},
    "KirikoObject": {"en": "An object in the rig", "ja": "リグの中のオブジェクト"},
    "KirikoPicture": {"en": "The picture's light", "ja": "絵の光"},
    "KirikoDisplay": {"en": "The display's light", "ja": "ディスプレイの光"},
    "KirikoPlate": {"en": "The plate", "ja": "プレート"},
    "KirikoCalibration": {"en": "Calibration", "ja": "キャリブレーション"},
    "KirikoView": {"en": "The view", "ja": "表示"},
}
LOCALES = {"en": "", "ja": "ja_JP"}
STYLE = (
    "<style>tr:has(:target) { outline: 2px solid var(--md-accent-fg-color); }"
    " tr > td:first-child { white-space: nowrap; }</style>"
)


def is_setting(prop: bpy.types.Property) -> bool:
    """Is a property one that people set: no group of others, no note that the code keeps?"""
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


def row(name: str, rna: object, texts: dict[str, str], language: str) -> str:
    """A line of the table: the label, and what the tooltip says."""

    def reported(text: str) -> str:
        return texts.get(text, text).replace("|", r"\|").replace("\n", " ")

    says = reported(rna.description)
    for item in getattr(rna, "enum_items_static", ()):
        says += f"<br>*{reported(item.name)}*"
        says += f": {reported(item.description)}" if item.description else ""
    place = place_of(name)
    if not place.startswith(REFERENCE):
        says += f" ([{MORE[language]}]({place}))"
    return f'| <span id="{name}">**{reported(rna.name)}**</span> | {says} |'


def sections(kiriko: object, language: str) -> Iterator[tuple[str, list[str]]]:
    """Lines of the page, each section with the full names that it explains."""
    languages = importlib.import_module(f"{kiriko.__name__}.languages")
    operators = importlib.import_module(f"{kiriko.__name__}.operators")
    texts = languages.texts_of(LOCALES[language]) if LOCALES[language] else {}

    def table(heading: str, rows: dict[str, object]) -> tuple[str, list[str]]:
        lines = [f"## {heading}", "", "| | |", "|---|---|"]
        lines += [row(name, rna, texts, language) for name, rna in rows.items()]
        return "\n".join([*lines, ""]), list(rows)

    buttons = {}
    for cls in operators.CLASSES:
        verb = cls.bl_idname.partition(".")[2]
        buttons[full_name(cls.bl_idname)] = getattr(bpy.ops.kiriko, verb).get_rna_type()
    yield table(BUTTONS[language], buttons)

    properties = importlib.import_module(f"{kiriko.__name__}.core.blender.properties")
    for cls in properties.classes:
        if cls.__name__ in SETTINGS:
            rows = {full_name(f"{cls.__name__}.{p.identifier}"): p for p in settings(cls)}
            yield table(SETTINGS[cls.__name__][language], rows)


def main() -> None:
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    kiriko = registered()
    names: list[str] = []
    for language in LOCALES:
        parts = list(sections(kiriko, language))
        names = [name for _, own in parts for name in own]
        page = "\n".join([STYLE, "", *(text for text, _ in parts)])
        (folder / f"{language}.md").write_text(page, encoding="utf-8")
    (folder / "names.json").write_text(json.dumps(names), encoding="utf-8")


if __name__ == "__main__":
    main()
