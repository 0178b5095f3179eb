"""Pictures of README and docs."""

import re

import pytest
from PIL import Image

from environments import ROOT
from manual.plays import LISTING

FOLDER = ROOT / "docs" / "pictures"
MOST_BYTES = {
    "gallery/*.webp": 60_000, "systems/*.webp": 30_000, "hero.webp": 120_000,
    "kiriko.webp": 2_000_000,
}  # fmt: skip
PAGES = "*.md", "docs/**/*.md"


@pytest.mark.parametrize("pattern", MOST_BYTES)
def test_pictures_are_small(pattern):
    """Every checkout downloads them."""
    paths = list(FOLDER.glob(pattern))
    assert paths
    assert all(path.stat().st_size < MOST_BYTES[pattern] for path in paths)


def test_the_listing_has_its_pictures():
    """The extension site wants a featured image and screenshots of one size."""
    folder = ROOT / "docs" / "listing"
    text = (folder / "listing.md").read_text(encoding="utf-8")
    named = re.findall(r"^\| `([\w.]+)`", text, re.MULTILINE)
    assert named == ["featured.webp", *(f"{name}.webp" for name in LISTING)]
    assert {path.name for path in folder.glob("*.webp")} == set(named)
    for name in named:
        assert Image.open(folder / name).size == (1920, 1080)
        assert (folder / name).stat().st_size < 200_000


def test_every_picture_is_on_a_page():
    """Files without a page are deleted; those of the panel are a record."""
    text = "".join(
        path.read_text(encoding="utf-8") for pattern in PAGES for path in ROOT.glob(pattern)
    )
    names = {path.relative_to(FOLDER).as_posix() for path in FOLDER.glob("*.*")}
    for folder in ("gallery", "systems"):
        names |= {f"{folder}/{path.name}" for path in FOLDER.glob(f"{folder}/*")}
    assert {name for name in names if f"pictures/{name}" not in text} == set()
