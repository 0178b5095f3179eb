"""Files of images: orientation, colour profile and damage that Blender ignores."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import gettempdir
from typing import Any

import bpy
import numpy as np

from ...base.errors import ImageError
from ...base.messages import Message
from ...files.disk import is_there, scratch
from ...files.image_io import PROFILE_NAME, has_openimageio
from ...files.picture_file import has_header, is_cut, light_said, said_by, upright
from . import colour

PROBES = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [128, 128, 128]])
UNLIKE = 0.01  # of linear light, a visible difference: at mid grey three steps of 8 bits


@contextmanager
def file_of(image: bpy.types.Image) -> Iterator[Path | None]:
    """The file of an image's pixels; for a packed image a temporary copy. None for movies, unsaved
    pixels and missing files. ImageError if the path is too long.
    """
    if image.source not in {"FILE", "SEQUENCE"} or image.is_dirty:
        yield None
    elif image.packed_file is None:
        path = Path(_path_of(image))
        yield path if is_there(path) and path.is_file() else None
    else:
        with ExitStack() as stack:
            path = None
            with suppress(ImageError, OSError):  # no space for it
                folder = stack.enter_context(scratch(Path(gettempdir())))
                (folder / "packed").write_bytes(image.packed_file.data)
                path = folder / "packed"
            yield path


def _path_of(image: bpy.types.Image) -> str:
    return bpy.path.abspath(image.filepath, library=image.library)


def check_header(image: bpy.types.Image, owner: str) -> None:
    """Raise ImageError if loading an image would hang Blender 4.2."""
    if not image.has_data:
        with file_of(image) as path:
            if path is not None and not has_header(path):
                raise _cut(image, owner)


def check_whole(image: bpy.types.Image, owner: str) -> None:
    """Raise ImageError if an image's file is truncated, which Blender does not report."""
    with file_of(image) as path:
        if path is not None and is_cut(path):
            raise _cut(image, owner)


def _cut(image: bpy.types.Image, owner: str) -> ImageError:
    return ImageError(
        "The image '{image}' of {owner} is incomplete: the end of {file} is missing. Copy or save"
        " it again.",
        image=image.name,
        owner=owner,
        file=_path_of(image),
    )


def _said(image: bpy.types.Image) -> dict[str, Any]:
    with file_of(image) as path:
        return {} if path is None else said_by(path)


def notes_on(image: bpy.types.Image) -> list[str]:
    """Sentences on file properties ignored by Blender."""
    said, notes = _said(image), []
    if said.get("Orientation", 1) != 1:
        again = Message("choose it again in the Kiriko tab, or ")
        notes.append(
            Message(
                "Blender ignores the Exif orientation of '{image}': {again}save it upright.",
                image=image.name,
                again=again if has_openimageio() else "",
            )
        )
    light = None if image.colorspace_settings.is_data else light_said(said, PROBES / 255)
    if light is not None:
        converted = colour.converted(image, PROBES[None].astype(np.uint8))[0]
        if np.abs(converted - light).max() > UNLIKE:
            notes.append(
                Message(
                    "Blender ignores the colour profile of '{image}' ({profile}). Set it as Color"
                    " Space, or save the image as sRGB.",
                    image=image.name,
                    profile=said.get(PROFILE_NAME) or Message("chromaticities"),
                )
            )
    return notes


def as_seen(image: bpy.types.Image, owner: str, is_new: bool = False) -> bpy.types.Image:
    """The image in the orientation of its file: itself, or a rotated packed copy. ImageError if the
    file is truncated. Without OpenImageIO the image is unchanged and a note reports it.

    is_new : the image was just loaded, and is rotated itself
    """
    check_header(image, owner)
    check_whole(image, owner)
    if image.source != "FILE" or min(image.size) < 1:
        return image
    with file_of(image) as path:
        is_upright = path is None or said_by(path).get("Orientation", 1) == 1
        if is_upright or not has_openimageio():
            return image
        data, suffix = upright(path)

    seen = image if is_new else image.copy()  # other users keep the original
    # the name of the unpacked file, different from the photograph's
    file = Path(_path_of(image) or image.name)
    seen.filepath_raw = str(file.with_name(f"{file.stem} upright{suffix}"))
    seen.pack(data=data, data_len=len(data))
    seen.buffers_free()
    return seen
