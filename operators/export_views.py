"""Export of a display with views: each view as a file, and the image for a lens sheet."""

from collections.abc import Iterator

import bpy
import numpy as np

from ..core.base.errors import ImageError
from ..core.base.messages import Message
from ..core.blender.data.image import pixels_from_image
from ..core.blender.data.paths import RELATIVE_PATH, absolute
from ..core.blender.result.write_result import Quilt, quilt_in
from ..core.files import disk, image_io
from ..core.files.quilt import interlaced, read_lens_sheet, tile_of
from . import folder, needed, reporting, watch
from .export import gamma_of, use_bundled_modules
from .to_file import ToFile


class OfQuilt(ToFile):
    """Mix-in for an operator that writes PNG files made from the quilt of the result."""

    allow_stale: bpy.props.BoolProperty(options={"SKIP_SAVE", "HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reasons = needed.unsolved(context.scene)
        image = context.scene.kiriko.result.source
        if not reasons and (image is None or quilt_in(image) is None):
            reasons = [Message("The display has no views: turn its Views on and solve")]
        return needed.can_run(cls, reasons)

    def images(self, pixels: np.ndarray, quilt: Quilt) -> Iterator[np.ndarray]:
        """The images, linear, row 0 at the top, from the pixels of a quilt."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            self.end_with(context)
            if not self.allow_stale and watch.has_changed(context):
                raise ImageError(
                    "The scene has changed since the last solve: solve again, or pass"
                    " allow_stale=True."
                )
            use_bundled_modules()
            path, source = self.path(), context.scene.kiriko.result.source
            made = list(self.images(pixels_from_image(source)[..., :3], quilt_in(source)))
            digits = len(str(len(made) - 1))
            names = [f"{path.stem}_{k:0{digits}d}.png" for k in range(len(made))]
            names = names if len(made) > 1 else [path.name]
            if not (self.overwrite or (self.is_in_dialogue and names == [path.name])):
                folder.refuse_existing(path.parent, names, Message("turn on Overwrite"))
            with folder.made(path.parent), disk.together(path.parent) as new:
                for name, pixels in zip(names, made, strict=True):
                    image_io.write(new / name, pixels, "PNG8", gamma=gamma_of(context.scene))
            written = " ... ".join(dict.fromkeys([names[0], names[-1]]))
            text = Message("Wrote {names} to '{folder}'.", names=written, folder=path.parent)
            reporting.report(self, "INFO", text)
            return {"FINISHED"}

        return {"CANCELLED"}


class KIRIKO_OT_export_views(OfQuilt, bpy.types.Operator):
    """Write each view of the display as a file, numbered from the left"""

    bl_idname = "kiriko.export_views"
    bl_label = "Export Views"
    bl_options = {"REGISTER"}

    default_name = "view.png"

    def images(self, pixels: np.ndarray, quilt: Quilt) -> Iterator[np.ndarray]:
        n = quilt.tiling[0] * quilt.tiling[1]
        return (tile_of(pixels, view, quilt.tiling) for view in range(n))


class KIRIKO_OT_export_interlaced(OfQuilt, bpy.types.Operator):
    """Write the image that a panel shows under its lens sheet, at its own resolution"""

    bl_idname = "kiriko.export_interlaced"
    bl_label = "Export Interlaced"
    bl_options = {"REGISTER"}

    default_name = "interlaced.png"

    calibration: bpy.props.StringProperty(
        name="Calibration",
        description="The device's visual.json: pitch, slope and center of its lenses, DPI, screenW"
        " and screenH of its panel",
        subtype="FILE_PATH",
        options={"SKIP_SAVE", *RELATIVE_PATH},
    )

    def images(self, pixels: np.ndarray, quilt: Quilt) -> Iterator[np.ndarray]:
        if quilt.rows > 1:
            raise ImageError("A lens sheet shows a single row of views: set Rows to 1 and solve.")
        if not self.calibration:
            raise ImageError("The lens sheet is not known: choose the device's visual.json.")
        sheet = read_lens_sheet(absolute(self.calibration))
        yield interlaced(pixels, quilt.tiling, sheet)
