"""Animation: one file with the source image for each frame.

Its own session reuses everything unchanged from frame to frame: with a still rig and a moving
picture, only the first frame is traced. A frame has the same bits whichever frames came before, so
machines can share the work. The scene's own result does not change.
"""

import json
from collections.abc import Generator, Iterable, Iterator, Sequence
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
from ..core.blender.data.scene_frames import folder_of, frame_files, frame_restored, frames_of_range
from ..core.blender.read.scene import Reading
from ..core.blender.read.shapes import ShapeCache
from ..core.files import disk, image_io
from ..core.files.frame_list import frames_of
from ..core.image.test_card import card
from ..core.lab.farm.job import LOG, logged
from ..core.light.mesh_cache import MeshCache as KeptGlass
from ..core.rig.joined_display import Section
from ..core.solve.session import Session
from ..core.solve.solution import Solution
from . import choose_picture, folder, long_work, look_over, needed, reporting, watch, windows, work
from .export import gamma_of, unwritable, use_bundled_modules
from .to_file import FOR_SCRIPTS, AsksToReplace


@dataclass(frozen=True)
class Run:
    """Frames to solve.

    files : by frame
    form : a key of image_io.FORMATS
    overwrite : replace existing files; else their frames are skipped
    placeholders : put an empty file in place of each frame while it is solved, so that other
        processes skip it; with `overwrite`, frames replaced by other processes count as done
    log : name of the log in the same folder, one line for each frame
    """

    files: dict[int, Path]
    form: str
    overwrite: bool = False
    placeholders: bool = False
    log: str = LOG


def files_of(path: Path, sections: Sequence[Section]) -> dict[Section, Path]:
    """Files of a frame: the first section's, and for each other one in a folder with its name."""
    first, *others = sections
    return {first: path} | {
        one: path.parent / bpy.path.clean_name(one.name) / path.name for one in others
    }


@dataclass
class Tally:
    """The outcome of a run.

    files : files written
    there : number of files that existed before
    stale : frames whose existing files show an earlier state of the scene
    others : number of frames claimed by other processes
    traced : number of frames with traced light
    failed : reasons, by frame that could not be solved
    ended : the first frame after a movie's end, by movie
    """

    files: list[Path] = field(default_factory=list)
    there: int = 0
    stale: list[int] = field(default_factory=list)
    others: int = 0
    traced: int = 0
    failed: list[tuple[int, str]] = field(default_factory=list)
    ended: dict[str, int] = field(default_factory=dict)

    def notice(self, frame: int, notes: Iterable[str]) -> None:
        """Record a frame's notes on its movies."""
        for note in notes:
            if isinstance(note, OfMovie):
                self.ended[note.movie] = min(frame, self.ended.get(note.movie, frame))

    @property
    def of_movies(self) -> list[Message]:
        """Sentences on movies shorter than the animation."""
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
        """A sentence on stale frames."""
        return Message(
            "Frames from an earlier state of the scene: {n}, starting with {frame}. Solve all"
            " frames again, or delete these files.",
            n=len(self.stale),
            frame=self.stale[0],
        )

    @property
    def written(self) -> int:
        """Number of files written."""
        return len(self.files)

    def sentence(self, folder: Path) -> Message:
        """The outcome in sentences."""
        parts = [
            Message(
                "Wrote {n} frame{s} to '{folder}', {traced} of them traced.",
                n=self.written,
                s="" if self.written == 1 else "s",
                folder=folder,
                traced=self.traced,
            )
        ]
        if self.there:
            parts.append(Message("Existing frames skipped: {n}.", n=self.there))
        if self.stale:
            parts.append(self.stale_words)
        if self.others:
            parts.append(
                Message(
                    "Claimed by another process: {n}. If it was stopped, delete the empty files or"
                    " turn off Placeholders.",
                    n=self.others,
                )
            )
        if self.failed:
            frame, why = self.failed[0]
            parts.append(
                Message(
                    "{n} failed, first frame {frame}: {why}",
                    n=len(self.failed),
                    frame=frame,
                    why=why,
                )
            )
        return joined(parts + self.of_movies)


@dataclass(frozen=True)
class Keeps:
    """Everything cached from frame to frame."""

    shapes: ShapeCache = field(default_factory=ShapeCache)
    session: Session = field(default_factory=lambda: Session(KeptGlass(is_exact=True)))


def solved(
    context: bpy.types.Context, run: Run, tally: Tally | None = None
) -> Generator[float, None, Tally]:
    """Solve the frames of a run and write each file completely or not at all.

    A frame that cannot be solved is recorded and skipped. Yields progress 0..1. Afterwards, even if
    stopped, the scene is at its previous frame.

    tally : updated as frames are done

    Raises
    ------
    ImageError
        A file cannot be written; earlier files are complete. The log is checked before the first
        frame.
    """
    scene = context.scene
    tally = Tally() if tally is None else tally
    keeps = Keeps()
    n = len(run.files)
    for into in {path.parent for path in run.files.values()}:  # before the first image exists
        disk.check_appendable(into / run.log)

    before = {p: disk.stamp(p) if disk.is_there(p) else None for p in run.files.values()}
    with frame_restored(scene), _news_for(keeps.shapes), _open_reel(keeps.shapes):
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
    """Fingerprints of the scenes behind existing files, by file name."""
    folders = {path.parent for path in run.files.values()}
    lines = [line for folder in folders for line in logged(folder)]
    return {str(line["file"]): str(line["scene"]) for line in lines if "scene" in line}


def _is_wanted(path: Path, run: Run, tally: Tally, before: disk.Stamp | None) -> bool:
    """Whether this process is to solve a frame.

    before : stamp of its file at the start of the run
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
    """Whether a file exists and is not an empty placeholder."""
    stamp = disk.stamp(path)
    return stamp is not None and stamp.size > 0


def _one(
    context: bpy.types.Context, keeps: Keeps, frame: int, run: Run, tally: Tally
) -> Generator[float, None, None]:
    """Solve a frame and write its file and log line; yields progress 0..1."""
    began = perf_counter()
    scene = context.scene
    path = run.files[frame]
    line: dict[str, Any] = {"frame": frame, "file": path.name}

    try:
        scene.frame_set(frame)
        reading = work.read(context, keeps.shapes)
        found = [] if tally.files else look_over.findings(context)  # once, with the first frame
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
        # the frame's own file, whose existence counts, comes last
        for section, file in reversed(files_of(path, solution.rig.files).items()):
            with folder.made(file.parent):
                image_io.write(
                    file,
                    section.of(solution.image),
                    run.form,
                    size=None if reading.display_size is None else tuple(reading.display_size),
                    gamma=gamma_of(scene, section.name),
                    overwrite=True,  # another process may have written the same file meanwhile
                )
        _log(path.parent / run.log, line, began, **_done(solution, reading), error=None)
    except ImageError as error:
        raise ImageError("Frame {frame}: {error}", frame=frame, error=error.message) from None

    tally.notice(frame, reading.notes)
    tally.files.append(path)
    tally.traced += solution.n_rays > 0


def _done(solution: Solution, reading: Reading) -> dict[str, Any]:
    """Cost and content of a frame."""
    return {
        "did": "traced" if solution.n_rays else "painted",
        "rays": solution.n_rays,
        "coverage": round(solution.picture_coverage, 6),
        "scene": reading.solved_for,
        "notes": [str(note) for note in dict.fromkeys((*reading.notes, *solution.notes))],
    }


def _log(path: Path, line: dict[str, Any], began: float, **rest: object) -> None:
    """Append a frame's line to the log."""
    whole = {**line, "seconds": round(perf_counter() - began, 4), **rest}
    disk.append_line(path, json.dumps(whole))


@contextmanager
def _open_reel(shapes: ShapeCache) -> Iterator[None]:
    """Keep movies open within the context."""
    shapes.reel = Reel()
    try:
        yield
    finally:
        shapes.reel.close()


@contextmanager
def _news_for(shapes: ShapeCache) -> Iterator[None]:
    """Forward Blender's change reports within the context."""

    def on_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        shapes.notice(depsgraph)

    handlers = (("frame_change_post", on_update), ("depsgraph_update_post", on_update))
    work.listen(handlers)
    try:
        yield
    finally:
        work.stop_listening(handlers)


SOLVED = 0.9  # of the progress
ENCODED = ("PNG8", "PNG16", "TIFF16")  # formats with the display's own encoding
LONGEST = 3600.0  # s: longest test card


@dataclass(frozen=True)
class Wish:
    """A movie to make.

    path : without the suffix of the codec
    codec : a key of movie.CODECS
    card : duration of a test card before the first frame, s
    """

    path: Path
    codec: str
    card: float = 0.0
    overwrite: bool = False

    @property
    def file(self) -> Path:
        """The file with its suffix."""
        suffix = movie.CODECS[self.codec].suffix
        return self.path.with_name(self.path.name.removesuffix(suffix) + suffix)


def made(
    context: bpy.types.Context, run: Run, wish: Wish, tally: Tally, remedy: str
) -> Generator[float, None, None]:
    """Solve the missing frames of a run and encode all frames as a movie; yields progress 0..1.

    remedy : ends the sentence on an existing file

    Raises
    ------
    RigError, ImageError
        A frame is missing, or the movie cannot be made. No incomplete file is left.
    """
    if run.form not in ENCODED:
        raise ImageError(
            "A movie needs frames encoded for the display. Choose PNG or TIFF as their format."
        )
    rig = work.read(context).rig
    sections, display = rig.files, rig.display.name
    films = files_of(wish.file, sections)
    for section, film in films.items():
        movie.check(wish.codec, (section.width, section.height))
        if not wish.overwrite:
            folder.refuse_existing(film.parent, [film.name], remedy)

    yield from subprogress(solved(context, run, tally), 0.0, SOLVED)
    if tally.failed or tally.others:
        raise RigError("Frames are missing: {report}", report=tally.sentence(wish.file.parent))
    if tally.stale:
        raise RigError("{reason}", reason=tally.stale_words)
    yield SOLVED
    scene = context.scene
    for section, film in films.items():
        size = section.width, section.height
        files = [files_of(path, sections)[section] for path in run.files.values()]
        _check_sizes(set(files) - set(tally.files), size)
        with folder.made(film.parent), disk.scratch(film.parent) as scratch:
            first = (
                _test_card(scratch, scene, wish, section.name or display, size)
                if wish.card
                else None
            )
            with disk.together(film.parent) as new:
                movie.encode(new / film.name, files, wish.codec, size, scene, first)
    # last step: a later Esc would report a finished movie as stopped


def _check_sizes(files: set[Path], size: tuple[int, int]) -> None:
    """Refuse existing frames of another size."""
    for file in sorted(files):
        found = size_of(file)
        if found != size:
            raise ImageError(
                "The frame '{file}' has {found} pixels, the display {size}. Delete it, or solve it"
                " again.",
                file=file,
                found=_by(found),
                size=_by(size),
            )


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]}"


def _test_card(
    scratch: Path, scene: bpy.types.Scene, wish: Wish, name: str, size: tuple[int, int]
) -> movie.Card:
    """A test card with the display's name and numbers."""
    rate = scene.render.fps / scene.render.fps_base
    file = image_io.write(scratch / "card.png", card(*size), "PNG8", gamma=gamma_of(scene))
    numbers = f"{_by(size)}, {rate:.4g} fps, {movie.CODECS[wish.codec].label}"
    n = max(1, round(wish.card * rate))
    return movie.Card(file, n, (name, numbers, wish.file.name))


def movie_report(wish: Wish, run: Run) -> Message:
    """A sentence on the finished movie."""
    return Message("Wrote '{written}'.", written=wish.file)


class OfFrames(long_work.LongWork):
    """Mix-in for operators that solve the frames of an animation."""

    bl_options = {"REGISTER"}

    frames: bpy.props.StringProperty(
        name="Frames",
        description="Frames to solve, such as 1-250:2 or 1,5,10-20; empty for the scene's range",
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
        """The run of an operator. Its folder is removed again if it stays empty."""
        if any(window.screen.is_animation_playing for window in windows.all_windows()):
            raise RigError("Stop the playback first.")
        scene = context.scene
        ours = scene.kiriko
        if not Path(ours.animation_path).name:
            raise ImageError(
                "The frames have no file name. Choose one, such as //frames/source_####."
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
        text = Message("Stopped after {n} frames.", n=self.tally.written)
        reporting.report(self, "INFO", text)
        return {"CANCELLED"}


class KIRIKO_OT_solve_animation(OfFrames, bpy.types.Operator):
    """Write the source image of each frame to its own file"""

    bl_idname = "kiriko.solve_animation"
    bl_label = "Solve Animation"

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        with self.run_of(context) as run:
            yield from solved(context, run, self.tally)
            self.level = "WARNING" if self.tally.failed or self.tally.of_movies else "INFO"
            return self.tally.sentence(next(iter(run.files.values())).parent)


class KIRIKO_OT_export_movie(AsksToReplace, OfFrames, bpy.types.Operator):
    """Encode the animation as a movie; missing frames are solved first"""

    bl_idname = "kiriko.export_movie"
    bl_label = "Export Movie"

    in_question = ("frames",)

    def existing(self, context: bpy.types.Context) -> list[Path]:
        if not Path(context.scene.kiriko.movie_path).name:
            return []
        file = self._wish(context).file
        return folder.existing(file.parent, [file.name])

    def _wish(self, context: bpy.types.Context) -> Wish:
        ours = context.scene.kiriko
        return Wish(absolute(ours.movie_path), ours.movie_codec, ours.movie_card, self.overwrite)

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        if not Path(context.scene.kiriko.movie_path).name:
            raise ImageError("No file is chosen for the movie.")
        wish = self._wish(context)
        with self.run_of(context) as run, folder.made(wish.file.parent):
            yield from made(context, run, wish, self.tally, FOR_SCRIPTS)
            remarks = self.tally.of_movies
            if warning := choose_picture.other_rate(context):
                remarks.append(warning)
            self.level = "WARNING" if remarks else "INFO"
            return joined([movie_report(wish, run), *remarks])
