"""Export: write the source image to a file for the display."""

from collections.abc import Sequence
from pathlib import Path

import bpy

from ..core.base.errors import ImageError
from ..core.base.messages import Message, joined
from ..core.blender.data.image import pixels_from_image
from ..core.blender.data.paths import RELATIVE_PATH, absolute
from ..core.blender.data.reports import said_by
from ..core.blender.data.stored_records import StoredNumbers
from ..core.blender.properties.rig_settings import EXPORT_FORMATS
from ..core.blender.result.write_result import Quilt, quilt_in, sections_in
from ..core.files import disk, image_io
from ..core.files.encoding import ENCODINGS, Curve, Encoding
from ..core.files.quilt import quilt_name
from ..core.rig.joined_display import Section
from . import needed, reporting, watch
from .choose_rig import EndsWithRig
from .wrapping import sentence

OLD = Message("Export the old image?")
ANYWAY = Message("Export Anyway")


def use_bundled_modules() -> None:
    """Make Blender's bundled modules importable; the bpy module needs it from 5.0 on."""
    if hasattr(bpy.utils, "expose_bundled_modules"):
        bpy.utils.expose_bundled_modules()


def target(path: str, form: str) -> Path:
    """The absolute path of a file, with the format's suffix.

    Raises
    ------
    ImageError
        There is no path, or it is relative and the .blend is not saved.
    """
    if not path:
        raise ImageError("No file is chosen for the export.")
    full = absolute(path)
    if (disk.is_there(full) and full.is_dir()) or path.endswith(("/", "\\")):
        full = full / "source"
    return image_io.named_for(full, form, bpy.path.extensions_image)


def files_of(
    path: Path, sections: Sequence[Section], quilt: Quilt | None = None
) -> dict[Section, Path]:
    """The file of each section of an image; with their parts' names if there are several, and the
    tiles of a quilt.
    """
    if quilt is not None:
        path = quilt_name(path, quilt.tiling, quilt.aspect)
    if len(sections) < 2:
        return dict.fromkeys(sections, path)
    names = (bpy.path.clean_name(section.name) for section in sections)
    return {
        section: path.with_name(f"{path.stem}_{name}{path.suffix}")
        for section, name in zip(sections, names, strict=True)
    }


def gamma_of(scene: bpy.types.Scene, name: str = "") -> Curve:
    """Gamma or encoding of the scene's display, the first or one of a name; None for sRGB."""
    for thing in needed.parts(scene).get("DISPLAY", {}):
        if name not in {"", thing.name}:
            continue
        ours = thing.kiriko.display
        if ours.encoding in ENCODINGS:
            return Encoding(ours.encoding, ours.white)
        return ours.gamma if ours.encoding == "POWER" else None
    return None


def unwritable(form: str) -> list[str]:
    """Reasons why a format cannot be written."""
    why = image_io.why_not(form)
    if why:
        use_bundled_modules()
        why = image_io.why_not(form)
    return [why] if why else []


class KIRIKO_OT_export(EndsWithRig, bpy.types.Operator):
    """Write the source image at the display's resolution, tagged with colour space and size"""

    bl_idname = "kiriko.export"
    bl_label = "Export Source Image"
    bl_options = {"REGISTER"}

    # empty: the path in the panel
    filepath: bpy.props.StringProperty(
        subtype="FILE_PATH", options={"SKIP_SAVE", "HIDDEN", *RELATIVE_PATH}
    )
    overwrite: bpy.props.BoolProperty(options={"SKIP_SAVE", "HIDDEN"})
    allow_stale: bpy.props.BoolProperty(options={"SKIP_SAVE", "HIDDEN"})
    choose: bpy.props.BoolProperty(options={"SKIP_SAVE", "HIDDEN"})  # open the file dialogue
    # read by the file dialogue: existing names turn red, and only images are listed
    check_existing: bpy.props.BoolProperty(default=True, options={"SKIP_SAVE", "HIDDEN"})
    filter_glob: bpy.props.StringProperty(
        default=";".join(f"*{suffix}" for suffix in sorted(image_io.SUFFIXES)),
        options={"SKIP_SAVE", "HIDDEN"},
    )

    form: bpy.props.EnumProperty(
        name="Format",
        description="File format; displays show 8 bit, more keeps gradients smooth",
        items=EXPORT_FORMATS,
        options={"SKIP_SAVE"},
    )

    is_in_dialogue = is_to_ask = False
    named_form = ""  # format of the name in the dialogue

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(
            cls, needed.unsolved(context.scene) + unwritable(context.scene.kiriko.export_format)
        )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        ours = context.scene.kiriko
        self.begin_with(context.scene)
        ask = context.window_manager.invoke_confirm

        with reporting.errors_reported(self):
            is_stale = not self.allow_stale and watch.has_changed(context)
            # a path relative to an unsaved file
            is_nowhere = not bpy.data.filepath and (
                self.filepath or ours.export_path or "//"
            ).startswith("//")
            needs_dialogue = is_nowhere or self.choose
            if needs_dialogue and is_stale:
                self.is_to_ask = self.allow_stale = True
                return ask(
                    self,
                    event,
                    title=OLD,
                    message=reporting.in_words(watch.CHANGED),
                    confirm_text=ANYWAY,
                )

            if needs_dialogue:
                path = self.filepath or ours.export_path
                path = Path(path).name or "source" if is_nowhere else absolute(path)
                self.form = self.named_form = self._form(context)
                self.filepath = self._named(path)
                self.is_in_dialogue = True
                context.window_manager.fileselect_add(self)
                return {"RUNNING_MODAL"}

            path = target(self.filepath or ours.export_path, self._form(context))
            source = ours.result.source
            files = files_of(path, sections_in(source), quilt_in(source)).values()
            taken = [file for file in files if disk.is_there(file)]
            is_taken = bool(taken) and not self.overwrite

            # the dialogue calls execute only after a yes
            self.overwrite |= is_taken
            self.allow_stale |= is_stale

            if is_stale:
                taken = [
                    Message("'{path}' will be replaced.", path=file)
                    for file in (taken if is_taken else ())
                ]
                return ask(
                    self,
                    event,
                    title=OLD,
                    message=reporting.in_words(joined([watch.CHANGED, *taken])),
                    confirm_text=ANYWAY,
                )

            if is_taken:
                return ask(
                    self,
                    event,
                    title=Message("Replace existing files?"),
                    message=", ".join(map(str, taken)),
                    confirm_text="Replace",
                )

            return self.execute(context)

        return {"CANCELLED"}

    def check(self, context: bpy.types.Context) -> bool:
        """Complete the name in the file dialogue, so that an existing file turns red. A typed
        suffix sets the format, and a chosen format sets the suffix.
        """
        if not Path(self.filepath).name:
            return False
        before = self.filepath, self.form
        if self.form == self.named_form:
            self.form = self._form(context)
        self.filepath, self.named_form = self._named(self.filepath), self.form
        return before != (self.filepath, self.form)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "form")
        for reason in unwritable(self.form):
            sentence(layout, context, Message("{reason}.", reason=reason), icon="ERROR")

    def _named(self, path: str) -> str:
        """A path with the suffix of the format."""
        return str(image_io.named_for(path, self.form, bpy.path.extensions_image))

    def execute(self, context: bpy.types.Context) -> set[str]:
        if self.is_to_ask:
            return self._ask_where()

        with reporting.errors_reported(self):
            self.end_with(context)
            ours = context.scene.kiriko
            if not self.allow_stale and watch.has_changed(context):
                raise ImageError(
                    "The scene has changed since the last solve: solve again, or pass"
                    " allow_stale=True."
                )

            details = StoredNumbers.read(ours.result.details).by_name
            size = None if quilt_in(ours.result.source) else details.get("display_size_m")
            use_bundled_modules()
            form = self._form(context)
            path = target(self.filepath or ours.export_path, form)

            # the dialogue showed exactly this name in red
            source = ours.result.source
            pixels = pixels_from_image(source)[..., :3]
            files = files_of(path, sections_in(source), quilt_in(source))
            for section, file in files.items():
                is_shown = self.is_in_dialogue and str(file) == self.filepath
                image_io.write(
                    file,
                    section.of(pixels),
                    form,
                    size=tuple(size) if size else None,
                    gamma=gamma_of(context.scene, section.name),
                    overwrite=self.overwrite or is_shown,
                )

            if self.is_in_dialogue and context.scene.is_editable:
                ours.export_path = str(path)
                ours.export_format = form

            written = "', '".join(map(str, files.values()))
            reporting.report(self, "INFO", Message("Wrote '{written}'.", written=written))
            return {"FINISHED"}

        return {"CANCELLED"}

    def _form(self, context: bpy.types.Context) -> str:
        is_given = self.is_in_dialogue or self.properties.is_property_set("form")
        form = self.form if is_given else context.scene.kiriko.export_format
        return image_io.format_for(self.filepath, form)

    def _ask_where(self) -> set[str]:
        """Start again after a yes to the old image: an operator of a dialogue cannot open another
        one.
        """
        try:
            bpy.ops.kiriko.export("INVOKE_DEFAULT", allow_stale=True, choose=self.choose)
            return {"FINISHED"}
        except RuntimeError as error:  # with the operator's report
            reporting.report(self, "ERROR", said_by(error))
            return {"CANCELLED"}
