"""Saves a copy of the open file, whole or not at all."""

from pathlib import Path

import bpy

from ..core.blender.reports import said_by
from ..core.errors import ImageError


def save_copy(path: Path) -> None:
    """Save the open file to another place, which its relative paths are then relative to.

    The open file stays as it is. ImageError where the copy cannot be written.
    """
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(path.absolute()), copy=True, relative_remap=True)
    except RuntimeError as reason:
        why = said_by(reason).rstrip(".")
        raise ImageError(
            "The file '{file}' cannot be written ({why}): choose another folder.",
            file=path,
            why=why,
        ) from None
