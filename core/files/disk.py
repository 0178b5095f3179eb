"""Files and folders on the disk: sets of files written whole or not at all, and claims of names."""

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

PREFIX = ".kiriko-"  # of the names of temporary files and folders


@contextmanager
def scratch(folder: Path) -> Iterator[Path]:
    """A folder within `folder` to write files to, gone at the
    end; an ImageError names their place in `folder`.

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
    """A value of a message with one folder in the place of another; no path stays as it is."""
    is_path = isinstance(value, Path) or (isinstance(value, str) and str(place) in value)
    return str(value).replace(str(place), str(folder)) if is_path else value


def _temporary(folder: Path) -> Any:
    """A temporary folder in another one, so that a move from one to the other copies nothing."""
    return tempfile.TemporaryDirectory(prefix=PREFIX, dir=folder, ignore_cleanup_errors=True)


@contextmanager
def together(folder: Path, of: Iterable[str] = ()) -> Iterator[Path]:
    """A folder to write files to, which take their places in `folder` once all are written.

    If an error, a full disk or Esc comes before, `folder` stays as it was. A file in a folder
    within it goes to the folder of the same name, which is made if need be. If `folder` has a
    symbolic link of a file's name, the link's target is replaced; a dangling link is replaced
    itself.

    of : names of files that belong together; those that are not written are removed

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
            for name, (near, target) in moves.items():  # noqa: B007 - the error says it
                near.replace(target)
            for name in leftover:
                (folder / name).unlink(missing_ok=True)
        except OSError as reason:
            raise unwritable(folder / name, reason) from None


def _target(place: Path, stack: ExitStack) -> Path:
    """Where a file goes, in a folder that is there; one that is made for it, and stays empty, goes
    with the stack.
    """
    target = Path(os.path.realpath(place)) if place.exists() else place
    _check_file(target)
    if not target.parent.exists():
        target.parent.mkdir()
        stack.callback(_remove_empty, target.parent)
    return target


def _check_file(target: Path) -> None:
    if target.is_dir():  # found before the first file is replaced
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))


def _remove_empty(folder: Path) -> None:
    with suppress(OSError):  # it is not empty
        folder.rmdir()


def unwritable_folder(folder: Path, reason: OSError) -> ImageError:
    """The error that a folder cannot be written to, for a reason of the system."""
    return ImageError(
        "The folder '{folder}' cannot be written ({why}): choose another one.",
        folder=folder,
        why=reason.strerror,
    )


def unwritable(path: Path, reason: OSError) -> ImageError:
    """The error that a file cannot be written, likewise."""
    why = reason.strerror
    return ImageError(
        "The file '{path}' cannot be written ({why}): check the disk or choose another name.",
        path=path,
        why=why,
    )


def is_there(path: Path) -> bool:
    """Is a name taken by a file, a folder or a link? ImageError where there can be none of it."""
    try:
        return path.exists() or path.is_symlink()
    except (OSError, ValueError) as reason:  # too long, or with a character that no name may have
        why = getattr(reason, "strerror", None) or reason
        raise ImageError(
            "The path '{folder}' has no room for such a name ({why}): choose another.",
            folder=path.parent,
            why=why,
        ) from None


def check_new(path: Path, overwrite: bool) -> None:
    """Raise ImageError where there is a file already, which is not to be replaced."""
    if is_there(path) and not overwrite:
        raise ImageError(
            "The file '{path}' exists already: choose another name or allow overwriting.", path=path
        )


def check_folder(folder: Path) -> None:
    """Raise ImageError when no file can be made in a folder."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as reason:
        raise unwritable_folder(folder, reason) from None


class Stamp(NamedTuple):
    """Tells a file from what it was before: its size in bytes, and when it was last written, ns."""

    size: int
    written: int


def stamp(path: Path) -> Stamp | None:
    """The stamp of a file; None if there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return Stamp(found.st_size, found.st_mtime_ns)


def claim(path: Path) -> bool:
    """Create an empty file that holds a name for this process; False if the name is taken.

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
    """Write a text file, whole or not at all.

    An existing one is replaced. ImageError when it cannot be written.
    """
    with together(path.parent) as new:
        try:
            (new / path.name).write_text(text, encoding="utf-8")
        except OSError as reason:
            raise unwritable(path, reason) from None


def write_bytes(path: Path, data: bytes) -> None:
    """Write any other file, likewise."""
    with together(path.parent) as new:
        try:
            (new / path.name).write_bytes(data)
        except OSError as reason:
            raise unwritable(path, reason) from None


def append_line(path: Path, text: str) -> None:
    """Add a line to a text file, whole or not at all, also where others add to it meanwhile.

    ImageError when it cannot be written.
    """
    line = f"{text}\n".encode()
    try:
        # opened so, all of one call goes to the end of the file, wherever that is by then
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
    """Raise ImageError when no line can be added to a text file, which is not made."""
    try:
        if path.exists():
            os.close(os.open(path, os.O_WRONLY | os.O_APPEND))
        elif not path.parent.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
    except OSError as reason:
        raise unwritable(path, reason) from None


def remove(path: Path) -> None:
    """Remove a file if it is there; ImageError when it cannot be removed."""
    try:
        path.unlink(missing_ok=True)
    except OSError as reason:
        raise unwritable(path, reason) from None


def digest(path: Path | str) -> str:
    """Tells a file's contents from others'; ImageError when it cannot be read."""
    return hashlib.sha1(read_bytes(path), usedforsecurity=False).hexdigest()


def read_bytes(path: Path | str) -> bytes:
    """The bytes of a file; ImageError when it cannot be read."""
    try:
        if not Path(path).is_file():  # reading a pipe would wait for whoever writes to it
            raise OSError(errno.ENOENT, os.strerror(errno.ENOENT))
        return Path(path).read_bytes()
    except (OSError, ValueError) as reason:
        why = getattr(reason, "strerror", None) or reason
        raise ImageError(
            "The file '{path}' cannot be read ({why}): choose another one.", path=path, why=why
        ) from None
