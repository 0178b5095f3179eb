"""Command line verbs for a render farm: job writes one, join is its last task."""

import argparse
from collections.abc import Generator
from dataclasses import replace
from typing import Any

import bpy

from ...core.base.messages import Message
from ...core.base.steps import run_steps
from ...core.blender.data.scene_frames import frame_files, frames_of_range
from ...core.files import disk, image_io
from ...core.files.frame_list import frames_of
from ...core.lab.farm import job as joining
from .. import export_job
from ..choose_rig import choose_by_name
from ..export_job import check_rigs
from ..set_value import check_values, idle
from ..viewer_reports import ALL, viewers_requested
from . import to_folder
from .usage import VALUES, as_is, path


def add_verbs(verbs: Any, shared: argparse.ArgumentParser) -> None:
    """Add both to the command line."""
    job = verbs.add_parser(
        "job", parents=[shared], help="write a job for a render farm, in Open Job Description"
    )
    _add_form(job)
    job.add_argument(
        "--frames",
        metavar="LIST",
        help="frames, such as 1-250:2 or 1,5,10-20, or 'scene' (default: the current frame)",
    )
    job.add_argument(
        "--chunk", type=int, metavar="N", help=f"frames for a task ({export_job.CHUNK})"
    )
    job.add_argument(
        "--vary",
        default="",
        metavar="PROPERTY",
        help="property to vary from task to task, such as kiriko.tolerance (of the scene) or"
        ' objects["Glass"].kiriko.ior',
    )
    job.add_argument(VALUES, nargs="+", type=as_is, default=[], metavar="VALUE", help="its values")
    job.add_argument(
        "--viewers",
        nargs="+",
        default=[],
        metavar="NAME",
        help="one task per viewer, solved only for it: camera names, or 'all'",
    )
    job.add_argument(
        "--zip",
        type=path,
        nargs="+",
        default=[],
        metavar="FILE",
        help="Kiriko's zips for the farm's platforms (default: this installation, zipped)",
    )
    job.set_defaults(run=write_job)

    join = verbs.add_parser(
        "join",
        parents=[shared],
        help="check that all images of a job exist, are complete and have the same size, and merge"
        " their logs",
    )
    _add_form(join)
    join.add_argument("--frames", metavar="LIST", help="the job's frames")
    join.add_argument(
        "--folders", nargs="+", default=["."], metavar="NAME", help="within the job's folder"
    )
    join.set_defaults(run=join_results)


def _add_form(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--format",
        choices=image_io.FORMATS,
        default="PNG8",
        help="file format of the images (default: PNG8)",
    )
    parser.add_argument(
        "--name",
        help=f"of the frames' files, where # are digits ({to_folder.NAME})",
    )


def write_job(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Write the job; yields lines of progress."""
    context = bpy.context
    frames = arguments.frames or ""
    if frames == to_folder.SCENE:
        frames = export_job.frames_of_scene(context.scene)

    options = ["--format", arguments.format] if arguments.format != "PNG8" else []
    if arguments.name is not None:
        options.append(f"--name={arguments.name}")
    job = replace(
        export_job.job_of(frames, export_job.CHUNK if arguments.chunk is None else arguments.chunk),
        path=arguments.vary,
        values=export_job.choices(arguments.values),
        options=tuple(options),
    )
    if arguments.rig == ALL:
        job = replace(job, rigs=export_job.all_rigs(context))
    elif arguments.rig is not None:
        choose_by_name(context, arguments.rig)  # reports a missing part
        job = replace(job, rigs=export_job.choices([arguments.rig]))

    if arguments.viewers:
        if arguments.rig == ALL:
            raise export_job.viewers_of_all("name it by --rig")
        viewers = viewers_requested(context.scene, arguments.viewers)
        job = replace(job, viewers=export_job.choices(viewers))

    job.check()
    if frames:  # reports an impossible file name, by the disk of the results
        longest = max(frames_of(frames), key=lambda frame: len(str(frame)))
        name = to_folder.name_of(arguments)
        named = frame_files(context.scene, arguments.out, name, arguments.format, [longest])
        disk.is_there(named[longest])
    if job.path:
        check_values(job.path, arguments.values)
    check_rigs(context, job)
    names = export_job.write(
        arguments.out, job, arguments.zip, arguments.overwrite, "add --overwrite"
    )
    if job.path:
        yield from idle([job.path])
    yield Message("wrote {names} to '{folder}'", names=", ".join(names), folder=arguments.out)


def join_results(arguments: argparse.Namespace) -> Generator[str, None, None]:
    """Check all images of a job and join its logs; yields lines of progress."""
    numbers = ()
    if arguments.frames == to_folder.SCENE:
        numbers = frames_of_range(bpy.context.scene)
    elif arguments.frames:
        numbers = frames_of(arguments.frames)

    for name in arguments.folders:
        place = arguments.out / name
        files = [image_io.named_for(place / "source", arguments.format)]
        if numbers:
            of_name = to_folder.name_of(arguments)
            named = frame_files(bpy.context.scene, place, of_name, arguments.format, numbers)
            files = list(named.values())
        size = run_steps(joining.check(files))
        joining.join_logs(place)
        yield joining.join_report(len(files), size, place)
