"""Records in a .blend that are damaged, come from a newer version, or were written by somebody."""

import importlib
import json
import time
from collections.abc import Callable
from types import ModuleType

import bpy
import pytest

from panel_layout import Layout
from small_rigs import inventory, record_text, small_rig

NEWER = json.dumps({"version": 99, "rig": "a", "changes": [["kiriko.role", "NONE", "GLASS"]]})
PANELS = (
    ("result_panel", "VIEW3D_PT_kiriko_result"),
    ("result_panel", "VIEW3D_PT_kiriko_details"),
    ("calibration_panel", "VIEW3D_PT_kiriko_calibration"),
    ("rig_panel", "VIEW3D_PT_kiriko_rig"),
    ("main_panel", "VIEW3D_PT_kiriko_main"),
)
DAMAGED = ("no JSON", "[]", "7", '"text"', '{"changes": 7}', NEWER, "[" * 100_000)


def draw_all(drawn: Callable[..., Layout], glass: bpy.types.Object) -> None:
    """Draw each panel that shows records; an error in one fails the test."""
    for module, name in PANELS:
        drawn(module, name, active=glass)


@pytest.mark.parametrize("text", DAMAGED, ids=lambda text: text[:12])
def test_every_verb_works_with_unreadable_records(
    kiriko: ModuleType, scene: bpy.types.Scene, drawn: Callable[..., Layout], text: str
) -> None:
    """An unreadable record counts as empty: panels draw, the rig solves, and Remove Rig leaves the
    artist's glass alone, without a role.
    """
    needed = importlib.import_module(f"{kiriko.__name__}.operators.needed")
    before = inventory()
    parts = small_rig()
    bpy.ops.kiriko.solve()
    ours = scene.kiriko
    for thing in parts.values():
        thing["kiriko_looking"] = text
    for name in ("details", "ladder", "sentences", "solved_for"):
        setattr(ours.result, name, text)
    ours.calibration.offset = ours.calibration.found = text
    scene.kiriko_scene.looking = text

    draw_all(drawn, parts["GLASS"])
    assert bpy.ops.kiriko.solve() == {"FINISHED"}
    assert ours.result.source is not None
    draw_all(drawn, parts["GLASS"])
    assert not needed.has_lost_plate(scene)
    assert bpy.ops.kiriko.remove_rig() == {"FINISHED"}
    assert parts["GLASS"].kiriko.role == "NONE"
    left = {kind: set(names) - set(before[kind]) for kind, names in inventory().items()}
    assert {kind: names for kind, names in left.items() if names} == {
        "objects": {"Cube"},
        "meshes": {"mesh"},
    }


def test_unreadable_marks_are_reported_once(
    kiriko: ModuleType, scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first button that meets an unreadable record reports it; the next ones do not."""
    reporting = importlib.import_module(f"{kiriko.__name__}.operators.reporting")
    small_rig()
    scene.kiriko.calibration.offset = "damaged on 29 November"
    reports: list[str] = []
    monkeypatch.setattr(reporting, "report", lambda _, level, text: reports.append(str(text)))
    for _ in range(2):
        bpy.ops.kiriko.solve()
    assert [text for text in reports if "damaged on 29 November" in text] == [
        "Kiriko ignores a damaged record, or one of another version, in this file: damaged on 29"
        " November"
    ]


@pytest.mark.parametrize(
    ("template", "value"),
    [
        ("{a:>1500000000}", "x"),
        ("{a.__class__}", "x"),
        ("{a!r}", "x"),
        ("{a[0]}", "x"),
        ("{}", "x"),
        ("{a:g}", "x"),
        ("{", "x"),
    ],
)
def test_a_file_cannot_run_format_strings(kiriko: ModuleType, template: str, value: str) -> None:
    """A stored sentence with anything but plain fields is shown as the plain text it stands for."""
    kept = importlib.import_module(f"{kiriko.__name__}.core.blender.data.stored_records")
    stored = {"by_text": {"As shown.": {"template": template, "values": {"a": value}}}}
    started = time.process_time()
    message = kept.Sentences.read(record_text(stored)).message("As shown.")
    assert (str(message), message.values) == ("As shown.", {})
    assert time.process_time() - started < 1


def test_sentences_that_double_are_cut(kiriko: ModuleType) -> None:
    """Forty nested messages, each of which stands twice in the next, do not fill the memory."""
    kept = importlib.import_module(f"{kiriko.__name__}.core.blender.data.stored_records")
    data: object = "a" * 100
    for _ in range(40):
        data = {"template": "{a}{a}", "values": {"a": data}}
    read = kept.Sentences.read(record_text({"by_text": {"As shown.": data}}))
    assert str(read.message("As shown.")) == "As shown."
