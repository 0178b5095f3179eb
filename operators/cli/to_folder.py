"""Solve to a folder: a rig's images and figures, or the source images of its frames."""

import argparse
import json
from collections.abc import Generator
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import bpy
import numpy as np

from ...core.base.errors import RigError
from ...core.base.messages import Message
from ...core.blender.checks.chosen_product import Given, give_display, give_glass, give_plate
from ...core.blender.data import movie
from ...core.blender.data.scene_frames import frame_files, frames_of_range, without_number
from ...core.blender.data.stored_records import StoredNumbers
from ...core.blender.preview.cycles_preview import Preview
from ...core.blender.result.write_result import quilt_of, write_solution, write_viewers
from ...core.files import disk, image_io
from ...core.files.frame_list import frames_of
from ...core.image.simulation import OTHER_PATH, by_path, simulate_colours
from ...core.lab.farm.job import LOG, log_of
from ...core.rig.catalogue import DISPLAYS, GLASSES, PLATES
from ...core.rig.joined_display import Section
from .. import folder, frames, look_over, needed, viewer_reports, work
from ..export import files_of, gamma_of
from ..simulate import plans_to_simulate

Result = TypeVar("Result")

OF_DISPLAYS = {"source", "linear"}  # images with a file for each display and projector
WHOLE = (Section("", 0, 0, 0),)

SAMPLES = 16  # rays per pixel of the preview
# products that a part of the file may be replaced by, by role
PRODUCTS = {"plate": PLATES, "display": DISPLAYS, "glass": GLASSES}


def file_names(arguments: argparse.Namespace) -> dict[str, Path]:
    """Files that solving writes, by image."""
    names = {
        "source": str(image_io.named_for("source", arguments.format)),
        "ideal": "ideal.png",
        "seen": "seen.png",
        "coverage": "coverage.png",
        "report": "report.json",
    }
    if not arguments.format.startswith("EXR"):  # otherwise the source itself is linear
        names["linear"] = "source.exr"
    if arguments.preview:
        names["preview"] = "preview.png"
    if arguments.simulate:
        names["simulated"] = "simulated.png"
    names |= viewer_reports.file_names(bpy.context.scene, arguments.viewers)

    return {image: arguments.out / name for image, name in names.items()}


def progress_in_tenths(steps: Generator[float, None, Result]) -> Generator[str, None, Result]:
    """Run long work; yields a line for every tenth of it."""
    reported = 0
    while True:
        try:
            done = int(10 * next(steps))
        except StopIteration as end:
            return end.value
        if done > reported:
            reported = done
            yield f"{10 * done} %"


def solve(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Solve and write the files; yields lines of progress."""
    image_io.openimageio()
    files = file_names(arguments)
    context = bpy.context
    scene = context.scene
    yield from products_given(context, arguments)
    reading = look_over.read_to_solve(context)
    files_of_image = {
        image: files_of(path, reading.rig.files, quilt_of(reading.rig))
        if image in OF_DISPLAYS
        else files_of(path, WHOLE)
        for image, path in files.items()
    }

    if not arguments.overwrite:
        names = [path.name for paths in files_of_image.values() for path in paths.values()]
        folder.refuse_existing(arguments.out, names, "add --overwrite")

    yield Message("solving '{file}'", file=Path(bpy.data.filepath).name)
    settings = work.settings_of(scene)
    solution = yield from progress_in_tenths(work.session().solve(reading.rig, settings))
    text = write_solution(scene, reading, solution)
    yield text
    reports = yield from progress_in_tenths(viewer_reports.reports_of(solution, settings))
    write_viewers(scene, reports.numbers)
    yield from viewer_reports.lines(scene, reports.numbers)

    yield "looking beside the glass"
    yield from progress_in_tenths(solution.trace_stray_light())

    size = tuple(reading.display_size) if reading.display_size is not None else None
    jobs: list[tuple[str, np.ndarray, str, tuple[float, float] | None]] = [
        ("source", solution.image, arguments.format, size),
        ("ideal", solution.ideal(), "PNG8", None),
        ("seen", solution.seen(past_glass=True), "PNG8", None),
        ("coverage", solution.display_coverage, "PNG8", size),
    ]
    if "linear" in files:
        jobs.append(("linear", solution.image, "EXR_FLOAT", size))
    numbers = _numbers(scene, text)
    of_viewers = viewer_reports.images_of(solution, scene, arguments.viewers, reports.conflict)
    for image, shown in (yield from progress_in_tenths(of_viewers)).items():
        is_of_display = image == viewer_reports.CONFLICT
        form = "EXR_FLOAT" if is_of_display else "PNG8"
        jobs.append((image, shown, form, size if is_of_display else None))

    if arguments.preview:
        yield "rendering the preview in Cycles"
        with Preview(
            scene, reading, scene.kiriko.result.source, samples=arguments.samples or SAMPLES
        ) as preview:
            jobs.append(("preview", preview.render()[..., :3], "PNG8", None))
        numbers["preview_notes"] = preview.notes

    if arguments.simulate:
        yield "simulating the plate's mirrors"
        plans = plans_to_simulate(reading.rig, settings)
        steps = simulate_colours(plans, solution.source, arguments.simulate)
        found = yield from progress_in_tenths(steps)
        jobs.append(("simulated", found.image, "PNG8", None))
        numbers["simulated"] = {
            "rays_a_pixel": found.spp,
            "noise": found.error,
            "luminance": by_path(found.luminance),
            "luminance_by_other_paths": found.luminance[OTHER_PATH],
            "luminance_error": by_path(found.luminance_error),
        }

    with disk.together(arguments.out) as scratch:
        for image, pixels, form, area in jobs:
            for section, path in files_of_image[image].items():
                image_io.write(
                    scratch / path.name,
                    pixels if section.name == "" else section.of(pixels),
                    form,
                    size=area,
                    title=f"Kiriko {image} image",
                    gamma=gamma_of(scene, section.name) if image == "source" else None,
                )
        disk.write_text(scratch / files["report"].name, json.dumps(numbers, indent=2) + "\n")

    yield Message("wrote {n} files to '{folder}'", n=len(jobs) + 1, folder=arguments.out)


def products_given(
    context: bpy.types.Context, arguments: argparse.Namespace
) -> Generator[str, None, None]:
    """Apply the requested products to the open file; yields a line for each."""
    for given in _with_products(context, arguments):
        if not given.is_whole:
            raise RigError("{reason}", reason=given.text)
        yield given.text


def _with_products(context: bpy.types.Context, arguments: argparse.Namespace) -> list[Given]:
    """Apply the requested products to the open file."""
    check_products(context.scene, arguments)
    parts = needed.parts(context.scene)
    plates, displays, glasses = (
        list(parts.get(role, {})) for role in ("PLATE", "DISPLAY", "GLASS")
    )
    given = []
    if arguments.plate:
        given += [give_plate(context, thing, PLATES[arguments.plate]) for thing in plates]
    if arguments.display:
        given += [give_display(context, thing, DISPLAYS[arguments.display]) for thing in displays]
    if arguments.glass:
        given += give_glass(glasses, GLASSES[arguments.glass])
    return given


def check_products(scene: bpy.types.Scene, arguments: argparse.Namespace) -> None:
    """Raise RigError if no part can be a requested product."""
    if arguments.plate and not needed.parts(scene).get("PLATE"):
        raise RigError("The rig has no plate: leave out --plate.")


def _numbers(scene: bpy.types.Scene, text: str) -> dict[str, Any]:
    result = scene.kiriko.result
    return {
        "file": Path(bpy.data.filepath).name,
        "blender": bpy.app.version_string,
        "summary": text,
        **StoredNumbers.read(result.details).by_name,
        "notes": result.notes.splitlines(),
    }


NAME = "source_####"
SCENE = "scene"  # means the frames that the scene would render


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of frames."""
    parser.add_argument(
        "--frames",
        metavar="LIST",
        help="only the source images of these frames, such as 1-250:2 or 1,5,10-20, or 'scene' for"
        " the scene's range and step; existing files stay unless --overwrite is given",
    )
    parser.add_argument(
        "--name",
        help=f"of the frames' files, where # are digits of the number ({NAME})",
    )
    parser.add_argument(
        "--placeholders",
        action="store_true",
        help="create an empty file for each frame while it is solved, so other processes skip this"
        " frame; with --overwrite they also skip frames replaced since they started",
    )
    parser.add_argument(
        "--log",
        metavar="PART",
        help="write a separate log for this process, which 'join' merges with the others",
    )

    parser.add_argument(
        "--movie",
        choices=movie.CODECS,
        metavar="CODEC",
        help=f"a movie of the frames, too, by Blender's encoder: {', '.join(movie.CODECS)}",
    )
    parser.add_argument(
        "--test-card",
        type=_card,
        metavar="SECONDS",
        help=f"for which the movie begins with a test card, up to {frames.LONGEST:g} (0)",
    )


def _card(text: str) -> float:
    with suppress(ValueError):
        if 0 <= float(text) <= frames.LONGEST:
            return float(text)
    raise argparse.ArgumentTypeError(f"'{text}' is no time from 0 to {frames.LONGEST:g} s")


def wanted(arguments: argparse.Namespace, scene: bpy.types.Scene) -> dict[int, Path]:
    """Files of the requested frames."""
    requested = arguments.frames
    numbers = frames_of_range(scene) if requested == SCENE else frames_of(requested)
    return frame_files(scene, arguments.out, name_of(arguments), arguments.format, numbers)


def name_of(arguments: argparse.Namespace) -> str:
    """The requested name."""
    return NAME if arguments.name is None else arguments.name


def wish_of(arguments: argparse.Namespace, scene: bpy.types.Scene) -> frames.Wish:
    """The requested movie."""
    name = without_number(scene, name_of(arguments)) or "movie"
    return frames.Wish(
        arguments.out / name, arguments.movie, arguments.test_card or 0.0, arguments.overwrite
    )


def solve_frames(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Solve frames into the folder; yields lines of progress."""
    image_io.openimageio()
    context = bpy.context
    files = wanted(arguments, context.scene)
    yield from products_given(context, arguments)
    yield Message(
        "solving {n} frame{s} of '{file}'",
        n=len(files),
        s="" if len(files) == 1 else "s",
        file=Path(bpy.data.filepath).name,
    )
    run = frames.Run(
        files,
        arguments.format,
        arguments.overwrite,
        arguments.placeholders,
        LOG if arguments.log is None else log_of(arguments.log),
    )
    tally = frames.Tally()

    if arguments.movie is None:
        yield from progress_in_tenths(frames.solved(context, run, tally))
        if tally.failed:
            raise RigError("{reason}", reason=tally.sentence(arguments.out))
        yield tally.sentence(arguments.out)
        return

    wish = wish_of(arguments, context.scene)
    steps = frames.made(context, run, wish, tally, "add --overwrite")
    yield from progress_in_tenths(steps)
    yield tally.sentence(arguments.out)
    yield frames.movie_report(wish, run)
