"""Checks scenes for the checklist in a timer, never while panels are drawn.

A panel requests the findings and gets those of the last check; the request makes the timer check
again. Meshes are checked one by one, once they have been unchanged for a while, and again only
after Blender reports a change.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from time import monotonic, perf_counter
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..core.base.messages import Message
from ..core.blender.checks import checklist
from ..core.blender.checks.inspect_scene import (
    CHECKED,
    InspectedMesh,
    inspect,
    inspect_mesh,
    is_checked,
)
from ..core.blender.checks.to_do import Entry, Inspection
from ..core.blender.data.rigs import rig_uid
from ..core.blender.data.units import length_text
from ..core.blender.read.shapes import ShapeCache, reshaped
from . import needed, reporting, watch, windows, work

TICK = 0.2  # s between turns
QUIET = 0.4  # s without changes before a mesh is checked
SHARE = 5.0  # required quiet time, relative to the time of the last check of a mesh
RESTING = 50.0  # pause of a scene's checks, relative to the time of a check


@dataclass(eq=False)
class Looked:
    """A checked scene.

    meshes : findings of objects' meshes by session uid, without changed ones
    rig : session uid of the rig that was active
    requested : whether a panel has requested findings since the last check
    is_whole : whether all meshes are checked
    """

    entries: list[Entry] = field(default_factory=list)
    meshes: dict[int, InspectedMesh] = field(default_factory=dict)
    rig: int | None = None
    requested: bool = True
    is_whole: bool = False
    rests_until: float = 0.0
    changed_at: float = 0.0
    lasted: float = 0.0
    moved_at: float = -inf  # time when findings came or went, and moved other buttons

    @property
    def is_quiet(self) -> bool:
        """Whether meshes have been unchanged for long enough."""
        return monotonic() - self.changed_at >= max(QUIET, SHARE * self.lasted)

    def forget(self, uids: Iterable[int]) -> None:
        """Mark meshes of objects for another check."""
        for uid in uids:
            self.meshes.pop(uid, None)
        self.requested, self.is_whole = True, False


_looked: dict[int, Looked] = {}  # by session uid of the scene


def found(context: bpy.types.Context) -> list[Entry]:
    """Findings of the last check of the active rig; none before the first one.

    A new rig may not be in the view layer yet when it is drawn, and would seem to have no parts. In
    background no timer runs, so each call checks.
    """
    looked = _looked.setdefault(context.scene.session_uid, Looked())
    if bpy.app.background:
        _look(looked, context.scene, is_whole=True)
    elif looked.rig != rig_uid(context.scene):
        looked.rig, looked.entries = rig_uid(context.scene), []
        looked.is_whole, looked.rests_until = False, 0.0
    looked.requested = True
    return looked.entries


def have_moved(scene: bpy.types.Scene) -> bool:
    """Whether buttons have just moved, so that a double click might press another one."""
    looked = _looked.get(scene.session_uid)
    return looked is not None and monotonic() < looked.moved_at + _double_click()


def _double_click() -> float:
    return 1e-3 * bpy.context.preferences.inputs.mouse_double_click_time


def is_looking(scene: bpy.types.Scene) -> bool:
    """Whether a mesh is still unchecked."""
    return scene.session_uid in _looked and not _looked[scene.session_uid].is_whole


def inspect_again(scene: bpy.types.Scene) -> None:
    """Check a scene at the next turn, because another of its rigs is active."""
    if scene.session_uid in _looked:
        _looked[scene.session_uid].requested, _looked[scene.session_uid].rests_until = True, 0.0


def look_now(context: bpy.types.Context) -> list[Entry]:
    """Check a scene now, with all of its meshes."""
    looked = _whole(context)
    _look(looked, context.scene, is_whole=True)
    return looked.entries


def read_to_solve(context: bpy.types.Context) -> Any:
    """The scene as read, with its fingerprint for the result, and findings among the notes."""
    shapes = ShapeCache()
    reading = work.read(context, shapes)
    notes = tuple(dict.fromkeys([*reading.notes, *findings(context)]))
    return replace(reading, notes=notes, solved_for=work.scene_now(context, shapes).as_text())


def findings(context: bpy.types.Context) -> list[str]:
    """Findings on the glass for background mode, which has no panels."""
    if not bpy.app.background:
        return []
    look = _seen(_whole(context), context.scene)
    return [entry.text for entry in checklist.findings(look)]


def _whole(context: bpy.types.Context) -> Looked:
    """A scene with all of its meshes checked."""
    looked = _looked.setdefault(context.scene.session_uid, Looked())
    context.view_layer.update()
    while things := _unknown(looked, context):
        for thing in things:
            _look_at_mesh(looked, context, thing)
    return looked


def _look(looked: Looked, scene: bpy.types.Scene, is_whole: bool) -> None:
    """Check everything but the meshes.

    is_whole : whether all meshes are checked; otherwise the check is repeated, drawn or not
    """
    started = perf_counter()
    look = _seen(looked, scene)
    looked.rig = rig_uid(scene)
    looked.entries = checklist.entries(look, partial(length_text, scene))
    looked.requested, looked.is_whole = not is_whole, is_whole
    looked.rests_until = monotonic() + RESTING * (perf_counter() - started)


def _seen(looked: Looked, scene: bpy.types.Scene) -> Inspection:
    """A scene as its checklist needs it, with the checked meshes."""
    found = needed.parts(scene)
    look = inspect(
        scene,
        found,
        needed.missing_of(scene, found),
        looked.meshes,
        watch.is_reported_changed(scene),
    )
    return replace(look, is_followed=watch.is_followed(scene))


def _unknown(looked: Looked, context: bpy.types.Context) -> list[bpy.types.Object]:
    """Objects whose meshes are still unchecked."""
    layer = context.view_layer
    return [
        thing
        for members in needed.parts(context.scene).values()
        for thing, by in members.items()
        if not by and thing.session_uid not in looked.meshes and is_checked(thing, layer)
    ]


def _look_at_mesh(looked: Looked, context: bpy.types.Context, thing: bpy.types.Object) -> None:
    started = perf_counter()
    looked.meshes[thing.session_uid] = inspect_mesh(thing, context.evaluated_depsgraph_get())
    looked.lasted = perf_counter() - started


def tick() -> float:
    """Timer callback."""
    try:
        _turn()
    except Exception as error:
        reporting.sentence(error, Message("The checklist"))  # prints unexpected errors
        for looked in _looked.values():  # nothing is scheduled
            looked.is_whole = True
        return watch.PATIENCE
    return TICK


def _turn() -> None:
    """One check of one of the scenes whose panel requests it."""
    if work.is_busy():
        return
    for window in windows.all_windows():
        scene = window.scene
        looked = _looked.get(scene.session_uid)
        if looked is None or not looked.requested or monotonic() < looked.rests_until:
            continue
        if any(w.screen.is_animation_playing for w in windows.all_windows()):
            return

        with bpy.context.temp_override(window=window):
            # Evaluated once: otherwise the quiet time might begin in between without a mesh being
            # checked.
            is_quiet = looked.is_quiet
            things = _unknown(looked, bpy.context) if is_quiet else []
            for thing in things[:1]:
                _look_at_mesh(looked, bpy.context, thing)
            is_whole = is_quiet and not things
            before = looked.entries, looked.is_whole
            _look(looked, scene, is_whole)
        if (looked.entries, looked.is_whole) != before:
            windows.redraw()
        if looked.entries != before[0]:
            looked.moved_at = monotonic()
            bpy.app.timers.register(partial(windows.redraw), first_interval=_double_click())
        return


@persistent
def on_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Forget meshes that Blender has evaluated again."""
    changed = reshaped(depsgraph) if _looked else []
    uids = [thing.session_uid for thing in changed if thing.kiriko.role in CHECKED]
    for looked in _looked.values():
        looked.requested |= bool(changed)
        if uids:
            looked.changed_at = monotonic()
            looked.forget(uids)


@persistent
def on_undo(*_: object) -> None:
    """Forget all meshes."""
    for looked in _looked.values():
        looked.forget(list(looked.meshes))


@persistent
def on_load(*_: object) -> None:
    """Handle another file."""
    _looked.clear()


HANDLERS = (
    ("depsgraph_update_post", on_update),
    ("undo_post", on_undo),
    ("redo_post", on_undo),
    ("load_post", on_load),
)


def register() -> None:
    """Start the timer."""
    work.follow(tick, TICK, HANDLERS)


def unregister() -> None:
    """Stop the timer."""
    work.stop_following(tick, HANDLERS)
    _looked.clear()
