"""Solve to a folder: all images of a saved rig, and its numbers, as files."""

import argparse
import json
from collections.abc import Generator
from pathlib import Path
from typing import Any, TypeVar

import bpy
import numpy as np

from ..core.base.errors import RigError
from ..core.base.messages import Message
from ..core.blender.chosen_product import Given, give_display, give_glass, give_plate
from ..core.blender.preview import Preview
from ..core.blender.result import write_solution, write_viewers
from ..core.blender.stored_records import Numbers
from ..core.files import disk, image_io
from ..core.image.simulation import simulate
from ..core.rig.catalogue import DISPLAYS, GLASSES, PLATES
from . import folder, look_over, needed, viewer_reports, viewer_words, work
from .export import gamma_of

Result = TypeVar("Result")

SAMPLES = 16  # rays a pixel of the preview
# the products that a part of the file may be changed for, by its role
PRODUCTS = {"plate": PLATES, "display": DISPLAYS, "glass": GLASSES}


def file_names(arguments: argparse.Namespace) -> dict[str, Path]:
    """The files that solving writes, by the image in them."""
    names = {
        "source": str(image_io.named_for("source", arguments.format)),
        "ideal": "ideal.png",
        "seen": "seen.png",
        "coverage": "coverage.png",
        "report": "report.json",
    }
    if not arguments.format.startswith("EXR"):  # else the source itself is linear
        names["linear"] = "source.exr"
    if arguments.preview:
        names["preview"] = "preview.png"
    if arguments.simulate:
        names["simulated"] = "simulated.png"
    names |= viewer_reports.file_names(bpy.context.scene, arguments.viewers)

    return {image: arguments.out / name for image, name in names.items()}


def told_in_tenths(steps: Generator[float, None, Result]) -> Generator[str, None, Result]:
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


def solve(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Solve and write the files; yields lines of progress."""
    image_io.openimageio()
    files = file_names(arguments)

    if not arguments.overwrite:
        folder.refuse_existing(
            arguments.out, (path.name for path in files.values()), "add --overwrite"
        )

    context = bpy.context
    scene = context.scene
    yield from products_given(context, arguments)
    reading = look_over.read_to_solve(context)
    yield Message("solving '{file}'", file=Path(bpy.data.filepath).name)
    settings = work.settings_of(scene)
    solution = yield from told_in_tenths(work.session().solve(reading.rig, settings))
    text = write_solution(scene, reading, solution)
    yield text
    told = yield from told_in_tenths(viewer_reports.reports_of(solution, settings))
    write_viewers(scene, told.numbers)
    yield from viewer_words.lines(scene, told.numbers)

    yield "looking beside the glass"
    yield from told_in_tenths(solution.look_beside())

    size = tuple(reading.display_size) if reading.display_size is not None else None
    jobs: list[tuple[str, np.ndarray, str, tuple[float, float] | None]] = [
        ("source", solution.source, arguments.format, size),
        ("ideal", solution.ideal(), "PNG8", None),
        ("seen", solution.seen(beside=True), "PNG8", None),
        ("coverage", solution.display_coverage, "PNG8", size),
    ]
    if "linear" in files:
        jobs.append(("linear", solution.source, "EXR_FLOAT", size))
    numbers = _numbers(scene, text)
    of_viewers = viewer_reports.images_of(solution, scene, arguments.viewers, told.conflict)
    for image, shown in (yield from told_in_tenths(of_viewers)).items():
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
        plan = work.session().plan(reading.rig, settings)
        found = yield from told_in_tenths(simulate(plan, solution.source, arguments.simulate))
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
                scratch / files[image].name,
                pixels,
                form,
                size=area,
                title=f"Kiriko {image} image",
                gamma=gamma_of(scene) if image == "source" else None,
            )
        disk.write_text(scratch / files["report"].name, json.dumps(numbers, indent=2) + "\n")

    yield Message("wrote {n} files to '{folder}'", n=len(jobs) + 1, folder=arguments.out)


def products_given(
    context: bpy.types.Context, arguments: argparse.Namespace
) -> Generator[str, None, None]:
    """Change parts of the open file for the products that are asked for; yields a line on each."""
    for given in _with_products(context, arguments):
        if not given.is_whole:
            raise RigError("{given}", given=given.text)
        yield given.text


def _with_products(context: bpy.types.Context, arguments: argparse.Namespace) -> list[Given]:
    """Change parts of the open file for the products that are asked for."""
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
    """Raise RigError where no part could be a product that is asked for."""
    if arguments.plate and not needed.parts(scene).get("PLATE"):
        raise RigError(
            "The rig has no plate that could be '{plate}': leave out --plate.",
            plate=arguments.plate,
        )


def _numbers(scene: bpy.types.Scene, text: str) -> dict[str, Any]:
    result = scene.kiriko.result
    return {
        "file": Path(bpy.data.filepath).name,
        "blender": bpy.app.version_string,
        "summary": text,
        **Numbers.read(result.details).by_name,
        "notes": result.notes.splitlines(),
    }
