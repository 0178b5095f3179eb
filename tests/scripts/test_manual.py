"""The manual's pages and data, without Blender and without the site."""

import ast
import re

import pytest

from environments import ROOT
from manual import plays
from manual.places import PLACES, REFERENCE, full_name, lead, place_of
from manual.steps import Do, Shot, Until

MANUAL = ROOT / "docs" / "manual"
LANGUAGES = "en", "ja"
PAGES = {language: sorted((MANUAL / language).glob("*.md")) for language in LANGUAGES}
BOTH = [path for language in LANGUAGES for path in PAGES[language]]
LINK = re.compile(r"\]\(([^)#]+)(?:#[^)]*)?\)")
PICTURE = re.compile(r"\(((?:\.\./en/)?pictures)/(\w+)\.webp\)")
MOST_BYTES = 4_000_000  # of all pictures: each checkout has them
MOST_WORDS = 8_500  # of the English pages


def shots(language: str) -> set[str]:
    """Names of the pictures that are taken in a language."""
    steps = [step for play in plays.MANUAL.values() for step in play]
    if language != "en":
        steps = plays.words_only(steps)
    return {step.name for step in steps if isinstance(step, Shot)}


def test_pages_are_there_in_both_languages():
    """Each page in English has one in Japanese, and no other is there."""
    names = [{path.name for path in PAGES[language]} for language in LANGUAGES]
    assert names[0] | {"glossary.md"} == names[1]  # the English one is docs/glossary.md


@pytest.mark.parametrize("path", BOTH, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_links_and_pictures_are_there(path):
    """A page links to pages and pictures that exist."""
    for target in LINK.findall(path.read_text(encoding="utf-8")):
        if "pictures/" in target:
            assert (path.parent / target).is_file()
        elif not target.startswith("http"):
            names = {"glossary.md", *(page.name for page in PAGES[path.parent.name])}
            assert target in names


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_picture_is_taken_and_shown(language):
    """The files are the pictures that plays take; each is on a page, and other pages show the
    English views. The pictures of panels are on the generated page.
    """
    taken = shots(language)
    files = (MANUAL / language / "pictures").iterdir()
    assert {path.name for path in files} == {f"{name}.webp" for name in taken}
    text = "".join(path.read_text(encoding="utf-8") for path in PAGES[language])
    shown = {name for folder, name in PICTURE.findall(text) if folder == "pictures"}
    assert {name for name in taken if not name.startswith("panel_")} <= shown <= taken


def test_pages_are_short():
    """The English manual stays short enough to be read."""
    words = sum(len(path.read_text(encoding="utf-8").split()) for path in PAGES["en"])
    assert words < MOST_WORDS


def test_pictures_are_small():
    """All pictures of the manual together stay small enough for the zip."""
    assert sum(path.stat().st_size for path in MANUAL.rglob("*.webp")) < MOST_BYTES


@pytest.mark.parametrize("language", LANGUAGES)
def test_places_are_headings(language):
    """Each place that F1 leads to is a heading with that anchor, whatever the language."""
    for place in PLACES:
        page, _, anchor = place.partition("#")
        text = (MANUAL / language / page).read_text(encoding="utf-8")
        assert len(re.findall(rf"^#+ .* {{ #{anchor} }}$", text, re.MULTILINE)) == 1, place


def test_no_button_has_two_places():
    """Each button is explained in one place."""
    names = [name for own in PLACES.values() for name in own]
    assert len(names) == len(set(names))


def test_a_page_leads_to_each_place(tmp_path):
    """A button's page leads to its heading, another one's to the page that has all."""
    own = full_name("kiriko.solve"), full_name("KirikoRig.tolerance")
    assert own == ("bpy.ops.kiriko.solve", "bpy.types.kirikorig.tolerance")
    assert place_of(own[1]) == f"{REFERENCE}#{own[1]}"
    lead(tmp_path, {**dict.fromkeys(own, True), "bpy.ops.kiriko.wipe": False})
    urls = [
        re.search(r'url=([^"]+)"', (tmp_path / "at" / f"{name}.html").read_text())[1]
        for name in (*own, "bpy.ops.kiriko.wipe")
    ]
    assert urls == [
        "../goblet.html#solve",
        f"../reference.html#{own[1]}",
        "../reference.html",
    ]


def test_navigation_has_each_page_in_both_languages():
    """Each page stands in the navigation, with a title in Japanese."""
    config = (ROOT / "scripts" / "manual" / "mkdocs.yml").read_text(encoding="utf-8")
    nav = dict(re.findall(r"^  - ([^:\n]+): (\w+\.md)$", config, re.MULTILINE))
    assert set(nav.values()) == {path.name for path in PAGES["ja"]}
    for title in nav:
        assert f"            {title}: " in config


def test_plays_name_functions_that_are_there():
    """What a play does or asks beside mouse and keys is a function of scenes.py."""
    tree = ast.parse((ROOT / "scripts" / "manual" / "scenes.py").read_text(encoding="utf-8"))
    functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    for play in plays.PLAYS.values():
        for step in play:
            if isinstance(step, Do):
                assert step.function in functions
            elif isinstance(step, Until):
                assert step.question in functions


def test_the_japanese_glossary_has_the_words():
    """Each word of the bench, of images and of settings has its Japanese line."""
    english = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    japanese = (MANUAL / "ja" / "glossary.md").read_text(encoding="utf-8")
    for title in ("The bench", "Images", "Settings"):
        part = english.split(f"## {title}\n")[1].split("\n## ")[0]
        for row in re.findall(r"^\| ([^|]+?) \|", part, re.MULTILINE)[1:]:
            if not row.startswith("-"):
                assert f"| {row} |" in japanese
