"""The extension's zip, packed from its installed folder, for the workers of a farm."""

import os
import tomllib
import zlib
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, BadZipFile, ZipFile, ZipInfo

from ...base.errors import ImageError

ROOT = Path(__file__).parents[3]
MANIFEST = "blender_manifest.toml"
DATE = (1980, 1, 1, 0, 0, 0)  # the earliest date in a zip, so the same files give the same zip
MODE = 0o644
# RuntimeError: encrypted; NotImplementedError (a RuntimeError): unsupported compression
UNREADABLE = (BadZipFile, OSError, KeyError, ValueError, EOFError, RuntimeError, zlib.error)


def manifest(root: Path = ROOT) -> dict[str, Any]:
    """The extension's manifest."""
    return tomllib.loads((root / MANIFEST).read_text(encoding="utf-8"))


def files_of(root: Path = ROOT) -> list[str]:
    """Relative paths of the extension's files: all of an installed folder, only the packed ones of
    a checkout.

    Raises
    ------
    ImageError : a wheel of the manifest is missing
    """
    about = manifest(root)
    build = about.get("build", {})
    wheels = build.get("generated", {}).get("wheels", about.get("wheels", []))
    wheels = [name.removeprefix("./") for name in wheels]
    missing = next((name for name in wheels if not (root / name).exists()), None)
    if missing is not None:
        raise ImageError(
            "The file '{name}' is missing, so Kiriko cannot be packed for the farm. Name its zip.",
            name=missing,
        )

    patterns = build.get("paths_exclude_pattern", [])
    left_out = {pattern.strip("/") for pattern in patterns if pattern.startswith("/")} | {"wheels"}
    found = []
    for folder, folders, names in os.walk(root):
        is_top = Path(folder) == root
        folders[:] = sorted(n for n in folders if _is_packed(n) and not (is_top and n in left_out))
        found += [
            (Path(folder) / name).relative_to(root).as_posix()
            for name in sorted(names)
            if _is_packed(name) and not (is_top and (name in left_out or name.endswith(".zip")))
        ]
    return [*found, *wheels]


def check_zip(path: Path) -> None:
    """Raise ImageError unless a file is a zip of this version; otherwise every task would fail."""
    if not path.is_file():
        raise ImageError("There is no zip '{path}'. Name an existing one.", path=path)
    about = _about(path)
    if about.get("id") != "kiriko":
        raise ImageError(
            "'{path}' is not a zip of Kiriko, or it is broken. Name another.", path=path
        )

    own = manifest()["version"]
    if about.get("version") != own:
        raise ImageError(
            "The zip '{path}' has Kiriko {version}, but this is {own}. Name the zip of {own}.",
            path=path,
            version=about.get("version"),
            own=own,
        )


def is_of_another_version(path: Path) -> bool:
    """Whether a file is a zip of another version of Kiriko."""
    about = _about(path)
    return about.get("id") == "kiriko" and about.get("version") != manifest()["version"]


def _about(path: Path) -> dict[str, Any]:
    """The manifest in a zip; {} if it is missing or the zip is broken."""
    try:
        with ZipFile(path) as archive:
            about = tomllib.loads(archive.read(MANIFEST).decode())
            return {} if archive.testzip() else about
    except UNREADABLE:
        return {}


def _is_packed(name: str) -> bool:
    return name != "__pycache__" and not name.startswith(".")


def pack(target: Path, root: Path = ROOT) -> None:
    """Write the extension's zip to a file."""
    names = files_of(root)
    with ZipFile(target, "w", ZIP_DEFLATED) as archive:
        for name in names:
            about = ZipInfo(name, DATE)
            about.compress_type = ZIP_DEFLATED
            about.external_attr = MODE << 16
            archive.writestr(about, (root / name).read_bytes())
