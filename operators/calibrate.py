"""Calibration of a real bench: draw the lattice, find errors from its points, apply or remove
them.
"""

from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..core.base.arrays import Floats
from ..core.base.errors import ImageError, RigError
from ..core.base.messages import Message, joined, quoted
from ..core.base.steps import subprogress
from ..core.bench.offset import parameters, with_amounts, with_offset
from ..core.blender.data.camera_viewer import seats_of, viewer_of
from ..core.blender.data.image import encoded_image
from ..core.blender.data.paths import RELATIVE_PATH, absolute
from ..core.blender.data.stored_records import Offset, Sentences, StoredNumbers
from ..core.blender.read.plane import plane_size
from ..core.blender.result.applied_calibration import keep_offset, put_into_scene
from ..core.blender.result.write_result import write_solution
from ..core.files import disk
from ..core.files.picture_file import read_photograph
from ..core.image.flat_picture import view_of_picture
from ..core.lab.calibrate.drawn import Lattice
from ..core.lab.calibrate.file import check, check_picture, check_way, missing_borders, read_points
from ..core.lab.calibrate.fit import BenchFit, Extra, extra_photographs, fit
from ..core.lab.calibrate.match import match
from ..core.lab.calibrate.misalignment import FEWEST, Bench
from ..core.lab.calibrate.photograph import find_points
from ..core.rig.rig import Rig
from . import long_work, look_over, needed, reporting, watch, work
from .export import use_bundled_modules

DETERMINED = (
    0.7  # of its tolerance: an amount with a smaller standard error is determined by the photograph
)
TEXTS = {".csv", ".txt", ".tsv"}  # suffixes of position files; any other file is an image


class KIRIKO_OT_calibrate(long_work.LongWork, bpy.types.Operator):
    """Find the errors of the real bench from a photograph of the lattice, then solve again"""

    bl_idname = "kiriko.calibrate"
    bl_label = "Calibrate"
    bl_options = {"REGISTER", "UNDO"}

    filepath: bpy.props.StringProperty(
        name="File",
        description="Photograph or CSV; empty: the one in the panel",
        subtype="FILE_PATH",
        options={"SKIP_SAVE", *RELATIVE_PATH},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, needed.missing_parts(context.scene))

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        path = self.filepath or context.scene.kiriko.calibration.filepath
        if not path:
            raise ImageError(
                "There is nothing to calibrate from: choose a photograph or a CSV of points."
            )

        use_bundled_modules()
        reading = work.read(context)
        reading.rig.check()
        yield 0.0

        return (yield from calibrated(context, reading, absolute(path)))


def calibrated(context: bpy.types.Context, reading: Any, path: Path) -> Generator[float, None, str]:
    """Fit, solve again, and store the result; returns the report.

    The last step changes the scene.
    """
    scene = context.scene
    ours = context.scene.kiriko.calibration
    is_moved = ours.keep == "SCENE"
    digest = disk.digest(path)
    found_before = StoredNumbers.read(ours.found).by_name
    if found_before.get("digest") == digest and found_before.get("kept") == "SCENE":
        raise RigError(
            "'{file}' is already applied: solve, and take another photograph.",
            file=path.name,
        )

    offset = Offset.read(ours.offset).sets
    if found_before.get("digest") == digest and found_before.get("kept") == "OFFSET" and offset:
        # The same file again, perhaps with other tolerances, replaces its earlier offset.
        offset.pop()

    first = seats_of(scene)[0].camera
    if first != viewer_of(scene):
        raise RigError(
            "Photographs are taken from the first viewer: choose '{viewer}' in the list of"
            " viewers.",
            viewer=first.name,
        )

    rig = with_offset(reading.drawn, offset)[0]
    settings = work.settings_of(scene)
    lattice = Lattice(ours.columns, ours.rows, ours.margin)
    expected = view_of_picture(rig.picture_place, rig.viewer, lattice.uv)
    tolerances = tolerances_of(ours)
    among = [parameter for parameter in parameters(rig) if tolerances[parameter.kind] > 0]
    if not among:
        raise RigError("All Expected Errors are 0: set at least one above 0.")

    expect = np.array([tolerances[parameter.kind] for parameter in among])
    bench = Bench(rig, settings, expected, among)
    size = rig.display.width, rig.display.height
    is_shown = ((bench.display >= 0) & (bench.display <= size)).all(axis=1)
    if is_shown.sum() < FEWEST:
        raise RigError(
            "Only {n_shown} of {n_points} lattice points are visible: check its columns, rows and"
            " margin.",
            n_shown=is_shown.sum(),
            n_points=len(expected),
        )

    due = np.where(is_shown[:, None], expected, np.nan)
    measured, scale = measured_points(path, lattice, due, rig, tuple(ours.size))
    noise = ours.noise * scale
    found = yield from subprogress(fit(bench, measured, expect, noise), 0.05, 0.5)
    extras = yield from subprogress(extra_photographs(bench, found, expect, noise), 0.5, 0.6)
    text = fit_report(found)
    odd = [lattice.name(k) for k in np.flatnonzero(found.left_out)]
    about = {"measured": path.name, "digest": digest, "kept": ours.keep, "left_out": odd}
    details = StoredNumbers({**about, **as_data(bench, found, expect, extras)}).text()
    amounts = {parameter.name: float(x) for parameter, x in zip(among, found.amounts, strict=True)}

    if ours.keep == "NONE":
        ours.found = details
        return Message("{text} The fit was discarded.", text=text)

    fitted = replace(reading, rig=with_amounts(rig, amounts)[0])
    solution = yield from subprogress(work.session().solve(fitted.rig, settings), 0.6, 1.0)
    stored = (
        put_into_scene(scene, fitted, lambda: work.read(context))
        if is_moved
        else keep_offset(scene, [*offset, amounts])
    )
    with stored:
        text = joined([text, write_solution(scene, look_over.read_to_solve(context), solution)])

    ours.found = details
    return text


def tolerances_of(ours: bpy.types.PropertyGroup) -> dict[str, float]:
    """Expected errors from the settings, by kind of parameter, in the parameters' units."""
    angles = {kind: float(np.degrees(getattr(ours, kind))) for kind in ("turn", "crossing")}
    return {
        **{kind: getattr(ours, kind) for kind in ("shift", "index", "mirror", "focal")},
        **angles,
    }


def measured_points(
    path: Path, lattice: Lattice, expected: Floats, rig: Rig, size: tuple[int, int]
) -> tuple[Floats, float]:
    """Points of the lattice (m, 2) in viewer px, NaN if not measured; and viewer px per pixel
    given.

    path : of a photograph, or of a CSV of positions in an image of a given size; (0, 0) for the
        viewer's
    expected : (m, 2) viewer px, NaN for points that the display does not show
    """
    viewer_size = np.array([rig.viewer.width, rig.viewer.height], float)
    if path.suffix.lower() in TEXTS:
        if bool(size[0]) != bool(size[1]):
            raise ImageError(
                "The photograph has {width} x {height} pixels: give both numbers, or 0 for both.",
                width=size[0],
                height=size[1],
            )

        size = np.array(size, float) if min(size) else viewer_size
        scale = _scale(path, size, viewer_size)
        points = read_points(path, lattice, expected / scale)
    else:
        photograph = read_photograph(path)
        size = np.array(photograph.shape[1::-1], float)
        scale = _scale(path, size, viewer_size)
        points = match(find_points(photograph), expected / scale, lattice)
        is_unsure = bool(missing_borders(points, expected, lattice))
        wanted = rig.picture_of(rig.viewer).image
        check_picture(points, lattice, photograph, wanted, is_unsure)

    check(points, lattice)
    check_way(points, expected / scale)
    return points * scale, float(scale.mean())


def _scale(path: Path, size: Floats, viewer_size: Floats) -> Floats:
    """Viewer px (2,) per pixel of an image; ImageError if their shapes differ by more than
    rounding.
    """
    scale = viewer_size / size
    if abs(size[0] * viewer_size[1] - size[1] * viewer_size[0]) > max(
        size.max(), viewer_size.max()
    ):
        raise ImageError(
            "'{file}' has {width:.0f} x {height:.0f} pixels, the viewer {viewer_width:.0f} x"
            " {viewer_height:.0f}: give the viewer the photograph's aspect ratio.",
            file=path.name,
            width=size[0],
            height=size[1],
            viewer_width=viewer_size[0],
            viewer_height=viewer_size[1],
        )

    return scale


def fit_report(found: BenchFit) -> str:
    """A fit in one sentence."""
    n = int(found.left_out.sum())
    odd = Message("; {n} outlier{s} left out", n=n, s="s" if n == 1 else "") if n else ""
    return Message(
        "The lattice was off by {before:.3g} viewer px; after the fit by {after:.3g} ({n_points}"
        " of {n_measured} points{odd}).",
        before=found.before,
        after=found.after,
        n_points=found.n_points,
        n_measured=found.n_measured,
        odd=odd,
    )


def as_data(
    bench: Bench, found: BenchFit, tolerances: Floats, extras: list[Extra]
) -> dict[str, Any]:
    """A fit as plain data, for the panel and for JSON."""
    names = [parameter.name for parameter in bench.parameters]
    alike, still = found.groups()
    rows = zip(bench.parameters, found.amounts, found.errors, tolerances, strict=True)
    return {
        "points": found.n_points,
        "of": len(bench.view),
        "measured_points": found.n_measured,
        "before_viewer_px": found.before,
        "after_viewer_px": found.after,
        "condition": _number(found.condition),
        "amounts": [
            {
                "name": p.name,
                "unit": p.unit,
                "amount": float(a),
                "error": float(e),
                "tolerance": float(t),
            }
            for p, a, e, t in rows
        ],
        "correlation": np.round(found.correlation, 4).tolist(),
        "alike": [[names[k] for k in group] for group in alike],
        "still": [names[k] for k in still],
        "extra_photographs": [
            {
                "where": extra.where,
                "said": Sentences.of(extra.where).text(),
                "gain_bits": extra.gain,
                "condition": _number(extra.condition),
                "errors": dict(zip(names, map(float, extra.errors), strict=True)),
            }
            for extra in extras
        ],
    }


def _number(x: float) -> float | None:
    """The number if JSON can hold it."""
    return float(x) if np.isfinite(x) else None


NAME = "Kiriko Calibration"
NO_CALIBRATION = Message("No calibration yet: press Calibrate first")
SIDE = 2048  # px


def _pixels(context: bpy.types.Context, picture: bpy.types.Object) -> tuple[int, int]:
    """Size, px, of a lattice image in the shape of its plane, so that dots are round."""
    try:
        width, height = plane_size(context, picture)
    except RigError:
        return SIDE, SIDE
    longer = max(width, height)
    return max(1, round(SIDE * width / longer)), max(1, round(SIDE * height / longer))


class KIRIKO_OT_lattice_picture(bpy.types.Operator):
    """Use the lattice as the picture, to photograph it through the real glass"""

    bl_idname = "kiriko.lattice_picture"
    bl_label = "Show Lattice"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        scene = context.scene
        is_there = scene.kiriko.picture_source == "IMAGE" or needed.has_part(scene, "PICTURE")
        return needed.can_run(cls, [] if is_there else [needed.NEEDED["PICTURE"]])

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        ours = context.scene.kiriko.calibration

        with reporting.errors_reported(self):
            lattice = Lattice(ours.columns, ours.rows, ours.margin)
            style = ours.style.lower()

            if scene.kiriko.picture_source == "IMAGE":
                image = encoded_image(NAME, lattice.image(SIDE, SIDE, style))
                scene.kiriko.picture_image = image
                for one in scene.kiriko.viewers:
                    one.image = one.image and image
                where = quoted([image.name])
            else:
                picture = next(iter(needed.parts(scene)["PICTURE"]))
                image = encoded_image(NAME, lattice.image(*_pixels(context, picture), style))
                picture.kiriko.image, where = image, quoted([picture.name])

            text = Message(
                "{where} shows the lattice: solve, show it on the display, and photograph the"
                " view.",
                where=where,
            )
            reporting.report(self, "INFO", text)
            return {"FINISHED"}

        return {"CANCELLED"}


def without_offset(scene: bpy.types.Scene) -> list[str]:
    """Reason to refuse if there is no calibration to apply or remove."""
    return [] if scene.kiriko.calibration.offset else [NO_CALIBRATION]


class KIRIKO_OT_apply_calibration(bpy.types.Operator):
    """Move the objects and set their optical properties to the calibrated values"""

    bl_idname = "kiriko.apply_calibration"
    bl_label = "Apply to Scene"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(
            cls, without_offset(context.scene) + needed.missing_parts(context.scene)
        )

    def execute(self, context: bpy.types.Context) -> set[str]:
        n = len(Offset.read(context.scene.kiriko.calibration.offset).sets)
        with reporting.errors_reported(self):
            reading = work.read(context)
            reading.rig.check()
            is_current = not watch.has_changed(context)

            with put_into_scene(context.scene, reading, lambda: work.read(context)):
                result = context.scene.kiriko.result
                # the rig is the same as before, in other numbers
                if result.solved_for and is_current:
                    result.solved_for = work.scene_now(context).as_text()

                reporting.report(
                    self,
                    "INFO",
                    Message(
                        "Applied {n} calibration{s} to the scene.",
                        n=n,
                        s="s" if n > 1 else "",
                    ),
                )

            return {"FINISHED"}

        return {"CANCELLED"}


class KIRIKO_OT_remove_calibration(bpy.types.Operator):
    """Remove the calibration"""

    bl_idname = "kiriko.remove_calibration"
    bl_label = "Remove Offset"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, without_offset(context.scene))

    def execute(self, context: bpy.types.Context) -> set[str]:
        ours = context.scene.kiriko.calibration
        ours.offset = ours.found = ""
        reporting.report(self, "INFO", Message("Calibration removed: solve again."))
        return {"FINISHED"}
