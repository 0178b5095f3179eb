"""Links among the documents of the repository, without the manual's site."""

import re
from collections import Counter
from pathlib import Path

import pytest

from environments import ROOT

DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
GLOSSARY = ROOT / "docs" / "glossary.md"  # also the manual's English page
LINK = re.compile(r"\]\(([^)\s]+)\)")
FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
HEADING = re.compile(r"^#+ (.+?)(?: *\{ *#([\w.-]+) *\})?$", re.MULTILINE)


def text_of(path: Path) -> str:
    return FENCE.sub("", path.read_text(encoding="utf-8"))


def anchors(path: Path) -> set[str]:
    """Anchors of a page's headings: their own, or as GitHub makes them."""
    found = set()
    counted = Counter()
    for title, own in HEADING.findall(text_of(path)):
        slug = own or re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")
        found.add(f"{slug}-{counted[slug]}" if counted[slug] else slug)
        counted[slug] += 1
    return found


def is_dead(page: Path, link: str) -> bool:
    target, _, anchor = link.partition("#")
    path = (page.parent / target).resolve() if target else page
    if path.name == GLOSSARY.name and not path.exists():
        path = GLOSSARY
    return not path.exists() or (bool(anchor) and anchor not in anchors(path))


def test_anchors_are_made_as_github_makes_them(tmp_path):
    """Punctuation goes, spaces become hyphens, a second heading gets a number."""
    page = tmp_path / "page.md"
    page.write_text("# A `b_c`, d!\n## Same\n```\n# code\n```\n## Same\n## Own { #it }\n", "utf-8")
    assert anchors(page) == {"a-b_c-d", "same", "same-1", "it"}
    assert not is_dead(page, "#same-1")
    assert is_dead(page, "#code")
    assert is_dead(page, "other.md")


@pytest.mark.parametrize("page", DOCUMENTS, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_link_leads_somewhere(page):
    """Each relative link of a document names a file that exists, and a heading in it."""
    links = [link for link in LINK.findall(text_of(page)) if "://" not in link]
    assert [link for link in links if is_dead(page, link)] == []
