"""Builds the manual's site, strict, into manual/, from where it goes into the extension's zips.

A link to nothing, a picture that is missing, a page that is left out of the navigation: each ends
the build. The site needs no network and no server: it is opened as files. With `--screenshots` the
pictures of all steps are taken anew first, in the real Blender, once in each language.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from environments import ROOT, ToolError, clean_environment, run_in_newest_blender
from manual.places import lead
from manual.plays import MANUAL
from manual.program import add_options, play

LANGUAGES = {"en": "en_US", "ja": "ja_JP"}  # Blender's names of them
PAGES = ROOT / "docs" / "manual"
OUT = ROOT / "out"
TOLD = OUT / "manual-reference"  # by the code
GATHERED = OUT / "manual-pages"
SITE = ROOT / "manual"
CONFIG = Path(__file__).with_name("mkdocs.yml")
WIDEST = 1000  # px
QUALITY = 70  # labels stay sharp, and the pictures of all languages fit into a megabyte
RING = (255, 122, 0)
RADIUS = 15.0  # px
WIDTH = 3
# for search and servers, or with the day of the build in it
NOT_NEEDED = (
    "404.html", "sitemap.xml", "sitemap.xml.gz", "assets/javascripts/lunr",
    "assets/javascripts/workers", "assets/**/*.map",
)  # fmt: skip


def pack(raw: Path, folder: Path) -> None:
    """Write the wanted part of a grabbed window as a WebP, with a ring where one is wanted."""
    # not above, for dev.py shows the options in a Python that has no Pillow
    from PIL import Image, ImageDraw

    told = json.loads(raw.with_suffix(".json").read_text(encoding="utf-8"))
    width, height = told["size"]
    image = Image.frombytes("RGB", (width, height), raw.read_bytes())
    left, bottom, across, up = told["box"]
    top = height - bottom - up
    image = image.crop((int(left), int(top), int(left + across), int(top + up)))
    scale = min(1.0, WIDEST / image.width)
    if scale < 1:
        size = round(image.width * scale), round(image.height * scale)
        image = image.resize(size, Image.Resampling.LANCZOS)

    if told["ring"]:
        x = (told["ring"][0] - left) * scale
        y = (height - told["ring"][1] - top) * scale
        corners = [x - RADIUS, y - RADIUS, x + RADIUS, y + RADIUS]
        ImageDraw.Draw(image).ellipse(corners, outline=RING, width=WIDTH)
    image.save(folder / f"{raw.stem}.webp", quality=QUALITY, method=6)


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


def gather() -> None:
    """Gather the pages of docs/, the glossary, and the buttons and settings from the code."""
    if run_in_newest_blender("manual.reference", TOLD):
        raise ToolError("The manual's page of buttons and settings failed, for the reason above.")

    shutil.rmtree(GATHERED, ignore_errors=True)
    shutil.copytree(PAGES, GATHERED)
    shutil.copy(ROOT / "docs" / "glossary.md", GATHERED / "en" / "glossary.md")
    for language in LANGUAGES:
        page = GATHERED / language / "reference.md"
        made = (TOLD / f"{language}.md").read_text(encoding="utf-8")
        page.write_text(f"{page.read_text(encoding='utf-8')}\n{made}", encoding="utf-8")


def build() -> None:
    """Build the site."""
    gather()
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "-f", CONFIG]
    # the theme's notice of its successor is no warning about these pages
    variables = clean_environment(NO_MKDOCS_2_WARNING="1")
    if subprocess.run(command, env=variables).returncode:
        raise ToolError("The manual was not built, for the reason above.")

    for pattern in NOT_NEEDED:
        for path in sorted(SITE.glob(pattern)):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    names = json.loads((TOLD / "names.json").read_text(encoding="utf-8"))
    for language in LANGUAGES:
        lead(SITE if language == "en" else SITE / language, names)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--screenshots", action="store_true", help="take all pictures anew in the real Blender"
    )
    parser.add_argument(
        "--only", nargs="+", choices=MANUAL, metavar="PLAY", help=f"of {', '.join(MANUAL)}"
    )
    parser.add_argument(
        "--languages", nargs="+", choices=LANGUAGES, default=list(LANGUAGES), metavar="LANGUAGE",
        help=f"of {', '.join(LANGUAGES)}",
    )  # fmt: skip
    add_options(parser)
    told = parser.parse_args()
    try:
        if told.screenshots:
            names = told.only or list(MANUAL)
            take_pictures(told.languages, names, told.blender, told.extension)
        build()
    except ToolError as error:
        sys.exit(str(error))
    print(f"The manual is in {SITE.relative_to(ROOT)}/: open index.html.")


if __name__ == "__main__":
    main()
