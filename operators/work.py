"""Shared state of the operators: the read scene, the session, and running work."""

from collections.abc import Callable, Iterable
from typing import Any

import bpy

from ..core.base.errors import RigError
from ..core.blender.read import scene as blender_scene
from ..core.blender.read.scene_parts import GLASS_REMEDY
from ..core.blender.read.shapes import ShapeCache
from ..core.blender.result import scene_fingerprint as blender_solved_for
from ..core.blender.result.result_images import is_missing_numbers
from ..core.native import loading
from ..core.rig.settings import Settings
from ..core.solve.session import Session
from ..core.solve.solved_for import SolvedFor
from . import map_drawing

_sessions: list[Session] = []
_legible: dict[str, Any] = {}
_running: list[Any] = []  # running operators with long work
# Fingerprints of complete results by session uid of the scene; cleared by undo, which restores an
# image without its record.
_written: dict[int, str] = {}


def session() -> Session:
    """The only session; it caches results from click to click."""
    if not _sessions:
        _sessions.append(Session())
    return _sessions[0]


def legible() -> dict[str, Any]:
    """Cache of the picture's last legibility, dropped with the session."""
    return _legible


def forget() -> None:
    """Stop all running work, which Blender would drop silently, and drop the session."""
    for operator in list(_running):
        with bpy.context.temp_override(window=operator.window):
            operator.cancel(bpy.context)
    _sessions.clear()
    _legible.clear()


def note_written(scene: bpy.types.Scene) -> None:
    """Mark a scene's result as complete, with all of its images painted."""
    map_drawing.forget()
    _written[scene.session_uid] = scene.kiriko.result.solved_for


def is_written(scene: bpy.types.Scene, solved_for: str) -> bool:
    """Whether a scene's result is complete and belongs to a scene, with nothing undone since."""
    result = scene.kiriko.result
    is_whole = not result.is_coarse and not is_missing_numbers(result)
    is_of_it = _written.get(scene.session_uid) == result.solved_for == solved_for
    return is_of_it and is_whole and result.source is not None


def forget_written() -> None:
    """Treat all results as incomplete, as after undo."""
    _written.clear()


def forget_report(scene: bpy.types.Scene) -> None:
    """Drop Add Rig's report on light, which a change has outdated; a result is marked as outdated
    instead.
    """
    if scene.kiriko.result.source is None:
        scene.kiriko.result.summary = scene.kiriko.result.details = ""


def listen(handlers: Iterable[tuple[str, Callable]]) -> None:
    """Register functions as handlers, by the lists of bpy.app.handlers."""
    for name, handler in handlers:
        getattr(bpy.app.handlers, name).append(handler)


def stop_listening(handlers: Iterable[tuple[str, Callable]]) -> None:
    """Unregister those that are still there."""
    for name, handler in handlers:
        listening = getattr(bpy.app.handlers, name)
        if handler in listening:
            listening.remove(handler)


def follow(
    tick: Callable[[], float], after: float, handlers: Iterable[tuple[str, Callable]]
) -> None:
    """Register a timer, first due after some seconds, and handlers."""
    listen(handlers)
    bpy.app.timers.register(tick, first_interval=after, persistent=True)


def stop_following(tick: Callable[[], float], handlers: Iterable[tuple[str, Callable]]) -> None:
    """Unregister the timer and the handlers."""
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
    stop_listening(handlers)


def running() -> Any | None:
    """The running operator with long work, with its `progress`, 0 to 1."""
    return _running[0] if _running else None


def is_busy() -> bool:
    """Whether an operator or a render is running, so that session and results must not be
    touched.
    """
    return bool(_running) or bpy.app.is_job_running("RENDER")


def read(context: bpy.types.Context, shapes: ShapeCache | None = None) -> Any:
    """The scene, read as evaluated now.

    Raises
    ------
    RigError : it has no glass, which its settings need; as from `read`
    """
    context.view_layer.update()
    found = blender_scene.read(context.evaluated_depsgraph_get(), context.scene, shapes)
    if context.scene.kiriko.only_through_glass and not found.rig.glasses:
        raise RigError("The rig has no glass: {remedy}.", remedy=GLASS_REMEDY)
    return found


def scene_now(context: bpy.types.Context, shapes: ShapeCache | None = None) -> SolvedFor:
    """Fingerprint of the scene as it is now."""
    context.view_layer.update()
    scene = context.scene
    return blender_solved_for.scene_now(
        context.evaluated_depsgraph_get(), scene, settings_of(scene), shapes
    )


def rig_now(context: bpy.types.Context, shapes: ShapeCache | None = None) -> SolvedFor:
    """Fingerprint of the rig as it is now, without what is painted."""
    context.view_layer.update()
    scene = context.scene
    settings = settings_of(scene).of_optics
    return blender_solved_for.scene_now(
        context.evaluated_depsgraph_get(), scene, settings, shapes, has_pixels=False
    )


def settings_of(scene: bpy.types.Scene) -> Settings:
    """Settings of the scene's solve, with as many threads as its renders."""
    loading.use_threads(scene.render.threads)
    ours = scene.kiriko
    return Settings(
        tolerance=ours.tolerance,
        max_events=ours.max_events,
        effort=ours.effort,
        only_through_glass=ours.only_through_glass,
        only_through_plate=ours.only_through_plate,
        brightness=ours.brightness,
        margin=ours.margin,
        suppress_glare=ours.suppress_glare,
        ghosts=ours.ghosts.lower(),
        disagreement=ours.disagreement.lower(),
        sharpen=ours.sharpen,
    )
