"""Saves a copy of the open file, whole or not at all."""

from pathlib import Path
from secrets import token_hex

import bpy

from ..core.base.errors import ImageError
from ..core.blender.reports import said_by
from ..core.files import disk


def save_copy(path: Path) -> None:
    """Save the open file to another place, which its relative paths are then relative to.

    The open file stays as it is, and so does a file of that name where the copy cannot be written:
    ImageError.
    """
    with disk.together(path.parent) as new:
        save_copy_into(new, path)


def save_copy_into(new: Path, path: Path) -> None:
    """Save it for that place, but into a folder whose files take their places later.

    new : a folder within that of `path`
    """
    # beside its place, as its relative paths will be; one that was there would be kept as .blend1
    made = path.absolute().with_name(f"{disk.PREFIX}{token_hex(8)}.blend")
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(made), copy=True, relative_remap=True)
        _check_whole(made, path)
        made.replace(new / path.name)
    except RuntimeError as reason:
        why = said_by(reason).rstrip(".").replace(str(made), str(path))
        raise ImageError(
            "The file '{file}' cannot be written ({why}): choose another folder.",
            file=path,
            why=why,
        ) from None
    finally:
        made.unlink(missing_ok=True)


def _check_whole(made: Path, path: Path) -> None:
    """See that Blender can read what it wrote: on a full disk it tells nothing of a compressed
    file that was cut.
    """
    try:
        with bpy.data.libraries.load(str(made)):
            pass  # what describes the data is at the file's end
    except OSError:
        raise ImageError(
            "The copy '{file}' cannot be written as a whole: the disk may be full, free some of it"
            " or choose another folder.",
            file=path,
        ) from None
