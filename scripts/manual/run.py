"""Builds the manual's site, strict, into out/manual/. Started by `dev.py manual`.

A link to nothing, a picture that is missing, a page that is left out of the navigation: each ends
the build. With `--screenshots` the pictures of all steps are taken anew first, in the real Blender.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

from environments import ROOT, ToolError, clean_environment
from manual import troubleshooting
from manual.pictures import pack
from manual.plays import MANUAL
from manual.program import HELP_BLENDER, HELP_EXTENSION, play

PAGES = ROOT / "docs" / "manual"
PICTURES = PAGES / "en" / "pictures"
GATHERED = ROOT / "out" / "manual-pages"
CONFIG = Path(__file__).with_name("mkdocs.yml")


def take_pictures(names: list[str], blender: str | None, extension: Path | None) -> None:
    """Play the manual's steps, and put the pictures of all that came of it among its pages."""
    folder = play(names, blender, extension)
    PICTURES.mkdir(parents=True, exist_ok=True)
    for raw in sorted(folder.glob("*.rgb")):
        pack(raw, PICTURES / f"{raw.stem}.png")


def gather() -> None:
    """Put all pages into one folder: those of docs/, the glossary, and the made sections."""
    shutil.rmtree(GATHERED, ignore_errors=True)
    shutil.copytree(PAGES, GATHERED)
    shutil.copy(ROOT / "docs" / "glossary.md", GATHERED / "en" / "glossary.md")
    for language in ("en", "ja"):
        page = GATHERED / language / "troubleshooting.md"
        text = page.read_text(encoding="utf-8")
        page.write_text(f"{text}\n{troubleshooting.sections(language)}", encoding="utf-8")


def build() -> int:
    """Build the site; the exit code of mkdocs."""
    gather()
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-f", CONFIG]
    # the theme's notice of its successor is no warning about these pages
    variables = clean_environment(NO_MKDOCS_2_WARNING="1")
    return subprocess.run(command, env=variables).returncode


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--screenshots", action="store_true", help="take all pictures anew in the real Blender"
    )
    parser.add_argument(
        "--only", nargs="+", choices=MANUAL, metavar="PLAY", help=f"of {', '.join(MANUAL)}"
    )
    parser.add_argument("--blender", metavar="PROGRAM", help=HELP_BLENDER)
    parser.add_argument("--extension", type=Path, metavar="ZIP", help=HELP_EXTENSION)
    arguments = parser.parse_args()
    try:
        if arguments.screenshots:
            take_pictures(arguments.only or list(MANUAL), arguments.blender, arguments.extension)
    except ToolError as error:
        sys.exit(str(error))
    code = build()
    if code == 0:
        print(f"The site is in {(ROOT / 'out' / 'manual').relative_to(ROOT)}: open index.html.")
    sys.exit(code)


if __name__ == "__main__":
    main()
