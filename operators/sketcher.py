"""Sketcher: keeps the sketch of each visible scene up to date while the Kiriko tab is open.

Handlers only note possible changes. A timer reads the scene when a reading is due, prepares it and
traces a few rays, in short turns. Nothing is done while the viewport is drawn. The sketcher reuses
the session's prepared glass without changing the session. A slow scene is read only when it is
quiet, so that a drag does not stutter.
"""

from collections.abc import Generator, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from time import monotonic, perf_counter, thread_time
from typing import NamedTuple

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..core.base.arrays import Floats
from ..core.base.errors import KirikoError
from ..core.base.fingerprint import fingerprint
from ..core.base.messages import Message
from ..core.base.steps import Steps
from ..core.bench.sketch import Sketch, sketching
from ..core.blender.data.camera_viewer import viewer_of
from ..core.blender.data.units import length_of_unit
from ..core.blender.read.places import PlaceCache, read_places
from ..core.blender.view.contours import MeshEdges, contours, edges_of
from ..core.light.compile_plan import compile_plan_steps
from ..core.light.mesh_cache import MeshCache
from ..core.light.plan import Plan
from ..core.rig.mesh import Mesh
from ..core.rig.rig import Rig
from ..core.rig.settings import Settings
from . import chosen, needed, reporting, windows, work

TAB = "Kiriko"
IDLE = 0.1  # s between two polls
PAUSE = 0.01  # s between two turns, for redraws
TURN = 0.02  # s: the longest turn, except for a single long step
SHARE = 2.0  # pause after a sketch, in times its duration,
MOST_PAUSE = 0.5  # and its limit in s
HEAVY = 0.1  # s: a sketch with a longer step waits until the scene is quiet
QUIET = 0.3  # s without a change
PATIENCE = 10.0  # s after an unexpected error
DONE = object()


@dataclass(frozen=True, eq=False)
class SketchDrawing:
    """The sketch of a scene.

    metres : length of a Blender unit, m, when the scene was read
    contours : (n, 2, 3) m, of the glass, for Look Through Viewer
    """

    sketch: Sketch
    metres: float
    contours: Floats = field(default_factory=lambda: np.empty((0, 2, 3)))


@dataclass(eq=False)
class Sketched:
    """A visible scene.

    kept, light : cached meshes and glass
    changed_at : time of the last unread change; None if everything has been read
    old_since : time of the first undrawn change; None if everything is drawn
    is_faint : the drawing is out of date and dimmed
    ended_at, spent : end of the last sketch, and its duration in s
    lasted : CPU seconds of its longest step, by whether only places and settings had changed
    key, plan_key : fingerprints of the last drawing and of the plan
    edges : cached by mesh
    """

    places: PlaceCache = field(default_factory=PlaceCache)
    light: MeshCache = field(default_factory=MeshCache)
    drawing: SketchDrawing | None = None
    changed_at: float | None = field(default_factory=monotonic)
    old_since: float | None = None
    is_faint: bool = False
    ended_at: float = 0.0
    lasted: dict[bool, float] = field(default_factory=dict)
    spent: float = 0.0
    polled: chosen.Polled = field(default_factory=chosen.Polled)
    is_short: bool = False
    key: str = ""
    rig: Rig | None = None
    plan_key: str = ""
    plan: Plan | None = None
    edges: dict[Mesh, MeshEdges] = field(default_factory=dict)
    steps: Generator[object, None, None] | None = None

    def touch(self) -> None:
        """Note a change."""
        self.changed_at = monotonic()
        if self.old_since is None:
            self.old_since = self.changed_at

    @property
    def is_old(self) -> bool:
        """Whether the drawing is out of date for longer than a moment; dimming it at once would
        flicker.
        """
        if self.changed_at is None and self.steps is None:
            self.old_since = None
        wait = QUIET + (0.0 if self.steps is not None else MOST_PAUSE)
        return self.old_since is not None and monotonic() - self.old_since > wait

    def poll(self, scene: bpy.types.Scene) -> None:
        """Compare the settings; Blender does not report their changes."""

        def read() -> tuple[object, ...]:
            unit = scene.unit_settings.length_unit
            return (*chosen.chosen_settings(scene), length_of_unit(scene), unit)

        if self.polled.have_changed(read):
            self.touch()

    def is_due(self, is_held: bool) -> bool:
        """Whether the scene is to be read now.

        is_held : a drag or playback is on
        """
        pause = min(SHARE * self.spent, MOST_PAUSE)
        if self.changed_at is None or monotonic() < self.ended_at + pause:
            return False
        # a change of places only is usually short
        lasted = self.lasted.get(self.places.is_whole, 0.0 if self.places.is_whole else HEAVY)
        if lasted < HEAVY:
            return True
        wait = max(QUIET, SHARE * lasted) if is_held else QUIET
        return monotonic() - self.changed_at >= wait

    def took(self, seconds: float) -> None:
        """Record the duration of a step."""
        self.spent += seconds
        self.lasted[self.is_short] = max(self.lasted.get(self.is_short, 0.0), seconds)
        self.ended_at = monotonic()

    def planning(self, rig: Rig, settings: Settings) -> Steps[Plan]:
        """Plan a valid rig. Another viewer or picture needs no new plan."""
        key = _key(replace(rig, viewers=(), pictures=()), settings)
        if self.plan is None or key != self.plan_key:
            work.session().lend(self.light)
            self.plan = yield from compile_plan_steps(rig, settings, self.light)
            self.plan_key = key
        return replace(self.plan, rig=rig, viewer=rig.viewers[0])


_sketched: dict[int, Sketched] = {}  # by session uid of the scene


def drawing_of(scene: bpy.types.Scene) -> SketchDrawing | None:
    """The drawing over a scene; None if there is none yet."""
    sketched = _sketched.get(scene.session_uid)
    return None if sketched is None else sketched.drawing


def is_faint(scene: bpy.types.Scene) -> bool:
    """Whether the drawing is out of date."""
    return scene.session_uid in _sketched and _sketched[scene.session_uid].is_faint


def erase(scene: bpy.types.Scene) -> None:
    """Clear a scene's drawing until the next reading, since another rig is active."""
    sketched = _sketched.get(scene.session_uid)
    if sketched is not None:
        sketched.drawing, sketched.steps, sketched.key = None, None, ""
        sketched.touch()


def is_looked_at(area: bpy.types.Area) -> bool:
    """Whether a 3D viewport shows overlays and the Kiriko tab."""
    space = area.spaces.active
    if area.type != "VIEW_3D" or not (space.show_region_ui and space.overlay.show_overlays):
        return False
    return any(r.type == "UI" and r.active_panel_category == TAB for r in area.regions)


def looks_through(scene: bpy.types.Scene, area: bpy.types.Area) -> bool:
    """Whether a 3D viewport is in Look Through Viewer."""
    space = area.spaces.active
    return (
        area.type == "VIEW_3D"
        and bool(scene.kiriko_scene.looking)
        and space.region_3d.view_perspective == "CAMERA"
        and space.camera is not None
        and space.camera == viewer_of(scene)
    )


def views() -> Iterator[tuple[bpy.types.Window, bpy.types.Area]]:
    """The viewports with a sketch or an outline of the glass."""
    for window in windows.all_windows():
        manager = window.id_data
        if manager.kiriko.show_overlay:
            for area in window.screen.areas:
                if is_looked_at(area) or looks_through(window.scene, area):
                    yield window, area


def redraw(scene_uid: int) -> None:
    """Redraw the viewports of a scene's sketch."""
    for window, area in views():
        if window.scene.session_uid == scene_uid:
            area.tag_redraw()


def tick() -> float:
    """Do the timer's turn."""
    try:
        return PAUSE if draw_next() else IDLE
    except Exception as error:
        reporting.sentence(error, Message("The overlay"))  # also prints unexpected errors
        _sketched.clear()
        return PATIENCE


def draw_next() -> bool:
    """Do one turn for one visible scene. Returns whether there is more to do."""
    shown = {window.scene.session_uid for window in windows.all_windows()}
    for gone in set(_sketched) - shown:
        del _sketched[gone]

    looked_at = {window.scene.session_uid: window for window, _ in views()}
    for uid in looked_at.keys() & _sketched.keys():
        sketched = _sketched[uid]
        if sketched.is_old != sketched.is_faint:
            sketched.is_faint = not sketched.is_faint
            redraw(uid)
    if work.is_busy():
        return False

    for uid, window in looked_at.items():
        sketched = _sketched.setdefault(uid, Sketched())
        sketched.poll(window.scene)
        is_held = bool(len(window.modal_operators)) or window.screen.is_animation_playing
        if sketched.steps is None and sketched.is_due(is_held):
            begin(sketched, window)
        if sketched.steps is not None:
            advance(sketched, uid)
            return True
    return False


def begin(sketched: Sketched, window: bpy.types.Window) -> None:
    """Read the scene of a window, and begin a sketch if it differs."""
    started = thread_time()
    with bpy.context.temp_override(window=window):
        context = bpy.context
        context.view_layer.update()
        sketched.changed_at = None  # this reading includes the change reported by the update above
        sketched.is_short = sketched.places.is_whole
        scene = context.scene
        try:
            rig = read_places(context.evaluated_depsgraph_get(), scene, sketched.places)
        except KirikoError:
            rig = Rig(viewers=(), glasses=(), plates=(), displays=())

        settings = work.settings_of(scene)
        has_light = any(map(is_looked_at, window.screen.areas)) and not needed.missing_parts(scene)
        has_contours = any(looks_through(scene, area) for area in window.screen.areas)
        metres = length_of_unit(scene)

    key = _key(rig, settings, has_light, has_contours, metres)
    sketched.spent = 0.0
    sketched.lasted.pop(sketched.is_short, None)
    sketched.took(thread_time() - started)
    if key != sketched.key:
        sketched.key, sketched.rig = key, rig  # referenced, so that no other mesh gets the same id
        wish = _SketchWish(settings if has_light else None, has_contours, metres)
        sketched.steps = _sketching(sketched, rig, wish)


def advance(sketched: Sketched, scene_uid: int) -> None:
    """Continue a sketch for one turn."""
    stop = perf_counter() + TURN
    while sketched.steps is not None and perf_counter() < stop:
        started = thread_time()
        if next(sketched.steps, DONE) is DONE:
            sketched.steps = None
            redraw(scene_uid)
        sketched.took(thread_time() - started)


class _SketchWish(NamedTuple):
    """Settings for the light, None for none, and whether contours are needed."""

    settings: Settings | None
    has_contours: bool
    metres: float


def _sketching(sketched: Sketched, rig: Rig, wish: _SketchWish) -> Generator[object, None, None]:
    """Sketch a rig, with its light if it can be solved."""
    sketch = None
    if wish.settings is not None:
        with suppress(KirikoError):
            rig.check()
            wish.settings.check()
            plan = yield from sketched.planning(rig, wish.settings)
            sketch = yield from sketching(rig, plan)

    if sketch is None:
        sketch = yield from sketching(rig, None)
    found = [np.empty((0, 2, 3))]
    if wish.has_contours and rig.viewers:
        yield from _contours(sketched, rig, found)
    sketched.drawing = SketchDrawing(sketch, wish.metres, np.concatenate(found))


def _contours(sketched: Sketched, rig: Rig, found: list[Floats]) -> Generator[object, None, None]:
    """Append the contours of each glass to `found`. Edges stay cached as long as their mesh."""
    before, sketched.edges = sketched.edges, {}
    for glass in rig.glasses:
        edges = before.get(glass.mesh)
        if edges is None:
            edges = edges_of(glass.mesh)
            yield
        sketched.edges[glass.mesh] = edges
        found.append(contours(glass.mesh, edges, rig.viewers[0]))
        yield


def _key(rig: Rig, *others: object) -> str:
    """Fingerprint of a rig and everything else drawn. Large cached meshes count by their ids."""
    parts = tuple(
        (id(part.mesh), replace(part, mesh=None)) if role.is_curved else part
        for role, part in rig.parts()
    )
    return fingerprint(parts, *others)


@persistent
def on_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Note a change in Blender; the next reading decides whether it matters."""
    for sketched in _sketched.values():
        sketched.places.notice(depsgraph)
        sketched.touch()


@persistent
def on_undo(*_: object) -> None:
    """Drop cached meshes, which undo may have restored."""
    for sketched in _sketched.values():
        sketched.places = PlaceCache()
        sketched.touch()


@persistent
def on_load(*_: object) -> None:
    """Drop all drawings before another file."""
    _sketched.clear()


HANDLERS = (
    ("depsgraph_update_post", on_update),
    ("frame_change_post", on_update),  # animated objects may have moved
    ("undo_post", on_undo),
    ("redo_post", on_undo),
    ("load_post", on_load),
)


def register() -> None:
    """Start the timer and handlers."""
    work.follow(tick, IDLE, HANDLERS)


def unregister() -> None:
    """Stop them."""
    work.stop_following(tick, HANDLERS)
    _sketched.clear()
