"""Looks over a scene for its checklist, beside the drawing of panels and never within it.

A panel asks for the entries and gets those of the last look. That it asks has a timer look again,
and Blender draws panels whenever something changes. Meshes are looked at one by one, when they have
been left alone for a while, and again only when Blender tells that they changed.
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
from . import needed, telling, watch, windows, work

TICK = 0.2  # s between two turns
QUIET = 0.4  # s without a change of a mesh before it is looked at
SHARE = 5.0  # times as long as the last look at a mesh took it has to be quiet
RESTING = 50.0  # times as long as a look took there is none at the same scene


@dataclass(eq=False)
class Looked:
    """A scene that was looked at.

    meshes : those of objects by session uid; one that has changed is not among them
    rig : session uid of the rig that was active
    asked : has a panel asked since the last look?
    is_whole : are all meshes known that are there?
    """

    entries: list[Entry] = field(default_factory=list)
    meshes: dict[int, InspectedMesh] = field(default_factory=dict)
    rig: int | None = None
    asked: bool = True
    is_whole: bool = False
    rests_until: float = 0.0
    changed_at: float = 0.0
    lasted: float = 0.0
    moved_at: float = -inf  # when entries came or went, and moved the buttons of others

    @property
    def is_quiet(self) -> bool:
        """Have meshes been left alone for a while?"""
        return monotonic() - self.changed_at >= max(QUIET, SHARE * self.lasted)

    def forget(self, uids: Iterable[int]) -> None:
        """Have meshes of objects be looked at anew."""
        for uid in uids:
            self.meshes.pop(uid, None)
        self.asked, self.is_whole = True, False


_looked: dict[int, Looked] = {}  # by session uid of the scene


def found(context: bpy.types.Context) -> list[Entry]:
    """The entries of the last look at the active rig; none before the timer's first look at it.

    A new rig may not be in the view layer yet while it is drawn, and would seem to have no parts.
    In the background no timer runs, and each call looks.
    """
    looked = _looked.setdefault(context.scene.session_uid, Looked())
    if bpy.app.background:
        _look(looked, context.scene, is_whole=True)
    elif looked.rig != rig_uid(context.scene):
        looked.rig, looked.entries = rig_uid(context.scene), []
        looked.is_whole, looked.rests_until = False, 0.0
    looked.asked = True
    return looked.entries


def have_moved(scene: bpy.types.Scene) -> bool:
    """Have buttons just moved, so that a double click on one would press another, too?"""
    looked = _looked.get(scene.session_uid)
    return looked is not None and monotonic() < looked.moved_at + _double_click()


def _double_click() -> float:
    return 1e-3 * bpy.context.preferences.inputs.mouse_double_click_time


def is_looking(scene: bpy.types.Scene) -> bool:
    """Is a mesh still to be looked at, so that nobody knows whether there is more to do?"""
    return scene.session_uid in _looked and not _looked[scene.session_uid].is_whole


def inspect_again(scene: bpy.types.Scene) -> None:
    """Have the timer look a scene over at once, for another of its rigs is active."""
    if scene.session_uid in _looked:
        _looked[scene.session_uid].asked, _looked[scene.session_uid].rests_until = True, 0.0


def look_now(context: bpy.types.Context) -> list[Entry]:
    """Look over a scene at once, with all of its meshes."""
    looked = _whole(context)
    _look(looked, context.scene, is_whole=True)
    return looked.entries


def read_to_solve(context: bpy.types.Context) -> Any:
    """The scene as it is read, with its fingerprint for the result, and findings in the notes."""
    kept = ShapeCache()
    reading = work.read(context, kept)
    notes = tuple(dict.fromkeys([*reading.notes, *findings(context)]))
    return replace(reading, notes=notes, solved_for=work.scene_now(context, kept).as_text())


def findings(context: bpy.types.Context) -> list[str]:
    """What the checklist knows of the glass, in the background, where no panel shows it."""
    if not bpy.app.background:
        return []
    look = _seen(_whole(context), context.scene)
    return [entry.text for entry in checklist.findings(look)]


def _whole(context: bpy.types.Context) -> Looked:
    """A scene with all of its meshes looked at."""
    looked = _looked.setdefault(context.scene.session_uid, Looked())
    context.view_layer.update()
    while things := _unknown(looked, context):
        for thing in things:
            _look_at_mesh(looked, context, thing)
    return looked


def _look(looked: Looked, scene: bpy.types.Scene, is_whole: bool) -> None:
    """All but the meshes.

    is_whole : is none of those left to be looked at? Else it is done again, drawn or not.
    """
    started = perf_counter()
    look = _seen(looked, scene)
    looked.rig = rig_uid(scene)
    looked.entries = checklist.entries(look, partial(length_text, scene))
    looked.asked, looked.is_whole = not is_whole, is_whole
    looked.rests_until = monotonic() + RESTING * (perf_counter() - started)


def _seen(looked: Looked, scene: bpy.types.Scene) -> Inspection:
    """A scene as its checklist needs it, with the meshes that were looked at."""
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
    """The objects whose meshes are still to be looked at."""
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
    """Called by the timer."""
    try:
        _turn()
    except Exception as error:
        telling.sentence(error, Message("The checklist"))  # prints errors that were not foreseen
        for looked in _looked.values():  # nothing is known to be looked at next
            looked.is_whole = True
        return watch.PATIENCE
    return TICK


def _turn() -> None:
    """One look at one of the scenes whose panel asks for it."""
    if work.is_busy():
        return
    for window in windows.all_windows():
        scene = window.scene
        looked = _looked.get(scene.session_uid)
        if looked is None or not looked.asked or monotonic() < looked.rests_until:
            continue
        if any(w.screen.is_animation_playing for w in windows.all_windows()):
            return

        with bpy.context.temp_override(window=window):
            # asked once: else the quiet may begin in between, and no mesh was looked at
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
    """Forget the meshes that Blender evaluated anew."""
    anew = reshaped(depsgraph) if _looked else []
    uids = [thing.session_uid for thing in anew if thing.kiriko.role in CHECKED]
    for looked in _looked.values():
        looked.asked |= bool(anew)
        if uids:
            looked.changed_at = monotonic()
            looked.forget(uids)


@persistent
def on_undo(*_: object) -> None:
    """Any mesh may be another one."""
    for looked in _looked.values():
        looked.forget(list(looked.meshes))


@persistent
def on_load(*_: object) -> None:
    """Another file."""
    _looked.clear()


HANDLERS = (
    ("depsgraph_update_post", on_update),
    ("undo_post", on_undo),
    ("redo_post", on_undo),
    ("load_post", on_load),
)


def register() -> None:
    """Begin to look."""
    work.follow(tick, TICK, HANDLERS)


def unregister() -> None:
    """Look no more."""
    work.stop_following(tick, HANDLERS)
    _looked.clear()
