"""Placeholders: an empty file holds the place of one that is being made, so that other processes,
also on other machines, leave it out.

A mark beside it tells whose it is, and is touched as long as the work goes on. So a placeholder is
known to be left by a process that was killed: at once where that was one of this start of this
machine, else when its mark has not been touched for a while. One without a mark is nobody's.

Where files that are there are made anew, one that was made since the work began is done. So each
process has a mark of its own as long as it takes part, which tells when that was.
"""

import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from math import inf
from pathlib import Path
from secrets import token_hex
from time import monotonic

from . import disk, own_files

MARK = f"{own_files.PREFIX}held-"  # how names of marks begin
AT_WORK = "-at-work"  # how names of marks of processes end that take part
PATIENCE = 600.0  # s after which a mark that was not touched is left
BEAT = 10.0  # s between two touches

_touched: dict[Path, float] = {}  # by mark: when this process touched it


def claim(path: Path) -> bool:
    """Hold a file's place, unless another process does; of several processes one alone is told so.

    Raises
    ------
    ImageError
        The folder cannot be written.
    """
    mark, text = _mark(path), f"{own_files.own_name()}\n{path.name}"
    if not _made(mark, text):
        if not is_left(mark):
            return False
        with suppress(OSError):  # another process does the same
            mark.unlink()
        if not _made(mark, text):
            return False
    _touched[mark] = monotonic()
    _made(path, "")
    return True


@contextmanager
def taking_part(folder: Path) -> Iterator[float]:
    """Take part in the work on files of a folder.

    Yields when the first of the processes that are at work there began, by the disk's clock: as the
    time of a file's last change, s.

    Raises
    ------
    ImageError
        The folder cannot be written.
    """
    try:
        began = now(folder)
    except OSError as reason:
        raise disk.unwritable_folder(folder, reason) from None
    for other in folder.glob(f"*{AT_WORK}"):
        if not is_left(other):
            began = min(began, _began(other))
            continue
        with suppress(OSError):  # another process does the same
            other.unlink()
    mark = folder / f"{own_files.own_name()}{token_hex(8)}{AT_WORK}"
    _made(mark, f"{own_files.own_name()}\n{began!r}")
    _touched[mark] = monotonic()
    try:
        yield began
    finally:
        _remove(mark)


def keep() -> None:
    """Tell that the work of this process goes on; called often."""
    moment = monotonic()
    for mark, touched in _touched.items():
        if moment > touched + BEAT:
            _touched[mark] = moment
            with suppress(OSError):
                os.utime(mark)


def give_up(path: Path) -> None:
    """Hold a file's place no longer; an empty file goes."""
    with suppress(OSError):
        if path.stat().st_size == 0:
            path.unlink()
    mark = _mark(path)
    if mark in _touched:
        _remove(mark)


def remove_left(folder: Path) -> None:
    """Remove the placeholders and marks in a folder whose processes were killed."""
    for mark in [*folder.glob(f"{MARK}*"), *folder.glob(f"*{AT_WORK}")]:
        if is_left(mark):
            with suppress(OSError):
                path = folder / Path(_text(mark).partition("\n")[2]).name
                if path.is_file() and path.stat().st_size == 0:
                    path.unlink()
                mark.unlink()


def is_left(mark: Path) -> bool:
    """Was the process killed that made a mark?"""
    try:
        if own_files.is_of_the_gone(_text(mark)):
            return True
        return now(mark.parent) - mark.stat().st_mtime > PATIENCE
    except OSError:  # it is gone by now
        return False


def now(folder: Path) -> float:
    """The time, s, by the clock of a folder's disk, which may be another machine's; OSError where
    it cannot be written.
    """
    with tempfile.NamedTemporaryFile(prefix=own_files.own_name(), dir=folder) as file:
        return os.fstat(file.fileno()).st_mtime


def _began(mark: Path) -> float:
    """When the work of the process with this mark began, s."""
    with suppress(OSError, ValueError):  # it is gone by now, or being written
        return float(_text(mark).partition("\n")[2])
    return inf


def _remove(mark: Path) -> None:
    _touched.pop(mark)
    with suppress(OSError):
        mark.unlink()


def _mark(path: Path) -> Path:
    """Its name has room for any name of a file."""
    name = os.fsencode(path.name)
    return path.with_name(f"{MARK}{hashlib.sha1(name, usedforsecurity=False).hexdigest()}")


def _text(mark: Path) -> str:
    """Whose it is, and the name of the file or when work began; '' while it is being made."""
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
