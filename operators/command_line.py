"""`blender --background FILE --command kiriko solve --out DIR`: solve a saved rig and write the results to a folder."""

import argparse
import json
import sys
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import bpy
import numpy as np

from ..core import image_io
from ..core.blender_preview import Preview
from ..core.blender_result import write_solution
from ..core.errors import ImageError, KirikoError, RigError
from . import work
from .export import use_bundled_modules

USAGE_ERROR = 2  # exit code, as other commands have it


class UsageError(KirikoError):
    """The command line cannot be understood."""


class _Parser(argparse.ArgumentParser):
    """A parser that makes one sentence of a mistake, in place of the usage and an exit."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message[:1].upper()}{message[1:].rstrip('.')}; try 'kiriko --help'.")


def parser() -> argparse.ArgumentParser:
    """What `--command kiriko` takes."""
    top = _Parser(
        prog="blender --background FILE --command kiriko", description="Images inside glass, without a window."
    )
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB")
    solve = verbs.add_parser("solve", help="compute the source image and write it to a folder")
    solve.add_argument(
        "--out", required=True, type=_folder_name, metavar="DIR", help="folder for the results; made if need be"
    )
    solve.add_argument("--overwrite", action="store_true", help="replace results that are there already")
    solve.add_argument("--preview", action="store_true", help="render what the viewer sees in Cycles, too")
    solve.add_argument("--samples", type=_count, default=16, metavar="N", help="rays a pixel of the preview (16)")
    solve.add_argument("--format", choices=image_io.FORMATS, default="PNG8", help="of source.png or source.tif (PNG8)")
    return top


def run(argv: list[str]) -> int:
    """Called by Blender with what follows the command's name; what it returns is the exit code."""
    try:
        arguments = parser().parse_args(argv)
        for line in solve(arguments):
            sys.stdout.write(f"kiriko: {line}\n")
            sys.stdout.flush()
    except SystemExit as end:  # --help
        return int(end.code or 0)
    except KirikoError as error:
        sys.stderr.write(f"kiriko: {error}\n")
        return USAGE_ERROR if isinstance(error, UsageError) else 1
    return 0


@contextmanager
def _folder(folder: Path) -> Iterator[None]:
    """Make the folder and see that it can be written, before any work is done for it; gone again if it stays empty."""
    is_new = not image_io.is_there(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as reason:
        raise ImageError(f"The folder '{folder}' cannot be written ({reason.strerror}): choose another one.") from None
    try:
        image_io.check_folder(folder)
        yield
    finally:
        if is_new and not any(folder.iterdir()):
            folder.rmdir()


def _count(text: str) -> int:
    number = int(text)
    if number < 1:
        raise ValueError(f"{number} is not 1 or more")
    return number


def _folder_name(text: str) -> Path:
    if not text:
        raise ValueError("a folder needs a name")
    return Path(text)


def _files(arguments: argparse.Namespace) -> dict[str, Path]:
    """The files to write, by what they show; ImageError when one is there already and may not be replaced."""
    form = arguments.format
    names = {
        "source": str(image_io.named_for("source", form)),
        "linear": "source.exr",
        "ideal": "ideal.png",
        "seen": "seen.png",
        "coverage": "coverage.png",
        "report": "report.json",
    }
    if arguments.preview:
        names["preview"] = "preview.png"
    files = {what: arguments.out / name for what, name in names.items()}
    there = [path.name for path in files.values() if image_io.is_there(path)]
    if there and not arguments.overwrite:
        raise ImageError(
            f"The folder '{arguments.out}' has {', '.join(there)} already: choose another or add --overwrite."
        )
    return files


def solve(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Solve the open file's scene and write the results; yields lines of progress."""
    if not bpy.data.filepath:
        # Blender goes on with its startup scene when the file it was given is missing
        raise RigError("No .blend file was loaded: name an existing file before --command.")
    use_bundled_modules()
    image_io.openimageio()
    with _folder(arguments.out):
        yield from _solve_into(arguments, _files(arguments))


def _solve_into(arguments: argparse.Namespace, files: dict[str, Path]) -> Generator[str, None, None]:
    """Solve and write the files; yields lines of progress."""
    context = bpy.context
    scene = context.scene
    reading = work.read(context)
    yield f"solving '{Path(bpy.data.filepath).name}'"
    steps = work.session().solve(reading.rig, work.settings_of(scene))
    told = 0
    while True:
        try:
            done = int(10 * next(steps))
        except StopIteration as end:
            solution = end.value
            break
        if done > told:
            told = done
            yield f"{10 * done} %"
    text = write_solution(scene, reading, solution)
    yield text

    size = tuple(reading.display_size) if reading.display_size is not None else None
    linear = arguments.format if arguments.format.startswith("EXR") else "EXR_FLOAT"
    jobs: list[tuple[str, np.ndarray, str, tuple[float, float] | None]] = [
        ("source", solution.source, arguments.format, size),
        ("linear", solution.source, linear, size),
        ("ideal", solution.ideal(), "PNG8", None),
        ("seen", solution.seen(), "PNG8", None),
        ("coverage", solution.display_coverage, "PNG8", size),
    ]
    report = _report(scene, text)
    if arguments.preview:
        yield "rendering the preview in Cycles"
        with Preview(scene, reading, scene.kiriko.result.source, samples=arguments.samples) as preview:
            jobs.append(("preview", preview.render()[..., :3], "PNG8", None))
        report["preview_notes"] = preview.notes
    for what, pixels, form, area in jobs:
        image_io.write(files[what], pixels, form, size=area, title=f"Kiriko {what} image", overwrite=True)
    image_io.write_text(files["report"], json.dumps(report, indent=2) + "\n")
    yield f"wrote {len(files)} files to '{arguments.out}'"


def _report(scene: bpy.types.Scene, text: str) -> dict[str, Any]:
    result = scene.kiriko.result
    return {
        "file": Path(bpy.data.filepath).name,
        "blender": bpy.app.version_string,
        "summary": text,
        **json.loads(result.details),
        "notes": result.notes.splitlines(),
    }
