"""Choose the picture from the file's images or from disk, its plane in the image's own shape.

Also the frame rate and range of the scene next to those of a film.
"""

from math import isclose
from os.path import normpath
from pathlib import Path

import bpy

from ..core.base.errors import ImageError, RigError
from ..core.base.messages import Message, as_message, joined
from ..core.blender.data.image import or_none
from ..core.blender.data.image_file import as_seen, check_whole, notes_on
from ..core.blender.data.moving import (
    Timing,
    at_frame,
    number_at,
    numbered_next_to,
    rate_of,
    sequence_of,
)
from ..core.blender.data.paths import RELATIVE_PATH, absolute, is_chosen
from ..core.blender.read import plane
from ..core.blender.read import plane as blender_plane
from ..core.blender.read.plane import fit, shown_as, squeezed_words
from ..core.blender.read.scene_picture import check_readable
from . import needed, telling
from .choose_rig import EndsWithRig
from .needed import the_picture

NO_FILM = Message("The picture is not a film")


def film_shown(context: bpy.types.Context) -> tuple[bpy.types.Image, Timing] | None:
    """The film that is the picture, and when it plays; None if there is none."""
    picture = the_picture(context)
    return None if picture is None else plane.film_of(picture)


def other_rate(context: bpy.types.Context) -> Message | None:
    """A warning that the film plays at another speed in this scene; None if it does not."""
    film = film_shown(context)
    rate = rate_of(film[0]) if film else 0.0
    own = context.scene.render.fps / context.scene.render.fps_base
    if not rate or isclose(rate, own, rel_tol=1e-3):
        return None
    return Message(
        "the film '{film}' runs at {rate:.4g} frames per second and the scene at {own:.4g}, so it"
        " plays {times:.2g} times as fast; press {button} to change the scene",
        film=film[0].name,
        rate=rate,
        own=own,
        times=own / rate,
        button=as_message(KIRIKO_OT_use_film.bl_label),
    )


class KIRIKO_OT_use_film(bpy.types.Operator):
    """Give the scene the frame rate and the frame range of the film that is the picture"""

    bl_idname = "kiriko.use_film"
    bl_label = "Use Film's Rate and Range"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, [] if film_shown(context) else [NO_FILM])

    def execute(self, context: bpy.types.Context) -> set[str]:
        with telling.errors_reported(self):
            image, timing = film_shown(context)
            scene = context.scene
            if rate := rate_of(image):
                scene.render.fps = max(round(rate), 1)
                scene.render.fps_base = scene.render.fps / rate
            scene.frame_start = timing.frame_start
            scene.frame_end = timing.frame_start + timing.frame_duration - 1
            telling.report(
                self,
                "INFO",
                Message(
                    "The scene runs at {rate:.4g} frames per second, from frame {first} to {last}.",
                    rate=scene.render.fps / scene.render.fps_base,
                    first=scene.frame_start,
                    last=scene.frame_end,
                ),
            )
            return {"FINISHED"}
        return {"CANCELLED"}


def why_no_picture(context: bpy.types.Context) -> list[str]:
    """Why there is no picture whose image or shape could be another."""
    if context.mode != "OBJECT":
        return [needed.LEAVE_EDIT_MODE]

    picture = the_picture(context)
    if picture is None:
        return [Message("Select the picture: an object whose role is Picture")]

    return (
        []
        if picture.is_editable
        else [Message("The picture is linked from another file: choose its image there")]
    )


class ChoosePicture:
    """Mix-in for an operator that makes an image the picture of a plane."""

    fit: bpy.props.BoolProperty(
        name="Fit to Image",
        description="Give the plane the shape of the image, its area kept",
        default=True,
        options={"SKIP_SAVE"},  # where it was left once, the next image shall not be squeezed
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, why_no_picture(context))

    def choose(
        self, context: bpy.types.Context, image: bpy.types.Image, timing: Timing | None = None
    ) -> None:
        """Make an image the picture, and report on plane and material.

        timing : of a moving one; None: all of it from the scene's frame 1 on
        """
        picture = the_picture(context)
        owner = Message("the picture '{picture}'", picture=picture.name)
        image = as_seen(image, owner)
        with at_frame(image, number_at(image, timing, context.scene.frame_current), owner) as shown:
            check_readable(shown, owner)
            check_whole(shown, owner)
            ignored = notes_on(shown)
        before = {slot.material for slot in picture.material_slots}
        picture.kiriko.image = image
        if timing is not None:
            blender_plane.set_shown_timing(picture, image, timing)

        problems = []
        if not picture.kiriko.is_image_shown:
            problems.append(
                Message(
                    "its material is not its own to be changed, and goes on showing the same image"
                )
            )

        try:
            if self.fit:
                blender_plane.fit(context, picture)
            elif squeezed := blender_plane.squeezed_words(blender_plane.shown_as(context, picture)):
                problems.append(Message("the image is {squeezed}", squeezed=squeezed))
        except RigError as why:
            problems.append(Message("the plane keeps its shape, for {why}", why=why))

        if warning := other_rate(context):
            problems.append(warning)
        new = [slot.material for slot in picture.material_slots if slot.material not in before]
        material = (
            Message(", by the new material '{material}'", material=new[0].name) if new else ""
        )
        n = 0 if timing is None else timing.frame_duration
        text = Message(
            "The picture '{picture}' is '{image}' now{frames}{material}",
            picture=picture.name,
            image=image.name,
            frames=Message(", a sequence of {n} frames", n=n) if n else "",
            material=material,
        )
        result = context.scene.kiriko.result
        if result.source is None:  # Add Rig's report is of the picture before
            result.summary = result.notes = ""

        if problems:
            telling.report(
                self,
                "WARNING",
                Message("{text}; but {problems}.", text=text, problems=joined(problems, ", and ")),
            )
        else:
            telling.report(self, "INFO", Message("{text}.", text=text))
        for note in ignored:
            telling.report(self, "WARNING", note)


class KIRIKO_OT_choose_picture(ChoosePicture, bpy.types.Operator):
    """Make an image of this file the picture: its plane shows it, in its own shape"""

    bl_idname = "kiriko.choose_picture"
    bl_label = "Choose Picture"
    bl_options = {"REGISTER", "UNDO"}

    image: bpy.props.StringProperty(name="Image", description="Name of the image")
    library: bpy.props.StringProperty(
        name="Library",
        description="File that the image is linked from; empty for one of this file",
        options={"HIDDEN"},
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        with telling.errors_reported(self):
            image = bpy.data.images.get((self.image, self.library or None))
            if image is None:
                raise ImageError(
                    "The file has no image '{image}': open it from its own file.", image=self.image
                )
            self.choose(context, image)
            return {"FINISHED"}
        return {"CANCELLED"}


class KIRIKO_OT_open_picture(EndsWithRig, ChoosePicture, bpy.types.Operator):
    """Open an image file, a movie or the files of a sequence as the picture"""

    bl_description = (
        "Open an image file, a movie or the files of a sequence as the picture: its plane shows it,"
        " in its own shape"
    )

    bl_idname = "kiriko.open_picture"
    bl_label = "Open Picture"
    bl_options = {"REGISTER", "UNDO"}

    filepath: bpy.props.StringProperty(
        name="File",
        description="The image file",
        subtype="FILE_PATH",
        options={"SKIP_SAVE", *RELATIVE_PATH},
    )
    # all that are selected in the file browser, which tells them only to who asks
    files: bpy.props.CollectionProperty(
        type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"}
    )
    filter_image: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})
    filter_movie: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})
    # of the file browser, by its own numbers
    display_type: bpy.props.EnumProperty(
        items=[("DEFAULT", "", "", 0), ("THUMBNAIL", "", "", 3)],
        default="THUMBNAIL",
        options={"HIDDEN", "SKIP_SAVE"},
    )
    detect_sequences: bpy.props.BoolProperty(
        name="Detect Sequences",
        description="Open the consecutively numbered files around the chosen one as its frames",
        options={"SKIP_SAVE"},
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.begin_with(context.scene)
        self.detect_sequences = True
        image = blender_plane.image_of(the_picture(context))
        if image is not None and image.filepath:  # other pictures are most likely beside it
            file = Path(bpy.path.abspath(image.filepath, library=image.library))
            self.filepath = str(file).removesuffix(file.name)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        with telling.errors_reported(self):
            self.end_with(context)
            known = set(bpy.data.images)
            names = [file.name for file in self.files]
            image, timing = _opened(context, self.filepath, names, self.detect_sequences)
            if image in known:
                self.choose(context, image, timing)
            else:
                with or_none(image):
                    self.choose(context, image, timing)
            return {"FINISHED"}
        return {"CANCELLED"}


def _opened(
    context: bpy.types.Context, filepath: str, names: list[str], is_sequence: bool = False
) -> tuple[bpy.types.Image, Timing | None]:
    """The image of a file or of a sequence of files in one folder, and its timing.

    As in Blender's own Open it is loaded once, by a path as the preferences want it.

    is_sequence : look for more frames around a single numbered file
    """
    if not is_chosen(filepath):
        raise ImageError("No file is chosen: choose an image.")

    file, timing = absolute(filepath), None
    # where all were selected and none was clicked, the path is that of the folder alone
    files = [(file if file.is_dir() else file.parent) / name for name in names]
    alone = (files or [file])[0]
    if is_sequence and len(files) < 2 and alone.suffix.lower() not in bpy.path.extensions_movie:
        files = numbered_next_to(alone) or files
    if len(files) > 1:
        file, timing = sequence_of(files)
    elif files and file.is_dir():
        file = files[0]
    if not file.is_file():
        raise ImageError("There is no file {path}: choose an image.", path=file)

    # alone a file is another picture than as the first of a sequence, which may be loaded already
    wanted = {"FILE", "MOVIE"} if timing is None else {"SEQUENCE"}
    for image in bpy.data.images:
        if image.source in wanted and _file_of(image) == normpath(file):
            return image, timing

    is_relative = bpy.data.filepath and context.preferences.filepaths.use_relative_paths
    image = bpy.data.images.load(bpy.path.relpath(str(file)) if is_relative else str(file))
    with or_none(image):
        if timing is not None:
            image.source = "SEQUENCE"
        else:
            picture = the_picture(context)
            owner = Message("the picture '{picture}'", picture=picture.name)
            as_seen(image, owner, is_new=True)
    return image, timing


def _file_of(image: bpy.types.Image) -> str:
    return normpath(bpy.path.abspath(image.filepath, library=image.library))


class KIRIKO_OT_fit_picture(bpy.types.Operator):
    """Give the picture's plane the shape of its image, its area kept"""

    bl_idname = "kiriko.fit_picture"
    bl_label = "Fit to Image"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reasons = why_no_picture(context)
        if not reasons:
            try:
                if not squeezed_words(shown_as(context, the_picture(context))):
                    reasons.append(Message("The picture has the shape of its image already"))
            except (RigError, ImageError):
                pass  # told when it is pressed
        return needed.can_run(cls, reasons)

    def execute(self, context: bpy.types.Context) -> set[str]:
        picture = the_picture(context)
        with telling.errors_reported(self):
            try:
                before = fit(context, picture)
            except RigError as why:
                raise RigError(
                    "'{picture}' keeps its shape, for {why}.", picture=picture.name, why=why
                ) from None

            telling.report(
                self,
                "INFO",
                Message(
                    "'{picture}' has the shape of its image now; it was {squeezed}.",
                    picture=picture.name,
                    squeezed=squeezed_words(before),
                ),
            )
            return {"FINISHED"}

        return {"CANCELLED"}
