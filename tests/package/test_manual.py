"""The manual that comes with the installed extension, and the ways to it from Blender."""

import re
import sys
import webbrowser
from pathlib import Path
from urllib.request import url2pathname

import bpy
import pytest

LANGUAGES = {"en": "", "ja": "ja"}  # with their folders
# what a browser loads by itself from another place
FROM_NETWORK = re.compile(r"<(?:script|img|link)\b[^>]*(?:src|href)=[\"']?(?:https?:)?//")


@pytest.fixture
def opened(installed, monkeypatch) -> list[str]:
    """URLs that a browser was asked to open."""
    urls: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda url, *_: urls.append(url) or True)
    return urls


@pytest.fixture(params=LANGUAGES)
def pages(request, installed, monkeypatch) -> Path:
    """The folder of the pages in the language that the interface is said to have."""
    opening = sys.modules[f"{installed}.operators.open_manual"]
    monkeypatch.setattr(opening, "language", lambda: request.param)
    return opening.FOLDER / LANGUAGES[request.param]


def file_of(url: str) -> Path:
    """The file that a URL names."""
    assert url.startswith("file://")
    return Path(url2pathname(url.removeprefix("file://")))


def names(installed: str) -> list[str]:
    """What Blender calls each operator and each setting of Kiriko's: `kiriko.solve` and
    `KirikoRig.tolerance`.
    """
    found = [cls.bl_idname for cls in sys.modules[f"{installed}.operators"].CLASSES]
    groups = sys.modules[f"{installed}.core.blender.properties"].classes
    own = {cls.__name__ for cls in groups}
    for cls in groups:
        for prop in cls.bl_rna.properties:
            is_kept = prop.is_hidden or (prop.type == "STRING" and prop.subtype == "NONE")
            is_group = prop.type == "COLLECTION" or (
                prop.type == "POINTER" and prop.fixed_type.identifier in own | {"Struct"}
            )
            if prop.identifier != "rna_type" and not is_kept and not is_group:
                found.append(f"{cls.__name__}.{prop.identifier}")
    return found


def test_f1_leads_to_the_place_of_each_button_and_setting(installed, pages, opened):
    """Blender's own lookup opens a page that is there, which leads to a place that is there."""
    every = names(installed)
    assert {"kiriko.solve", "KirikoRig.tolerance", "KirikoObject.image"} <= set(every)
    texts: dict[Path, str] = {}
    for name in every:
        assert bpy.ops.wm.doc_view_manual(doc_id=name) == {"FINISHED"}, name
        first = file_of(opened[-1])
        assert first.is_relative_to(pages)
        (url,) = re.findall(r'content="0; url=([^"]+)"', first.read_text(encoding="utf-8"))
        page, _, anchor = url.partition("#")
        path = (first.parent / page).resolve()
        text = texts.setdefault(path, path.read_text(encoding="utf-8"))
        found = re.findall(rf'id="?{re.escape(anchor)}"?[ >]', text)
        assert not anchor or len(found) == 1, name
    assert len(opened) == len(every)


def test_the_button_opens_the_first_page(pages, opened):
    """In the language of the interface."""
    assert bpy.ops.kiriko.open_manual() == {"FINISHED"}
    assert file_of(opened[-1]) == pages / "index.html"


def test_without_a_browser_the_file_is_named(installed, monkeypatch):
    """An artist without a browser reads where the manual is."""
    monkeypatch.setattr(webbrowser, "open", lambda url: False)
    with pytest.raises(RuntimeError, match=r"No browser was found: open the file '.*index\.html'"):
        bpy.ops.kiriko.open_manual()


def test_a_language_without_pages_reads_english(installed, opened, monkeypatch):
    """Also one whose name is that of another folder of the site."""
    opening = sys.modules[f"{installed}.operators.open_manual"]
    for name in ("fr", "at", ""):
        monkeypatch.setattr(opening, "language", lambda name=name: name)
        bpy.ops.kiriko.open_manual()
        assert file_of(opened[-1]) == opening.FOLDER / "index.html"


def test_links_of_the_site_are_files(installed):
    """No page loads anything from a network, and each link within the site is one to a file."""
    site = sys.modules[f"{installed}.operators.open_manual"].FOLDER
    for path in site.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        assert not FROM_NETWORK.search(text), path
        for target in re.findall(r"\b(?:href|src)=[\"']?([^\"' >]+)", text):
            if not target.startswith(("http", "#", "data:", "mailto:", "${")):
                name = target.partition("#")[0]
                assert (path.parent / name).resolve().is_file(), f"{path}: {target}"
