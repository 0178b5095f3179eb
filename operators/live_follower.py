"""One scene that Live follows: what has changed, and the steps from it to a new source image.

Only numbers and session uids are remembered from turn to turn; datablocks are looked up anew each
turn, so that undo, deletion and file load leave nothing behind that points nowhere.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.base.errors import KirikoError, one_line
from ..core.base.fingerprint import fingerprint
from ..core.base.messages import Message
from ..core.blender.data.rigs import rig_uid
from ..core.blender.read.nested_glass import reasons
from ..core.blender.read.scene import Reading
from ..core.blender.read.shapes import ShapeCache
from ..core.blender.result.conflict import write_conflict
from ..core.blender.result.on_display import MATERIAL_MARK, is_on_display
from ..core.blender.result.result_images import images_of
from ..core.blender.result.write_result import (
    leave_coarse,
    update_coarse,
    update_final,
    update_solution,
    write_helps,
    write_viewers,
)
from ..core.rig.rig import Rig
from ..core.rig.settings import Settings
from ..core.solve.first_picture import coarser, enlarged, has_coarse
from ..core.solve.memory import check_memory
from . import compared, work
from .chosen import chosen_settings, uid
from .remedies import remedies_for
from .telling import in_words
from .viewer_reports import reports_of
from .windows import all_windows, redraw

# s between two looks at the settings, which take a millisecond:
# scripts that change them wake no handler
IDLE = 0.1
PAUSE = 0.0  # s between two turns of work: Blender hears events and draws before each anyway
TURN = 0.03  # s after which a turn begins no other step
QUICK = 0.4  # s: a rig that took less as a whole the last time gets no coarse picture first
LONG = 0.1  # s: a step that may take longer is announced
NOTICE = 0.05  # s for the status bar to be drawn before a long step begins


@dataclass(frozen=True)
class NextStep:
    """The next step: words for the status bar, the key of its duration, a guess at that, s."""

    phrase: str
    key: tuple[object, ...] = ()
    guess: float = field(default=2 * LONG, compare=False)


READING = Message("reading the scene")
WRITING = Message("writing the source image")
COMPARING = Message("comparing before and after")
REMEDIES = Message("finding remedies")
VIEWERS = Message("comparing the viewers")
GLASS = Message("comparing the glass with Cycles")


class Live:
    """One scene that is followed. `turn` does a little work; it needs no window and no event."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        self.uid, self._rig = scene.session_uid, rig_uid(scene)
        self.problem = ""
        self.n_pictures = 0
        self.n_pushed = 0  # of them, when the last undo step of them was made
        self.is_unpacked = False
        self.otherwise: list[Message] = []  # why Cycles shows the glass otherwise, as last read
        # from a change to the first and to the last picture of it
        self.seconds: tuple[float, float] | None = None
        self._shown_at: list[float] = []  # when, the pictures of the update under way
        self.longest: dict[str, float] = {}  # s by phrase of the step
        self.kept = ShapeCache()
        self.ours: set[int] = set()  # session uids of the datablocks that we write to
        self.progress: float | None = None  # 0..1, of a picture that takes a while
        self.phrase: Message | str = ""  # on the step in the status bar; '' for none
        self._text = ""
        self._told: set[int] = set()  # session uids of the workspaces that have the text
        self._lasted: dict[NextStep, float] = {}
        # s of tracing and painting, by kind of rig
        self._whole_lasted: dict[tuple[object, ...], float] = {}
        self._settings: tuple[object, ...] = ()
        self._looked = -np.inf  # when, at the settings
        self._solved_meshes: list[object] = []
        self._reading: Reading | None = None
        self._compared: Reading | None = None  # whose glass was compared with that of Cycles
        self.start_over()
        self._may_keep = True  # a result that is there, at the first reading

    def start_over(self) -> None:
        """Take everything for changed, as after undo, which may have put back the image, too."""
        self.kept = ShapeCache()
        self._drop()
        self._key, self._may_keep = None, False
        self.problem = ""  # of a scene that may be another now
        self.touch()

    def touch(self) -> None:
        """Something has changed that may count."""
        self.is_changed = True

    @property
    def is_working(self) -> bool:
        return self._work is not None

    def is_of_another(self, solved_for: str) -> bool:
        """Was a result, if there is one, solved for another scene than was read last?"""
        return self._reading is not None and solved_for not in ("", self._reading.solved_for)

    @property
    def has_read(self) -> bool:
        """Is the scene known, as it was last?"""
        return self._key is not None

    def turn(self) -> float | None:
        """Do a little work; returns seconds until the next turn is
        due, or None when the scene is not shown any more.

        Single steps are done until TURN is over; before one that may take longer
        than LONG it returns once, so that the status bar can say so.
        """
        window = next((w for w in all_windows() if w.scene.session_uid == self.uid), None)
        if window is None:
            return None
        if work.is_busy():
            return IDLE
        with bpy.context.temp_override(window=window):
            if rig_uid(window.scene) != self._rig:
                # another rig's result is never written to
                self._rig = rig_uid(window.scene)
                self.start_over()
            was_working = self.is_working
            if not was_working or perf_counter() > self._looked + IDLE:
                self._look(window.scene)
            end = perf_counter() + TURN
            while perf_counter() < end:
                step = self._upcoming()
                if step is None:
                    self.phrase = ""
                    self._say("")
                    # work may have ended before the settings were looked at again
                    return PAUSE if was_working else IDLE
                # a short step is not worth a word, but no other step's is left there
                is_long = self._lasted.get(step, step.guess) > LONG
                if is_long or self._text:
                    self.phrase = step.phrase
                    now = Message("Kiriko Live: {phrase}...", phrase=step.phrase)
                    if self._say(in_words(now)) and is_long:
                        return NOTICE
                self._do(step, bpy.context)
        return PAUSE

    def _look(self, scene: bpy.types.Scene) -> None:
        """Has a script changed the settings?"""
        self._looked = perf_counter()
        settings = chosen_settings(scene)
        if settings != self._settings:
            self._settings = settings
            self.touch()

    def leave_picture(self, scene: bpy.types.Scene) -> None:
        """The picture that is shown stays, as far as anybody knows."""
        leave_coarse(scene, self._reading)

    def close(self) -> None:
        """End the work; nothing is half-written."""
        self._drop()
        self.phrase = ""
        self._say("")

    def _drop(self) -> None:
        # a generator is closed when nothing holds it
        self._work: Generator[NextStep, None, None] | None = None
        self._pending: NextStep | None = None
        self._has_picture, self.progress = False, None

    def _upcoming(self) -> NextStep | None:
        """The next single step. A first picture is not given up for
        a newer change, or a drag would never show any.
        """
        if self.is_changed and (self._work is None or self._has_picture):
            return NextStep(READING, (self.kept.is_whole,))
        if (self._pending is None or self._has_picture) and self._is_to_compare:
            return NextStep(GLASS, (*_sizes(self._reading.rig),))
        return self._pending

    @property
    def _is_to_compare(self) -> bool:
        """Is the scene looked at through the viewer, and is its glass another than was compared?"""
        now, before = self._reading, self._compared
        if now is None or not scene_by_uid(self.uid).kiriko_scene.looking:
            return False
        return before is None or _glass_of(now) != _glass_of(before)

    def _do(self, step: NextStep, context: bpy.types.Context) -> None:
        started = perf_counter()
        try:
            if step.phrase == READING:
                self._read(context)
            elif step.phrase == GLASS:
                self._compared = self._reading
                self.otherwise = reasons(self._reading.rig.glasses, self._reading.materials)
                redraw()
            else:
                self._pending = next(self._work, None)
                if self._pending is None:
                    self._drop()
        except KirikoError as error:
            self._drop()
            self._show_problem(one_line(in_words(error.message)))
        self._lasted[step] = perf_counter() - started
        self.longest[step.phrase] = max(self.longest.get(step.phrase, 0.0), self._lasted[step])

    def _read(self, context: bpy.types.Context) -> None:
        """Read the scene, and begin an update if anything that counts is different."""
        context.view_layer.update()
        self.is_changed = False  # the change that the update above told of is in the reading
        settings = work.settings_of(context.scene)
        try:
            reading = work.read(context, self.kept)
            reading.rig.check()
            settings.check()
        except KirikoError:
            self._key = None
            raise
        context.view_layer.update()
        self.is_changed = False  # this one told of what reading itself made and removed
        if self._key is None:
            self._show_problem("")  # that of a scene that could not be read
        key = (
            # in their order: numbers are those of the first
            reading.rig.light_keys,
            tuple(viewer.weight for viewer in reading.rig.viewers),
            tuple(display.black_level for display in reading.rig.displays),
            settings,
            fingerprint(reading.rig.picture_place),
            *map(self.kept.fingerprint_of, reading.rig.picture.images),
        )
        if key == self._key:
            self._reading = replace(reading, solved_for=self._reading.solved_for)
            return
        self._reading = replace(reading, solved_for=work.scene_now(context, self.kept).as_text())
        self._drop()
        self._key = key
        may_keep, self._may_keep = self._may_keep, False
        if may_keep and self._is_shown(context.scene):
            self._note_ours(context.scene)
            self._show_problem("")
            return
        self._work = self._update(context.scene.session_uid, settings)
        self._pending = next(self._work)

    def _is_shown(self, scene: bpy.types.Scene) -> bool:
        """Is the whole result that Solve wrote last that of the scene as it was read, and shown?"""
        image = scene.kiriko.result.source
        display = bpy.data.objects.get(self._reading.display_object)
        return (
            work.is_written(scene, self._reading.solved_for)
            and (display is None or is_on_display(display, image))
            and not compared.is_shown(scene)
        )

    def _update(self, scene_uid: int, settings: Settings) -> Generator[NextStep, None, None]:
        """Solve and write, coarse and then finer; yields each single step before it is done."""
        started = perf_counter()
        self._shown_at = []
        rig = self._reading.rig
        meshes = [part.mesh for part in (*rig.glasses, *rig.mirrors)]
        is_same = [id(mesh) for mesh in meshes] == [id(mesh) for mesh in self._solved_meshes]
        self._solved_meshes = meshes  # held, so that no other mesh gets their ids
        # where the light is traced, a picture costs one product: nothing coarse is faster
        is_traced = work.session().has_view_maps(rig, settings)
        kind = (*_sizes(rig), is_same, settings.of_optics)
        is_quick = is_traced or self._whole_lasted.get(kind, np.inf) < QUICK
        pictures = [(rig, settings)]
        if not is_quick and has_coarse(rig):
            pictures.insert(0, coarser(rig, settings))
        if not is_traced:
            # of the last of them: nothing is shown of a rig that cannot be solved
            check_memory(rig, settings, is_checked_again=True)
        for n, (a_rig, how) in enumerate(pictures):
            is_last = n == len(pictures) - 1
            began, n_before = perf_counter(), self.n_pictures
            try:
                tells = is_last and not is_quick
                found = yield from self._solve(a_rig, how, is_same or n > 0, is_last, tells)
            except KirikoError:
                if is_last:
                    raise
                continue  # a coarse viewer may miss light that the rig's own sees
            if not is_last:
                yield from self._show(found, update_coarse)
        yield NextStep(WRITING, (rig.display.width, rig.display.height))
        update_solution(scene_by_uid(scene_uid), self._reading, found)
        if self.n_pictures == n_before:  # it was not shown before its numbers
            self._note_shown()
        if not is_traced:
            self._whole_lasted[kind] = self._shown_at[-1] - began
        if compared.is_shown(scene_by_uid(scene_uid)):
            scene = scene_by_uid(scene_uid)
            comparing = compared.comparing(scene, self._reading.rig, found, settings)
            yield from self._stepped(COMPARING, comparing)
            redraw()
        self.seconds = (self._shown_at[0] - started, self._shown_at[-1] - started)
        self._show_problem("")
        reports = yield from self._stepped(VIEWERS, reports_of(found, settings))
        scene = scene_by_uid(scene_uid)
        write_viewers(scene, reports.numbers)
        write_conflict(scene, reports.conflict, is_packed=False)
        self.is_unpacked = True
        self._note_ours(scene)
        helps = yield from self._stepped(REMEDIES, remedies_for(rig, settings, found))
        write_helps(scene_by_uid(scene_uid), helps)
        redraw()

    def _solve(
        self, rig: Rig, settings: Settings, is_built: bool, is_last: bool, tells: bool
    ) -> Generator[NextStep, None, Any]:
        """The solution, or a coarse source image alone. Names each
        step before it, and the time that it may take.

        tells : is it told how far it is? Not where it was there in no time before.
        """
        sizes = (*_sizes(rig), is_built)
        session = work.session()
        n = 0
        painted: list[NDArray[np.float32]] = []  # the final picture, whose numbers follow
        steps = (
            session.solve(rig, settings, painted.append)
            if is_last
            else session.solve_preview(rig, settings)
        )
        phrase = Message("solving")
        # solved with these sizes before, it may take a step
        # more than then, which is no reason to speak
        guess = 0.0 if NextStep(phrase, (*sizes, 0)) in self._lasted else 2 * LONG
        while True:
            yield NextStep(phrase, (*sizes, n), guess)
            try:
                progress = next(steps)
            except StopIteration as end:
                self.progress = None
                return end.value
            n += 1
            if tells:
                self._tell(progress)
            if painted:
                yield from self._show(painted.pop(), update_final)

    def _tell(self, progress: float) -> None:
        """Tell how far the final picture is."""
        before, self.progress = self.progress, progress
        if before is None or int(100 * before) != int(100 * progress):
            redraw()

    def _show(
        self, pixels: NDArray[np.float32], update: Callable[..., Reading]
    ) -> Generator[NextStep, None, None]:
        """Show a source image without numbers: these follow once nothing changes.

        update : `update_coarse` or `update_final`
        """
        display = self._reading.rig.display
        yield NextStep(WRITING, (display.width, display.height))
        pixels = enlarged(pixels, display.width, display.height)
        self._reading = update(scene_by_uid(self.uid), self._reading, pixels)
        self._note_shown()

    def _note_shown(self) -> None:
        """A picture is there: a newer change may end the work that follows."""
        self.problem = ""  # of the scene before
        self.n_pictures += 1
        self._shown_at.append(perf_counter())
        self.is_unpacked = self._has_picture = True
        self._note_ours(scene_by_uid(self.uid))
        redraw()

    def _stepped(
        self, phrase: str, steps: Generator[float, None, Any]
    ) -> Generator[NextStep, None, Any]:
        """Long work on the last solution; names each step before it."""
        n = 0
        while True:
            yield NextStep(phrase, (*_sizes(self._reading.rig), n))
            try:
                next(steps)
            except StopIteration as end:
                return end.value
            n += 1

    def _note_ours(self, scene: bpy.types.Scene) -> None:
        display = bpy.data.objects.get(self._reading.display_object)
        materials = [] if display is None else [slot.material for slot in display.material_slots]
        self.ours = {
            *map(uid, images_of(scene.kiriko.result)),
            *(uid(m) for m in materials if m is not None and m.get(MATERIAL_MARK)),
        }

    def _show_problem(self, text: str) -> None:
        self.problem = text
        redraw()

    def _say(self, text: str) -> bool:
        """Put a sentence into the status bar, '' for none; is it another one than before?"""
        if text == self._text:
            return False
        self._text = text
        told, self._told = self._told, set()
        for window in all_windows():
            if window.scene.session_uid == self.uid or not text:
                with bpy.context.temp_override(window=window):
                    window.workspace.status_text_set(text or None)
                self._told.add(uid(window.workspace))
        # a workspace that was left keeps its text, which would stand there for good
        for workspace in bpy.data.workspaces:
            if uid(workspace) in told - self._told:
                with bpy.context.temp_override(workspace=workspace):
                    workspace.status_text_set(None)
        redraw()  # panels tell the same
        return True


def _glass_of(reading: Reading) -> tuple[object, ...]:
    """All that tells whether Cycles shows the glass as it is; meshes by their identity."""
    glasses = [(id(one.mesh), one.name, one.ior, one.priority) for one in reading.rig.glasses]
    return (*glasses, reading.materials)


def _sizes(rig: Rig) -> tuple[int, ...]:
    """Sizes by which the time of a solve is guessed: pixels, and
    the number of triangles up to a factor of two.
    """
    n_triangles = sum(len(part.mesh.triangles) for part in (*rig.glasses, *rig.mirrors))
    images = (side for part in (*rig.viewers, rig.display) for side in (part.width, part.height))
    return (*images, n_triangles.bit_length())


def scene_by_uid(scene_uid: int) -> bpy.types.Scene:
    """The scene that has this session uid; it is shown in a window, so it is there."""
    return next(scene for scene in bpy.data.scenes if scene.session_uid == scene_uid)
