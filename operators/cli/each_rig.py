"""Checks of all rigs before the command line writes anything."""

import argparse
from collections.abc import Iterable
from pathlib import Path

import bpy

from .. import bench_drawing, export_maps, folder, report, set_value, viewer_images, work
from ..choose_rig import choose_by_name
from ..viewer_reports import naming_rig, viewers_requested
from . import to_folder


def check(arguments: argparse.Namespace, folders: dict[str, Path]) -> None:
    """Raise the first error that work on any of the rigs would begin with; each rig is chosen once.

    folders : for results, by rig name
    """
    for name, out in folders.items():
        with naming_rig(name):
            choose_by_name(bpy.context, name)
            set_value.set_values(arguments.set)
            _check_active(argparse.Namespace(**{**vars(arguments), "out": out}))


def _check_active(arguments: argparse.Namespace) -> None:
    scene, given = bpy.context.scene, vars(arguments)
    # Not read here: another frame may have parts that this one does not.
    is_changed = given.get("frames") is not None
    viewers_requested(scene, given.get("viewers", []))
    if given.get("only_viewer") is not None:
        viewers_requested(scene, [arguments.only_viewer])
        is_changed = True
    if given.get("pictures"):
        viewer_images.check_images(scene, arguments.pictures)
        is_changed = True
    if any(given.get(role) for role in to_folder.PRODUCTS):
        to_folder.check_products(scene, arguments)
        is_changed = True
    if not is_changed:
        work.read(bpy.context).rig.check()
    if not arguments.overwrite:
        folder.refuse_existing(arguments.out, _files(arguments), "add --overwrite")


def _files(arguments: argparse.Namespace) -> Iterable[str]:
    """Files that work on the active rig will write, as far as known in advance."""
    if arguments.verb == "solve":
        if arguments.frames is None:
            return [path.name for path in to_folder.file_names(arguments).values()]
        if arguments.movie is not None:
            return [to_folder.wish_of(arguments, bpy.context.scene).file.name]
        return []
    if arguments.verb == "report":
        return report.names(work.read(bpy.context).rig)
    if arguments.verb == "eyes":
        return report.files_of(work.read(bpy.context).rig)
    # only those that exist in any case
    return {"maps": [export_maps.SIDECAR], "drawing": [bench_drawing.NAME]}.get(arguments.verb, [])
