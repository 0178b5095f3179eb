"""The command line's way from the frames of a saved file to a folder."""

import argparse
from collections.abc import Generator
from contextlib import suppress
from pathlib import Path

import bpy

from ..core.base.errors import RigError
from ..core.base.messages import Message
from ..core.blender import movie
from ..core.blender.frames import frame_files, frames_of_range, without_number
from ..core.files import image_io
from ..core.files.frame_list import frames_of
from ..core.lab.farm.join import LOG, log_of
from . import frames, movies, solve_to_folder

NAME = "source_####"
SCENE = "scene"  # in place of a list: the frames that the scene would render


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of frames."""
    parser.add_argument(
        "--frames",
        metavar="LIST",
        help="the source images alone of these frames, such as 1-250:2 or 1,5,10-20, or 'scene' for"
        " the scene's range and step; those that are there stay, unless --overwrite is given",
    )
    parser.add_argument(
        "--name",
        help=f"of the frames' files, where # are digits of the number ({NAME})",
    )
    parser.add_argument(
        "--placeholders",
        action="store_true",
        help="an empty file for each frame while it is solved, which other processes leave out;"
        " with --overwrite they also leave out frames replaced since they started",
    )
    parser.add_argument(
        "--log",
        metavar="PART",
        help="a log of its own for this process, which 'join' puts together with the others",
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
        help=f"for which the movie begins with a test card, up to {movies.LONGEST:g} (0)",
    )


def _card(text: str) -> float:
    with suppress(ValueError):
        if 0 <= float(text) <= movies.LONGEST:
            return float(text)
    raise argparse.ArgumentTypeError(f"'{text}' is no time from 0 to {movies.LONGEST:g} s")


def wanted(arguments: argparse.Namespace, scene: bpy.types.Scene) -> dict[int, Path]:
    """The files of the frames that are asked for."""
    asked = arguments.frames
    numbers = frames_of_range(scene) if asked == SCENE else frames_of(asked)
    return frame_files(scene, arguments.out, name_of(arguments), arguments.format, numbers)


def name_of(arguments: argparse.Namespace) -> str:
    """The name that is asked for."""
    return NAME if arguments.name is None else arguments.name


def wish_of(arguments: argparse.Namespace, scene: bpy.types.Scene) -> movies.Wish:
    """The movie that is asked for."""
    name = without_number(scene, name_of(arguments)) or "movie"
    return movies.Wish(
        arguments.out / name, arguments.movie, arguments.test_card or 0.0, arguments.overwrite
    )


def solve(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Solve frames into the folder; yields lines of progress."""
    image_io.openimageio()
    context = bpy.context
    files = wanted(arguments, context.scene)
    yield from solve_to_folder.products_given(context, arguments)
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
        yield from solve_to_folder.told_in_tenths(frames.solved(context, run, tally))
        if tally.failed:
            raise RigError("{told}", told=tally.told(arguments.out))
        yield tally.told(arguments.out)
        return

    wish = wish_of(arguments, context.scene)
    steps = movies.made(context, run, wish, tally, "add --overwrite")
    yield from solve_to_folder.told_in_tenths(steps)
    yield tally.told(arguments.out)
    yield movies.told(wish, run)
