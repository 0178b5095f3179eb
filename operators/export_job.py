"""Export of a job: a folder for a farm's scheduler, with everything its tasks need."""

import json
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from secrets import token_hex

import bpy

from ..core.base.errors import ImageError, KirikoError, RigError
from ..core.base.messages import Message
from ..core.blender.data.camera_viewer import seats_of
from ..core.blender.data.files_read import files_read
from ..core.blender.data.paths import RELATIVE_PATH, absolute
from ..core.blender.data.reports import said_by
from ..core.blender.data.rigs import active_rig, rigs
from ..core.blender.data.scene_frames import frame_restored
from ..core.files import disk
from ..core.files.frame_list import frames_of
from ..core.lab.farm import extension
from ..core.lab.farm.job import (
    BOOTSTRAP,
    FLAMENCO,
    KIRIKO,
    OUT,
    AtlasJob,
    Job,
    TaskChoice,
    asset_references,
    parameter_values,
)
from ..core.light.mesh_cache import MeshCache
from ..core.solve.first_picture import check_light
from . import folder, needed, reporting, work
from .set_value import having
from .viewer_reports import ALL, choose_alone, naming_rig, naming_viewer, viewers_requested

MOST = 64  # frames of a job to try until one has a complete rig


def check_rigs(context: bpy.types.Context, job: Job) -> None:
    """Raise the error that all tasks of a rig or viewer would end with, as Solve words it.

    One frame, or one value, with a complete rig is enough. The scene is left unchanged.
    """
    cache = MeshCache()  # glass is prepared once for all viewers
    for rig in [one.value for one in job.rigs] or [None]:
        with naming_rig(rig), _chosen(context.scene, rig):
            for viewer in [one.value for one in job.viewers] or [None]:
                with naming_viewer(viewer), _alone(context.scene, viewer):
                    _check_one(context, job, cache)


def _check_one(context: bpy.types.Context, job: Job, cache: MeshCache) -> None:
    """Raise the first error if each of the job's tasks for a rig has one."""
    first = None
    for value in [one.value for one in job.values] or [None]:
        with ExitStack() as stack:
            if value is not None:
                stack.enter_context(having(job.path, value))
            stack.enter_context(frame_restored(context.scene))
            for frame in _frames(context.scene, job):
                if frame != context.scene.frame_current:
                    context.scene.frame_set(frame)
                try:
                    rig = work.read(context).rig
                    rig.check()
                    check_light(cache, rig, work.settings_of(context.scene))
                except KirikoError as error:
                    first = first or error
                else:
                    return
    if first is not None:
        raise first


def _frames(scene: bpy.types.Scene, job: Job) -> list[int]:
    """Frames to try; the current one comes first, since it costs least."""
    if not job.frames:
        return [scene.frame_current]
    frames = frames_of(job.frames)
    n = min(len(frames), MOST)
    some = [frames[k * (len(frames) - 1) // max(n - 1, 1)] for k in range(n)]
    return sorted(some, key=lambda frame: frame != scene.frame_current)


@contextmanager
def _chosen(scene: bpy.types.Scene, name: str | None) -> Iterator[None]:
    """Make a rig of the scene active for a while."""
    own = active_rig(scene)
    scene.kiriko_scene.rig = next((one for one in rigs(scene) if one.name == name), own)
    try:
        yield
    finally:
        scene.kiriko_scene.rig = own


@contextmanager
def _alone(scene: bpy.types.Scene, name: str | None) -> Iterator[None]:
    """Turn all other viewers off for a while."""
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


TEMPLATE = "template.json"
VALUES = "parameter_values.json"
ASSETS = "asset_references.json"
CHUNK = 10  # frames per task
UNNAMED = "rig.blend"  # name for an unsaved file
SCRIPTS = extension.ROOT / "farm"  # scripts that run on the farm


def job_of(frames: str, chunk: int) -> Job:
    """A job of the open file and its active rig."""
    return Job(*_of_file(), frames=frames, chunk=chunk)


def atlas_job(options: tuple[str, ...], shares: int, overwrite: bool = False) -> AtlasJob:
    """A job for an atlas of the open file's active rig.

    options : of the verb atlas
    overwrite : whether its plan may replace the atlas of another rig or box
    """
    return AtlasJob(*_of_file(), options, shares, overwrite)


def _of_file() -> tuple[str, str, str]:
    """A job's name, its file's name, and Kiriko's version."""
    name = Path(bpy.data.filepath).name or UNNAMED
    return f"Kiriko {Path(name).stem}", name, extension.manifest()["version"]


def choices(values: list[str]) -> tuple[TaskChoice, ...]:
    """Values, each with a folder."""
    return tuple(map(TaskChoice, values, folder.names_for(values)))


def all_rigs(context: bpy.types.Context) -> tuple[TaskChoice, ...]:
    """All rigs of the scene."""
    return choices([rig.name for rig in rigs(context.scene)])


def viewers_of_all(remedy: str) -> RigError:
    """Error for viewers of several rigs; `remedy` ends its sentence."""
    return RigError("A job for each viewer needs a single rig: {remedy}.", remedy=remedy)


def frames_of_scene(scene: bpy.types.Scene) -> str:
    """The scene's frames as a frame list in text."""
    step = f":{scene.frame_step}" if scene.frame_step > 1 else ""
    return f"{scene.frame_start}-{scene.frame_end}{step}"


def write(
    target: Path, job: Job | AtlasJob, zips: list[Path], overwrite: bool, remedy: str
) -> list[str]:
    """Write the files of a job to an existing folder, all or none; returns their names.

    zips : of Kiriko for the farm's platforms; none: this one, packed
    remedy : ends the sentence about existing files
    """
    job.check()
    if bpy.data.filepath and (target / job.blend).resolve() == Path(bpy.data.filepath).resolve():
        raise ImageError(
            "The job's copy of '{file}' would replace the file itself: choose another folder.",
            file=job.blend,
        )
    for path in zips:
        extension.check_zip(path)
        if sum(path.name.casefold() == other.name.casefold() for other in zips) > 1:
            raise ImageError("Two zips are called '{name}': rename one of them.", name=path.name)
    names = [job.blend, KIRIKO, ASSETS, VALUES, TEMPLATE]
    if not overwrite:
        folder.refuse_existing(target, names, remedy)
    if isinstance(job, Job):  # an atlas recognises its own maps by its index
        _refuse_results(target)

    with disk.together(target) as new:
        _write_scripts(new / KIRIKO, zips)
        save_copy_into(new, target / job.blend)
        for name, contents in (
            (ASSETS, asset_references(files_read())),
            (VALUES, parameter_values(job.template)),
            (TEMPLATE, job.template),
        ):
            text = json.dumps(contents, indent=2, ensure_ascii=False)
            disk.write_text(new / name, f"{text}\n")
    for path in (target / KIRIKO).glob("*.zip"):  # of the replaced job
        if extension.is_of_another_version(path) or (zips and path.name == _packed()):
            disk.remove(path)
    return names


def _refuse_results(target: Path) -> None:
    """Raise ImageError if tasks would mistake the images of another job for theirs."""
    results = target / OUT
    is_taken = disk.is_there(results) and (
        not results.is_dir()
        or any(not path.name.startswith(disk.PREFIX) for path in results.iterdir())
    )
    if is_taken:
        raise ImageError(
            "The folder '{folder}' has results of an earlier job, which the tasks would leave as"
            " they are: move or remove '{results}' in it, or choose another folder.",
            folder=target,
            results=OUT,
        )


def bundle_report(names: list[str], target: Path) -> Message:
    """Report of a written job."""
    return Message("Wrote {names} to '{folder}'.", names=", ".join(names), folder=target)


def _packed() -> str:
    """Name of the zip packed here."""
    return f"kiriko-{extension.manifest()['version']}.zip"


def _write_scripts(new: Path, zips: list[Path]) -> None:
    """The scripts, and zips of Kiriko."""
    try:
        new.mkdir()
        for name in (BOOTSTRAP, FLAMENCO):
            shutil.copyfile(SCRIPTS / name, new / name)
        for path in zips:
            shutil.copyfile(path, new / path.name)
        if not zips:
            extension.pack(new / _packed())
    except OSError as reason:
        raise disk.unwritable_folder(new, reason) from None


class KIRIKO_OT_export_job(bpy.types.Operator):
    """Write a job for a render farm"""

    bl_description = (
        "Write a folder for a render farm: a job in Open Job Description, a copy of this file, and"
        " Kiriko itself, so that workers need nothing but Blender"
    )
    bl_idname = "kiriko.export_job"
    bl_label = "Export Job"
    bl_options = {"REGISTER"}

    directory: bpy.props.StringProperty(
        name="Folder",
        description="Where to write",
        subtype="DIR_PATH",
        options={"SKIP_SAVE", *RELATIVE_PATH},
    )
    frames: bpy.props.StringProperty(
        name="Frames",
        description="Frames to solve, such as 1-250:2 or 1,5,10-20; empty for the scene's range",
        options={"SKIP_SAVE"},
    )
    chunk: bpy.props.IntProperty(
        name="Frames a Task",
        description="Frames solved per launch of Blender",
        default=CHUNK,
        min=1,
        soft_max=1000,
    )
    every_rig: bpy.props.BoolProperty(
        name="Every Rig",
        description="Solve each separately, to its own folder",
    )
    every_viewer: bpy.props.BoolProperty(
        name="Every Viewer",
        description="Solve each separately, to its own folder",
    )
    overwrite: bpy.props.BoolProperty(
        name="Overwrite",
        description="Replace existing files",
        options={"SKIP_SAVE"},
    )
    filter_folder: bpy.props.BoolProperty(default=True, options={"SKIP_SAVE", "HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(cls, needed.missing_parts(context.scene))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.directory:
            return self.execute(context)
        self.frames = self.frames or frames_of_scene(context.scene)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(self, "frames")
        layout.prop(self, "chunk")
        if len(rigs(context.scene)) > 1:
            layout.prop(self, "every_rig")
        if len(seats_of(context.scene)) > 1:
            row = layout.row()
            row.active = not self.every_rig
            row.prop(self, "every_viewer")
        layout.prop(self, "overwrite")

    def execute(self, context: bpy.types.Context) -> set[str]:
        with reporting.errors_reported(self):
            if not self.directory:
                raise ImageError("The job has no folder: choose one.")
            target = absolute(self.directory)
            job = job_of(self.frames or frames_of_scene(context.scene), self.chunk)
            if self.every_rig:
                job = replace(job, rigs=all_rigs(context))
            if self.every_viewer and self.every_rig:
                raise viewers_of_all(Message("leave out Every Rig"))
            if self.every_viewer:
                viewers = viewers_requested(context.scene, [ALL])
                job = replace(job, viewers=choices(viewers))
            job.check()
            check_rigs(context, job)

            with folder.made(target):
                names = write(target, job, [], self.overwrite, Message("turn on Overwrite"))
            reporting.report(self, "INFO", bundle_report(names, target))
            return {"FINISHED"}
        return {"CANCELLED"}


def save_copy(path: Path) -> None:
    """Save the open file to another place, with paths relative to that place.

    The open file stays unchanged, and so does an existing file if the copy cannot be written:
    ImageError.
    """
    with disk.together(path.parent) as new:
        save_copy_into(new, path)


def save_copy_into(new: Path, path: Path) -> None:
    """Save a copy for that place into a folder whose files are moved there later.

    new : a folder within that of `path`
    """
    # Relative paths need the final folder; an existing file would become .blend1.
    made = path.absolute().with_name(f"{disk.PREFIX}{token_hex(8)}.blend")
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(made), copy=True, relative_remap=True)
        _check_whole(made, path)
        made.replace(new / path.name)
    except RuntimeError as reason:
        why = said_by(reason).rstrip(".").replace(str(made), str(path))
        raise ImageError(
            "The file '{file}' cannot be written ({why}): choose another folder.",
            file=path,
            why=why,
        ) from None
    finally:
        made.unlink(missing_ok=True)


def _check_whole(made: Path, path: Path) -> None:
    """Check that Blender can read what it wrote: a full disk may cut a compressed file silently."""
    try:
        with bpy.data.libraries.load(str(made)):
            pass  # the description of the data is at the file's end
    except OSError:
        raise ImageError(
            "The copy '{file}' cannot be written completely. The disk may be full: free some"
            " space, or choose another folder.",
            file=path,
        ) from None
