"""Placeholders: an empty file holds the place of one that is being made, so that other processes,
also on other machines, leave it out.

A mark beside it tells whose it is, and is touched as long as the work goes on. So a placeholder is
known to be left by a process that was killed: at once where that was one of this start of this
machine, else when its mark has not been touched for a while. One without a mark is nobody's.
"""

import hashlib
import os
import tempfile
from contextlib import suppress
from pathlib import Path
from time import monotonic

from . import disk

MARK = f"{disk.PREFIX}held-"  # how names of marks begin
PATIENCE = 600.0  # s after which a mark that was not touched is left
BEAT = 10.0  # s between two touches

_touched: dict[Path, float] = {}  # when this process touched its marks


def claim(path: Path) -> bool:
    """Hold a file's place, unless another process does; of several processes one alone is told so.

    Raises
    ------
    ImageError
        The folder cannot be written.
    """
    mark, text = _mark(path), f"{disk.own_name()}\n{path.name}"
    if not _made(mark, text):
        if not is_left(mark):
            return False
        with suppress(OSError):  # another process does the same
            mark.unlink()
        if not _made(mark, text):
            return False
    _touched[path] = monotonic()
    _made(path, "")
    return True


def keep(path: Path) -> None:
    """Tell that the work goes on; called often."""
    now = monotonic()
    if path in _touched and now > _touched[path] + BEAT:
        _touched[path] = now
        with suppress(OSError):
            os.utime(_mark(path))


def give_up(path: Path) -> None:
    """Hold a file's place no longer; an empty file goes."""
    with suppress(OSError):
        if path.stat().st_size == 0:
            path.unlink()
    if _touched.pop(path, None) is not None:
        with suppress(OSError):
            _mark(path).unlink()


def remove_left(folder: Path) -> None:
    """Remove the placeholders in a folder whose processes were killed."""
    for mark in folder.glob(f"{MARK}*"):
        if is_left(mark):
            with suppress(OSError):
                path = folder / Path(_text(mark).partition("\n")[2]).name
                if path.is_file() and path.stat().st_size == 0:
                    path.unlink()
                mark.unlink()


def is_left(mark: Path) -> bool:
    """Was the process killed that made a mark?"""
    try:
        if disk.is_of_the_gone(_text(mark)):
            return True
        # by the clock of the disk, which may be another machine's
        with tempfile.NamedTemporaryFile(prefix=disk.own_name(), dir=mark.parent) as now:
            return os.fstat(now.fileno()).st_mtime - mark.stat().st_mtime > PATIENCE
    except OSError:  # it is gone by now
        return False


def _mark(path: Path) -> Path:
    """Its name has room for any name of a file."""
    name = os.fsencode(path.name)
    return path.with_name(f"{MARK}{hashlib.sha1(name, usedforsecurity=False).hexdigest()}")


def _text(mark: Path) -> str:
    """Whose it is, and the name of the file; '' where it is being made."""
    return mark.read_text(encoding="utf-8", errors="surrogateescape")


def _made(path: Path, text: str) -> bool:
    """Make a file that is not there yet; False where it is."""
    try:
        with path.open("x", encoding="utf-8", errors="surrogateescape", newline="\n") as file:
            file.write(text)
    except FileExistsError:
        return False
    except OSError as reason:
        raise disk.unwritable(path, reason) from None
    return True
