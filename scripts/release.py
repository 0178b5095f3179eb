"""Makes everything of a release: `dev.py release`, into out/release/.

`NOTES.md` is the version's part of the changelog. `assets/` has the files for a release page: zips,
wheels and source distributions of both packages, and `SHA256SUMS`. `site/` is a static web site:
the manual, the Python interface, and an extension repository, whose page has links to drag into
Blender. `--zips` uses those in dist/ as they are.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import shutil
import sys
import tomllib
from pathlib import Path

import package
import wheels
from environments import ROOT, ToolError

OUT = ROOT / "out" / "release"
ASSETS, SITE = OUT / "assets", OUT / "site"
REPOSITORY = SITE / "extensions"
TEMPLATE = Path(__file__).with_name("repository.html")


def notes(version: str) -> str:
    """The version's part of the changelog."""
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    found = re.search(rf"^## {re.escape(version)}\b[^\n]*\n(.*?)(?=^## |\Z)", text, re.M | re.S)
    if found is None:
        raise ToolError(f"CHANGELOG.md has no part for {version}: write one.")
    return found[1].strip() + "\n"


def make_repository() -> None:
    """Make the extension repository from the zips of the assets."""
    REPOSITORY.mkdir(parents=True)
    for path in sorted(ASSETS.glob("*.zip")):
        shutil.copy(path, REPOSITORY)
    package.extension_tool(
        "server-generate", "--repo-dir", REPOSITORY, "--html", "--html-template", TEMPLATE
    )


def make_sums() -> None:
    """Write the checksums of all assets, as `sha256sum --check` reads them."""
    sums = [
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n"
        for path in sorted(ASSETS.iterdir())
    ]
    (ASSETS / "SHA256SUMS").write_text("".join(sums), encoding="utf-8")


def make(is_zip_kept: bool) -> None:
    """Make the release."""
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    text = notes(manifest["version"])
    shutil.rmtree(OUT, ignore_errors=True)
    ASSETS.mkdir(parents=True)
    if not is_zip_kept:
        package.build(is_manual_kept=False, is_for_here=False)
    for path in (*package.DIST.glob("kiriko-*.zip"), *wheels.WHEELS.glob("kiriko_kernel-*.whl")):
        shutil.copy(path, ASSETS)
    wheels.make("kernel", "--sdist", into=ASSETS)
    wheels.make("optics", "--wheel", "--sdist", into=ASSETS)
    make_sums()
    (OUT / "NOTES.md").write_text(text, encoding="utf-8")
    make_repository()
    package.make_interface(SITE / "python")
    shutil.copytree(ROOT / "manual", SITE / "manual")
    first = '<!DOCTYPE html><meta http-equiv="refresh" content="0; url=extensions/index.html">\n'
    (SITE / "index.html").write_text(first, encoding="utf-8")
    for path in sorted(ASSETS.iterdir()):
        print(f"{path.stat().st_size / 1e6:8.2f} MB  {path.name}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--zips", action="store_true", help="use the zips in dist/ as they are")
    try:
        make(parser.parse_args().zips)
    except ToolError as error:
        sys.exit(str(error))
