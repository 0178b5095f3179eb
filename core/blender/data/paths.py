"""Paths as the interface has them, relative to the .blend or not."""

from pathlib import Path

import bpy

from ...base.errors import ImageError
from ...files.disk import is_there

# Blender 4.5 learned to mark paths that may begin with // and warns where the mark is missing
RELATIVE_PATH = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else set()


def absolute(path: str) -> Path:
    """The place that a path from the interface means; ImageError
    when it is relative to a .blend never saved, or too long.
    """
    if path.startswith("//") and not bpy.data.filepath:
        raise ImageError(
            "The path '{path}' is relative, but this file was never saved. Save it, or choose"
            " another path.",
            path=path,
        )
    found = Path(bpy.path.abspath(path))
    is_there(found)  # refuses what can be no path
    return found


def is_chosen(path: str) -> bool:
    """Was a file chosen? Where none was, Blender's file browser may name the open .blend itself."""
    return bool(path) and (not bpy.data.filepath or absolute(path) != Path(bpy.data.filepath))
