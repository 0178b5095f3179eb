"""Frames of a scene: file names by Blender's rules, and the return to the current frame."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import bpy

from ...base.errors import ImageError
from ...files.image_io import FORMATS, SUFFIXES


@contextmanager
def frame_restored(scene: bpy.types.Scene) -> Iterator[None]:
    """Restore a scene's frame and subframe at the end."""
    frame, part = scene.frame_current, scene.frame_subframe
    try:
        yield
    finally:
        with suppress(ReferenceError):  # another file was loaded, or the scene is gone
            if (scene.frame_current, scene.frame_subframe) != (frame, part):
                scene.frame_set(frame, subframe=part)


def frames_of_range(scene: bpy.types.Scene) -> tuple[int, ...]:
    """The frames of a scene's render range."""
    return tuple(range(scene.frame_start, scene.frame_end + 1, scene.frame_step))


def frame_files(
    scene: bpy.types.Scene, folder: Path, name: str, form: str, frames: Iterable[int]
) -> dict[int, Path]:
    """The files of a scene's frames in a folder, named as Blender names renders: # are digits of
    the frame number, which comes last without #. From 4.5 on words in braces are templates, such as
    {fps}.

    form : a key of image_io.FORMATS, whose suffix the files get

    Raises
    ------
    ImageError
        The name has a folder in it, or an unknown template.
    """
    _check_plain(name)
    named = _named(scene, _stem(name), frames)
    for text in named.values():
        _check_plain(text)
    return {frame: folder / f"{text}{FORMATS[form].suffix}" for frame, text in named.items()}


def without_number(scene: bpy.types.Scene, name: str) -> str:
    """The name of a movie from the name of its frames, without number and suffix; '' if nothing is
    left. Raises ImageError as frame_files.
    """
    stem = _stem(name).rstrip("#").rstrip("_-. ").replace("#", "")
    if not stem:
        return ""
    return _named(scene, f"{stem}#", (0,))[0][:-1]  # the number is one digit, 0


def folder_of(scene: bpy.types.Scene, path: str) -> Path:
    """The folder of a path from the interface, which may have templates, too; in the folder of the
    .blend braces are plain text. Raises ImageError as frame_files.
    """
    folder = path.rstrip("/\\").removesuffix(Path(path).name)
    return Path(bpy.path.abspath(_named(scene, f"{folder}#", (0,))[0])).parent


def _stem(name: str) -> str:
    """A name without the suffix of an image."""
    suffix = Path(name).suffix
    return name.removesuffix(suffix) if suffix.lower() in SUFFIXES else name


def _check_plain(name: str) -> None:
    """Raise ImageError for a file name with a folder in it."""
    if "/" in name or "\\" in name:
        raise ImageError("'{name}' is not a plain file name. Remove the slashes.", name=name)


def _named(scene: bpy.types.Scene, stem: str, frames: Iterable[int]) -> dict[int, str]:
    """Blender's file names for a name without suffix, by frame. The scene's render settings are
    used for it, and restored.
    """
    render = scene.render
    before = render.filepath, render.use_file_extension
    try:
        render.filepath, render.use_file_extension = stem, False
        return {frame: render.frame_path(frame=frame) for frame in frames}
    except RuntimeError:  # Blender's report
        raise ImageError(
            "Blender doesn't know the template in braces in '{name}'. Remove the braces, or"
            " double them to keep them.",
            name=stem,
        ) from None
    finally:
        render.filepath, render.use_file_extension = before
