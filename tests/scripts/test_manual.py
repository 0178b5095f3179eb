"""The manual's pages and data, without Blender and without the site."""

import ast
import re
from pathlib import Path

import pytest

from environments import ROOT
from manual import plays, troubleshooting
from manual.advice import SECTIONS, Section
from manual.steps import Do, Shot, Until

MANUAL = ROOT / "docs" / "manual"
LANGUAGES = "en", "ja"
PAGES = {language: sorted((MANUAL / language).glob("*.md")) for language in LANGUAGES}
BOTH = [path for language in LANGUAGES for path in PAGES[language]]
LINK = re.compile(r"\]\(([^)#]+)(?:#[^)]*)?\)")
MOST_BYTES = 3_000_000  # of all pictures: each checkout has them


def test_pages_are_there_in_both_languages() -> None:
    """Each page in English has one in Japanese, and no other is there."""
    names = [{path.name for path in PAGES[language]} for language in LANGUAGES]
    assert names[0] | {"glossary.md"} == names[1]  # the English one is docs/glossary.md


@pytest.mark.parametrize("path", BOTH, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_links_and_pictures_are_there(path: Path) -> None:
    """What a page links to is a page, or a picture that some play takes."""
    taken = {step.name for play in plays.MANUAL.values() for step in play if isinstance(step, Shot)}
    for target in LINK.findall(path.read_text(encoding="utf-8")):
        if target.startswith("pictures/"):
            assert (MANUAL / "en" / target).exists()
            assert Path(target).stem in taken
        elif not target.startswith("http"):
            names = {"glossary.md", *(page.name for page in PAGES[path.parent.name])}
            assert target in names


def test_every_picture_is_shown_in_both_languages() -> None:
    """A picture that a play takes is on a page, and a file among the pictures is taken."""
    taken = {step.name for play in plays.MANUAL.values() for step in play if isinstance(step, Shot)}
    files = {path.stem for path in (MANUAL / "en" / "pictures").glob("*.png")}
    assert files == taken
    for language in LANGUAGES:
        text = "".join(path.read_text(encoding="utf-8") for path in PAGES[language])
        assert taken == set(re.findall(r"\(pictures/(\w+)\.png\)", text))


def test_pictures_are_small() -> None:
    """All pictures of the manual together stay below three megabytes."""
    assert sum(path.stat().st_size for path in MANUAL.rglob("*.png")) < MOST_BYTES


def test_each_sentence_of_troubleshooting_is_one_of_the_program() -> None:
    """No sentence of the page has been written anew, or left, in the code."""
    told = troubleshooting.all_told()
    page = {advice.template for section in SECTIONS for advice in section.advice}
    assert page - told == set()


@pytest.mark.parametrize("section", SECTIONS, ids=lambda section: section.en)
def test_troubleshooting_has_each_error_that_matters(section: Section) -> None:
    """The errors and remarks of a section's files are all on the page."""
    page = {advice.template for one in SECTIONS for advice in one.advice}
    told = {text for name in section.files for text in troubleshooting.told_in(ROOT / name)}
    assert told - page == set()


def test_values_stand_as_dots() -> None:
    """A sentence on the page has no name of a value in it."""
    shown = troubleshooting.readable("The glass '{glass}' has {n}{s} of {width:.0f} mm.")
    assert shown == "The glass '…' has … of … mm."
    for language in LANGUAGES:
        assert "{" not in troubleshooting.sections(language)


def test_plays_name_functions_that_are_there() -> None:
    """What a play does or asks beside mouse and keys is a function of scenes.py."""
    tree = ast.parse((ROOT / "scripts" / "manual" / "scenes.py").read_text(encoding="utf-8"))
    functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    for play in plays.PLAYS.values():
        for step in play:
            if isinstance(step, Do):
                assert step.function in functions
            elif isinstance(step, Until):
                assert step.question in functions


def test_the_japanese_glossary_has_the_words() -> None:
    """Each word of the bench, of images and of settings has its Japanese line."""
    english = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    japanese = (MANUAL / "ja" / "glossary.md").read_text(encoding="utf-8")
    for title in ("The bench", "Images", "Settings"):
        part = english.split(f"## {title}\n")[1].split("\n## ")[0]
        for row in re.findall(r"^\| ([^|]+?) \|", part, re.MULTILINE)[1:]:
            if not row.startswith("-"):
                assert f"| {row} |" in japanese
