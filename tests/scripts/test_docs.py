"""Links, file names and names of code in the docs exist."""

import re
from functools import cache
from pathlib import Path

import pytest

from environments import ROOT

PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for pattern in ("*.md", "docs/*.md", "docs/decisions/*.md")
    for path in ROOT.glob(pattern)
    if path.name != "CHANGELOG.md"  # names of its time
)
FOLDERS = "core", "operators", "panels", "languages", "scripts", "tests", "farm", "docs", "assets"
CODE = {".py", ".c", ".h", ".js"}
MADE = re.compile(r"out/|dist/|manual/|\.dev/|.*[<*{ ]")  # by commands, or with a placeholder
FILE = re.compile(r"[\w./-]+\.(py|c|h|js|po)")
NAME = re.compile(r"[a-zA-Z]\w*(\.\w+)*")
ABROAD = re.compile(
    r"bpy\b|[A-Z]+$|a_from_b|[\w.]*(_|\.(json|svg|npz|exr|png|blend|csv|html|webp))$"
)  # Blender's, patterns, results


def anchor(heading: str) -> str:
    """The anchor of a heading, as GitHub makes it."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@cache
def files() -> set[str]:
    """Names of all files, by each ending of their paths."""
    found = set()
    for folder in (*FOLDERS, ""):
        for path in (ROOT / folder).rglob("*") if folder else ROOT.glob("*"):
            parts = path.relative_to(ROOT).parts
            found |= {"/".join(parts[k:]) for k in range(len(parts))}
    return found


@cache
def words() -> set[str]:
    """Identifiers in the code."""
    texts = [
        path.read_text(encoding="utf-8", errors="ignore")
        for folder in FOLDERS[:-2]
        for path in (ROOT / folder).rglob("*")
        if path.suffix in CODE and path.name != "test_docs.py"
    ]
    return {word for text in texts for word in re.findall(r"\w+", text)}


def missing_names(text: str) -> list[str]:
    """Files and names in backticks that do not exist."""
    return [name for name in re.findall(r"(?<!`)`([^`\n]+)`(?!`)", text) if is_missing(name)]


def is_missing(name: str) -> bool:
    """Is this the name of a file or of code, and not there?"""
    if MADE.match(name) or ABROAD.match(name):
        return False
    if FILE.fullmatch(name):
        return name not in files()
    if name.rstrip("/").partition("/")[0] in FOLDERS:
        return name.rstrip("/") not in files()
    is_code = NAME.fullmatch(name) and re.search(r"[._A-Z]", name[1:])
    return bool(is_code) and not set(name.split(".")) <= words()


@pytest.mark.parametrize("page", PAGES)
def test_names_in_backticks_exist(page):
    """A name that is changed in the code is changed in the docs."""
    assert missing_names((ROOT / page).read_text(encoding="utf-8")) == []


def test_a_name_that_is_gone_is_found():
    """Files, folders, dotted names and constants count; words, options and products do not."""
    gone = ["core/light/gone.py", "Plan.no_such_member", "NO_SUCH_NUMBER", "core/gone/"]
    there = ["core/light/plan.py", "plan.py", "Plan.needs_plate", "--only", "ball", "out/paper/"]
    text = " ".join(f"`{name}`" for name in gone + there)
    assert missing_names(text) == gone


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_to_files_and_headings(page):
    """Links to pages of the repository, and to headings in them."""
    path = ROOT / page
    for target in re.findall(r"\]\(([^)\s]+)\)", path.read_text(encoding="utf-8")):
        if re.match(r"https?:|mailto:", target):
            continue
        file, _, heading = target.partition("#")
        other = (path.parent / file).resolve() if file else path
        assert other.exists(), target
        if heading and other.suffix == ".md":
            titles = re.findall(r"^#+ (.*)$", other.read_text(encoding="utf-8"), re.MULTILINE)
            assert heading in map(anchor, titles), target


def test_documents_named_in_the_code_exist():
    """A comment names a page that is there."""
    gone = [
        f"{path.relative_to(ROOT)}: {name}"
        for folder in ("core", "operators", "panels", "scripts", "tests")
        for path in sorted((ROOT / folder).rglob("*"))
        if path.suffix in (".py", ".c", ".h")
        for name in re.findall(r"docs/[\w/-]+\.(?:md|json|svg)", path.read_text(encoding="utf-8"))
        if not Path(ROOT, name).exists()
    ]
    assert gone == []
