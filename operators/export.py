"""Export: write the source image to a file for the display."""

from pathlib import Path

import bpy

from ..core.base.errors import ImageError
from ..core.base.messages import Message
from ..core.blender.data.image import pixels_from_image
from ..core.blender.data.paths import RELATIVE_PATH, absolute
from ..core.blender.data.reports import said_by
from ..core.blender.data.stored_records import StoredNumbers
from ..core.blender.properties.rig_settings import EXPORT_FORMATS
from ..core.files import disk, image_io
from . import needed, telling, watch
from .choose_rig import EndsWithRig
from .wrapping import sentence

OLD = Message("Export the old image?")
ALL_THE_SAME = Message("Export All the Same")


def use_bundled_modules() -> None:
    """Let Python import the modules that Blender ships (needed from 5.0 in the bpy module)."""
    if hasattr(bpy.utils, "expose_bundled_modules"):
        bpy.utils.expose_bundled_modules()


def target(path: str, form: str) -> Path:
    """The file that a path from the interface means: absolute, with the format's suffix.

    Raises
    ------
    ImageError
        There is no path, or it is relative to a .blend that has not been saved.
    """
    if not path:
        raise ImageError("The export has no path: choose a file.")
    full = absolute(path)
    if (disk.is_there(full) and full.is_dir()) or path.endswith(("/", "\\")):
        full = full / "source"
    return image_io.named_for(full, form, bpy.path.extensions_image)


def gamma_of(scene: bpy.types.Scene) -> float | None:
    """The power by which a scene's display encodes light; None: as sRGB does."""
    for thing in needed.parts(scene).get("DISPLAY", {}):
        ours = thing.kiriko.display
        return ours.gamma if ours.encoding == "POWER" else None
    return None


def unwritable(form: str) -> list[str]:
    """The reason why a format cannot be exported, where there is one."""
    why = image_io.why_not(form)
    if why:
        use_bundled_modules()
        why = image_io.why_not(form)
    return [why] if why else []


class KIRIKO_OT_export(EndsWithRig, bpy.types.Operator):
    """Write the source image to a file in the display's own pixels, with colour space and size"""

    bl_idname = "kiriko.export"
    bl_label = "Export Source Image"
    bl_options = {"REGISTER"}

    filepath: bpy.props.StringProperty(
        name="File",
        description="Where to write; empty: the path in the panel",
        subtype="FILE_PATH",
        options={"SKIP_SAVE", *RELATIVE_PATH},
    )
    overwrite: bpy.props.BoolProperty(
        name="Overwrite",
        description="Replace the file if there is one already",
        options={"SKIP_SAVE", "HIDDEN"},
    )
    allow_stale: bpy.props.BoolProperty(
        name="Allow Stale",
        description="Export the image although the scene has changed since it was solved",
        options={"SKIP_SAVE", "HIDDEN"},
    )
    choose: bpy.props.BoolProperty(
        name="Choose File",
        description="Ask for the file, beginning with the one of the last export",
        options={"SKIP_SAVE", "HIDDEN"},
    )
    # the file dialogue asks an operator for these: show
    # names that are taken in red, and only images
    check_existing: bpy.props.BoolProperty(default=True, options={"SKIP_SAVE", "HIDDEN"})
    filter_glob: bpy.props.StringProperty(
        default=";".join(f"*{suffix}" for suffix in sorted(image_io.SUFFIXES)),
        options={"SKIP_SAVE", "HIDDEN"},
    )

    form: bpy.props.EnumProperty(
        name="Format",
        description="File format and bit depth",
        items=EXPORT_FORMATS,
        options={"SKIP_SAVE"},
    )

    is_in_dialogue = is_to_ask = False
    named_form = ""  # by which the name in the dialogue was completed

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(
            cls, needed.unsolved(context.scene) + unwritable(context.scene.kiriko.export_format)
        )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        ours = context.scene.kiriko
        self.begin_with(context.scene)
        ask = context.window_manager.invoke_confirm

        with telling.errors_reported(self):
            is_stale = not self.allow_stale and watch.has_changed(context)
            # the path is relative to a file that was never saved
            is_nowhere = not bpy.data.filepath and (
                self.filepath or ours.export_path or "//"
            ).startswith("//")
            is_asked = is_nowhere or self.choose
            if is_asked and is_stale:
                self.is_to_ask = self.allow_stale = True
                return ask(
                    self,
                    event,
                    title=OLD,
                    message=telling.in_words(watch.CHANGED),
                    confirm_text=ALL_THE_SAME,
                )

            if is_asked:
                path = self.filepath or ours.export_path
                path = Path(path).name or "source" if is_nowhere else absolute(path)
                self.form = self.named_form = self._form(context)
                self.filepath = self._named(path)
                self.is_in_dialogue = True
                context.window_manager.fileselect_add(self)
                return {"RUNNING_MODAL"}

            path = target(self.filepath or ours.export_path, self._form(context))
            is_taken = disk.is_there(path) and not self.overwrite

            # only an answer of yes leads to execute
            self.overwrite |= is_taken
            self.allow_stale |= is_stale

            if is_stale:
                taken = Message(" The file '{path}' is replaced.", path=path) if is_taken else ""
                return ask(
                    self,
                    event,
                    title=OLD,
                    message=telling.in_words(
                        Message("{changed}{taken}", changed=watch.CHANGED, taken=taken)
                    ),
                    confirm_text=ALL_THE_SAME,
                )

            if is_taken:
                return ask(
                    self,
                    event,
                    title=Message("Replace the file?"),
                    message=str(path),
                    confirm_text="Replace",
                )

            return self.execute(context)

        return {"CANCELLED"}

    def check(self, context: bpy.types.Context) -> bool:
        """Complete the name in the file dialogue, so that the name of an existing file is red. A
        suffix that is typed chooses the format, and a format that is chosen sets the suffix.
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

        with telling.errors_reported(self):
            self.end_with(context)
            ours = context.scene.kiriko
            if not self.allow_stale and watch.has_changed(context):
                raise ImageError(
                    "The scene has changed since: solve again, or export the old image with"
                    " allow_stale=True."
                )

            details = StoredNumbers.read(ours.result.details).by_name
            size = details.get("display_size_m")
            use_bundled_modules()
            form = self._form(context)
            path = target(self.filepath or ours.export_path, form)

            # the dialogue showed this very name in red; another one, with a suffix, it did not
            is_shown = self.is_in_dialogue and str(path) == self.filepath
            written = image_io.write(
                path,
                pixels_from_image(ours.result.source)[..., :3],
                form,
                size=tuple(size) if size else None,
                gamma=gamma_of(context.scene),
                overwrite=self.overwrite or is_shown,
            )

            if self.is_in_dialogue and context.scene.is_editable:
                ours.export_path = str(written)
                ours.export_format = form

            telling.report(self, "INFO", Message("Wrote '{written}'.", written=written))
            return {"FINISHED"}

        return {"CANCELLED"}

    def _form(self, context: bpy.types.Context) -> str:
        is_given = self.is_in_dialogue or self.properties.is_property_set("form")
        form = self.form if is_given else context.scene.kiriko.export_format
        return image_io.format_for(self.filepath, form)

    def _ask_where(self) -> set[str]:
        """The old image is wanted: begin again, with that answer.
        An operator of a dialogue cannot open another.
        """
        try:
            bpy.ops.kiriko.export("INVOKE_DEFAULT", allow_stale=True, choose=self.choose)
            return {"FINISHED"}
        except RuntimeError as error:  # its report
            telling.report(self, "ERROR", said_by(error))
            return {"CANCELLED"}
