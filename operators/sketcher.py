"""Sketcher: keeps the sketch of each scene up to date that is looked at with the Kiriko tab open.

Handlers only note that something may have changed. A timer of the application reads the scene, when
that is due, makes it ready and traces a few rays, a little in each turn; nothing is done while the
viewport is drawn. It uses the glass that the session has made ready, and leaves the session as it
is. A scene whose reading takes long is left until it is quiet, so that a drag does not stutter.
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
from . import chosen, needed, telling, windows, work

TAB = "Kiriko"
IDLE = 0.1  # s between two looks
PAUSE = 0.01  # s between two turns of work, in which the interface is drawn
TURN = 0.02  # s after which a turn begins no other step
SHARE = 2.0  # times as long as the last sketch took there is none after it,
MOST_PAUSE = 0.5  # but s at the most
HEAVY = 0.1  # s: a sketch with a longer step waits until it is quiet, longer during a drag
QUIET = 0.3  # s without a change, for one that waits
PATIENCE = 10.0  # s after an error that was not foreseen
DONE = object()


@dataclass(frozen=True, eq=False)
class SketchDrawing:
    """A sketch, as a scene shows it.

    metres : length of a Blender unit, m, in which the scene was read
    contours : (n, 2, 3) m, of the glass, for views that look through the viewer
    """

    sketch: Sketch
    metres: float
    contours: Floats = field(default_factory=lambda: np.empty((0, 2, 3)))


@dataclass(eq=False)
class Sketched:
    """A scene that is looked at.

    kept, light : meshes and glass that need not be made again
    changed_at : when the last change was noticed; None where all has been looked at
    old_since : when the first change was noticed that is not drawn yet; None where all is drawn
    is_faint : is it drawn as the scene as it was?
    ended_at, spent : when the last sketch was done, and the s that it took
    lasted : s of its longest step, where only places and settings had changed, and else; of the
        processor, so that others' work does not count
    key, plan_key : of all that was drawn last, and of the plan
    """

    kept: PlaceCache = field(default_factory=PlaceCache)
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
        """Something has changed that may count."""
        self.changed_at = monotonic()
        if self.old_since is None:
            self.old_since = self.changed_at

    @property
    def is_old(self) -> bool:
        """Is the drawing known to be old, or has nobody looked for long? Not one that will be drawn
        anew soon, which would flicker.
        """
        if self.changed_at is None and self.steps is None:
            self.old_since = None
        wait = QUIET + (0.0 if self.steps is not None else MOST_PAUSE)
        return self.old_since is not None and monotonic() - self.old_since > wait

    def poll(self, scene: bpy.types.Scene) -> None:
        """Look at the settings, of whose changes Blender does not tell."""

        def read() -> tuple[object, ...]:
            unit = scene.unit_settings.length_unit
            return (*chosen.chosen_settings(scene), length_of_unit(scene), unit)

        if self.polled.have_changed(read):
            self.touch()

    def is_due(self, is_held: bool) -> bool:
        """Is it time to read the scene?

        is_held : something is dragged, or played
        """
        pause = min(SHARE * self.spent, MOST_PAUSE)
        if self.changed_at is None or monotonic() < self.ended_at + pause:
            return False
        # one of which only places have changed is likely to be short
        lasted = self.lasted.get(self.kept.is_whole, 0.0 if self.kept.is_whole else HEAVY)
        if lasted < HEAVY:
            return True
        wait = max(QUIET, SHARE * lasted) if is_held else QUIET
        return monotonic() - self.changed_at >= wait

    def took(self, seconds: float) -> None:
        """A step took so long."""
        self.spent += seconds
        self.lasted[self.is_short] = max(self.lasted.get(self.is_short, 0.0), seconds)
        self.ended_at = monotonic()

    def planning(self, rig: Rig, settings: Settings) -> Steps[Plan]:
        """Make a rig that was checked ready to be traced. Another
        viewer or picture needs nothing made ready.
        """
        key = _key(replace(rig, viewers=(), pictures=()), settings)
        if self.plan is None or key != self.plan_key:
            work.session().lend(self.light)
            self.plan = yield from compile_plan_steps(rig, settings, self.light)
            self.plan_key = key
        return replace(self.plan, rig=rig, viewer=rig.viewers[0])


_sketched: dict[int, Sketched] = {}  # by session uid of the scene


def drawing_of(scene: bpy.types.Scene) -> SketchDrawing | None:
    """What is to be drawn over a scene, as far as it is known by now."""
    sketched = _sketched.get(scene.session_uid)
    return None if sketched is None else sketched.drawing


def is_faint(scene: bpy.types.Scene) -> bool:
    """Is that of the scene as it was?"""
    return scene.session_uid in _sketched and _sketched[scene.session_uid].is_faint


def erase(scene: bpy.types.Scene) -> None:
    """Draw nothing over a scene until it was read again, for another of its rigs is active."""
    sketched = _sketched.get(scene.session_uid)
    if sketched is not None:
        sketched.drawing, sketched.steps, sketched.key = None, None, ""
        sketched.touch()


def is_looked_at(area: bpy.types.Area) -> bool:
    """Does a 3D viewport show overlays, and its sidebar the Kiriko tab?"""
    space = area.spaces.active
    if area.type != "VIEW_3D" or not (space.show_region_ui and space.overlay.show_overlays):
        return False
    return any(r.type == "UI" and r.active_panel_category == TAB for r in area.regions)


def looks_through(scene: bpy.types.Scene, area: bpy.types.Area) -> bool:
    """Whether a 3D viewport shows a scene by Look Through Viewer."""
    space = area.spaces.active
    return (
        area.type == "VIEW_3D"
        and bool(scene.kiriko_scene.looking)
        and space.region_3d.view_perspective == "CAMERA"
        and space.camera is not None
        and space.camera == viewer_of(scene)
    )


def views() -> Iterator[tuple[bpy.types.Window, bpy.types.Area]]:
    """The viewports with a sketch, or with contours of the glass."""
    for window in windows.all_windows():
        manager = window.id_data
        if manager.kiriko.show_overlay:
            for area in window.screen.areas:
                if is_looked_at(area) or looks_through(window.scene, area):
                    yield window, area


def redraw(scene_uid: int) -> None:
    """Have the viewports drawn again that show a scene's sketch."""
    for window, area in views():
        if window.scene.session_uid == scene_uid:
            area.tag_redraw()


def tick() -> float:
    """Called by the timer."""
    try:
        return PAUSE if draw_next() else IDLE
    except Exception as error:
        telling.sentence(
            error, Message("The overlay")
        )  # which prints errors that were not foreseen
        _sketched.clear()
        return PATIENCE


def draw_next() -> bool:
    """Do a little for one scene that is looked at, if there is anything to do; is there more?"""
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
    """Read the scene that a window shows, and begin a sketch if anything is different."""
    started = thread_time()
    with bpy.context.temp_override(window=window):
        context = bpy.context
        context.view_layer.update()
        sketched.changed_at = None  # the change that the update above told of is in the reading
        sketched.is_short = sketched.kept.is_whole
        scene = context.scene
        try:
            rig = read_places(context.evaluated_depsgraph_get(), scene, sketched.kept)
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
        sketched.key, sketched.rig = key, rig  # held, so that no other mesh gets their ids
        wish = _SketchWish(settings if has_light else None, has_contours, metres)
        sketched.steps = _sketching(sketched, rig, wish)


def advance(sketched: Sketched, scene_uid: int) -> None:
    """Go on with a sketch for a turn."""
    stop = perf_counter() + TURN
    while sketched.steps is not None and perf_counter() < stop:
        started = thread_time()
        if next(sketched.steps, DONE) is DONE:
            sketched.steps = None
            redraw(scene_uid)
        sketched.took(thread_time() - started)


class _SketchWish(NamedTuple):
    """Settings for the light, None: without light; and whether contours are drawn."""

    settings: Settings | None
    has_contours: bool
    metres: float


def _sketching(sketched: Sketched, rig: Rig, wish: _SketchWish) -> Generator[object, None, None]:
    """Sketch the rig, with its light if it can be solved."""
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
    """Append the contours of each glass to `found`; edges are cached as long as its mesh is."""
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
    """Tells a rig from others, and all else that is drawn; meshes
    that may be large, and are kept from reading to reading, by their ids.
    """
    parts = tuple(
        (id(part.mesh), replace(part, mesh=None)) if role.is_curved else part
        for role, part in rig.parts()
    )
    return fingerprint(parts, *others)


@persistent
def on_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Blender evaluated a change; whether it counts shows when the scene is read."""
    for sketched in _sketched.values():
        sketched.kept.notice(depsgraph)
        sketched.touch()


@persistent
def on_undo(*_: object) -> None:
    """Meshes that are kept may have been put back."""
    for sketched in _sketched.values():
        sketched.kept = PlaceCache()
        sketched.touch()


@persistent
def on_load(*_: object) -> None:
    """Another file: nothing of the one before is drawn over it."""
    _sketched.clear()


HANDLERS = (
    ("depsgraph_update_post", on_update),
    ("frame_change_post", on_update),  # animated objects may stand elsewhere
    ("undo_post", on_undo),
    ("redo_post", on_undo),
    ("load_post", on_load),
)


def register() -> None:
    """Begin to look."""
    work.follow(tick, IDLE, HANDLERS)


def unregister() -> None:
    """Look no more."""
    work.stop_following(tick, HANDLERS)
    _sketched.clear()
