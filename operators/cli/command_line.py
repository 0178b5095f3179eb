"""`blender --background FILE --command kiriko VERB --out DIR`: work on a saved rig."""

import argparse
import json
import re
import sys
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

import bpy

from ...core.base.errors import RigError
from ...core.base.messages import Message
from ...core.blender.data.rigs import active_rig, rigs
from ...core.blender.data.stored_records import StoredNumbers, take_reports
from ...core.files import disk, image_io
from ...core.lab.measure.work_precision import BUDGET
from ...core.lab.warp.map_files import FORMATS, SIDECAR, TIMES, MapOptions
from .. import (
    bench_drawing,
    export_atlas,
    export_maps,
    folder,
    report,
    reporting,
    set_value,
    viewer_images,
    work,
)
from ..calibrate import calibrated
from ..choose_rig import choose_by_name, find_scene
from ..export import use_bundled_modules
from ..export_job import save_copy
from ..viewer_reports import ALL, choose_alone
from . import each_rig, farm_verbs, to_folder
from .usage import AS_IS, VALUES, UsageError, as_is, check, count, path

USAGE_ERROR = 2  # exit code for usage errors, as usual for commands
NEGATIVE = re.compile(
    r"-(\.?\d|inf|nan)"
)  # beginning of a negative number, with or without an exponent
OPTION = re.compile(r"--[a-z]|-h$")
SET = "--set"


class _Parser(argparse.ArgumentParser):
    """A parser that reports a mistake in one sentence instead of usage and exit.

    It accepts -1e9 as a number, any text as a value of --set, and texts with one leading minus as
    values of --values, all of which Python's own parser takes for options.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._negative_number_matcher = NEGATIVE

    def parse_args(self, args: Sequence[str], namespace: Any = None) -> Any:  # type: ignore[override]
        """Options among some words."""
        return super().parse_args(list(_marked(args)), namespace)

    def error(self, message: str) -> NoReturn:
        raise UsageError(
            "{first}{rest}; try 'kiriko --help'.",
            first=message[:1].upper(),
            rest=message[1:].rstrip("."),
        )


def _marked(words: Iterable[str]) -> Iterator[str]:
    """Words of a command line, with marks on those that only look like options."""
    n_of_set, are_values = 0, False
    for word in words:
        is_value = are_values and OPTION.match(word) is None
        yield f"{AS_IS}{word}" if n_of_set or is_value else word
        n_of_set = n_of_set - 1 if n_of_set else 2 * (word == SET)
        are_values = is_value or word == VALUES


def parser() -> argparse.ArgumentParser:
    """Arguments of `--command kiriko`."""
    top = _Parser(
        prog="blender --background FILE --command kiriko",
        description="Images inside glass, without a window.",
    )
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB")
    shared = _shared()
    _add_report(verbs, shared)
    report.add_verb(verbs, shared)
    _add_drawing(verbs, shared)
    _add_maps(verbs, shared)
    export_atlas.add_verb(verbs, shared)
    pictures = _pictures(shared)
    _add_solve(verbs, pictures)
    _add_calibrate(verbs, pictures)
    farm_verbs.add_verbs(verbs, shared)
    return top


def _shared() -> argparse.ArgumentParser:
    """Add the options of all verbs that work on a rig."""
    shared = argparse.ArgumentParser(add_help=False)
    shared.add_argument(
        "--out",
        required=True,
        type=path,
        metavar="DIR",
        help="folder for the results; created if necessary",
    )
    shared.add_argument("--overwrite", action="store_true", help="overwrite existing results")
    shared.add_argument(
        SET,
        nargs=2,
        type=as_is,
        action="append",
        default=[],
        metavar=("PROPERTY", "VALUE"),
        help="set a property first, such as kiriko.tolerance 0.05 (of the scene) or"
        ' objects["Glass"].kiriko.ior 1.5',
    )
    shared.add_argument(
        "--rig",
        metavar="NAME",
        help="name of a rig's collection, or 'all' to write each rig to a folder of its name"
        " (default: the active rig)",
    )
    return shared


def _add_report(verbs: argparse._SubParsersAction, shared: argparse.ArgumentParser) -> None:
    measure = verbs.add_parser(
        "report", parents=[shared], help="measure error against run time and write a report"
    )
    measure.add_argument(
        "--seconds",
        type=_seconds,
        default=BUDGET,
        metavar="N",
        help=f"time for the brute-force comparison ({BUDGET:g})",
    )
    measure.set_defaults(run=_report)


def _add_drawing(verbs: argparse._SubParsersAction, shared: argparse.ArgumentParser) -> None:
    drawing = verbs.add_parser(
        "drawing", parents=[shared], help="draw the bench to scale, for whoever builds it"
    )
    drawing.add_argument(
        "--paper",
        choices=[name for name, *_ in bench_drawing.PAPERS],
        default="A4",
        help="size of the sheets (A4)",
    )
    drawing.set_defaults(run=_drawing)


def _add_maps(verbs: argparse._SubParsersAction, shared: argparse.ArgumentParser) -> None:
    maps = verbs.add_parser(
        "maps", parents=[shared], help="write warp maps, for warping pictures in other programs"
    )
    maps.add_argument(
        "--formats",
        nargs="+",
        choices=[name.lower() for name in FORMATS],
        default=["exr"],
        metavar="NAME",
        help=f"which files: {', '.join(name.lower() for name in FORMATS)} (exr)",
    )
    maps.add_argument(
        "--overscan",
        type=float,
        default=MapOptions.overscan,
        metavar="PERCENT",
        help="margin by which images exceed the picture at each side (default: 0)",
    )
    maps.add_argument(
        "--times",
        type=int,
        choices=TIMES,
        default=MapOptions.times,
        help=f"size of ffmpeg's maps, in display pixels ({MapOptions.times})",
    )
    maps.add_argument(
        "--mesh-step",
        type=float,
        default=MapOptions.mesh_step,
        metavar="N",
        help=f"display pixels between the nodes of meshes ({MapOptions.mesh_step:g})",
    )
    maps.set_defaults(run=_maps)


def _pictures(shared: argparse.ArgumentParser) -> argparse.ArgumentParser:
    """Add the options of verbs that write images of display and viewers."""
    pictures = argparse.ArgumentParser(add_help=False, parents=[shared])
    pictures.add_argument(
        "--preview", action="store_true", help="render the viewer's image in Cycles, too"
    )
    pictures.add_argument(
        "--simulate",
        type=count,
        default=0,
        metavar="N",
        help="simulate N rays a pixel through the plate's mirrors, too",
    )
    pictures.add_argument(
        "--viewers",
        nargs="+",
        default=[],
        metavar="NAME",
        help="also write the images seen by these viewers: camera names, or 'all'",
    )
    pictures.add_argument(
        "--samples",
        type=count,
        metavar="N",
        help=f"rays a pixel of the preview ({to_folder.SAMPLES})",
    )
    pictures.add_argument(
        "--format",
        choices=image_io.FORMATS,
        default="PNG8",
        help="file format of source.png or source.tif (default: PNG8)",
    )
    for role, products in to_folder.PRODUCTS.items():
        pictures.add_argument(
            f"--{role}",
            choices=products,
            metavar="NAME",
            help=f"solve with another {role} of the catalogue: {', '.join(products)}".replace(
                "%", "%%"
            ),
        )
    return pictures


def _add_solve(verbs: argparse._SubParsersAction, pictures: argparse.ArgumentParser) -> None:
    solve = verbs.add_parser(
        "solve", parents=[pictures], help="compute the source image and write it to a folder"
    )
    solve.add_argument(
        "--pictures",
        default="",
        metavar="FILE",
        help="one image file per viewer: a path with {viewer} in place of the camera's name",
    )
    solve.add_argument(
        "--only-viewer",
        metavar="NAME",
        help="solve only for the viewer with this camera name",
    )
    to_folder.add_options(solve)
    solve.set_defaults(run=_solve)


def _add_calibrate(verbs: argparse._SubParsersAction, pictures: argparse.ArgumentParser) -> None:
    calibrate = verbs.add_parser(
        "calibrate",
        parents=[pictures],
        help="find the errors of a real bench, solve for it, and write the errors, the solution"
        " and a .blend to a folder",
    )
    calibrate.add_argument(
        "--measured",
        required=True,
        type=path,
        metavar="FILE",
        help="photograph of the lattice as seen, or CSV of its points",
    )
    calibrate.add_argument(
        "--keep",
        choices=("offset", "scene"),
        default="offset",
        help="how the .blend stores the result: as an offset, or by moving its objects (default:"
        " offset)",
    )
    calibrate.set_defaults(run=_calibrate)


def run(argv: list[str]) -> int:
    """Entry point for Blender, with the arguments after the command's name; returns the exit
    code.
    """
    try:
        arguments = parser().parse_args(argv)
        check(arguments)
        for line in _into_folder(arguments):
            sys.stdout.write(f"kiriko: {line}\n")
            sys.stdout.flush()
    except SystemExit as end:  # --help
        return int(end.code or 0)
    except (Exception, KeyboardInterrupt) as error:
        sys.stderr.write(
            f"kiriko: {reporting.sentence(error, Message('The command'), translate=str)}\n"
        )
        return USAGE_ERROR if isinstance(error, UsageError) else 1
    finally:
        for text in take_reports():
            sys.stderr.write(f"kiriko: {text}\n")
    return 0


def _seconds(text: str) -> float:
    with suppress(ValueError):
        if 0 <= float(text) < float("inf"):
            return float(text)
    raise argparse.ArgumentTypeError(f"'{text}' is no time in s")


def _into_folder(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Work on the open file's scene, results in a folder; yields lines of progress."""
    if not bpy.data.filepath:
        # If the given file is missing, Blender goes on with its startup scene.
        raise RigError("No .blend file was loaded: name an existing file before --command.")
    use_bundled_modules()
    yield from find_scene(bpy.context, arguments.rig)
    with folder.made(arguments.out):
        if arguments.rig == ALL:
            yield from _each_rig(arguments)
            return
        if arguments.rig is not None:  # settings are those of the chosen rig
            choose_by_name(bpy.context, arguments.rig)
        yield from set_value.set_values(arguments.set)
        yield from arguments.run(arguments)


def _each_rig(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Work on each rig of the scene, results in a folder of its name; yields lines of progress.

    A job covers all rigs, so it is written once.
    """
    own = active_rig(bpy.context.scene)
    is_job = arguments.run == farm_verbs.write_job
    names = [rig.name for rig in rigs(bpy.context.scene)]
    if arguments.verb == "calibrate":
        raise UsageError("A photograph shows only one rig: name it with --rig.")
    if not names:
        raise RigError("The scene has no rig from Add Rig: leave out --rig.")

    folders = {
        name: arguments.out / of_name
        for name, of_name in zip(names, folder.names_for(names), strict=True)
    }
    if not is_job:
        each_rig.check(arguments, folders)
    for name, out in folders.items():
        choose_by_name(bpy.context, name)
        yield Message("rig '{name}'", name=name)
        yield from set_value.set_values(arguments.set)
        if not is_job:
            with folder.made(out):
                yield from arguments.run(argparse.Namespace(**{**vars(arguments), "out": out}))
    if is_job:
        if own is not None:
            choose_by_name(bpy.context, own.name)
        yield from arguments.run(arguments)


def _solve(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Solve the scene, or the requested frames; yields lines of progress."""
    if arguments.only_viewer is not None:
        choose_alone(bpy.context.scene, arguments.only_viewer)
    if arguments.pictures:
        viewer_images.open_images(bpy.context.scene, arguments.pictures)
    if arguments.frames is None:
        return to_folder.solve(arguments)
    if arguments.preview or arguments.simulate or arguments.viewers:
        raise UsageError(
            "With --frames, only source images are written: leave out --preview, --simulate and"
            " --viewers."
        )
    return to_folder.solve_frames(arguments)


def _report(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Measure error against run time and write the report; yields progress, then the table."""
    rig = work.read(bpy.context).rig
    if not arguments.overwrite:
        folder.refuse_existing(arguments.out, report.names(rig), "add --overwrite")

    yield Message("measuring '{file}'", file=Path(bpy.data.filepath).name)
    found, extras = yield from to_folder.progress_in_tenths(
        report.measured(bpy.context, rig, arguments.out, arguments.seconds)
    )
    files = report.write(arguments.out, rig, work.settings_of(bpy.context.scene), found, extras)
    yield from report.table(found).splitlines()
    yield from extras.lines(bpy.context.scene)
    yield from extras.missing(str)
    yield Message("wrote {n} files to '{folder}'", n=len(files), folder=arguments.out)


def _drawing(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Draw the bench; yields lines of progress."""
    rig = work.read(bpy.context).rig
    rig.check()
    lattice = bench_drawing.lattice_of(bpy.context.scene)
    sheets = bench_drawing.drawings(rig, lattice, arguments.paper)
    if not arguments.overwrite:
        folder.refuse_existing(arguments.out, sheets, "add --overwrite")
    bench_drawing.write(arguments.out, sheets)
    yield Message("wrote {names} to '{folder}'", names=", ".join(sheets), folder=arguments.out)


def _maps(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Write warp maps; yields lines of progress."""
    formats = tuple(name for name in FORMATS if name.lower() in arguments.formats)
    options = MapOptions(formats, arguments.overscan, arguments.times, arguments.mesh_step)
    yield Message("mapping '{file}'", file=Path(bpy.data.filepath).name)
    about = yield from to_folder.progress_in_tenths(
        export_maps.exported(
            bpy.context, arguments.out, options, arguments.overwrite, "add --overwrite"
        )
    )
    files = [*export_maps.files_in(about), SIDECAR]
    yield Message("wrote {names} to '{folder}'", names=", ".join(files), folder=arguments.out)
    yield from export_maps.left_out(options)
    yield from (one["ffmpeg"]["command"] for one in about["maps"] if "ffmpeg" in one)


def _calibrate(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Fit, store the result, solve and write the files; yields lines of progress."""
    image_io.openimageio()
    details = arguments.out / "calibration.json"
    file = arguments.out / "calibrated.blend"

    if not arguments.overwrite:
        paths = (details, file, *to_folder.file_names(arguments).values())
        folder.refuse_existing(arguments.out, (path.name for path in paths), "add --overwrite")

    context = bpy.context
    ours = bpy.context.scene.kiriko.calibration
    ours.keep = arguments.keep.upper()
    reading = work.read(context)
    reading.rig.check()
    yield Message(
        "calibrating '{file}' by '{measured}'",
        file=Path(bpy.data.filepath).name,
        measured=arguments.measured.name,
    )
    yield (
        yield from to_folder.progress_in_tenths(calibrated(context, reading, arguments.measured))
    )
    yield from to_folder.solve(arguments)
    disk.write_text(details, json.dumps(StoredNumbers.read(ours.found).by_name, indent=2) + "\n")

    save_copy(file)
    yield Message("wrote '{details}' and '{file}' there, too", details=details.name, file=file.name)
