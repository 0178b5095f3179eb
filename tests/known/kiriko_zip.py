"""Zips that have no more of Kiriko than its manifest, which a job copies as they are."""

from pathlib import Path
from zipfile import ZipFile

ROOT = Path(__file__).parents[2]
MANIFEST = "blender_manifest.toml"


def kiriko_zip(path: Path, *change: str) -> Path:
    """Write one to a path.

    change : a text in the manifest, and another in its place
    """
    about = (ROOT / MANIFEST).read_text(encoding="utf-8")
    assert not change or change[0] in about
    with ZipFile(path, "w") as archive:
        archive.writestr(MANIFEST, about.replace(*change) if change else about)
    return path
