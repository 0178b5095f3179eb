"""Export of an atlas: warp maps for a head that moves.

The dialogue estimates the size before any light is traced, since it is redrawn with each mouse
move.
"""

import argparse
from collections.abc import Generator
from contextlib import suppress
from functools import partial
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.base.errors import ImageError, KirikoError
from ..core.base.messages import CONTEXT, Message
from ..core.base.numbers import number
from ..core.base.steps import subprogress
from ..core.base.words import percent
from ..core.blender.data.camera_viewer import seats_of
from ..core.blender.data.paths import absolute
from ..core.blender.data.stored_records import StoredNumbers
from ..core.blender.data.units import length_of_unit
from ..core.files import image_io
from ..core.files.encoding import Curve
from ..core.lab.atlas import atlas as atlas_plan
from ..core.lab.atlas import atlas as atlases
from ..core.lab.atlas.atlas import BYTES_A_PIXEL, CHECKED, Atlas, Making, amount
from ..core.lab.atlas.head_map import check, check_heads
from ..core.lab.atlas.heads import AXES, HeadBox, HeadGrid
from ..core.lab.farm.job import MOST as MOST_TASKS
from ..core.lab.farm.job import SHARES
from . import export_job, folder, needed, work
from .cli import to_folder
from .cli.usage import count, path
from .export import gamma_of, use_bundled_modules
from .reporting import report
from .to_file import IntoFolder
from .wrapping import sentence

BYTES = 16  # bytes per display pixel of a map before compression: st, coverage, path
SECONDS = 9e-6  # s per display pixel of a map, through a ball of a solved rig


def estimate(scene: bpy.types.Scene, box: HeadBox, most: int, has_images: bool) -> list[Message]:
    """Estimates for the coarsest atlas of a box of heads; none without a display."""
    try:
        box.check()
    except KirikoError as error:
        return [error.message]
    displays = list(needed.parts(scene).get("DISPLAY", ()))
    if not displays:
        return []

    width, height = displays[0].kiriko.resolution
    n_pixels = width * height
    n = len(HeadGrid(box))
    lines = [Message("At least {n} of {most} places.", n=n, most=most)]
    size = n_pixels * (BYTES + BYTES_A_PIXEL * has_images) / 1e6
    lines.append(
        Message("Up to {mb} MB each, {all} MB in all.", mb=number(size), all=number(n * size))
    )
    details = StoredNumbers.read(scene.kiriko.result.details).by_name
    if "tracing" not in details.get("seconds", {}) or "total_seconds" not in details:
        return lines

    # an atlas is for one viewer
    each = details["total_seconds"] / max(len(seats_of(scene)), 1) + n_pixels * SECONDS
    # Planning traces the centre, and one place to each side of it along an axis.
    n_made = n + 1 + 2 * len(box.axes) + CHECKED
    lines.append(
        Message(
            "About {seconds} s each, {minutes} min in all.",
            seconds=number(each),
            minutes=number(n_made * each / 60),
        )
    )
    return lines


TOLERANCE = 1.0  # px of the picture
MOST = 500  # places of the head
PLANNED = 0.2  # progress, approximate
MM = 1e-3  # m
ASIDE = 0.03  # m to each side, initially: half the eye distance each way


def making_of(context: bpy.types.Context, target: Path, has_images: bool) -> Making:
    """Everything an atlas of the scene's rig is made from."""
    use_bundled_modules()
    scene = context.scene
    reading = work.read(context)
    size = tuple(reading.display_size) if reading.display_size is not None else None
    save = partial(_save_image, size=size, gamma=gamma_of(scene))
    return Making(
        session=work.session(),
        rig=reading.rig,
        viewer=reading.rig.viewer,
        settings=work.settings_of(scene),
        folder=target,
        save_image=save,
        has_images=has_images,
    )


def _save_image(
    path: Path,
    pixels: NDArray[np.float32],
    size: tuple[float, float] | None,
    gamma: Curve,
) -> None:
    image_io.write(path, pixels, "PNG8", size=size, gamma=gamma)


def atlas_report(atlas: Atlas, target: Path) -> Message:
    """Report of a checked atlas."""
    found = atlas.checked
    return Message(
        "Wrote {n} maps to '{folder}'. Between them the error is {off:.2g} px at most; {share} of"
        " the pixels are at borders.",
        n=len(atlas.grid),
        folder=target,
        off=found["most_px"],
        share=percent(found["at_borders"]),
    )


def add_verb(verbs: argparse._SubParsersAction, shared: argparse.ArgumentParser) -> None:
    """Add `atlas` to the command line."""
    atlas = verbs.add_parser(
        "atlas",
        parents=[shared],
        help="write warp maps for a moving head, on a grid of positions",
    )
    for axis in ("right", "up", "forward"):
        atlas.add_argument(
            f"--{axis}",
            nargs=2,
            type=float,
            default=(0.0, 0.0),
            metavar=("FROM", "TO"),
            help=f"mm {axis} of the viewer's place, along its own axes (0 0)",
        )
    atlas.add_argument(
        "--tolerance",
        type=float,
        default=TOLERANCE,
        metavar="PX",
        help=f"picture px by which blended maps may be off ({TOLERANCE:g})",
    )
    atlas.add_argument(
        "--most",
        type=count,
        default=MOST,
        metavar="N",
        help=f"places of the head, at most ({MOST})",
    )
    atlas.add_argument(
        "--images", action="store_true", help="also write the source image for each position"
    )
    step = atlas.add_mutually_exclusive_group()
    step.add_argument(
        "--plan",
        action="store_true",
        help="only write index.json, and report the size of the atlas",
    )
    step.add_argument(
        "--places",
        type=_places,
        metavar="A-B",
        help="only make these positions of a planned atlas, counted from 1",
    )
    step.add_argument(
        "--share",
        type=_share,
        metavar="K/N",
        help="only make every Nth position of a planned atlas, starting with the Kth",
    )
    step.add_argument(
        "--check",
        type=count,
        metavar="N",
        help="only check a complete atlas at N random head positions",
    )
    step.add_argument(
        "--halve",
        action="store_true",
        help="only check a complete atlas, and halve its grid spacing where it exceeds the"
        " tolerance",
    )
    step.add_argument(
        "--job",
        type=count,
        metavar="N",
        help="write a render farm job instead, which divides the positions among N tasks",
    )
    atlas.add_argument(
        "--zip",
        type=path,
        nargs="+",
        default=[],
        metavar="FILE",
        help="Kiriko's zips for the farm's platforms (default: this installation, zipped)",
    )
    atlas.set_defaults(run=run)


def _places(text: str) -> range:
    """Numbers from 0, of "3" or "3-7", which count from 1."""
    first, _, last = text.partition("-")
    with suppress(ValueError):
        found = range(int(first) - 1, int(last or first))
        if found and found.start >= 0:
            return found
    raise argparse.ArgumentTypeError(f"'{text}' is no range of places, as 3-7 is")


def _share(text: str) -> tuple[int, int]:
    """Number and count of "2/8"."""
    number, _, of = text.partition("/")
    with suppress(ValueError):
        if 1 <= int(number) <= int(of):
            return int(number), int(of)
    raise argparse.ArgumentTypeError(f"'{text}' is no share, as 2/8 is")


def options_of(box: HeadBox, tolerance: float, most: int, has_images: bool) -> tuple[str, ...]:
    """Command line options that request an atlas."""

    def number(x: float) -> str:  # no exponent, which would look like an option
        return np.format_float_positional(x, trim="-")

    edges = zip(AXES, box.low, box.high, strict=True)
    moves = [(f"--{axis}", number(a / MM), number(b / MM)) for axis, a, b in edges if a != b]
    wanted = ("--tolerance", number(tolerance), "--most", str(most))
    return (*(word for move in moves for word in move), *wanted, *(("--images",) * has_images))


def run(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Make an atlas, a part of one, or a job for one; yields lines of progress."""
    making = making_of(bpy.context, arguments.out, arguments.images)
    if arguments.job is not None:
        return _write_job(arguments, making)
    if arguments.places is None and arguments.share is None:
        if arguments.check is None and not arguments.halve:
            return _make(arguments, making)
        return _check(arguments, making)
    return _make_some(arguments, making)


def _box(arguments: argparse.Namespace) -> HeadBox:
    edges = zip(arguments.right, arguments.up, arguments.forward, strict=True)
    low, high = (tuple(MM * x for x in edge) for edge in edges)
    return HeadBox(low, high)


def _make(arguments: argparse.Namespace, making: Making) -> Generator[str, None, None]:
    """Plan an atlas and make all of it."""
    yield Message("planning the atlas")
    atlas = yield from to_folder.progress_in_tenths(
        atlas_plan.planned(
            making,
            _box(arguments),
            arguments.tolerance,
            arguments.most,
            arguments.overwrite,
            "add --overwrite",
        )
    )
    yield amount(atlas)
    if not arguments.plan:
        steps = atlases.whole(making, atlas, arguments.most)
        atlas = yield from to_folder.progress_in_tenths(steps)
        yield atlas_report(atlas, arguments.out)


def _make_some(arguments: argparse.Namespace, making: Making) -> Generator[str, None, None]:
    """Make places of a planned atlas."""
    atlas = atlas_plan.planned_before(making)
    numbers = arguments.places
    if arguments.share is not None:
        numbers = atlases.share(atlas, *arguments.share)
    n = yield from to_folder.progress_in_tenths(atlases.made(making, atlas, numbers))
    yield Message("wrote {n} files to '{folder}'", n=n, folder=arguments.out)


def _check(arguments: argparse.Namespace, making: Making) -> Generator[str, None, None]:
    """Check an atlas whose places are made, and halve its grid on request."""
    atlas = atlas_plan.planned_before(making)
    if arguments.halve:
        steps = atlases.halved(making, atlas, arguments.most)
        atlas = yield from to_folder.progress_in_tenths(steps)
        if atlas.checked is None:
            yield amount(atlas)
            return
    else:
        steps = atlases.checked(making, atlas, arguments.check)
        atlas = yield from to_folder.progress_in_tenths(steps)
        atlases.refuse_too_coarse(atlas)
    yield atlas_report(atlas, arguments.out)


def _check_job(making: Making, box: HeadBox, tolerance: float, most: int) -> None:
    """Raise the error that a job's tasks would end with, as far as it is known in advance."""
    check(making.rig, making.viewer, box, tolerance, most)
    check_heads(making.rig, making.viewer, making.settings, box, most)


def _write_job(arguments: argparse.Namespace, making: Making) -> Generator[str, None, None]:
    """Write a job whose tasks make an atlas, unless they would refuse it."""
    box = _box(arguments)
    _check_job(making, box, arguments.tolerance, arguments.most)
    options = options_of(box, arguments.tolerance, arguments.most, arguments.images)
    names = export_job.write(
        arguments.out,
        export_job.atlas_job(options, arguments.job, arguments.overwrite),
        arguments.zip,
        arguments.overwrite,
        "add --overwrite",
    )
    yield Message("wrote {names} to '{folder}'", names=", ".join(names), folder=arguments.out)


class KIRIKO_OT_export_atlas(IntoFolder, bpy.types.Operator):
    """Write warp maps for a moving head, at as many places in a box as needed"""

    bl_idname = "kiriko.export_atlas"
    bl_label = "Export Atlas"
    bl_options = {"REGISTER"}

    low: bpy.props.FloatVectorProperty(
        name="From",
        description="Corner of the head's box, relative to the viewer: right, up, forward",
        subtype="TRANSLATION",
        unit="LENGTH",
    )
    high: bpy.props.FloatVectorProperty(
        name="To",
        description="Corner of the head's box, relative to the viewer: right, up, forward",
        subtype="TRANSLATION",
        unit="LENGTH",
    )
    tolerance: bpy.props.FloatProperty(
        name="Tolerance",
        description="Allowed error of a map blended from two places, in picture pixels. Smaller"
        " needs more places",
        subtype="PIXEL",
        default=TOLERANCE,
        min=1e-3,
        soft_max=10.0,
    )
    most: bpy.props.IntProperty(
        name="Most Places",
        default=MOST,
        min=2,
    )
    images: bpy.props.BoolProperty(
        name="Source Images",
        description="Also write a source image for each place, for programs that show the nearest"
        " one",
    )
    overwrite: bpy.props.BoolProperty(
        name="Overwrite",
        description="Replace existing files",
        options={"SKIP_SAVE"},
    )
    job: bpy.props.BoolProperty(
        name="As a Job",
        description="Write a render farm job that makes the atlas",
        options={"SKIP_SAVE"},
    )
    shares: bpy.props.IntProperty(
        name="Tasks",
        default=SHARES,
        min=1,
        max=MOST_TASKS,
    )
    in_dialogue = ("low", "high", "tolerance", "most", "images", "overwrite", "job", "shares")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        for name, x in (("low", -ASIDE), ("high", ASIDE)):
            if not self.properties.is_property_set(name):
                setattr(self, name, (x / length_of_unit(context.scene), 0.0, 0.0))
        return super().invoke(context, event)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        edges = layout.column(align=True)
        edges.prop(self, "low", index=0, text="Left", text_ctxt=CONTEXT)
        edges.prop(self, "high", index=0, text="Right", text_ctxt=CONTEXT)
        edges.prop(self, "low", index=1, text="Down", text_ctxt=CONTEXT)
        edges.prop(self, "high", index=1, text="Up", text_ctxt=CONTEXT)
        edges.prop(self, "low", index=2, text="Back", text_ctxt=CONTEXT)
        edges.prop(self, "high", index=2, text="Forward", text_ctxt=CONTEXT)
        for name in ("tolerance", "most", "images"):
            layout.prop(self, name)
        for text in estimate(context.scene, self._box(context), self.most, self.images):
            sentence(layout, context, text)
        layout.prop(self, "overwrite")
        layout.prop(self, "job")
        tasks = layout.row()
        tasks.active = self.job
        tasks.prop(self, "shares")

    def _box(self, context: bpy.types.Context) -> HeadBox:
        unit = length_of_unit(context.scene)
        return HeadBox(*(tuple(unit * x for x in edge) for edge in (self.low, self.high)))

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        if not self.directory:
            raise ImageError("The atlas has no folder: choose one.")

        target = absolute(self.directory)
        box = self._box(context)
        overwrite = self.overwrite
        remedy = Message("turn on Overwrite")
        with folder.made(target):
            making = making_of(context, target, self.images)
            if self.job:
                _check_job(making, box, self.tolerance, self.most)
                options = options_of(box, self.tolerance, self.most, self.images)
                job = export_job.atlas_job(options, self.shares, overwrite)
                names = export_job.write(target, job, [], overwrite, remedy)
                return export_job.bundle_report(names, target)

            steps = atlas_plan.planned(making, box, self.tolerance, self.most, overwrite, remedy)
            atlas = yield from subprogress(steps, 0.0, PLANNED)
            report(self, "INFO", Message("{atlas}; Esc stops it.", atlas=amount(atlas)))
            atlas = yield from subprogress(atlases.whole(making, atlas, self.most), PLANNED, 1.0)
        return atlas_report(atlas, target)
