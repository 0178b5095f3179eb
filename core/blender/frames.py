"""Frames of a scene: the files that Blender names after them, and the way back to the first."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import bpy

from ..errors import ImageError
from ..image_io import FORMATS, SUFFIXES


@contextmanager
def frame_kept(scene: bpy.types.Scene) -> Iterator[None]:
    """Have a scene go back to its frame, and the part of one, at the end."""
    frame, part = scene.frame_current, scene.frame_subframe
    try:
        yield
    finally:
        with suppress(ReferenceError):  # another file was loaded, or the scene is gone
            if (scene.frame_current, scene.frame_subframe) != (frame, part):
                scene.frame_set(frame, subframe=part)


def frames_of_range(scene: bpy.types.Scene) -> tuple[int, ...]:
    """The frames that Blender would render of a scene."""
    return tuple(range(scene.frame_start, scene.frame_end + 1, scene.frame_step))


def frame_files(folder: Path, name: str, form: str, frames: Iterable[int]) -> dict[int, Path]:
    """The files of frames in a folder, named by Blender as it names its renders: # are digits of
    the frame's number, which comes last where there is no #.

    form : a key of image_io.FORMATS, whose suffix the files get

    Raises
    ------
    ImageError
        The name has a folder in it, or braces that Blender, which from 4.5 on reads them as a
        template, does not know.
    """
    if "/" in name or "\\" in name:
        raise ImageError(
            "The name '{name}' has a folder in it, and is that of files alone: leave out all before"
            " the last slash, and the slash.",
            name=name,
        )

    suffix = Path(name).suffix
    stem = name.removesuffix(suffix) if suffix.lower() in SUFFIXES else name
    scene = bpy.data.scenes.new("Kiriko Names")
    try:
        scene.render.use_file_extension = False
        scene.render.filepath = stem
        return {
            frame: folder
            / f"{Path(scene.render.frame_path(frame=frame)).name}{FORMATS[form].suffix}"
            for frame in frames
        }
    except RuntimeError:  # Blender's report
        raise ImageError(
            "Blender takes the braces in the name '{name}' for a template, which it does not know:"
            " leave them out, or double each to have the brace itself.",
            name=name,
        ) from None
    finally:
        bpy.data.scenes.remove(scene)
