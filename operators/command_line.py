"""`blender --background FILE --command kiriko VERB --out
DIR`: solve, measure or calibrate a saved rig.
"""

import argparse
import json
import sys
from collections.abc import Generator
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import bpy
import numpy as np

from ..core import disk, image_io
from ..core.blender.kept import Numbers
from ..core.blender.preview import Preview
from ..core.blender.result import write_solution
from ..core.errors import ImageError, KirikoError, RigError
from ..core.image.simulation import simulate
from ..core.measure.work_precision import BUDGET
from . import folder, report, work
from .calibrate import calibrated
from .export import use_bundled_modules

Result = TypeVar("Result")

USAGE_ERROR = 2  # exit code, as other commands have it


class UsageError(KirikoError):
    """The command line cannot be understood."""


class _Parser(argparse.ArgumentParser):
    """A parser that makes one sentence of a mistake, in place of the usage and an exit."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(
            "{first}{rest}; try 'kiriko --help'.",
            first=message[:1].upper(),
            rest=message[1:].rstrip("."),
        )


def parser() -> argparse.ArgumentParser:
    """Arguments of `--command kiriko`."""
    top = _Parser(
        prog="blender --background FILE --command kiriko",
        description="Images inside glass, without a window.",
    )
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB")
    shared = argparse.ArgumentParser(add_help=False)
    shared.add_argument(
        "--out",
        required=True,
        type=_folder_name,
        metavar="DIR",
        help="folder for the results; made if need be",
    )
    shared.add_argument(
        "--overwrite", action="store_true", help="replace results that are there already"
    )
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
    pictures = argparse.ArgumentParser(add_help=False, parents=[shared])
    pictures.add_argument(
        "--preview", action="store_true", help="render the viewer's image in Cycles, too"
    )
    pictures.add_argument(
        "--simulate",
        type=_count,
        default=0,
        metavar="N",
        help="simulate N rays a pixel through the plate's mirrors, too",
    )
    pictures.add_argument(
        "--samples", type=_count, default=16, metavar="N", help="rays a pixel of the preview (16)"
    )
    pictures.add_argument(
        "--format",
        choices=image_io.FORMATS,
        default="PNG8",
        help="of source.png or source.tif (PNG8)",
    )
    solve = verbs.add_parser(
        "solve", parents=[pictures], help="compute the source image and write it to a folder"
    )
    solve.set_defaults(run=_solve)
    calibrate = verbs.add_parser(
        "calibrate",
        parents=[pictures],
        help="find the errors of a real bench, solve for it, and write both, and a .blend of it,"
        " to a folder",
    )
    calibrate.add_argument(
        "--measured",
        required=True,
        type=_file_name,
        metavar="FILE",
        help="photograph of the lattice as seen, or CSV of its points",
    )
    calibrate.add_argument(
        "--keep",
        choices=("offset", "scene"),
        default="offset",
        help="the result, in the .blend: as an offset, or by moving its objects (offset)",
    )
    calibrate.set_defaults(run=_calibrate)
    return top


def run(argv: list[str]) -> int:
    """Called by Blender with the arguments after the command's name; returns the exit code."""
    try:
        arguments = parser().parse_args(argv)
        for line in _into_folder(arguments):
            sys.stdout.write(f"kiriko: {line}\n")
            sys.stdout.flush()
    except SystemExit as end:  # --help
        return int(end.code or 0)
    except (Exception, KeyboardInterrupt) as error:
        sys.stderr.write(f"kiriko: {work.sentence(error, 'The command')}\n")
        return USAGE_ERROR if isinstance(error, UsageError) else 1
    return 0


def _count(text: str) -> int:
    number = int(text)
    if number < 1:
        raise ValueError(f"{number} is not 1 or more")
    return number


def _folder_name(text: str) -> Path:
    if not text:
        raise argparse.ArgumentTypeError("a folder needs a name")
    return Path(text)


def _file_name(text: str) -> Path:
    if not text:
        raise argparse.ArgumentTypeError("a file needs a name")
    return Path(text)


def _seconds(text: str) -> float:
    number = float(text)
    if not 0 <= number < float("inf"):
        raise ValueError(f"{number} is no time")
    return number


def _into_folder(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Do the work with the open file's scene, results in a folder; yields lines of progress."""
    if not bpy.data.filepath:
        # Blender goes on with its startup scene when the file it was given is missing
        raise RigError("No .blend file was loaded: name an existing file before --command.")
    use_bundled_modules()
    with folder.made(arguments.out):
        yield from arguments.run(arguments)


def _progress(steps: Generator[float, None, Result]) -> Generator[str, None, Result]:
    """Run long work; yields a line for every tenth of it."""
    told = 0
    while True:
        try:
            done = int(10 * next(steps))
        except StopIteration as end:
            return end.value
        if done > told:
            told = done
            yield f"{10 * done} %"


def _files(arguments: argparse.Namespace) -> dict[str, Path]:
    """The files that solving writes, by the image in them."""
    names = {
        "source": str(image_io.named_for("source", arguments.format)),
        "linear": "source.exr",
        "ideal": "ideal.png",
        "seen": "seen.png",
        "coverage": "coverage.png",
        "report": "report.json",
    }
    if arguments.preview:
        names["preview"] = "preview.png"
    if arguments.simulate:
        names["simulated"] = "simulated.png"
    return {image: arguments.out / name for image, name in names.items()}


def _report(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Measure error against run time and write the report.

    Yields lines of progress, then the table.
    """
    rig = work.read(bpy.context).rig
    if not arguments.overwrite:
        folder.refuse_existing(arguments.out, report.names(rig), "add --overwrite")
    yield f"measuring '{Path(bpy.data.filepath).name}'"
    found = yield from _progress(
        report.measured(bpy.context, rig, arguments.out, arguments.seconds)
    )
    report.write(arguments.out, rig, work.settings_of(bpy.context.scene), found)
    yield from report.table(found).splitlines()
    yield f"wrote {len(report.names(rig))} files to '{arguments.out}'"


def _calibrate(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Fit, keep the result, solve and write the files; yields lines of progress."""
    image_io.openimageio()
    details = arguments.out / "calibration.json"
    file = arguments.out / "calibrated.blend"
    if not arguments.overwrite:
        paths = (details, file, *_files(arguments).values())
        folder.refuse_existing(arguments.out, (path.name for path in paths), "add --overwrite")
    context = bpy.context
    ours = bpy.context.scene.kiriko.calibration
    ours.keep = arguments.keep.upper()
    reading = work.read(context)
    reading.rig.check()
    yield f"calibrating '{Path(bpy.data.filepath).name}' by '{arguments.measured.name}'"
    yield (yield from _progress(calibrated(context, reading, arguments.measured)))
    yield from _solve(arguments)
    disk.write_text(details, json.dumps(Numbers.read(ours.found).by_name, indent=2) + "\n")
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(file.absolute()), copy=True)
    except RuntimeError as reason:
        why = " ".join(str(reason).split()).removeprefix("Error: ").rstrip(".")
        raise ImageError(
            "The file '{file}' cannot be written ({why}): choose another folder.",
            file=file,
            why=why,
        ) from None
    yield f"wrote '{details.name}' and '{file.name}' there, too"


def _solve(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Solve and write the files; yields lines of progress."""
    image_io.openimageio()
    files = _files(arguments)
    if not arguments.overwrite:
        folder.refuse_existing(
            arguments.out, (path.name for path in files.values()), "add --overwrite"
        )
    context = bpy.context
    scene = context.scene
    reading = work.read_to_solve(context)
    yield f"solving '{Path(bpy.data.filepath).name}'"
    solution = yield from _progress(work.session().solve(reading.rig, work.settings_of(scene)))
    text = write_solution(scene, reading, solution)
    yield text

    yield "looking beside the glass"
    yield from _progress(solution.look_beside())

    size = tuple(reading.display_size) if reading.display_size is not None else None
    linear = arguments.format if arguments.format.startswith("EXR") else "EXR_FLOAT"
    jobs: list[tuple[str, np.ndarray, str, tuple[float, float] | None]] = [
        ("source", solution.source, arguments.format, size),
        ("linear", solution.source, linear, size),
        ("ideal", solution.ideal(), "PNG8", None),
        ("seen", solution.seen(beside=True), "PNG8", None),
        ("coverage", solution.display_coverage, "PNG8", size),
    ]
    numbers = _numbers(scene, text)
    if arguments.preview:
        yield "rendering the preview in Cycles"
        with Preview(
            scene, reading, scene.kiriko.result.source, samples=arguments.samples
        ) as preview:
            jobs.append(("preview", preview.render()[..., :3], "PNG8", None))
        numbers["preview_notes"] = preview.notes
    if arguments.simulate:
        yield "simulating the plate's mirrors"
        plan = work.session().plan(reading.rig, work.settings_of(scene))
        found = yield from _progress(simulate(plan, solution.source, arguments.simulate))
        jobs.append(("simulated", found.image, "PNG8", None))
        numbers["simulated"] = {
            "rays_a_pixel": found.spp,
            "noise": found.error,
            "luminance": {path.name.lower(): light for path, light in found.luminance.items()},
            "luminance_error": {
                path.name.lower(): error for path, error in found.luminance_error.items()
            },
        }
    with disk.together(arguments.out) as scratch:
        for image, pixels, form, area in jobs:
            image_io.write(
                scratch / files[image].name, pixels, form, size=area, title=f"Kiriko {image} image"
            )
        disk.write_text(scratch / files["report"].name, json.dumps(numbers, indent=2) + "\n")
    yield f"wrote {len(files)} files to '{arguments.out}'"


def _numbers(scene: bpy.types.Scene, text: str) -> dict[str, Any]:
    result = scene.kiriko.result
    return {
        "file": Path(bpy.data.filepath).name,
        "blender": bpy.app.version_string,
        "summary": text,
        **Numbers.read(result.details).by_name,
        "notes": result.notes.splitlines(),
    }
