"""An output folder: made if needed, checked before work, removed if it stays empty."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy

from ..core.base.errors import ImageError
from ..core.files import disk

LONGEST = 120  # bytes of a name: systems allow 255 for a file's in all


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Make the folder and check that it is writable, before any work.

    It is removed again if it stays empty.
    """
    new = [path for path in (folder, *folder.parents) if not disk.is_there(path)]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as reason:
        raise disk.unwritable_folder(folder, reason) from None

    try:
        disk.check_folder(folder)
        yield
    finally:
        for path in new:
            if any(path.iterdir()):
                break
            path.rmdir()


def names_for(things: Iterable[str]) -> list[str]:
    """Distinct folder names that every system allows.

    A name that is valid as it is stays unchanged, even if another is shortened to it.
    """
    things = list(things)
    allowed = [_allowed(thing) for thing in things]
    names: dict[int, str] = {}
    taken: set[str] = set()  # disks may ignore case
    for n in sorted(range(len(things)), key=lambda n: allowed[n] != things[n]):
        name, number = allowed[n], 1
        while name.casefold() in taken:
            number += 1
            name = f"{allowed[n]}_{number}"
        taken.add(name.casefold())
        names[n] = name
    return [names[n] for n in range(len(things))]


def _allowed(thing: str) -> str:
    """A name that every system allows, and no command takes for an option."""
    # removes an incomplete character at the cut
    whole = bpy.path.clean_name(thing)
    whole = f"_{whole[1:]}" if whole.startswith("-") else whole
    return whole.encode(errors="ignore")[:LONGEST].decode(errors="ignore")


def existing(folder: Path, names: Iterable[str]) -> list[Path]:
    """The files that exist in the folder."""
    return [folder / name for name in names if disk.is_there(folder / name)]


def refuse_existing(folder: Path, names: Iterable[str], remedy: str) -> None:
    """Raise ImageError if any of the files exists in the folder; `remedy` ends its sentence."""
    there = existing(folder, names)
    if there:
        raise ImageError(
            "The folder '{folder}' has {files} already: choose another or {remedy}.",
            folder=folder,
            files=", ".join(path.name for path in there),
            remedy=remedy,
        )
