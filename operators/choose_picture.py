"""Choose the picture from the file's images or from disk. Its plane takes the shape of the image.

Also: the scene's frame rate and range from a movie.
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
from ..core.rig.rig import ROLES
from . import needed, reporting
from .choose_rig import EndsWithRig
from .needed import the_picture

PICTURE = next(role for role in ROLES if role.name == "PICTURE")
NO_FILM = Message("The picture is not a movie")


def film_shown(context: bpy.types.Context) -> tuple[bpy.types.Image, Timing] | None:
    """The picture's movie with its timing; None if it has none."""
    picture = the_picture(context)
    return None if picture is None else plane.film_of(picture)


def other_rate(context: bpy.types.Context) -> Message | None:
    """A warning that the movie plays at another speed in this scene; None if not."""
    film = film_shown(context)
    rate = rate_of(film[0]) if film else 0.0
    own = context.scene.render.fps / context.scene.render.fps_base
    if not rate or isclose(rate, own, rel_tol=1e-3):
        return None
    return Message(
        "'{film}' runs at {rate:.4g} fps, the scene at {own:.4g}. Press {button} to match them.",
        film=film[0].name,
        rate=rate,
        own=own,
        button=as_message(KIRIKO_OT_use_film.bl_label),
    )


class KIRIKO_OT_use_film(bpy.types.Operator):
    """Give the scene the frame rate and range of the picture's movie"""

    bl_idname = "kiriko.use_film"
    bl_label = "Use Movie's Rate and Range"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, [] if film_shown(context) else [NO_FILM])

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            image, timing = film_shown(context)
            scene = context.scene
            if rate := rate_of(image):
                scene.render.fps = max(round(rate), 1)
                scene.render.fps_base = scene.render.fps / rate
            scene.frame_start = timing.frame_start
            scene.frame_end = timing.frame_start + timing.frame_duration - 1
            reporting.report(
                self,
                "INFO",
                Message(
                    "The scene now runs at {rate:.4g} fps, frames {first} to {last}.",
                    rate=scene.render.fps / scene.render.fps_base,
                    first=scene.frame_start,
                    last=scene.frame_end,
                ),
            )
            return {"FINISHED"}
        return {"CANCELLED"}


def why_no_picture(context: bpy.types.Context) -> list[str]:
    """Reasons why the picture cannot be changed."""
    if context.mode != "OBJECT":
        return [needed.LEAVE_EDIT_MODE]

    picture = the_picture(context)
    if picture is None:
        return [Message("Select an object with the role {role}", role=PICTURE.label)]

    return (
        []
        if picture.is_editable
        else [
            Message(
                "The {noun} is linked from another file: change it there",
                noun=PICTURE.noun,
            )
        ]
    )


class ChoosePicture:
    """Mix-in for operators that set a plane's picture."""

    fit: bpy.props.BoolProperty(
        name="Fit to Image",
        description="Give the plane the shape of the image",
        default=True,
        options={
            "SKIP_SAVE"
        },  # otherwise a single choice without it would squeeze every later image
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, why_no_picture(context))

    def choose(
        self, context: bpy.types.Context, image: bpy.types.Image, timing: Timing | None = None
    ) -> None:
        """Set the picture, and report changes of plane and material.

        timing : of a moving image; None for all of it from frame 1
        """
        picture = the_picture(context)
        owner = Message("the picture '{picture}'", picture=picture.name)
        image = as_seen(image, owner)
        with at_frame(image, number_at(image, timing, context.scene.frame_current), owner) as shown:
            check_readable(shown, owner)
            check_whole(shown, owner)
            ignored = notes_on(shown)
        picture.kiriko.image = image
        if timing is not None:
            blender_plane.set_shown_timing(picture, image, timing)

        problems = []
        if not picture.kiriko.is_image_shown:
            problems.append(Message("Its material is shared and still shows the same image."))

        try:
            if self.fit:
                blender_plane.fit(context, picture)
            elif squeezed := blender_plane.squeezed_words(blender_plane.shown_as(context, picture)):
                problems.append(Message("The image is {squeezed}.", squeezed=squeezed))
        except RigError as why:
            problems.append(_unchanged(picture, why))

        if warning := other_rate(context):
            problems.append(warning)
        n = 0 if timing is None else timing.frame_duration
        text = Message(
            "'{picture}' now shows '{image}'{frames}.",
            picture=picture.name,
            image=image.name,
            frames=Message(", a sequence of {n} frames", n=n) if n else "",
        )
        result = context.scene.kiriko.result
        if result.source is None:  # Add Rig's report is about the previous picture
            result.summary = result.notes = ""

        reporting.report(self, "WARNING" if problems else "INFO", joined([text, *problems]))
        for note in ignored:
            reporting.report(self, "WARNING", note)


class KIRIKO_OT_choose_picture(ChoosePicture, bpy.types.Operator):
    """Show an image of this file as the picture, in the image's own shape"""

    bl_idname = "kiriko.choose_picture"
    bl_label = "Choose Picture"
    bl_options = {"REGISTER", "UNDO"}

    image: bpy.props.StringProperty(options={"HIDDEN"})
    library: bpy.props.StringProperty(options={"HIDDEN"})  # file of a linked image

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            image = bpy.data.images.get((self.image, self.library or None))
            if image is None:
                raise ImageError(
                    "The file has no image '{image}': open it from its own file.", image=self.image
                )
            self.choose(context, image)
            return {"FINISHED"}
        return {"CANCELLED"}


class KIRIKO_OT_open_picture(EndsWithRig, ChoosePicture, bpy.types.Operator):
    """Choose an image, movie or image sequence as the picture"""

    bl_idname = "kiriko.open_picture"
    bl_label = "Open Picture"
    bl_options = {"REGISTER", "UNDO"}

    filepath: bpy.props.StringProperty(
        subtype="FILE_PATH", options={"SKIP_SAVE", "HIDDEN", *RELATIVE_PATH}
    )
    # all files selected in the browser, which sets them only if the property exists
    files: bpy.props.CollectionProperty(
        type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"}
    )
    filter_image: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})
    filter_movie: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})
    # read by the file browser; the numbers are Blender's
    display_type: bpy.props.EnumProperty(
        items=[("DEFAULT", "", "", 0), ("THUMBNAIL", "", "", 3)],
        default="THUMBNAIL",
        options={"HIDDEN", "SKIP_SAVE"},
    )
    detect_sequences: bpy.props.BoolProperty(
        name="Detect Sequences",
        description="Open the chosen file and its consecutively numbered neighbours as a sequence",
        options={"SKIP_SAVE"},
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.begin_with(context.scene)
        self.detect_sequences = True
        image = blender_plane.image_of(the_picture(context))
        if (
            image is not None and image.filepath
        ):  # other pictures are most likely in the same folder
            file = Path(bpy.path.abspath(image.filepath, library=image.library))
            self.filepath = str(file).removesuffix(file.name)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
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


def _unchanged(picture: bpy.types.Object, why: object) -> Message:
    return Message("'{name}' keeps its size: {why}.", name=picture.name, why=why)


def _opened(
    context: bpy.types.Context, filepath: str, names: list[str], is_sequence: bool = False
) -> tuple[bpy.types.Image, Timing | None]:
    """The image and timing of a file, or of a sequence of files in one folder.

    As in Blender's own Open, an image is loaded only once, with a relative path if the preferences
    say so.

    is_sequence : include the numbered files around a single file
    """
    if not is_chosen(filepath):
        raise ImageError("No file is chosen: choose an image.")

    file, timing = absolute(filepath), None
    # if files are selected without a click, the path is the folder
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

    # a still and a sequence with the same first file are different images
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
    """Give the picture's plane the shape of its image, with the same area"""

    bl_idname = "kiriko.fit_picture"
    bl_label = "Fit to Image"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reasons = why_no_picture(context)
        if not reasons:
            try:
                if not squeezed_words(shown_as(context, the_picture(context))):
                    reasons.append(Message("The picture already has the shape of its image"))
            except (RigError, ImageError):
                pass  # reported when the button is pressed
        return needed.can_run(cls, reasons)

    def execute(self, context: bpy.types.Context) -> set[str]:
        picture = the_picture(context)
        with reporting.errors_reported(self):
            try:
                before = fit(context, picture)
            except RigError as why:
                raise RigError("{reason}", reason=_unchanged(picture, why)) from None

            reporting.report(
                self,
                "INFO",
                Message(
                    "'{picture}' now has the shape of its image. It was {squeezed}.",
                    picture=picture.name,
                    squeezed=squeezed_words(before),
                ),
            )
            return {"FINISHED"}

        return {"CANCELLED"}
