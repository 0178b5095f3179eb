"""Before a job is written: can its tasks solve anything, for each rig and each viewer?"""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import bpy

from ..core.base.errors import KirikoError
from ..core.blender.frames import frame_kept
from ..core.blender.rigs import active_rig, rigs
from ..core.files.frame_list import frames_of
from ..core.lab.farm.job import Job
from ..core.light.mesh_cache import Kept
from ..core.solve.first_picture import check_light
from . import work
from .set_value import having
from .viewer_reports import choose_alone, naming_rig, naming_viewer

MOST = 64  # frames of a job that are looked at, where the rig is whole at none before


def check_rigs(context: bpy.types.Context, job: Job) -> None:
    """Raise the error with which all tasks of a rig, or of a viewer, would end: that of Solve.

    A rig that is whole at one frame at least, or with one of the values, is good enough. Nothing of
    the scene is changed in the end.
    """
    kept = Kept()  # glass is made ready once for all viewers
    for rig in [one.value for one in job.rigs] or [None]:
        with naming_rig(rig), _chosen(context.scene, rig):
            for viewer in [one.value for one in job.viewers] or [None]:
                with naming_viewer(viewer), _alone(context.scene, viewer):
                    _check_one(context, job, kept)


def _check_one(context: bpy.types.Context, job: Job, kept: Kept) -> None:
    """Raise the first of the errors, where each of the job's tasks for a rig has one."""
    first = None
    for value in [one.value for one in job.values] or [None]:
        with ExitStack() as stack:
            if value is not None:
                stack.enter_context(having(job.path, value))
            stack.enter_context(frame_kept(context.scene))
            for frame in _frames(context.scene, job):
                if frame != context.scene.frame_current:
                    context.scene.frame_set(frame)
                try:
                    rig = work.read(context).rig
                    rig.check()
                    check_light(kept, rig, work.settings_of(context.scene))
                except KirikoError as error:
                    first = first or error
                else:
                    return
    if first is not None:
        raise first


def _frames(scene: bpy.types.Scene, job: Job) -> list[int]:
    """Those that are looked at: the one that the scene shows first, which costs least."""
    if not job.frames:
        return [scene.frame_current]
    frames = frames_of(job.frames)
    n = min(len(frames), MOST)
    some = [frames[k * (len(frames) - 1) // max(n - 1, 1)] for k in range(n)]
    return sorted(some, key=lambda frame: frame != scene.frame_current)


@contextmanager
def _chosen(scene: bpy.types.Scene, name: str | None) -> Iterator[None]:
    """Have a rig of the scene be the active one for a while."""
    own = active_rig(scene)
    scene.kiriko_scene.rig = next((one for one in rigs(scene) if one.name == name), own)
    try:
        yield
    finally:
        scene.kiriko_scene.rig = own


@contextmanager
def _alone(scene: bpy.types.Scene, name: str | None) -> Iterator[None]:
    """Have all other viewers be off for a while."""
    ours = scene.kiriko
    before = [one.is_on for one in ours.viewers], ours.viewer_shown
    try:
        if name is not None:
            choose_alone(scene, name)
        yield
    finally:
        for one, is_on in zip(ours.viewers, before[0], strict=True):
            if one.is_on != is_on:
                one.is_on = is_on
        if ours.viewer_shown != before[1]:
            ours.viewer_shown = before[1]
