"""Builds the manual's site, strict, into manual/, from where it goes into the extension's zips.

A link to nothing, a picture that is missing, a page that is left out of the navigation: each ends
the build. The site needs no network and no server: it is opened as files. With `--screenshots` the
pictures of all steps are taken anew first, in the real Blender, once in each language. With
`--listing`, whole windows for the extension site's page are taken instead.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from environments import ROOT, ToolError, clean_environment, run_in_newest_blender
from manual.places import lead
from manual.plays import LISTING, MANUAL
from manual.program import add_options, play

if TYPE_CHECKING:
    from PIL import Image

LANGUAGES = {"en": "en_US", "ja": "ja_JP"}  # Blender's names of them
PAGES = ROOT / "docs" / "manual"
OUT = ROOT / "out"
GENERATED = OUT / "manual-reference"  # from the code
GATHERED = OUT / "manual-pages"
SITE = ROOT / "manual"
CONFIG = Path(__file__).with_name("mkdocs.yml")
WORKER = Path(__file__).with_name("iframe-worker.js")
SHARED = "../../pictures/"  # of README and docs, seen from a page
STEMMERS = "lunr.ja.min.js", "lunr.multi.min.js", "lunr.stemmer.support.min.js"
WIDEST = 1000  # px
LISTING_SIZE = 1920, 1080  # px of a window, as the extension site wants it
QUALITY = 70  # labels stay sharp, and the pictures of all languages fit into a megabyte
MARK = (255, 122, 0)  # around the row of a button
MARGIN = 10, 36  # px left and right of the row; the tabs stand at the right
HALF = 14.0  # px, half of the mark's height
WIDTH = 2
EDGE = 4  # px, the line around a region
NOISE = 12  # of 255, between equal pixels
TABS = 30  # px, at the right of the sidebar
# for servers, or with the day of the build in it
NOT_NEEDED = (
    "404.html", "sitemap.xml", "sitemap.xml.gz", "search/search_index.json",
    "assets/**/*.map", "assets/javascripts/lunr/wordcut.js",
)  # fmt: skip


def pack(raw: Path, folder: Path, widest: int = WIDEST) -> None:
    """Write the wanted part of a grabbed window as a WebP, with the row of a button marked."""
    # not above, for dev.py shows the options in a Python that has no Pillow
    from PIL import Image, ImageDraw

    told = json.loads(raw.with_suffix(".json").read_text(encoding="utf-8"))
    width, height = told["size"]
    image = Image.frombytes("RGB", (width, height), raw.read_bytes())
    left, bottom, across, up = told["box"]
    top = height - bottom - up
    image = image.crop((int(left), int(top), int(left + across), int(top + up)))
    if told["sidebar"]:
        image, cut = without_rest(image, told.get("closed"))
        top += cut
    scale = min(1.0, widest / image.width)
    if scale < 1:
        size = round(image.width * scale), round(image.height * scale)
        image = image.resize(size, Image.Resampling.LANCZOS)

    if told["ring"]:
        middle = (height - told["ring"][1] - top) * scale
        right = image.width - MARGIN[1] + (TABS if "closed" in told else 0)
        box = [MARGIN[0], middle - HALF, min(right, image.width - WIDTH), middle + HALF]
        ImageDraw.Draw(image).rounded_rectangle(box, 5, outline=MARK, width=WIDTH)
    image.save(folder / f"{raw.stem}.webp", quality=QUALITY, method=6)


def without_rest(image: Image.Image, closed: list[int] | None) -> tuple[Image.Image, int]:
    """A sidebar without the empty rest below its panels, and the number of rows cut at its top.

    closed : heights of the closed panels above and below the wanted one, px, to be cut with the
        tabs; None to keep them
    """
    from PIL import ImageChops

    left = image.crop((EDGE, 0, image.width // 2, image.height - EDGE))
    last = left.crop((0, left.height - 1, left.width, left.height)).resize(left.size)
    change = ImageChops.difference(left, last).convert("L").point(lambda value: value > NOISE)
    box = change.getbbox()
    end = box[3] if box else left.height
    if closed is None:
        return image.crop((0, 0, image.width, min(end + EDGE, image.height))), 0
    bottom = end - closed[1] + 2 * EDGE if end < left.height else image.height
    return image.crop((0, closed[0], image.width - TABS, bottom)), closed[0]


def take_pictures(
    languages: Sequence[str], names: Sequence[str], blender: str | None, extension: Path | None
) -> None:
    """Play the manual's steps, and put the pictures of all that came of it among its pages."""
    for language in languages:
        folder = play(names, blender, extension, LANGUAGES[language])
        pictures = PAGES / language / "pictures"
        pictures.mkdir(parents=True, exist_ok=True)
        for raw in sorted(folder.glob("*.rgb")):
            pack(raw, pictures)


def take_listing(names: Sequence[str], blender: str | None, extension: Path | None) -> None:
    """Play the steps of the extension site's page, and put their pictures next to its text."""
    folder = play(names, blender, extension, size=LISTING_SIZE)
    for raw in sorted(folder.glob("*.rgb")):
        pack(raw, ROOT / "docs" / "listing", LISTING_SIZE[0])


def gather() -> None:
    """Gather the pages of docs/, the glossary, and the buttons and settings from the code."""
    if run_in_newest_blender("manual.reference", GENERATED):
        raise ToolError("The manual's page of buttons and settings failed, for the reason above.")

    shutil.rmtree(GATHERED, ignore_errors=True)
    shutil.copytree(PAGES, GATHERED)
    shutil.copy(ROOT / "docs" / "glossary.md", GATHERED / "en" / "glossary.md")
    worker = GATHERED / "en" / "assets" / WORKER.name
    worker.parent.mkdir()
    shutil.copy(WORKER, worker)
    for language in LANGUAGES:
        page = GATHERED / language / "reference.md"
        made = (GENERATED / f"{language}.md").read_text(encoding="utf-8")
        page.write_text(f"{page.read_text(encoding='utf-8')}\n{made}", encoding="utf-8")
        for path in (GATHERED / language).glob("*.md"):
            path.write_text(with_own_pictures(path), encoding="utf-8")


def with_own_pictures(path: Path) -> str:
    """A page whose pictures of other folders are among those of the English pages, which serve
    other languages, too.
    """
    text = path.read_text(encoding="utf-8")
    for name in re.findall(rf"\({re.escape(SHARED)}([\w/.]+)\)", text):
        shutil.copy(ROOT / "docs" / "pictures" / name, GATHERED / "en" / "pictures")
        text = text.replace(f"({SHARED}{name})", f"(pictures/{Path(name).name})")
    return text.replace("(../en/pictures/", "(pictures/")


def split_search() -> None:
    """Give each language a search of its own; the site is built with one for all."""
    whole = json.loads((SITE / "search" / "search_index.json").read_text(encoding="utf-8"))
    others = tuple(f"{language}/" for language in LANGUAGES if language != "en")
    for language in LANGUAGES:
        folder = SITE if language == "en" else SITE / language
        if language == "en":
            docs = [doc for doc in whole["docs"] if not doc["location"].startswith(others)]
        else:
            first = f"{language}/"
            docs = [
                doc | {"location": doc["location"].removeprefix(first)}
                for doc in whole["docs"]
                if doc["location"].startswith(first)
            ]
            for path in folder.glob("*.html"):  # the base of their search results
                text = path.read_text(encoding="utf-8")
                path.write_text(text.replace('"base": ".."', '"base": "."'), encoding="utf-8")
        own = whole | {"config": whole["config"] | {"lang": [language]}, "docs": docs}
        (folder / "search").mkdir(exist_ok=True)
        index = json.dumps(own, ensure_ascii=False, separators=(",", ":"))
        (folder / "search" / "search_index.js").write_text(
            f"var __index = {index}", encoding="utf-8"
        )


def build() -> None:
    """Build the site."""
    gather()
    # not --quiet, which lets warnings pass that --strict would count
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-f", CONFIG]
    # the theme's notice of its successor is no warning about these pages
    variables = clean_environment(NO_MKDOCS_2_WARNING="1")
    done = subprocess.run(command, env=variables, capture_output=True, text=True)
    if done.returncode:
        lines = done.stderr.splitlines()
        print(*(line for line in lines if not line.startswith("INFO")), sep="\n", file=sys.stderr)
        raise ToolError("The manual was not built, for the reason above.")

    split_search()
    for pattern in NOT_NEEDED:
        for path in SITE.glob(pattern):
            path.unlink()
    for path in (SITE / "assets" / "javascripts" / "lunr" / "min").iterdir():
        if path.name not in STEMMERS:
            path.unlink()
    names = json.loads((GENERATED / "names.json").read_text(encoding="utf-8"))
    for language in LANGUAGES:
        lead(SITE if language == "en" else SITE / language, names)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--screenshots", action="store_true", help="take all pictures anew in the real Blender"
    )
    parser.add_argument(
        "--listing", action="store_true", help="take the screenshots of docs/listing/ instead"
    )
    plays = [*MANUAL, *LISTING]
    parser.add_argument(
        "--only", nargs="+", choices=plays, metavar="PLAY", help=f"of {', '.join(plays)}"
    )
    parser.add_argument(
        "--languages", nargs="+", choices=LANGUAGES, default=list(LANGUAGES), metavar="LANGUAGE",
        help=f"of {', '.join(LANGUAGES)}",
    )  # fmt: skip
    add_options(parser)
    told = parser.parse_args()
    try:
        if told.listing:
            take_listing(told.only or list(LISTING), told.blender, told.extension)
            return
        if told.screenshots:
            names = told.only or list(MANUAL)
            take_pictures(told.languages, names, told.blender, told.extension)
        build()
    except ToolError as error:
        sys.exit(str(error))
    print(f"The manual is in {SITE.relative_to(ROOT)}/: open index.html.")


if __name__ == "__main__":
    main()
