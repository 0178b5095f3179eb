"""Export of a display with views: each view as a file, and the image for a lens sheet."""

from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np

from ..core.base.errors import ImageError
from ..core.base.messages import Message
from ..core.blender.data.image import pixels_from_image
from ..core.blender.data.paths import RELATIVE_PATH, absolute
from ..core.blender.result.write_result import quilt_in
from ..core.files import disk, image_io
from ..core.files.quilt import LensSheet, interlaced, read_lens_sheet, tile_of, view_name
from . import folder, needed, reporting, watch
from .export import gamma_of, use_bundled_modules
from .to_file import ToFile

NO_QUILT = Message("The display has no views: turn its Views on and solve")


class OfQuilt(ToFile):
    """Mix-in for an operator that writes PNG files made from the quilt of the result."""

    allow_stale: bpy.props.BoolProperty(options={"SKIP_SAVE", "HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reasons = needed.unsolved(context.scene)
        image = context.scene.kiriko.result.source
        if not reasons and (image is None or quilt_in(image) is None):
            reasons = [NO_QUILT]
        return needed.can_run(cls, reasons)

    def images(
        self, quilt: np.ndarray, tiling: tuple[int, int], path: Path
    ) -> Iterator[tuple[Path, np.ndarray]]:
        """The files and their pixels, linear, row 0 at the top."""
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
            path = self.path()
            source = context.scene.kiriko.result.source
            quilt = pixels_from_image(source)[..., :3]
            made = dict(self.images(quilt, quilt_in(source).tiling, path))
            names = [file.name for file in made]
            is_agreed = self.is_in_dialogue and names == [path.name]
            if not (self.overwrite or is_agreed):
                folder.refuse_existing(path.parent, names, Message("turn on Overwrite"))
            with folder.made(path.parent), disk.together(path.parent) as new:
                for file, pixels in made.items():
                    image_io.write(new / file.name, pixels, "PNG8", gamma=gamma_of(context.scene))
            reporting.report(
                self,
                "INFO",
                Message(
                    "Wrote {names} to '{folder}'.",
                    names=" ... ".join(dict.fromkeys([names[0], names[-1]])),
                    folder=path.parent,
                ),
            )
            return {"FINISHED"}

        return {"CANCELLED"}


class KIRIKO_OT_export_views(OfQuilt, bpy.types.Operator):
    """Write each view of the display as a file, numbered from the left"""

    bl_idname = "kiriko.export_views"
    bl_label = "Export Views"
    bl_options = {"REGISTER"}

    default_name = "view.png"

    def images(
        self, quilt: np.ndarray, tiling: tuple[int, int], path: Path
    ) -> Iterator[tuple[Path, np.ndarray]]:
        n = tiling[0] * tiling[1]
        for view in range(n):
            yield view_name(path, view, n), tile_of(quilt, view, tiling)


class KIRIKO_OT_export_interlaced(OfQuilt, bpy.types.Operator):
    """Write the image that a panel shows under its lens sheet, at its own resolution"""

    bl_idname = "kiriko.export_interlaced"
    bl_label = "Export Interlaced"
    bl_options = {"REGISTER"}

    default_name = "interlaced.png"

    calibration: bpy.props.StringProperty(
        name="Calibration",
        description="The device's visual.json, with the numbers of its lens sheet; empty for the"
        " numbers below",
        subtype="FILE_PATH",
        options={"SKIP_SAVE", *RELATIVE_PATH},
    )
    pitch: bpy.props.FloatProperty(
        name="Lenses an Inch", description="Across the lenses", default=50.0, min=0.1, precision=5
    )
    slope: bpy.props.FloatProperty(
        name="Slope",
        description="Drop of a lens for each unit to the right",
        default=-7.0,
        precision=5,
    )
    centre: bpy.props.FloatProperty(
        name="Centre",
        description="Shift of the lenses to the right, in lenses",
        default=0.0,
        precision=5,
    )
    per_inch: bpy.props.FloatProperty(
        name="Pixels an Inch", description="Of the panel", default=324.0, min=1.0, precision=3
    )
    size: bpy.props.IntVectorProperty(
        name="Resolution",
        description="Width and height of the panel in pixels",
        size=2,
        default=(1536, 2048),
        min=1,
        max=32768,
    )

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(self, "calibration")
        column = layout.column()
        column.active = not self.calibration
        for name in ("pitch", "slope", "centre", "per_inch", "size"):
            column.prop(self, name)

    def images(
        self, quilt: np.ndarray, tiling: tuple[int, int], path: Path
    ) -> Iterator[tuple[Path, np.ndarray]]:
        if self.calibration:
            sheet = read_lens_sheet(absolute(self.calibration))
        else:
            sheet = LensSheet(self.pitch, self.slope, self.centre, self.per_inch, *self.size)
            sheet.check()
        yield path, interlaced(quilt, tiling, sheet)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        image = context.scene.kiriko.result.source
        quilt = None if image is None else quilt_in(image)
        if quilt is not None and quilt.rows > 1:
            text = Message("A lens sheet shows a single row of views: set Rows to 1 and solve")
            return needed.can_run(cls, [text])
        return super().poll(context)
