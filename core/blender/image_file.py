"""The file that Blender reads an image from: what it says about the image and Blender ignores."""

from pathlib import Path

import bpy
import numpy as np

from ..disk import is_there
from ..errors import ImageError
from ..image_io import PROFILE_NAME
from ..messages import Message
from ..picture_file import has_header, is_cut, light_said, said_by, turned
from . import colour

PROBES = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [128, 128, 128]])
UNLIKE = 0.01  # of linear light, by which colours differ visibly: at mid grey three steps of 8 bits


def file_of(image: bpy.types.Image) -> Path | None:
    """The file that an image's pixels are read from; None for a movie, and where there is none.
    ImageError where its path is too long.
    """
    is_read = image.source in {"FILE", "SEQUENCE"} and not (image.is_dirty or image.packed_file)
    path = Path(bpy.path.abspath(image.filepath, library=image.library)) if is_read else None
    return path if path is not None and is_there(path) and path.is_file() else None


def check_header(image: bpy.types.Image, owner: str) -> None:
    """Raise ImageError where Blender 4.2 would never come back from loading an image."""
    path = None if image.has_data else file_of(image)
    if path is not None and not has_header(path):
        raise _cut(image, owner, path)


def check_whole(image: bpy.types.Image, owner: str) -> None:
    """Raise ImageError where an image's file is cut off, of which Blender says nothing."""
    path = file_of(image)
    if path is not None and is_cut(path):
        raise _cut(image, owner, path)


def _cut(image: bpy.types.Image, owner: str, path: Path) -> ImageError:
    return ImageError(
        "The image '{image}' of {owner} is cut off: the end of its file {file} is missing. Copy or"
        " save it again.",
        image=image.name,
        owner=owner,
        file=path,
    )


def notes_on(image: bpy.types.Image) -> list[str]:
    """Sentences on what an image's file says about its pixels and Blender does not apply."""
    path = file_of(image)
    said = {} if path is None else said_by(path)
    notes = []
    if said.get("Orientation", 1) != 1:
        notes.append(
            Message(
                "The image '{image}' is stored turned or mirrored (Exif orientation), which Blender"
                " ignores: open its file with Open Picture, which turns it.",
                image=image.name,
            )
        )
    light = None if image.colorspace_settings.is_data else light_said(said, PROBES / 255)
    if light is not None:
        taken = colour.converted(image, PROBES[None].astype(np.uint8))[0]
        if np.abs(taken - light).max() > UNLIKE:
            notes.append(
                Message(
                    "The image '{image}' has a colour profile ({profile}) that Blender ignores:"
                    " choose it as Color Space, or save the image as sRGB.",
                    image=image.name,
                    profile=said.get(PROFILE_NAME) or Message("the chromaticities of its file"),
                )
            )
    return notes


def make_ready(image: bpy.types.Image, owner: str) -> None:
    """Turn an image that was just loaded as its file says that it is seen, and pack it then;
    ImageError where the file is cut off.
    """
    check_header(image, owner)
    check_whole(image, owner)
    path = file_of(image)
    orientation = 1 if path is None else said_by(path).get("Orientation", 1)
    if orientation == 1 or min(image.size) < 1:
        return

    width, height = image.size
    stored = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(stored)
    upright = turned(stored.reshape(height, width, -1)[::-1], orientation)
    image.scale(*upright.shape[1::-1])
    image.pixels.foreach_set(np.ascontiguousarray(upright[::-1]).ravel())
    image.update()
    image.pack()
    # or unpacking it would overwrite the file
    image.filepath_raw = str(path.with_name(f"{path.stem} upright.png"))
    if image.is_float and not image.colorspace_settings.is_data:
        # its packed file has the numbers of the working space
        new = bpy.data.images.new(image.name, 1, 1, float_buffer=True)
        image.colorspace_settings.name = new.colorspace_settings.name
        bpy.data.images.remove(new)
