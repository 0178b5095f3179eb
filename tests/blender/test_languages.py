"""Languages of the interface: nothing is untranslated, in scenes solved in another one, too."""

import re
import string
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest

import languages as tool
from extension import EXTENSION, loaded
from panel_layout import Layout
from small_rigs import small_rig

LOCALES = sorted(path.stem for path in (tool.ROOT / "languages").glob("*.po"))
# letters that need no translation: units, formats, names of products and of ours
SAME = re.compile(
    "「[^」]*」|(?<![A-Za-z])(px|mm|cd|GB|JSON|CSV|Esc|Kiriko|Cycles|OpenEXR|PNG|IOR|UV|BVH|Embree"
    "|Blender)(?![A-Za-z])"
)


@pytest.fixture
def wanted(kiriko) -> dict[str, str]:
    """All texts of the interface, each with its place."""
    return tool.needed(kiriko, EXTENSION)


@pytest.mark.parametrize("locale", LOCALES)
def test_nothing_is_untranslated(kiriko, wanted, locale):
    """Each label, tooltip and sentence has its text in every language."""
    missing = tool.missing_in(kiriko.languages.all_of(locale), wanted)
    assert not missing, (
        f"Add these entries to languages/{locale}.po, each with its text behind msgstr (its first"
        " lines have the words to be used):\n\n" + "\n".join(missing)
    )


@pytest.mark.parametrize("locale", LOCALES)
def test_nothing_is_stale(kiriko, wanted, locale):
    """No language has a text that nobody shows any more."""
    known = {*wanted, *tool.sentences(with_frames=True)}
    stale = [text for text in kiriko.languages.all_of(locale) if text not in known]
    assert not stale, f"Remove these entries from languages/{locale}.po: {stale}"


def test_an_empty_text_is_missing():
    """An entry without its text does not count as translated."""
    wanted = {"Solve": "a", "Live": "b", "Plate": "c"}
    missing = tool.missing_in({"Solve": "計算", "Live": ""}, wanted)
    assert missing == [tool.entry("Live", "b"), tool.entry("Plate", "c")]


def places(template: str) -> set[tuple[str, str]]:
    """A template's values, with the forms in which they are written."""
    parts = string.Formatter().parse(template)
    return {(name, form) for _, name, form, _ in parts if name and name not in tool.GRAMMAR}


@pytest.mark.parametrize("locale", LOCALES)
def test_values_are_those_of_the_english_text(kiriko, locale):
    """A translated template has each value of the English one, in the same form, and no other."""
    for english, text in kiriko.languages.texts_of(locale).items():
        assert places(text) == places(english), english


@pytest.mark.parametrize("locale", LOCALES)
def test_no_language_writes_a_text_twice(kiriko, locale):
    """A file has each English text once."""
    file = Path(kiriko.languages.FOLDER, f"{locale}.po").read_text(encoding="utf-8")
    lines = [line for line in file.splitlines() if line.startswith("msgid ")]
    assert len(lines) == len(set(lines))


def test_blender_gets_all_and_forgets_all(kiriko, monkeypatch):
    """Enabling hands every language to Blender, disabling takes each back."""
    there: dict[str, dict] = {}
    stand_in = SimpleNamespace(register=there.__setitem__, unregister=there.pop)
    monkeypatch.setattr(kiriko.languages, "translations", stand_in)
    kiriko.languages.register(kiriko.operators.TIPS)
    (by_locale,) = there.values()

    assert sorted(by_locale) == LOCALES
    japanese = by_locale["ja_JP"]
    for context in ("*", "Operator", "Kiriko"):
        assert japanese[context, "Look Through Viewer"] == "視点から見る"
    # a tooltip with values is looked up as a whole
    assert japanese["*", "Index of refraction 1.49"] == "屈折率1.49"
    kiriko.languages.unregister()
    assert not there


@pytest.fixture
def in_japanese(kiriko, monkeypatch) -> Callable[[str], str]:
    """Blender as it is in Japanese, for Blenders without any language; returns its look-up."""
    texts = kiriko.languages.texts_of("ja_JP")

    def look_up(text: str, context: str = "*") -> str:
        return texts.get(text, text)

    kinds = "iface", "tip", "rpt", "data"
    stand_in = SimpleNamespace(**{f"pgettext_{kind}": look_up for kind in kinds})
    reporting = loaded("operators.reporting")
    monkeypatch.setattr(reporting, "translations", stand_in)
    return look_up


def test_a_rig_with_names_in_japanese(scene, in_japanese, monkeypatch):
    """New parts have names as Blender gives them to new data; no name is looked up, so that such a
    rig solves, and goes as a whole.
    """
    own_words = loaded("core.blender.data.translation_context")
    stand_in = SimpleNamespace(pgettext_data=lambda text, context: in_japanese(text))
    monkeypatch.setattr(own_words, "translations", stand_in)
    parts = small_rig()
    assert {parts["PLATE"].name, scene.kiriko.viewer.name} == {"Kirikoプレート", "Kiriko視点"}
    assert bpy.ops.kiriko.solve() == {"FINISHED"}

    # a plate that is out of use is not lost, also once names are English again
    parts["PLATE"].kiriko.role = "NONE"
    assert not bpy.ops.kiriko.go_without_plate.poll()
    monkeypatch.undo()
    assert not bpy.ops.kiriko.go_without_plate.poll()

    assert bpy.ops.kiriko.remove_rig() == {"FINISHED"}
    assert [thing.name for thing in scene.objects] == ["Cube"]
    assert not any(c.name.startswith("Kiriko") for c in bpy.data.collections)


def english_in(texts: list[str], look_up: Callable[[str], str]) -> list[str]:
    """Texts that are still English as they are shown, whose labels Blender looks up itself."""
    names = [thing.name for thing in (*bpy.data.objects, *bpy.data.images, *bpy.data.materials)]
    shown = [look_up(text) for text in texts]
    for name in sorted(names, key=len, reverse=True):
        shown = [text.replace(name, "") for text in shown]
    return [text for text in shown if re.search("[A-Za-z]{2}", SAME.sub("", text))]


PANELS = {
    "main_panel": ["VIEW3D_PT_kiriko_main"],
    "solve_panel": ["VIEW3D_PT_kiriko_check", "VIEW3D_PT_kiriko_advanced"],
    "result_panel": ["VIEW3D_PT_kiriko_result", "VIEW3D_PT_kiriko_details"],
    "object": ["OBJECT_PT_kiriko"],
    "rig_panel": ["VIEW3D_PT_kiriko_rig"],
    "viewers_panel": ["VIEW3D_PT_kiriko_viewers"],
    "export_panel": [
        "VIEW3D_PT_kiriko_export",
        "VIEW3D_PT_kiriko_more_exports",
        "VIEW3D_PT_kiriko_report",
    ],
    "calibration_panel": ["VIEW3D_PT_kiriko_calibration"],
    "add_menu": ["VIEW3D_MT_kiriko_add"],
}


def shown_texts(
    drawn: Callable[..., Layout], thing: bpy.types.Object | None = None
) -> Iterator[str]:
    """All that the panels write, with an active object."""
    for module, names in PANELS.items():
        for name in names if thing is not None or module != "object" else ():
            layout = drawn(module, name, thing)
            yield from (*layout.texts, *layout.labels)


def test_a_result_solved_in_english_reads_japanese(drawn, scene, in_japanese):
    """The scene keeps the English sentence, which scripts read, and all that another language
    needs: after a change of language no panel has an English word left, the notes' values too.
    """
    parts = small_rig()
    parts["DISPLAY"].scale *= 0.5  # some of the picture is lost
    parts["VIEWER"] = scene.kiriko.viewer
    parts["VIEWER"].data.dof.use_dof = True  # a note
    bpy.ops.kiriko.solve()
    assert scene.kiriko.result.summary.startswith("The display shows")
    assert scene.kiriko.result.notes

    texts = [text for thing in parts.values() for text in shown_texts(drawn, thing)]
    assert any("被写界深度" in text for text in texts)
    assert not english_in(texts, in_japanese)


def test_before_and_right_after_add_rig(drawn, scene, in_japanese):
    """The first panel, and the sentences of Add Rig, have no English word left."""
    first = drawn("main_panel", "VIEW3D_PT_kiriko_main")
    assert not english_in([*first.texts, *first.labels], in_japanese)
    small_rig()
    assert not english_in(list(shown_texts(drawn)), in_japanese)


def test_errors_come_in_the_language_of_reports(scene, in_japanese):
    """An operator that fails says so in Japanese, to an artist and to a script."""
    small_rig()["GLASS"].hide_viewport = True
    with pytest.raises(
        RuntimeError, match="ガラス「Cube」がモニターのアイコンによりビューポートで非表示です"
    ):
        bpy.ops.kiriko.solve()


def test_the_terminal_stays_english(scene, in_japanese):
    """Scripts and logs read the command line, whatever language the interface has."""
    reporting = loaded("operators.reporting")
    error = reporting.KirikoError("The scene has {n} gaps.", n=2)
    assert reporting.sentence(error, "The command", translate=str) == "The scene has 2 gaps."
