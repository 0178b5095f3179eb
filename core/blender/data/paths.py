"""Paths from the interface, relative to the .blend or absolute."""

from pathlib import Path

import bpy

from ...base.errors import ImageError
from ...files.disk import is_there

# from 4.5 on Blender warns about paths with // unless they are marked so
RELATIVE_PATH = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else set()


def absolute(path: str) -> Path:
    """The absolute path of one from the interface. ImageError if it is too long, or relative to an
    unsaved .blend.
    """
    if path.startswith("//") and not bpy.data.filepath:
        raise ImageError(
            "The path '{path}' is relative, but this file was never saved. Save it, or choose"
            " another path.",
            path=path,
        )
    found = Path(bpy.path.abspath(path))
    is_there(found)  # refuses an impossible path
    return found


def is_chosen(path: str) -> bool:
    """Whether a file was chosen. If none was, Blender's file browser may return the open .blend."""
    return bool(path) and (not bpy.data.filepath or absolute(path) != Path(bpy.data.filepath))
