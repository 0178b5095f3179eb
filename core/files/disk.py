"""Files and folders on disk: sets of files written completely or not at all, and reserved names."""

import errno
import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from ..base.errors import ImageError

PREFIX = ".kiriko-"  # of temporary files and folders


@contextmanager
def scratch(folder: Path) -> Iterator[Path]:
    """A temporary folder within `folder`, removed at the end.

    An ImageError raised within it names the place in `folder` instead.

    Raises
    ------
    ImageError
        `folder` cannot be written.
    """
    try:
        place = _temporary(folder)
    except OSError as reason:
        raise unwritable_folder(folder, reason) from None
    with place as name:
        try:
            yield Path(name)
        except ImageError as error:
            values = {
                key: _elsewhere(value, Path(name), folder)
                for key, value in error.message.values.items()
            }
            raise ImageError(error.message.template, **values) from None


def _elsewhere(value: object, place: Path, folder: Path) -> object:
    """A message value with the path `place` replaced by `folder`; other values are unchanged."""
    is_path = isinstance(value, Path) or (isinstance(value, str) and str(place) in value)
    return str(value).replace(str(place), str(folder)) if is_path else value


def _temporary(folder: Path) -> Any:
    """A temporary folder within another one, so a move between them copies nothing."""
    return tempfile.TemporaryDirectory(prefix=PREFIX, dir=folder, ignore_cleanup_errors=True)


@contextmanager
def together(folder: Path, of: Iterable[str] = ()) -> Iterator[Path]:
    """A folder to write files to, which are moved to `folder` once all are written.

    After an error, a full disk or Esc, `folder` is unchanged. Files in a subfolder go to the
    subfolder of the same name, created if necessary. If a file's name is a symbolic link in
    `folder`, its target is replaced; a dangling link is replaced itself.

    of : names of files in the set; the ones not written are removed

    Raises
    ------
    ImageError
        A file cannot be written; the sentence names its place in `folder`.
    """
    with scratch(folder) as new, ExitStack() as stack:
        yield new
        moves: dict[Path, tuple[Path, Path]] = {}
        try:
            for path in sorted(path for path in new.rglob("*") if not path.is_dir()):
                name = path.relative_to(new)
                target = _target(folder / name, stack)
                near = Path(stack.enter_context(_temporary(target.parent))) / "new"
                shutil.move(path, near)  # copies only if a link points to another disk
                moves[name] = near, target
            leftover = sorted({Path(name) for name in of} - moves.keys())
            for name in leftover:
                _check_file(folder / name)
            for name, (near, target) in moves.items():  # noqa: B007 - the error names it
                near.replace(target)
            for name in leftover:
                (folder / name).unlink(missing_ok=True)
        except OSError as reason:
            raise unwritable(folder / name, reason) from None


def _target(place: Path, stack: ExitStack) -> Path:
    """Final path of a file; creates its folder if necessary, removed with the stack if left
    empty.
    """
    target = Path(os.path.realpath(place)) if place.exists() else place
    _check_file(target)
    if not target.parent.exists():
        target.parent.mkdir()
        stack.callback(_remove_empty, target.parent)
    return target


def _check_file(target: Path) -> None:
    if target.is_dir():  # before any file is replaced
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))


def _remove_empty(folder: Path) -> None:
    with suppress(OSError):  # not empty
        folder.rmdir()


def unwritable_folder(folder: Path, reason: OSError) -> ImageError:
    """Error for a folder the system cannot write to."""
    return ImageError(
        "The folder '{folder}' cannot be written ({why}): choose another one.",
        folder=folder,
        why=reason.strerror,
    )


def unwritable(path: Path, reason: OSError) -> ImageError:
    """Error for a file the system cannot write."""
    why = reason.strerror
    return ImageError(
        "The file '{path}' cannot be written ({why}): check the disk or choose another name.",
        path=path,
        why=why,
    )


def is_there(path: Path) -> bool:
    """Whether a file, folder or link has this name; ImageError for an impossible name."""
    try:
        return path.exists() or path.is_symlink()
    except (OSError, ValueError) as reason:  # too long, or an illegal character
        why = getattr(reason, "strerror", None) or reason
        raise ImageError(
            "The folder '{folder}' cannot hold a file of this name ({why}): choose another name.",
            folder=path.parent,
            why=why,
        ) from None


def check_new(path: Path, overwrite: bool) -> None:
    """Raise ImageError if the file exists and must not be replaced."""
    if is_there(path) and not overwrite:
        raise ImageError(
            "The file '{path}' already exists: choose another name or allow overwriting.", path=path
        )


def check_folder(folder: Path) -> None:
    """Raise ImageError if no file can be created in a folder."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as reason:
        raise unwritable_folder(folder, reason) from None


class Stamp(NamedTuple):
    """Identifies a version of a file: size in bytes and time of the last write, ns."""

    size: int
    written: int


def stamp(path: Path) -> Stamp | None:
    """The stamp of a file; None if it does not exist."""
    try:
        found = path.stat()
    except OSError:
        return None
    return Stamp(found.st_size, found.st_mtime_ns)


def claim(path: Path) -> bool:
    """Reserve a name by creating an empty file; False if the name is taken.

    Raises
    ------
    ImageError
        The folder cannot be written.
    """
    try:
        path.open("x").close()
    except FileExistsError:
        return False
    except OSError as reason:
        raise unwritable(path, reason) from None
    return True


def give_up(path: Path) -> None:
    """Remove the empty file of a claim; a file with contents stays."""
    with suppress(OSError):
        if path.stat().st_size == 0:
            path.unlink()


def write_text(path: Path, text: str) -> None:
    """Write or replace a text file, completely or not at all; ImageError if it cannot be
    written.
    """
    with together(path.parent) as new:
        try:
            (new / path.name).write_text(text, encoding="utf-8")
        except OSError as reason:
            raise unwritable(path, reason) from None


def write_bytes(path: Path, data: bytes) -> None:
    """Write or replace a binary file in the same manner."""
    with together(path.parent) as new:
        try:
            (new / path.name).write_bytes(data)
        except OSError as reason:
            raise unwritable(path, reason) from None


def append_line(path: Path, text: str) -> None:
    """Append a line to a text file, completely or not at all, even with concurrent writers.

    ImageError if it cannot be written.
    """
    line = f"{text}\n".encode()
    try:
        # O_APPEND writes each call's data at the current end of the file
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
        try:
            n = os.write(file, line)
            if n < len(line):  # the disk is full
                os.ftruncate(file, os.fstat(file).st_size - n)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        finally:
            os.close(file)
    except OSError as reason:
        raise unwritable(path, reason) from None


def check_appendable(path: Path) -> None:
    """Raise ImageError if no line can be appended to a text file; does not create it."""
    try:
        if path.exists():
            os.close(os.open(path, os.O_WRONLY | os.O_APPEND))
        elif not path.parent.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
    except OSError as reason:
        raise unwritable(path, reason) from None


def remove(path: Path) -> None:
    """Remove a file if it exists; ImageError if it cannot be removed."""
    try:
        path.unlink(missing_ok=True)
    except OSError as reason:
        raise unwritable(path, reason) from None


def digest(path: Path | str) -> str:
    """Hash of a file's contents; ImageError if it cannot be read."""
    return hashlib.sha1(read_bytes(path), usedforsecurity=False).hexdigest()


def read_bytes(path: Path | str) -> bytes:
    """The bytes of a file; ImageError if it cannot be read."""
    try:
        if not Path(path).is_file():  # reading a pipe would block
            raise OSError(errno.ENOENT, os.strerror(errno.ENOENT))
        return Path(path).read_bytes()
    except (OSError, ValueError) as reason:
        why = getattr(reason, "strerror", None) or reason
        raise ImageError(
            "The file '{path}' cannot be read ({why}): choose another one.", path=path, why=why
        ) from None
