"""Report: measure error against run time on the scene's own rig and write it to a folder, with what
`beside_report` tells of the head and of two eyes.
"""

import os
import platform
from collections.abc import Generator
from dataclasses import asdict
from pathlib import Path

import bpy
import numpy as np

from ..core.base.errors import ImageError
from ..core.base.messages import Message, joined
from ..core.base.steps import finish, within
from ..core.blender.paths import RELATIVE_PATH, absolute
from ..core.blender.result_numbers import write_ladder
from ..core.files import disk, image_io
from ..core.image.simulation import plate_view
from ..core.lab.measure.report import (
    NAMES,
    PLATE_NAMES,
    as_csv,
    as_json,
    as_svg,
    plate_csv,
    plate_svg,
    table,
)
from ..core.lab.measure.work_precision import BUDGET, Ladders, WorkPrecision, measure
from ..core.rig.rig import Plate, Rig
from ..core.rig.settings import Settings
from . import beside_report, folder, long_work, needed, work
from .beside_report import Beside
from .export import use_bundled_modules

MEASURED = 0.8  # of the progress

__all__ = ["measured", "names", "table", "write"]


def names(rig: Rig) -> tuple[str, ...]:
    """The files of a rig's report."""
    return (*_own_names(rig), *beside_report.names(rig))


def _own_names(rig: Rig) -> tuple[str, ...]:
    """Of them, those that tell of costs and of the plate."""
    return NAMES if _array_plate(rig) is None else (*NAMES, *PLATE_NAMES)


def _array_plate(rig: Rig) -> Plate | None:
    return next((plate for plate in rig.plates if plate.array is not None), None)


def measured(
    context: bpy.types.Context, rig: Rig, target: Path, budget: float
) -> Generator[float, None, tuple[WorkPrecision, Beside]]:
    """Measure the scene's rig, reading, and writing to the
    folder `target`, included, and what is told beside; yields progress 0..1.

    Scene and folder stay as they are.
    """
    use_bundled_modules()
    form = context.scene.kiriko.export_format

    with disk.scratch(target) as scratch:

        def save(image: np.ndarray) -> None:
            image_io.write(scratch / "source", image, form, overwrite=True)

        steps = measure(
            rig,
            work.settings_of(context.scene),
            ladders=Ladders(budget=budget),
            read=lambda: work.read(context),
            write=save if _can_write() else None,
        )
        found = yield from within(steps, 0.0, MEASURED)
    return found, (yield from within(beside_report.beside(context, rig), MEASURED, 1.0))


def _can_write() -> bool:
    """Is there a module that writes image files? The report itself is text and does without."""
    try:
        image_io.openimageio()
    except ImageError:
        return False
    return True


def write(
    target: Path, rig: Rig, settings: Settings, found: WorkPrecision, beside: Beside
) -> tuple[str, ...]:
    """Write the report's files to a folder, all of them or
    none, and return their names; ImageError when they cannot be written.
    """
    about = {
        "file": Path(bpy.data.filepath).name,
        "blender": bpy.app.version_string,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "system": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
    }
    view = finish(plate_view(work.session().plan(rig, settings)))
    if view is not None:
        about["plate"] = asdict(view)

    texts = [as_csv(found), as_json(found, about, beside.numbers), as_svg(found)]
    plate = _array_plate(rig)
    if plate is not None:
        texts += [plate_csv(plate.array), plate_svg(plate.array, plate.name)]
    files = dict(zip(_own_names(rig), texts, strict=True)) | beside.drawings

    with disk.together(target, of=names(rig)) as scratch:
        for name, text in files.items():
            disk.write_text(scratch / name, text)
    return tuple(files)


class KIRIKO_OT_report(long_work.LongWork, bpy.types.Operator):
    """Measure the cost of accuracy on this rig: error against time, as table and diagram"""

    bl_idname = "kiriko.report"
    bl_label = "Write Report"
    bl_options = {"REGISTER"}

    directory: bpy.props.StringProperty(
        name="Folder",
        description="Where to write; empty: the folder in the panel",
        subtype="DIR_PATH",
        options={"SKIP_SAVE", *RELATIVE_PATH},
    )
    overwrite: bpy.props.BoolProperty(
        name="Overwrite",
        description="Replace a report that is there already",
        options={"SKIP_SAVE"},
    )
    seconds: bpy.props.FloatProperty(
        name="Brute Force",
        description="Time for the brute-force comparison: with more, it gets to more samples a"
        " pixel",
        default=BUDGET,
        min=0.0,
        soft_max=3600.0,
        unit="TIME_ABSOLUTE",
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        scene = context.scene
        return needed.can_run(cls, needed.linked(scene) + needed.lacking(scene))

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        scene = context.scene
        path = self.directory or scene.kiriko.report_folder
        if not path:
            raise ImageError("The report has no folder: choose one.")

        target = absolute(path)
        rig = work.read(context).rig

        with folder.made(target):
            if not (self.overwrite or scene.kiriko.export_overwrite):
                folder.refuse_existing(target, names(rig), Message("allow overwriting"))
            found, beside = yield from measured(context, rig, target, self.seconds)
            files = write(target, rig, work.settings_of(scene), found, beside)

        write_ladder(scene, found.ladder)
        missing = beside.missing()
        self.level = "WARNING" if missing else "INFO"
        text = Message("Wrote {files} to '{target}'.", files=", ".join(files), target=target)
        return joined([text, *missing])
