"""Report: error against cost, and what several viewers, a moving head and two eyes see.

The latter appears if the rig has several viewers, a head before a flat picture, or a pair of eyes.
"""

import argparse
import json
import os
import platform
from collections.abc import Callable, Generator, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, get_args

import bpy
import numpy as np

from ..core.base.errors import ImageError, KirikoError
from ..core.base.messages import Message, joined
from ..core.base.steps import hold_progress, run_steps, subprogress
from ..core.bench.part_sizes import plane_of
from ..core.blender.data.paths import RELATIVE_PATH, absolute
from ..core.blender.result.result_numbers import write_ladder
from ..core.files import disk, image_io
from ..core.image.simulation import plate_view
from ..core.lab.atlas.heads import check_viewer
from ..core.lab.measure import head_box, head_range, sharpness
from ..core.lab.measure import two_eyes as pairs
from ..core.lab.measure.cost_report import (
    NAMES,
    PLATE_NAMES,
    as_csv,
    as_json,
    as_svg,
    plate_csv,
    plate_svg,
    table,
)
from ..core.lab.measure.head_range import LEAST, LIMIT, Walk
from ..core.lab.measure.two_eyes import pair_of, two_eyes
from ..core.lab.measure.viewer_errors import sharpness as edge_sharpness
from ..core.lab.measure.viewer_errors import viewer_reports
from ..core.lab.measure.work_precision import BUDGET, Ladders, WorkPrecision, measure
from ..core.light.mesh_cache import MeshCache
from ..core.rig.rig import Plate, Rig
from ..core.rig.settings import Disagreement, Settings
from ..core.solve.picture_coverage import check_seen
from . import folder, needed, reporting, work
from .cli import to_folder
from .export import use_bundled_modules
from .eye_box import OffFromStartError, begin, check_limit, check_share, of_blended
from .to_file import FOR_SCRIPTS, AsksToReplace
from .viewer_reports import CONFLICT, lines, reports_of

NUMBERS = "eyes.json"  # file name of the verb, which a report adds to report.json

FOUND = 0.8  # progress of an eye box before its curves


@dataclass
class ReportExtras:
    """Figures by their keys in report.json, drawings by file, and errors by the label of the work.

    of_viewers : figures of several viewers, as a result stores them
    no_pair : reason why two viewers before a flat picture are not a pair of eyes
    """

    of_viewers: dict[str, Any] = field(default_factory=dict)
    numbers: dict[str, Any] = field(default_factory=dict)
    drawings: dict[str, str] = field(default_factory=dict)
    errors: dict[str, Exception] = field(default_factory=dict)
    no_pair: Message | None = None

    def lines(self, scene: bpy.types.Scene) -> Iterator[Message]:
        """Figures of several viewers as the panel words them, and the mode of settling for the
        boxes.
        """
        yield from lines(scene, self.of_viewers)
        if self.no_pair is not None and "no_pair" not in self.of_viewers:
            yield self.no_pair
        for one in self.numbers.get("sharpness", ()):
            yield sharpness.in_words(one)
        if {"eye_box", "head_box"} & self.numbers.keys():
            yield from of_blended(scene)

    def missing(self, translate: reporting.Translate | None = None) -> list[str]:
        """A sentence on each part that failed, worded like any error."""
        return [
            reporting.sentence(error, label, translate=translate)
            for label, error in self.errors.items()
        ]


def check_head(rig: Rig) -> None:
    """Raise RigError unless the first viewer has a head that can move before a flat picture."""
    check_viewer(rig, rig.viewer)
    plane_of(rig)


def check_pair(rig: Rig) -> None:
    """Raise RigError unless the viewers are a pair of eyes before a flat picture."""
    pair_of(rig)
    plane_of(rig)


def _has_several(rig: Rig) -> bool:
    """Whether there are several viewers of one flat picture."""
    return len(rig.viewers) > 1 and not rig.has_own_images and _has(plane_of, rig)


def _has(check: Callable[[Rig], object], rig: Rig) -> bool:
    return _refused(check, rig) is None


def _refused(check: Callable[[Rig], object], rig: Rig) -> KirikoError | None:
    """The reason with which a check refuses a rig."""
    try:
        rig.check()
        check(rig)
    except KirikoError as reason:
        return reason
    return None


def extra_names(rig: Rig) -> tuple[str, ...]:
    """Files of the drawings that `find_extras` makes."""
    found = (
        (check_head, head_range.FILE),
        (check_pair, pairs.FILE),
        (head_box.check_box, head_box.FILE),
        (sharpness.check_pupils, sharpness.FILE),
    )
    return tuple(name for check, name in found if _has(check, rig))


def find_extras(
    context: bpy.types.Context, rig: Rig, limit: float = LIMIT, least: float = LEAST
) -> Generator[float, None, ReportExtras]:
    """Find everything a report contains besides costs; yields progress 0..1.

    A part that fails is left out without affecting the others.
    """
    found = ReportExtras()
    parts = (
        ("eye_box", "Eye Box", _has(check_head, rig), eye_box_of(context, rig, limit, least), 0.6),
        ("two_eyes", "Two Eyes", _has(check_pair, rig), _two_eyes_of(context, rig), 0.7),
        ("head_box", "Head Box", _has(head_box.check_box, rig), _head_box_of(context, rig), 0.88),
        (
            "sharpness",
            "Sharpness",
            _has(sharpness.check_pupils, rig),
            _sharpness_of(context, rig),
            0.9,
        ),
        ("viewers", "Viewers", len(rig.viewers) > 1, _seen_by_each(context, rig, found), 0.93),
        ("disagreement", "Disagreement", _has_several(rig), ways_to_settle(context, rig), 1.0),
    )
    start = 0.0
    if len(rig.viewers) == 2 and (why := _refused(check_pair, rig)) is not None:
        found.no_pair = why.message
        found.numbers["missing"] = {"two_eyes": str(why)}
    for name, label, is_there, steps, end in parts:
        if is_there:
            try:
                figures, drawings = yield from subprogress(steps, start, end)
            except Exception as error:
                found.errors[label] = error
                missing = found.numbers.setdefault("missing", {})
                missing[name] = str(error) or type(error).__name__
            else:
                if len(rig.viewers) > 1 and name.endswith("_box"):
                    figures["disagreement"] = "sharp"  # in any mode
                found.numbers[name] = figures
                found.drawings |= drawings
        start = end
    return found


def _seen_by_each(
    context: bpy.types.Context, rig: Rig, found: ReportExtras
) -> Generator[float, None, tuple[list[dict[str, Any]], dict[str, str]]]:
    """What each viewer sees, the worst first, and their conflict, as after a solve; no drawing.

    Yields progress 0..1.
    """
    settings = work.settings_of(context.scene)
    solution = yield from subprogress(work.session().solve(rig, settings), 0.0, 0.9)
    reports = yield from subprogress(reports_of(solution, settings), 0.9, 1.0)
    found.of_viewers = reports.numbers
    if CONFLICT in reports.numbers:
        found.numbers[CONFLICT] = reports.numbers[CONFLICT]
    return reports.numbers["viewers"], {}


def _two_eyes_of(
    context: bpy.types.Context, rig: Rig
) -> Generator[float, None, tuple[dict[str, Any], dict[str, str]]]:
    """Figures and a drawing of what a pair of eyes sees; yields progress 0..1."""
    cache = MeshCache()
    work.session().lend(cache)
    eyes = yield from two_eyes(rig, work.settings_of(context.scene), kept=cache)
    return pairs.as_data(eyes), {pairs.FILE: pairs.as_svg(rig, eyes)}


def _sharpness_of(
    context: bpy.types.Context, rig: Rig
) -> Generator[float, None, tuple[list[dict[str, Any]], dict[str, str]]]:
    """Figures and a drawing of the sharpness through pupils; yields progress 0..1."""
    plan = work.session().plan(rig, work.settings_of(context.scene))
    found = yield from sharpness.sharpness_of(plan)
    figures = [one.as_data() for one in found]
    return figures, {sharpness.FILE: sharpness.as_svg(rig, found)}


def _head_box_of(
    context: bpy.types.Context, rig: Rig
) -> Generator[float, None, tuple[dict[str, Any], dict[str, str]]]:
    """Comparison of solving for all viewers and for the centre of their box: figures and a drawing.

    Yields progress 0..1.
    """
    plan = work.session().plan(rig, work.settings_of(context.scene))
    served = yield from head_box.head_box(plan)
    return head_box.as_data(served), {head_box.FILE: head_box.as_svg(served)}


def ways_to_settle(
    context: bpy.types.Context, rig: Rig
) -> Generator[float, None, tuple[dict[str, list[dict[str, Any]]], dict[str, str]]]:
    """For each mode of settling a report on each viewer, the largest displacement first, with
    sharpness.

    No drawing; yields progress 0..1.
    """
    session = work.session()
    ways = get_args(Disagreement)
    of_ways = {}
    for k, way in enumerate(ways):
        settings = replace(work.settings_of(context.scene), disagreement=way, sharpen=False)
        start, half, end = ((k + part) / len(ways) for part in (0.0, 0.5, 1.0))
        sharp = yield from subprogress(edge_sharpness(session, rig, settings), start, half)
        of_viewer = {viewer.name: mtf for viewer, mtf in zip(rig.viewers, sharp, strict=True)}
        solution = yield from subprogress(session.solve(rig, settings), half, end)
        reports = yield from subprogress(viewer_reports(solution), end, end)
        of_ways[way] = [{**asdict(one), "mtf50_per_px": of_viewer[one.viewer]} for one in reports]
    return of_ways, {}


def eye_box_of(
    context: bpy.types.Context, rig: Rig, limit: float, least: float
) -> Generator[float, None, tuple[dict[str, Any], dict[str, str]]]:
    """Figures and a drawing of the eye box and its curves; yields progress 0..1."""
    plan = work.session().plan(rig, work.settings_of(context.scene))
    walk = Walk(plan, limit, least)
    yield from hold_progress(0.02, begin(walk))
    box = yield from subprogress(walk.box(), 0.02, FOUND)
    curves = yield from subprogress(head_range.curves_of(walk, box), FOUND, 1.0)
    viewer = rig.viewer.name
    drawing = head_range.as_svg(box, viewer, curves)
    return head_range.as_data(box, viewer, curves), {head_range.FILE: drawing}


def files_of(rig: Rig) -> tuple[str, ...]:
    """Files that the verb writes."""
    return (*extra_names(rig), NUMBERS)


def add_verb(verbs: argparse._SubParsersAction, shared: argparse.ArgumentParser) -> None:
    """Add `eyes` to the command line."""
    eyes = verbs.add_parser(
        "eyes",
        parents=[shared],
        help="measure how far the head may move, how two eyes see the picture, solving for a box"
        " of heads against solving for its centre, and the errors and conflicts of several viewers"
        " in each mode of settling",
    )
    eyes.add_argument(
        "--limit",
        type=_limit,
        default=LIMIT,
        metavar="ARCMIN",
        help=f"largest error of a point of the picture ({LIMIT:g})",
    )
    eyes.add_argument(
        "--share",
        type=_share,
        default=LEAST,
        metavar="SHARE",
        help="part of the picture that must stay visible, relative to the part visible from the"
        f" viewer's own position ({LEAST:g})",
    )
    eyes.set_defaults(run=_eyes)


def _eyes(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Write only the part of a report besides costs; yields lines of progress."""
    context = bpy.context
    rig = work.read(context).rig
    rig.check()
    files = files_of(rig)
    if len(rig.viewers) == len(files) == 1:
        check_head(rig)  # raises the reason if there is nothing
    for viewer in rig.viewers:  # before minutes of work on the others
        check_seen(rig.place_of(viewer), viewer)
    if not arguments.overwrite:
        folder.refuse_existing(arguments.out, files, "add --overwrite")

    found = yield from to_folder.progress_in_tenths(
        find_extras(context, rig, arguments.limit, arguments.share)
    )
    for error in found.errors.values():
        if not isinstance(error, OffFromStartError):
            raise error
    texts = {**found.drawings, NUMBERS: json.dumps(found.numbers, indent=2) + "\n"}
    with disk.together(arguments.out, of=files) as scratch:
        for name, text in texts.items():
            disk.write_text(scratch / name, text)
    yield from found.lines(context.scene)
    yield from found.missing(str)
    yield Message("wrote {names} to '{folder}'", names=", ".join(texts), folder=arguments.out)


def _limit(text: str) -> float:
    return _checked(float(text), check_limit)


def _share(text: str) -> float:
    return _checked(float(text), check_share)


def _checked(number: float, check: Callable[[float], None]) -> float:
    """A number as an option's value."""
    try:
        check(number)
    except KirikoError as reason:
        raise argparse.ArgumentTypeError(str(reason)) from None
    return number


MEASURED = 0.8  # progress of the first part

__all__ = ["measured", "names", "table", "write"]


def names(rig: Rig) -> tuple[str, ...]:
    """Files of the rig's report."""
    return (*_own_names(rig), *extra_names(rig))


def _own_names(rig: Rig) -> tuple[str, ...]:
    """Those about costs and the plate."""
    return NAMES if _array_plate(rig) is None else (*NAMES, *PLATE_NAMES)


def _array_plate(rig: Rig) -> Plate | None:
    return next((plate for plate in rig.plates if plate.array is not None), None)


def measured(
    context: bpy.types.Context, rig: Rig, target: Path, budget: float
) -> Generator[float, None, tuple[WorkPrecision, ReportExtras]]:
    """Measure the scene's rig, with reading, writing to the folder `target`, and the extras.

    Yields progress 0..1; scene and folder stay unchanged.
    """
    use_bundled_modules()
    form = context.scene.kiriko.export_format

    with disk.scratch(target) as scratch:

        def save(image: np.ndarray) -> None:
            image_io.write(scratch / "source", image, form, overwrite=True)

        steps = measure(
            rig,
            replace(work.settings_of(context.scene), sharpen=False),
            ladders=Ladders(budget=budget),
            read=lambda: work.read(context),
            write=save if _can_write() else None,
        )
        found = yield from subprogress(steps, 0.0, MEASURED)
    return found, (yield from subprogress(find_extras(context, rig), MEASURED, 1.0))


def _can_write() -> bool:
    """Whether image files can be written; the report itself is text and works without."""
    try:
        image_io.openimageio()
    except ImageError:
        return False
    return True


def write(
    target: Path, rig: Rig, settings: Settings, found: WorkPrecision, extras: ReportExtras
) -> tuple[str, ...]:
    """Write the report's files to a folder, all or none; returns their names.

    ImageError if they cannot be written.
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
    view = run_steps(plate_view(work.session().plan(rig, settings)))
    if view is not None:
        about["plate"] = asdict(view)

    texts = [as_csv(found), as_json(found, about, extras.numbers), as_svg(found)]
    plate = _array_plate(rig)
    if plate is not None:
        texts += [plate_csv(plate.array), plate_svg(plate.array, plate.name)]
    files = dict(zip(_own_names(rig), texts, strict=True)) | extras.drawings

    with disk.together(target, of=names(rig)) as scratch:
        for name, text in files.items():
            disk.write_text(scratch / name, text)
    return tuple(files)


class KIRIKO_OT_report(AsksToReplace, bpy.types.Operator):
    """Measure error against time on this rig, as a table and a diagram"""

    bl_idname = "kiriko.report"
    bl_label = "Write Report"
    bl_options = {"REGISTER"}

    directory: bpy.props.StringProperty(
        name="Folder",
        description="Where to write",
        subtype="DIR_PATH",
        options={"SKIP_SAVE", *RELATIVE_PATH},
    )
    seconds: bpy.props.FloatProperty(
        name="Brute Force",
        description="Time limit of the brute-force comparison. More allows more samples per pixel",
        default=BUDGET,
        min=0.0,
        soft_max=3600.0,
        unit="TIME_ABSOLUTE",
    )

    in_question = ("directory", "seconds")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        scene = context.scene
        return needed.can_run(cls, needed.linked(scene) + needed.missing_parts(scene))

    def existing(self, context: bpy.types.Context) -> list[Path]:
        target = self._target(context)
        return folder.existing(target, names(work.read(context).rig))

    def _target(self, context: bpy.types.Context) -> Path:
        path = self.directory or context.scene.kiriko.report_folder
        if not path:
            raise ImageError("The report has no folder: choose one.")
        return absolute(path)

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        scene = context.scene
        target = self._target(context)
        rig = work.read(context).rig

        with folder.made(target):
            if not self.overwrite:
                folder.refuse_existing(target, names(rig), FOR_SCRIPTS)
            found, extras = yield from measured(context, rig, target, self.seconds)
            files = write(target, rig, work.settings_of(scene), found, extras)

        write_ladder(scene, found.ladder)
        missing = extras.missing()
        self.level = "WARNING" if missing else "INFO"
        text = Message("Wrote {names} to '{folder}'.", names=", ".join(files), folder=target)
        return joined([text, *missing])
