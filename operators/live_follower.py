"""A scene that Live follows: detects changes, and steps from a change to a new source image.

Only numbers and session uids are stored between turns. Datablocks are looked up in each turn, so
that undo, deletion and file load leave no dangling pointers.
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
from ..core.bench.sketch import spread_paths
from ..core.blender.data.rigs import rig_uid
from ..core.blender.read.nested_glass import reasons
from ..core.blender.read.scene import Reading
from ..core.blender.read.shapes import ShapeCache
from ..core.blender.result.conflict import write_conflict
from ..core.blender.result.light_path_curves import drawn_count, update_paths
from ..core.blender.result.on_display import MATERIAL_MARK, are_on_displays, displays_of
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
from . import compared, map_drawing, work
from .chosen import chosen_settings, uid
from .remedies import remedies_for
from .reporting import in_words
from .viewer_reports import reports_of
from .windows import all_windows, redraw

# s between polls of the settings (1 ms each), because scripts that change them trigger no handler
IDLE = 0.1
PAUSE = 0.0  # s between turns: Blender handles events and draws before each anyway
TURN = 0.03  # s after which a turn starts no further step
QUICK = 0.4  # s: a rig solved faster than this gets no coarse picture first
LONG = 0.1  # s: a longer step is announced
REST = 0.1  # s without a change after which a drawn picture is painted
NOTICE = 0.05  # s to let the status bar redraw before a long step


@dataclass(frozen=True)
class NextStep:
    """The next step: status bar text, key of its duration, expected duration in s."""

    phrase: str
    key: tuple[object, ...] = ()
    guess: float = field(default=2 * LONG, compare=False)


READING = Message("reading the scene")
DRAWING = Message("drawing the source image")
WRITING = Message("writing the source image")
COMPARING = Message("comparing before and after")
REMEDIES = Message("finding remedies")
PATHS = Message("following light paths")
VIEWERS = Message("comparing the viewers")
GLASS = Message("comparing the glass with Cycles")


class Live:
    """One followed scene. `turn` does a little work, without window or event."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        self.uid, self._rig = scene.session_uid, rig_uid(scene)
        self.problem = ""
        self.n_pictures = 0
        self.n_pushed = 0  # number of results at the last undo step of them
        self.is_unpacked = False
        self.otherwise: list[Message] = []  # differences to Cycles' glass, as last read
        # s from a change to its first and its last picture
        self.seconds: tuple[float, float] | None = None
        self._shown_at: list[float] = []  # times of the present update's pictures
        self.longest: dict[str, float] = {}  # s by phrase of the step
        self.shapes = ShapeCache()
        self.ours: set[int] = set()  # session uids of datablocks that Live itself writes to
        self.progress: float | None = None  # 0..1, of a slow picture
        self.phrase: Message | str = ""  # status bar text of the step; '' for none
        self._text = ""
        self._text_workspaces: set[int] = set()  # session uids of the workspaces that show it
        self._lasted: dict[NextStep, float] = {}
        # s of tracing and painting, by kind of rig
        self._whole_lasted: dict[tuple[object, ...], float] = {}
        self._settings: tuple[object, ...] = ()
        self._looked = -np.inf  # time of the last poll of the settings
        self._solved_meshes: list[object] = []
        self._reading: Reading | None = None
        self._compared: Reading | None = None  # identity of the glass last compared with Cycles
        self.start_over()
        self._may_keep = True  # the existing result, at the first reading

    def start_over(self) -> None:
        """Treat everything as changed, as after undo, which may have restored the image too."""
        self.shapes = ShapeCache()
        self._drop()
        map_drawing.forget()
        self._key, self._may_keep = None, False
        self.problem = ""  # may belong to an older scene
        self.touch()

    def touch(self) -> None:
        """Note a change that may matter."""
        self.is_changed = True

    @property
    def is_working(self) -> bool:
        return self._work is not None

    def is_of_another(self, solved_for: str) -> bool:
        """Whether the existing result was solved for another scene than the last one read."""
        return self._reading is not None and solved_for not in ("", self._reading.solved_for)

    @property
    def has_read(self) -> bool:
        """Whether the scene was read since its last change."""
        return self._key is not None

    def turn(self) -> float | None:
        """Do a little work; returns seconds until the next turn, or None if the scene is no longer
        shown.

        Single steps run until TURN is over. Before a step expected to exceed LONG it returns once,
        so that the status bar can announce it.
        """
        window = next((w for w in all_windows() if w.scene.session_uid == self.uid), None)
        if window is None:
            return None
        if work.is_busy():
            return IDLE
        with bpy.context.temp_override(window=window):
            if rig_uid(window.scene) != self._rig:
                # Never write to the result of another rig.
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
                    # Work may have ended before the next poll of the settings.
                    return PAUSE if was_working else IDLE
                # A short step is not announced, but the text of an earlier step has to go.
                is_long = self._lasted.get(step, step.guess) > LONG
                if is_long or self._text:
                    self.phrase = step.phrase
                    now = Message("Live: {phrase}...", phrase=step.phrase)
                    if self._say(in_words(now)) and is_long:
                        return NOTICE
                self._do(step, bpy.context)
        return PAUSE

    def _look(self, scene: bpy.types.Scene) -> None:
        """Whether a script has changed the settings."""
        self._looked = perf_counter()
        settings = chosen_settings(scene)
        if settings != self._settings:
            self._settings = settings
            self.touch()

    def leave_picture(self, scene: bpy.types.Scene) -> None:
        """Forget the measured durations of the picture."""
        leave_coarse(scene, self._reading)

    def close(self) -> None:
        """End the work; nothing is left half-written."""
        self._drop()
        map_drawing.forget()
        self.phrase = ""
        self._say("")

    def _drop(self) -> None:
        # a generator closes when its last reference goes
        self._work: Generator[NextStep, None, None] | None = None
        self._pending: NextStep | None = None
        self._has_picture, self.progress = False, None
        self._rests_at = 0.0  # time at which a drawn picture is painted

    def _upcoming(self) -> NextStep | None:
        """The next single step.

        A first picture is finished even if a newer change arrives, otherwise a drag would never
        show one.
        """
        if self.is_changed and (self._work is None or self._has_picture):
            return NextStep(READING, (self.shapes.is_whole,))
        if perf_counter() < self._rests_at:
            return None
        if (self._pending is None or self._has_picture) and self._is_to_compare:
            return NextStep(GLASS, (*_sizes(self._reading.rig),))
        return self._pending

    @property
    def _is_to_compare(self) -> bool:
        """Whether the scene is viewed through the viewer with glass that was not compared with
        Cycles yet.
        """
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
            map_drawing.forget()
            self._show_problem(one_line(in_words(error.message)))
        self._lasted[step] = perf_counter() - started
        self.longest[step.phrase] = max(self.longest.get(step.phrase, 0.0), self._lasted[step])

    def _read(self, context: bpy.types.Context) -> None:
        """Read the scene, and begin an update if anything relevant differs."""
        context.view_layer.update()
        self.is_changed = False  # the reading includes the change that triggered it
        settings = work.settings_of(context.scene)
        try:
            reading = work.read(context, self.shapes)
            reading.rig.check()
            settings.check()
        except KirikoError:
            self._key = None
            raise
        context.view_layer.update()
        self.is_changed = False  # triggered by objects that reading itself made and removed
        if self._key is None:
            self._show_problem("")  # left from a scene that could not be read
        key = (
            # in their order, because figures are those of the first one
            reading.rig.light_keys,
            tuple(viewer.weight for viewer in reading.rig.viewers),
            tuple((one.black_level, one.primaries) for one in reading.rig.lit),
            tuple((viewer.pupil, viewer.focus) for viewer in reading.rig.viewers),
            fingerprint(reading.rig.projectors),
            settings,
            fingerprint(reading.rig.picture_place),
            *map(self.shapes.fingerprint_of, reading.rig.picture.images),
        )
        if key == self._key:
            self._reading = replace(reading, solved_for=self._reading.solved_for)
            return
        self._reading = replace(reading, solved_for=work.scene_now(context, self.shapes).as_text())
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
        """Whether the last complete result from Solve fits the scene as read, and is shown."""
        image = scene.kiriko.result.source
        return (
            work.is_written(scene, self._reading.solved_for)
            and are_on_displays(self._reading, image)
            and not compared.is_shown(scene)
        )

    def _update(self, scene_uid: int, settings: Settings) -> Generator[NextStep, None, None]:
        """Solve and write, first coarse, then final; yields each step before it runs."""
        started = perf_counter()
        self._shown_at = []
        rig = self._reading.rig
        yield from self._draw_paths(rig, settings)  # a drag may end the work after a picture
        meshes = [part.mesh for part in rig.curved_parts()]
        is_same = [id(mesh) for mesh in meshes] == [id(mesh) for mesh in self._solved_meshes]
        self._solved_meshes = meshes  # keeps their ids from being reused by other meshes
        # If the light is traced already, a picture costs one product and needs no coarse one.
        is_traced = work.session().has_view_maps(rig, settings)
        kind = (*_sizes(rig), is_same, settings.of_optics)
        is_quick = is_traced or self._whole_lasted.get(kind, np.inf) < QUICK
        pictures = [(rig, settings)]
        if not is_traced:
            # check first: nothing is shown of a rig that cannot be solved
            check_memory(rig, settings, is_checked_again=True)
        is_coarse = not is_quick and has_coarse(rig)
        is_drawn = yield from self._draw(scene_uid, settings, is_traced, is_coarse)
        if is_coarse and not is_drawn:
            pictures.insert(0, coarser(rig, settings))
        for n, (a_rig, how) in enumerate(pictures):
            is_last = n == len(pictures) - 1
            began, n_before = perf_counter(), self.n_pictures
            try:
                is_reported = is_last and not is_quick
                found = yield from self._solve(a_rig, how, is_same or n > 0, is_last, is_reported)
            except KirikoError:
                if is_last:
                    raise
                continue  # a coarse viewer may miss light that the real one sees
            if not is_last:
                yield from self._show(found, update_coarse)
        yield NextStep(WRITING, rig.display.image_size)
        update_solution(scene_by_uid(scene_uid), self._reading, found)
        map_drawing.forget()
        if self.n_pictures == n_before:  # it was not shown before its figures
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

    def _draw(
        self, scene_uid: int, settings: Settings, is_traced: bool, is_coarse: bool
    ) -> Generator[NextStep, None, bool]:
        """Draw the first picture in place of the result's pixels, and return whether it could be
        drawn.

        is_traced, is_coarse : whether the maps are there already, or coarse ones are worth it
        """
        rig = self._reading.rig
        size = rig.display.image_size
        image = scene_by_uid(scene_uid).kiriko.result.source
        if image is None or tuple(image.size) != size or not (is_traced or is_coarse):
            return False
        if not map_drawing.can_draw(rig, settings):
            return False
        of_maps = (rig, settings) if is_traced else coarser(rig, settings)
        try:
            steps = work.session().view_maps(*of_maps, is_coarse=not is_traced)
            maps = yield from self._stepped(DRAWING, steps)
        except KirikoError:
            return False
        yield NextStep(DRAWING, size)
        image = scene_by_uid(scene_uid).kiriko.result.source
        # the image may be removed during a pause, and a coarse viewer may miss all light
        if image is None or not map_drawing.show(image, *of_maps, maps):
            return False
        self._note_shown()
        self._rests_at = perf_counter() + REST
        return True

    def _draw_paths(self, rig: Rig, settings: Settings) -> Generator[NextStep, None, None]:
        """Draw the light paths again if there are any."""
        count = drawn_count(scene_by_uid(self.uid))
        if count:
            plan = work.session().plan(rig, settings)
            paths = yield from self._stepped(PATHS, spread_paths(plan, count))
            update_paths(scene_by_uid(self.uid), paths)

    def _solve(
        self, rig: Rig, settings: Settings, is_built: bool, is_last: bool, is_reported: bool
    ) -> Generator[NextStep, None, Any]:
        """Solve, fully or for a coarse source image; yields each step and its expected duration
        first.

        is_reported : whether progress is reported; not if an earlier solve took no time
        """
        sizes = (*_sizes(rig), is_built)
        session = work.session()
        n = 0
        painted: list[NDArray[np.float32]] = []  # the final picture, before its figures
        steps = (
            session.solve(rig, settings, painted.append, is_moving=True)
            if is_last
            else session.solve_preview(rig, settings)
        )
        phrase = Message("solving")
        # With the same sizes as before, a slightly slower step needs no announcement.
        guess = 0.0 if NextStep(phrase, (*sizes, 0)) in self._lasted else 2 * LONG
        while True:
            yield NextStep(phrase, (*sizes, n), guess)
            try:
                progress = next(steps)
            except StopIteration as end:
                self.progress = None
                return end.value
            n += 1
            if is_reported:
                self._report_progress(progress)
            if painted:
                yield from self._show(painted.pop(), update_final)

    def _report_progress(self, progress: float) -> None:
        """Report the progress of the final picture."""
        before, self.progress = self.progress, progress
        if before is None or int(100 * before) != int(100 * progress):
            redraw()

    def _show(
        self, pixels: NDArray[np.float32], update: Callable[..., Reading]
    ) -> Generator[NextStep, None, None]:
        """Show a source image without figures, which follow once nothing changes.

        update : `update_coarse` or `update_final`
        """
        display = self._reading.rig.display
        yield NextStep(WRITING, display.image_size)
        pixels = enlarged(pixels, *display.image_size)
        map_drawing.forget()
        self._reading = update(scene_by_uid(self.uid), self._reading, pixels)
        self._note_shown()

    def _note_shown(self) -> None:
        """Note that a picture is shown: a newer change may now end the remaining work."""
        self.problem = ""  # of the earlier scene
        self.n_pictures += 1
        self._shown_at.append(perf_counter())
        self.is_unpacked = self._has_picture = True
        self._note_ours(scene_by_uid(self.uid))
        redraw()

    def _stepped(
        self, phrase: str, steps: Generator[float, None, Any]
    ) -> Generator[NextStep, None, Any]:
        """Run long work on the last solution; yields each step before it runs."""
        n = 0
        while True:
            yield NextStep(phrase, (*_sizes(self._reading.rig), n))
            try:
                next(steps)
            except StopIteration as end:
                return end.value
            n += 1

    def _note_ours(self, scene: bpy.types.Scene) -> None:
        displays = displays_of(self._reading)
        materials = [slot.material for display, _ in displays for slot in display.material_slots]
        self.ours = {
            *map(uid, images_of(scene.kiriko.result)),
            *(uid(m) for m in materials if m is not None and m.get(MATERIAL_MARK)),
        }

    def _show_problem(self, text: str) -> None:
        self.problem = text
        redraw()

    def _say(self, text: str) -> bool:
        """Show a text in the status bar, '' for none; returns whether it changed."""
        if text == self._text:
            return False
        self._text = text
        before, self._text_workspaces = self._text_workspaces, set()
        for window in all_windows():
            if window.scene.session_uid == self.uid or not text:
                with bpy.context.temp_override(window=window):
                    window.workspace.status_text_set(text or None)
                self._text_workspaces.add(uid(window.workspace))
        # a workspace that was left would keep the text for good
        for workspace in bpy.data.workspaces:
            if uid(workspace) in before - self._text_workspaces:
                with bpy.context.temp_override(workspace=workspace):
                    workspace.status_text_set(None)
        redraw()  # panels show the same text
        return True


def _glass_of(reading: Reading) -> tuple[object, ...]:
    """Identity of everything that affects how Cycles shows the glass; meshes by identity."""
    glasses = [
        (id(one.mesh), one.name, one.ior, one.priority, one.absorption)
        for one in reading.rig.glasses
    ]
    return (*glasses, reading.materials)


def _sizes(rig: Rig) -> tuple[int, ...]:
    """Sizes that predict the time of a solve: pixels, and triangles up to a factor of two."""
    n_triangles = sum(len(part.mesh.triangles) for part in rig.curved_parts())
    images = (side for part in (*rig.viewers, rig.display) for side in (part.width, part.height))
    return (*images, n_triangles.bit_length())


def scene_by_uid(scene_uid: int) -> bpy.types.Scene:
    """The scene with this session uid, which a window shows."""
    return next(scene for scene in bpy.data.scenes if scene.session_uid == scene_uid)
