"""Gives each viewer an image of its own: by a file name with the viewer's in it, or as rendered."""

from pathlib import Path

import bpy

from ..core.base.errors import ImageError, RigError
from ..core.base.messages import Message
from ..core.blender.image_file import as_seen
from ..core.blender.paths import absolute
from ..core.blender.picture import check_readable
from ..core.blender.viewer import camera_at, seats_of
from .folder import names_for

MARK = "{viewer}"


def files_of(scene: bpy.types.Scene, file: str) -> dict[str, Path]:
    """The files of the viewers that are on, by their cameras' names, as these are or as every disk
    takes them; RigError where several viewers would have the same.

    file : a name with the mark where a viewer's is, the file of one of them, or a folder that has
        an image of each viewer's name, whatever its kind
    """
    names = names_of(scene)
    folder = absolute(file)
    if folder.is_dir():
        return {
            name: _in_folder(folder, (name, safe))
            for name, safe in zip(names, names_for(names), strict=True)
        }
    if MARK not in file and len(names) > 1:
        file = _with_mark(file, [*names, *names_for(names)])
    if MARK not in file and len(names) > 1:
        raise RigError(
            "The file '{file}' is the same for {n} viewers: put {mark} where their names are.",
            file=file,
            n=len(names),
            mark=MARK,
        )
    found = {}
    for name, safe in zip(names, names_for(names), strict=True):
        paths = [absolute(file.replace(MARK, word)) for word in (name, safe)]
        found[name] = next((path for path in paths if path.is_file()), paths[0])
    return found


def _with_mark(file: str, names: list[str]) -> str:
    """A file's name with the mark where a viewer's name is, the longest one; else as it is."""
    place = Path(file)
    found = max((name for name in names if name in place.name), key=len, default="")
    return str(place.with_name(place.name.replace(found, MARK))) if found else file


def _in_folder(folder: Path, names: tuple[str, ...]) -> Path:
    """The image in a folder that has one of these names, the first by its kind."""
    known = bpy.path.extensions_image
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in known)
    return next((path for path in files if path.stem in names), folder / f"{names[-1]}.png")


def names_of(scene: bpy.types.Scene) -> list[str]:
    """The names of the viewers that are on; that an entry has no camera is told when it is read."""
    return [seat.camera.name for seat in seats_of(scene) if seat.camera is not None]


def open_images(scene: bpy.types.Scene, file: str) -> int:
    """Give each viewer that is on the image in its file, and return how many these are.

    Raises ImageError, and changes nothing, where one cannot be read; RigError as `files_of` does.
    """
    before = set(bpy.data.images)
    try:
        images = {name: _opened(path, name) for name, path in files_of(scene, file).items()}
    except ImageError:
        bpy.data.batch_remove([one for one in bpy.data.images if one not in before])
        raise
    give(scene, images)
    return len(images)


def check_images(scene: bpy.types.Scene, file: str) -> None:
    """Raise the error of `open_images`; nothing is changed."""
    before = set(bpy.data.images)
    try:
        for name, path in files_of(scene, file).items():
            _opened(path, name)
    finally:
        bpy.data.batch_remove([one for one in bpy.data.images if one not in before])


def give(scene: bpy.types.Scene, images: dict[str, bpy.types.Image]) -> None:
    """Have the viewers of some names see these images, in their own pixels."""
    ours = scene.kiriko
    ours.picture_source = "IMAGE"
    if not len(ours.viewers):
        ours.picture_image = next(iter(images.values()), ours.picture_image)
    for n, one in enumerate(ours.viewers):
        camera = camera_at(scene, n)
        if one.is_on and camera is not None:
            one.image = images[camera.name]


def _opened(path: Path, viewer: str) -> bpy.types.Image:
    """The image in a viewer's file."""
    owner, known = Message("the viewer '{viewer}'", viewer=viewer), set(bpy.data.images)
    try:
        image = bpy.data.images.load(str(path), check_existing=True)
        if image.source == "SEQUENCE":  # it is loaded as the first of one, another picture
            image = bpy.data.images.load(str(path))
    except RuntimeError:
        raise ImageError(
            "The file '{file}' of the viewer '{viewer}' cannot be read: it is missing or broken.",
            file=path,
            viewer=viewer,
        ) from None
    image = as_seen(image, owner, is_new=image not in known)
    check_readable(image, owner)
    return image
