"""Own images of viewers: rendered from another scene, or opened by file name."""

from collections.abc import Generator
from pathlib import Path

import bpy

from ..core.base.errors import ImageError, RigError
from ..core.base.messages import Message
from ..core.blender.data.camera_viewer import camera_at, frame_of, seats_of, viewer_of
from ..core.blender.data.image_file import as_seen
from ..core.blender.data.paths import RELATIVE_PATH, absolute, is_chosen
from ..core.blender.preview.viewer_render import eye_of, remove_unused, render_for
from ..core.blender.read.scene import read_viewers
from ..core.blender.read.scene_picture import check_readable
from ..core.rig.viewer import check_together
from . import needed, reporting
from .choose_rig import EndsWithRig
from .folder import names_for
from .long_work import LongWork

MARK = "{viewer}"


def files_of(scene: bpy.types.Scene, file: str) -> dict[str, Path]:
    """Image files of the active viewers, by camera name.

    Names are used as they are, or as every disk allows them; RigError if viewers would share a
    file.

    file : a name with the mark in place of the viewer's, the file of one viewer, or a folder with
        an image of each viewer's name and any type
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
            "'{file}' is a single file for {n} viewers: use {mark} in place of their names.",
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
    """A file name with the mark in place of the longest matching viewer's name; otherwise
    unchanged.
    """
    place = Path(file)
    found = max((name for name in names if name in place.name), key=len, default="")
    return str(place.with_name(place.name.replace(found, MARK))) if found else file


def _in_folder(folder: Path, names: tuple[str, ...]) -> Path:
    """The image in a folder with one of these names, the first by type."""
    known = bpy.path.extensions_image
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in known)
    return next((path for path in files if path.stem in names), folder / f"{names[-1]}.png")


def names_of(scene: bpy.types.Scene) -> list[str]:
    """Names of the active viewers; reading reports an entry without a camera."""
    return [seat.camera.name for seat in seats_of(scene) if seat.camera is not None]


def open_images(scene: bpy.types.Scene, file: str) -> int:
    """Give each active viewer the image in its file; returns their number.

    Raises ImageError, and changes nothing, if one cannot be read; RigError like `files_of`.
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
    """Raise the error of `open_images` without changing anything."""
    before = set(bpy.data.images)
    try:
        for name, path in files_of(scene, file).items():
            _opened(path, name)
    finally:
        bpy.data.batch_remove([one for one in bpy.data.images if one not in before])


def give(scene: bpy.types.Scene, images: dict[str, bpy.types.Image]) -> None:
    """Set the own images of the named viewers."""
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
        if image.source == "SEQUENCE":  # a sequence would show another picture
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


class KIRIKO_OT_open_pictures(EndsWithRig, bpy.types.Operator):
    """Open an image for each viewer, matched by the viewers' names"""

    bl_idname = "kiriko.open_pictures"
    bl_label = "Open Pictures"
    bl_options = {"REGISTER", "UNDO"}

    filepath: bpy.props.StringProperty(
        name="File",
        description="Image file, or a folder of images",
        subtype="FILE_PATH",
        options={"SKIP_SAVE", *RELATIVE_PATH},
    )
    filter_image: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        is_there = viewer_of(context.scene) is not None or names_of(context.scene)
        return needed.can_run(cls, [] if is_there else [needed.NEEDED["VIEWER"]])

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.begin_with(context.scene)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            self.end_with(context)
            if not is_chosen(self.filepath):
                raise ImageError("No file is chosen: choose an image.")
            n = open_images(context.scene, str(absolute(self.filepath)))
            reporting.report(self, "INFO", Message("{n} viewers now have their own images.", n=n))
            return {"FINISHED"}
        return {"CANCELLED"}


NO_OTHER = Message("There is no other scene: make one for the viewers to see")


class KIRIKO_OT_render_pictures(LongWork, bpy.types.Operator):
    """Render another scene from each viewer's camera, as its own picture"""

    bl_idname = "kiriko.render_pictures"
    bl_label = "Render Pictures"
    bl_options = {"REGISTER", "UNDO"}

    scene: bpy.props.StringProperty(
        name="Scene",
        description="Scene to render; if empty, the only other scene",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        missing = [] if len(bpy.data.scenes) > 1 else [NO_OTHER]
        if not seats_of(context.scene):
            missing.append(needed.NEEDED["VIEWER"])
        return needed.can_run(cls, missing)

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        scene, other = context.scene, self._other(context.scene)
        context.view_layer.update()
        depsgraph = context.evaluated_depsgraph_get()
        # raises an error for missing or repeated viewers
        check_together(read_viewers(depsgraph, scene), (), has_mirrors=True)
        eyes = [eye_of(one.camera, depsgraph) for one in seats_of(scene)]

        images: dict[str, bpy.types.Image] = {}
        is_done = False
        try:
            yield 0.0
            for n, eye in enumerate(eyes):
                image = render_for(other, eye, frame_of(eye.camera, scene.render))
                images[eye.camera.name] = image
                yield (n + 1) / len(eyes)
            _replace(scene, images)
            is_done = True
        finally:
            if not is_done:
                bpy.data.batch_remove(list(images.values()))

        return Message(
            "{n} viewers now see '{scene}', rendered from their cameras.",
            n=len(images),
            scene=other.name,
        )

    def _other(self, scene: bpy.types.Scene) -> bpy.types.Scene:
        """The scene to render; RigError if it is ambiguous or cannot be changed."""
        others = [one for one in bpy.data.scenes if one != scene]
        found = [one for one in others if one.name == self.scene] if self.scene else others
        if len(found) != 1:
            raise RigError(
                "There are {n} other scenes: name the one to render.",
                n=len(others),
            )
        if not found[0].is_editable:
            raise RigError("{reason}.", reason=needed.LINKED)
        return found[0]


def _replace(scene: bpy.types.Scene, images: dict[str, bpy.types.Image]) -> None:
    """Set the viewers' images, and remove unused earlier renders."""
    give(scene, images)
    remove_unused()
    for name, image in images.items():
        image.name = name
