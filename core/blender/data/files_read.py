"""External files of the open .blend, needed to copy it to another machine."""

import glob
import re
from pathlib import Path

import bpy

TILE = "<UDIM>"  # in an image's path, the place of a tile's number


def files_read() -> list[str]:
    """Absolute paths, each once and sorted: for a sequence its existing frames, for tiles likewise.
    Packed files and Blender's own are left out.
    """
    own = Path(bpy.utils.system_resource("DATAFILES"))
    paths = bpy.utils.blend_paths(absolute=True, packed=False)
    found = {path for path in paths if path and not Path(path).is_relative_to(own)}
    for image in bpy.data.images:
        path = Path(bpy.path.abspath(image.filepath, library=image.library))
        if str(path) not in found:
            continue
        if image.source == "SEQUENCE":
            found |= _frames(path)
        elif image.source == "TILED" and TILE in path.name:
            name = glob.escape(path.name).replace(TILE, "[0-9]" * 4)
            found |= {str(one) for one in path.parent.glob(name)}
    return sorted(path for path in found if TILE not in path)


def _frames(path: Path) -> set[str]:
    """The files of a sequence: the last digits in a name are the frame number."""
    before, _, after = re.fullmatch(r"(.*?)(\d*)(\D*)", path.stem).groups()
    name = re.compile(rf"{re.escape(before)}\d+{re.escape(after + path.suffix)}")
    there = path.parent.iterdir() if path.parent.is_dir() else ()
    return {str(one) for one in there if name.fullmatch(one.name)}
