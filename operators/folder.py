"""A folder that results are written to: made if need be, seen
to be writable before any work, gone again if unused.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy

from ..core.base.errors import ImageError
from ..core.files import disk

LONGEST = 120  # bytes of a thing's name: systems take 255 for a file's in all


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Make the folder and see that it can be written, before any work is done for it.

    Gone again if it stays empty.
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
    """A folder's name for each of some things, as every system allows it, and each another. What
    can have its own name has it, whatever others were shortened to.
    """
    things = list(things)
    allowed = [_allowed(thing) for thing in things]
    names: dict[int, str] = {}
    taken: set[str] = set()  # disks may not tell capitals from small letters
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
    # half a letter at the cut goes, too
    whole = bpy.path.clean_name(thing)
    whole = f"_{whole[1:]}" if whole.startswith("-") else whole
    return whole.encode(errors="ignore")[:LONGEST].decode(errors="ignore")


def refuse_existing(folder: Path, names: Iterable[str], remedy: str) -> None:
    """Raise ImageError when files of these names are in the folder already; `remedy` ends its
    sentence.
    """
    there = [name for name in names if disk.is_there(folder / name)]
    if there:
        raise ImageError(
            "The folder '{folder}' has {files} already: choose another or {remedy}.",
            folder=folder,
            files=", ".join(there),
            remedy=remedy,
        )
