"""Frame by frame: the source images of an animation, each a file of its own.

A session of its own keeps from frame to frame all that has not changed: of a rig that stands still
and a picture that moves, nothing is traced after the first frame. A frame is the same bits
whichever were solved before, so that several machines can share them. None is kept in the scene,
whose result stays as it is.
"""

import json
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import bpy

from ..core.base.errors import ImageError, KirikoError, RigError
from ..core.base.messages import Message, joined
from ..core.base.steps import subprogress
from ..core.blender.data import movie
from ..core.blender.data.image import size_of
from ..core.blender.data.moving import OfMovie, Reel
from ..core.blender.data.paths import absolute
from ..core.blender.data.scene_frames import folder_of, frame_files, frame_kept, frames_of_range
from ..core.blender.read.scene import Reading
from ..core.blender.read.shapes import ShapeCache
from ..core.files import disk, image_io
from ..core.files.frame_list import frames_of
from ..core.image.test_card import card
from ..core.lab.farm.job import LOG, logged
from ..core.light.mesh_cache import MeshCache as KeptGlass
from ..core.solve.session import Session
from ..core.solve.solution import Solution
from . import choose_picture, folder, long_work, look_over, needed, telling, watch, windows, work
from .export import gamma_of, unwritable, use_bundled_modules


@dataclass(frozen=True)
class Run:
    """Frames that are wanted, and how.

    files : by frame
    form : a key of image_io.FORMATS
    overwrite : replace files that are there already; else these frames are left out
    placeholders : an empty file stands for each frame while it is solved, so that other processes
        leave it out; with `overwrite`, a frame that another process replaced meanwhile is done
    log : name of the file beside them that gets a line for each frame that was solved
    """

    files: dict[int, Path]
    form: str
    overwrite: bool = False
    placeholders: bool = False
    log: str = LOG


@dataclass
class Tally:
    """What became of the frames of a run.

    files : that were written
    there : number of files that were there already
    stale : frames whose files were there and show an earlier state of the scene
    others : number of frames that have a placeholder of another process
    traced : number of frames for which light was traced
    failed : frames that could not be solved, and why
    ended : the first frame that was solved after a movie's end, by the movie
    """

    files: list[Path] = field(default_factory=list)
    there: int = 0
    stale: list[int] = field(default_factory=list)
    others: int = 0
    traced: int = 0
    failed: list[tuple[int, str]] = field(default_factory=list)
    ended: dict[str, int] = field(default_factory=dict)

    def notice(self, frame: int, notes: Iterable[str]) -> None:
        """Keep what notes on a frame tell of its movies."""
        for note in notes:
            if isinstance(note, OfMovie):
                self.ended[note.movie] = min(frame, self.ended.get(note.movie, frame))

    @property
    def of_movies(self) -> list[Message]:
        """Sentences on movies that are too short."""
        return [
            Message(
                "The movie '{image}' ends early: from frame {frame} on its last frame is shown.",
                image=movie,
                frame=frame,
            )
            for movie, frame in self.ended.items()
        ]

    @property
    def stale_words(self) -> Message:
        """A sentence on the stale frames."""
        return Message(
            "Frames solved for an earlier state of the scene: {n}, the first is {frame}. Solve all"
            " frames anew, or remove these.",
            n=len(self.stale),
            frame=self.stale[0],
        )

    @property
    def written(self) -> int:
        """Number of files that were written."""
        return len(self.files)

    def sentence(self, folder: Path) -> Message:
        """In one or more sentences."""
        parts = [
            Message(
                "Wrote {n} frame{s} to '{folder}', {traced} of them traced anew.",
                n=self.written,
                s="" if self.written == 1 else "s",
                folder=folder,
                traced=self.traced,
            )
        ]
        if self.there:
            parts.append(Message("Already there: {n}.", n=self.there))
        if self.stale:
            parts.append(self.stale_words)
        if self.others:
            parts.append(
                Message(
                    "Left out: {n}, with an empty placeholder file of another process. If that"
                    " process was stopped, delete the empty files or solve without Placeholders.",
                    n=self.others,
                )
            )
        if self.failed:
            frame, why = self.failed[0]
            parts.append(
                Message(
                    "{n} failed, the first of them frame {frame}: {why}",
                    n=len(self.failed),
                    frame=frame,
                    why=why,
                )
            )
        return joined(parts + self.of_movies)


@dataclass(frozen=True)
class Keeps:
    """All that is kept from frame to frame."""

    shapes: ShapeCache = field(default_factory=ShapeCache)
    session: Session = field(default_factory=lambda: Session(KeptGlass(is_exact=True)))


def solved(
    context: bpy.types.Context, run: Run, tally: Tally | None = None
) -> Generator[float, None, Tally]:
    """Solve the frames of a run and write their files, each whole or not at all.

    A frame that cannot be solved is noted, and the next is begun. Yields progress 0..1. At the end,
    also where it is stopped, the scene is at its frame of before.

    tally : that is kept up to date meanwhile

    Raises
    ------
    ImageError
        A file cannot be written: the files of all frames before are whole. The log is seen to be
        writable before the first.
    """
    scene = context.scene
    tally = Tally() if tally is None else tally
    keeps = Keeps()
    n = len(run.files)
    for into in {path.parent for path in run.files.values()}:  # before any image is there
        disk.check_appendable(into / run.log)

    before = {p: disk.stamp(p) if disk.is_there(p) else None for p in run.files.values()}
    with frame_kept(scene), _news_for(keeps.shapes), _open_reel(keeps.shapes):
        solved_for = {} if run.overwrite else _solved_for(run)
        for k, (frame, path) in enumerate(run.files.items()):
            yield k / n
            if not _is_wanted(path, run, tally, before[path]):
                if path.name in solved_for:
                    scene.frame_set(frame)
                    if watch.is_another(
                        solved_for[path.name], work.scene_now, context, keeps.shapes
                    ):
                        tally.stale.append(frame)
                continue
            try:
                yield from subprogress(_one(context, keeps, frame, run, tally), k / n, (k + 1) / n)
            finally:
                if run.placeholders:
                    disk.give_up(path)

    return tally


def _solved_for(run: Run) -> dict[str, str]:
    """The fingerprint of the scene that each file of the folders was solved for, by its name."""
    folders = {path.parent for path in run.files.values()}
    lines = [line for folder in folders for line in logged(folder)]
    return {str(line["file"]): str(line["scene"]) for line in lines if "scene" in line}


def _is_wanted(path: Path, run: Run, tally: Tally, before: disk.Stamp | None) -> bool:
    """Is a frame still to be solved, and by this process?

    before : the stamp of its file when the run began
    """
    if run.placeholders:
        if run.overwrite and before is not None and disk.stamp(path) == before:
            disk.remove(path)
        is_wanted = disk.claim(path)
    else:
        is_wanted = run.overwrite or not _has_contents(path)
    if not is_wanted and _has_contents(path):
        tally.there += 1
    elif not is_wanted:
        tally.others += 1
    return is_wanted


def _has_contents(path: Path) -> bool:
    """Is there a file that is not empty? An empty one is a placeholder."""
    stamp = disk.stamp(path)
    return stamp is not None and stamp.size > 0


def _one(
    context: bpy.types.Context, keeps: Keeps, frame: int, run: Run, tally: Tally
) -> Generator[float, None, None]:
    """Solve a frame, write its file and its line in the log; yields progress 0..1."""
    began = perf_counter()
    scene = context.scene
    path = run.files[frame]
    line: dict[str, Any] = {"frame": frame, "file": path.name}

    try:
        scene.frame_set(frame)
        reading = work.read(context, keeps.shapes)
        found = [] if tally.files else look_over.findings(context)  # of the first frame, once
        reading = replace(
            reading,
            notes=(*reading.notes, *found),
            solved_for=work.scene_now(context, keeps.shapes).as_text(),
        )
        solution = yield from keeps.session.solve(reading.rig, work.settings_of(scene))
    except KirikoError as error:
        tally.failed.append((frame, error.message))
        _log(path.parent / run.log, line, began, error=str(error))
        return

    try:
        image_io.write(
            path,
            solution.source,
            run.form,
            size=None if reading.display_size is None else tuple(reading.display_size),
            gamma=gamma_of(scene),
            overwrite=True,  # another process may have written the same meanwhile
        )
        _log(path.parent / run.log, line, began, **_done(solution, reading), error=None)
    except ImageError as error:
        raise ImageError("Frame {frame}: {error}", frame=frame, error=error.message) from None

    tally.notice(frame, reading.notes)
    tally.files.append(path)
    tally.traced += solution.n_rays > 0


def _done(solution: Solution, reading: Reading) -> dict[str, Any]:
    """What a frame took, and what it shows."""
    return {
        "did": "traced" if solution.n_rays else "painted",
        "rays": solution.n_rays,
        "coverage": round(solution.picture_coverage, 6),
        "scene": reading.solved_for,
        "notes": [str(note) for note in dict.fromkeys((*reading.notes, *solution.notes))],
    }


def _log(path: Path, line: dict[str, Any], began: float, **rest: object) -> None:
    """Add a frame's line to the log."""
    whole = {**line, "seconds": round(perf_counter() - began, 4), **rest}
    disk.append_line(path, json.dumps(whole))


@contextmanager
def _open_reel(kept: ShapeCache) -> Iterator[None]:
    """Have movies stay open meanwhile."""
    kept.reel = Reel()
    try:
        yield
    finally:
        kept.reel.close()


@contextmanager
def _news_for(kept: ShapeCache) -> Iterator[None]:
    """Hand Blender's news of changes on, meanwhile."""

    def on_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        kept.notice(depsgraph)

    handlers = (("frame_change_post", on_update), ("depsgraph_update_post", on_update))
    work.listen(handlers)
    try:
        yield
    finally:
        work.stop_listening(handlers)


SOLVED = 0.9  # of the progress
ENCODED = ("PNG8", "PNG16", "TIFF16")  # formats of frames in a display's own numbers
LONGEST = 3600.0  # s of a test card


@dataclass(frozen=True)
class Wish:
    """A movie that is wanted.

    path : without suffix, which the codec gives
    codec : a key of movie.CODECS
    card : s that a test card is shown for, before, 0..LONGEST
    """

    path: Path
    codec: str
    card: float = 0.0
    overwrite: bool = False

    @property
    def file(self) -> Path:
        """Its file."""
        suffix = movie.CODECS[self.codec].suffix
        return self.path.with_name(self.path.name.removesuffix(suffix) + suffix)


def made(
    context: bpy.types.Context, run: Run, wish: Wish, tally: Tally, remedy: str
) -> Generator[float, None, None]:
    """Solve the frames of a run that are not there, and make a movie of all; yields progress 0..1.

    remedy : ends the sentence that there is such a file already

    Raises
    ------
    RigError, ImageError
        A frame is lacking, or the movie cannot be made; it is whole or not there.
    """
    if run.form not in ENCODED:
        raise ImageError(
            "A movie is made of frames in the display's own numbers: choose PNG or TIFF as their"
            " format."
        )
    display = work.read(context).rig.display
    size = display.width, display.height
    movie.check(wish.codec, size)
    if not wish.overwrite:
        folder.refuse_existing(wish.file.parent, [wish.file.name], remedy)

    yield from subprogress(solved(context, run, tally), 0.0, SOLVED)
    if tally.failed or tally.others:
        raise RigError("The movie would lack frames: {told}", told=tally.sentence(wish.file.parent))
    if tally.stale:
        raise RigError("{reason}", reason=tally.stale_words)
    files = list(run.files.values())
    _check_sizes(set(files) - set(tally.files), size)

    yield SOLVED
    scene = context.scene
    with disk.scratch(wish.file.parent) as scratch:
        first = _test_card(scratch, scene, wish, display.name, size) if wish.card else None
        with disk.together(wish.file.parent) as new:
            movie.encode(new / wish.file.name, files, wish.codec, size, scene, first)
    # the last step: an Esc that was pressed meanwhile would call a movie stopped that is there


def _check_sizes(files: set[Path], size: tuple[int, int]) -> None:
    """Refuse frames that were there, and have another size."""
    for file in sorted(files):
        found = size_of(file)
        if found != size:
            raise ImageError(
                "The frame '{file}' has {found} pixels, the display {size}: remove it, or solve it"
                " anew.",
                file=file,
                found=_by(found),
                size=_by(size),
            )


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]}"


def _test_card(
    scratch: Path, scene: bpy.types.Scene, wish: Wish, name: str, size: tuple[int, int]
) -> movie.Card:
    """The test card, with the display's name and numbers over it."""
    rate = scene.render.fps / scene.render.fps_base
    file = image_io.write(scratch / "card.png", card(*size), "PNG8", gamma=gamma_of(scene))
    numbers = f"{_by(size)}, {rate:.4g} fps, {movie.CODECS[wish.codec].label}"
    n = max(1, round(wish.card * rate))
    return movie.Card(file, n, (name, numbers, wish.file.name))


def movie_report(wish: Wish, run: Run) -> Message:
    """The movie, in a sentence."""
    return Message(
        "Wrote '{file}', {n} frames in {codec}.",
        file=wish.file,
        n=len(run.files),
        codec=movie.CODECS[wish.codec].label,
    )


class OfFrames(long_work.LongWork):
    """Mix-in for an operator that solves an animation's frames."""

    bl_options = {"REGISTER"}

    frames: bpy.props.StringProperty(
        name="Frames",
        description="Numbers and ranges, such as 1-250:2 or 1,5,10-20; empty: the scene's range and"
        " step",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return needed.can_run(
            cls,
            needed.missing_parts(context.scene) + unwritable(context.scene.kiriko.export_format),
        )

    @contextmanager
    def run_of(self, context: bpy.types.Context) -> Iterator[Run]:
        """The frames that are asked for, and their folder, which goes again if it stays empty."""
        if any(window.screen.is_animation_playing for window in windows.all_windows()):
            raise RigError("The playback sets frames, too: stop it first.")
        scene = context.scene
        ours = scene.kiriko
        if not Path(ours.animation_path).name:
            raise ImageError(
                "The frames have no name: choose a file, such as //frames/source_####."
            )

        use_bundled_modules()
        numbers = frames_of(self.frames) if self.frames else frames_of_range(scene)
        path = absolute(ours.animation_path)
        place = folder_of(scene, ours.animation_path)
        files = frame_files(scene, place, path.name, ours.export_format, numbers)
        self.tally = Tally()
        with folder.made(place):
            yield Run(files, ours.export_format, ours.animation_anew, ours.animation_placeholders)

    def _stopped(self) -> set[str]:
        text = Message("Stopped; frames written: {n}.", n=self.tally.written)
        telling.report(self, "INFO", text)
        return {"CANCELLED"}


class KIRIKO_OT_solve_animation(OfFrames, bpy.types.Operator):
    """Write the source image of each frame to a file of its own, whatever moves"""

    bl_idname = "kiriko.solve_animation"
    bl_label = "Solve Animation"

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        with self.run_of(context) as run:
            yield from solved(context, run, self.tally)
            self.level = "WARNING" if self.tally.failed or self.tally.of_movies else "INFO"
            return self.tally.sentence(next(iter(run.files.values())).parent)


class KIRIKO_OT_export_movie(OfFrames, bpy.types.Operator):
    """Make a movie of the animation's frames, by Blender's encoder"""

    bl_description = (
        "Make a movie of the animation's frames, by Blender's encoder, in the display's pixels and"
        " the scene's frame rate. Frames that are not there are solved first"
    )
    bl_idname = "kiriko.export_movie"
    bl_label = "Export Movie"

    overwrite: bpy.props.BoolProperty(
        name="Overwrite",
        description="Replace the file if there is one already",
        options={"SKIP_SAVE", "HIDDEN"},
    )

    is_to_ask = False

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        ours = context.scene.kiriko
        file = self._wish(context).file
        if self.overwrite or not (Path(ours.movie_path).name and disk.is_there(file)):
            return super().invoke(context, event)
        self.is_to_ask = True
        return context.window_manager.invoke_confirm(
            self,
            event,
            title=Message("Replace the file?"),
            message=str(file),
            confirm_text="Replace",
        )

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not self.is_to_ask:
            return super().execute(context)
        # a dialogue's operator cannot go on in steps: another one can
        bpy.ops.kiriko.export_movie("INVOKE_DEFAULT", overwrite=True, frames=self.frames)
        return {"FINISHED"}

    def _wish(self, context: bpy.types.Context) -> Wish:
        ours = context.scene.kiriko
        return Wish(absolute(ours.movie_path), ours.movie_codec, ours.movie_card, self.overwrite)

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        if not Path(context.scene.kiriko.movie_path).name:
            raise ImageError("The movie has no path: choose a file.")
        wish = self._wish(context)
        with self.run_of(context) as run, folder.made(wish.file.parent):
            yield from made(context, run, wish, self.tally, Message("allow overwriting"))
            remarks = self.tally.of_movies
            if warning := choose_picture.other_rate(context):
                remarks.append(Message("But {warning}.", warning=warning))
            self.level = "WARNING" if remarks else "INFO"
            return joined([movie_report(wish, run), *remarks])
