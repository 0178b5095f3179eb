"""Shared by the operators: reading the scene, the session, and work that takes its time."""

import traceback
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from time import perf_counter
from typing import Any, TypeVar

import bpy

from ..core import kernel
from ..core.blender import scene as blender_scene
from ..core.blender import solved_for as blender_solved_for
from ..core.blender.parts import hidden_words
from ..core.blender.shapes import Kept
from ..core.blender.visibility import Shown, instance_hidden_by
from ..core.errors import KirikoError
from ..core.rig import ROLES
from ..core.settings import Settings
from ..core.solve.session import Session
from ..core.solve.solved_for import SolvedFor
from ..core.steps import finish
from .looking import only_looks

Result = TypeVar("Result")

TICK = 0.02  # s between two turns of work in the interface
TURN = 0.1  # s that a turn may take before the interface is drawn again and Esc is heard

_sessions: list[Session] = []
_running: list["LongWork"] = []

NEEDED = {
    **{
        role.name: f"No {role.noun}: {role.remedy}"
        for role in ROLES
        if role.remedy and role.number is not None
    },
    "PICTURE": "No picture: set a textured plane's role to Picture, or choose an image",
    "VIEWER": "No viewer: choose a camera",
}
NO_IMAGE = "No picture: choose an image, or set Picture to Plane"
COARSE = "The source image is a coarse one: solve, or let Live finish"


MAKERS = {"NODES", "PARTICLE_SYSTEM"}  # modifiers that instance objects


def session() -> Session:
    """The one session; it keeps all that need not be computed again from click to click."""
    if not _sessions:
        _sessions.append(Session())
    return _sessions[0]


def forget() -> None:
    """Stop all that is running, which Blender would drop without a word, and drop the session."""
    for operator in list(_running):
        with bpy.context.temp_override(window=operator.window):
            operator.cancel(bpy.context)
    _sessions.clear()


def listen(handlers: Iterable[tuple[str, Callable]]) -> None:
    """Have Blender call functions, by the names of their lists in bpy.app.handlers."""
    for name, handler in handlers:
        getattr(bpy.app.handlers, name).append(handler)


def stop_listening(handlers: Iterable[tuple[str, Callable]]) -> None:
    """Take them back, those that are still there."""
    for name, handler in handlers:
        listening = getattr(bpy.app.handlers, name)
        if handler in listening:
            listening.remove(handler)


def is_busy() -> bool:
    """Is one of the operators at work, or a render, so that
    nothing else may touch session and results?
    """
    return bool(_running) or bpy.app.is_job_running("RENDER")


def read(context: bpy.types.Context, kept: Kept | None = None) -> Any:
    """The scene, evaluated as it is now, as blender_scene.Reading."""
    context.view_layer.update()
    return blender_scene.read(context.evaluated_depsgraph_get(), context.scene, kept)


def read_to_solve(context: bpy.types.Context, kept: Kept | None = None) -> Any:
    """The same, and with it the scene's fingerprint for the result."""
    kept = kept or Kept()
    reading = read(context, kept)
    return replace(reading, solved_for=scene_now(context, kept).as_text())


def scene_now(context: bpy.types.Context, kept: Kept | None = None) -> SolvedFor:
    """The fingerprint of the scene as it is now."""
    context.view_layer.update()
    scene = context.scene
    return blender_solved_for.scene_now(
        context.evaluated_depsgraph_get(), scene, settings_of(scene), kept
    )


def settings_of(scene: bpy.types.Scene) -> Settings:
    """How the scene wants to be solved, by as many threads as may render it."""
    kernel.use_threads(scene.render.threads)
    ours = scene.kiriko
    return Settings(
        tolerance=ours.tolerance,
        max_events=ours.max_events,
        effort=ours.effort,
        only_through_glass=ours.only_through_glass,
        brightness=ours.brightness,
        margin=ours.margin,
        suppress_glare=ours.suppress_glare,
        ghosts=ours.ghosts.lower(),
    )


def parts(scene: bpy.types.Scene) -> dict[str, dict[bpy.types.Object, str]]:
    """Objects of the scene by role, those in instanced
    collections too, each with what hides it, '' if shown.
    """
    found: dict[str, dict[bpy.types.Object, str]] = {}
    shown = Shown(scene, layer_of(scene))
    seen: set[tuple[bpy.types.Object, bool]] = set()
    todo = [(thing, True, "") for thing in scene.objects]
    while todo:
        thing, is_itself, by = todo.pop()
        if thing.kiriko.role == "NONE" and thing.instance_collection is None:
            continue
        by = by or (shown.hidden_by(thing) if is_itself else instance_hidden_by(thing))
        if (thing, not by) in seen:
            continue
        seen.add((thing, not by))
        if thing.kiriko.role != "NONE":
            things = found.setdefault(thing.kiriko.role, {})
            things[thing] = by and things.get(thing, by)  # shown once is shown
        if thing.instance_collection is not None:
            todo.extend((other, False, by) for other in thing.instance_collection.all_objects)
    return found


def layer_of(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    """The view layer in which a scene is worked on."""
    return bpy.context.view_layer if bpy.context.scene == scene else scene.view_layers[0]


def missing(scene: bpy.types.Scene) -> list[str]:
    """One phrase for each part that the rig still lacks, or that is hidden."""
    return list(_missing(scene).values())


def _missing(scene: bpy.types.Scene) -> dict[str, str]:
    """Parts that the rig lacks, by role, and a phrase on each."""
    found = parts(scene)
    ours = scene.kiriko
    there = {role for role, things in found.items() if not all(things.values())}
    if ours.viewer or scene.camera:
        there.add("VIEWER")
    lacks = {role: phrase for role, phrase in NEEDED.items() if role not in there}
    lacks |= {r: hidden_words(*next(iter(found[r].items()))) for r in lacks if r in found}
    if ours.picture_source == "IMAGE":
        lacks.pop("PICTURE", None)
        if ours.picture_image is None:
            lacks["IMAGE"] = NO_IMAGE
    return lacks


def lacking(scene: bpy.types.Scene) -> list[str]:
    """Missing parts that cannot be there all the same: modifiers
    may instance objects from anywhere in a file.
    """
    lacks = _missing(scene)
    if lacks and any(m.type in MAKERS for thing in scene.objects for m in thing.modifiers):
        elsewhere = {thing.kiriko.role for thing in bpy.data.objects}
        lacks = {role: phrase for role, phrase in lacks.items() if role not in elsewhere}
    return list(lacks.values())


def unsolved(scene: bpy.types.Scene) -> list[str]:
    """The reason why nothing can be done with a source image, where there is none."""
    result = scene.kiriko.result
    if result.source is None:
        return ["There is no source image yet: solve first"]
    return [COARSE] if result.is_coarse else []


def can_run(operator: type[bpy.types.Operator], reasons: list[str]) -> bool:
    """The answer of `poll`: are there no reasons against it?
    The first one is told where the button is grey.
    """
    if reasons:
        operator.poll_message_set(f"{reasons[0]}.")
    return not reasons


def sentence(error: BaseException, label: str, stays: str = "") -> str:
    """The report on an error, foreseen or not, in the work called
    `label`, of which nothing stays but what is named.

    The traceback of one that was not foreseen is in the console, for whoever has to find its cause.
    """
    state = f"{stays} stays (Undo takes it back)" if stays else "the scene is as it was"
    if isinstance(error, KirikoError):
        return f"{error} {state[0].upper()}{state[1:]}." if stays else str(error)
    if isinstance(error, KeyboardInterrupt):
        return f"{label} was stopped; {state}."
    traceback.print_exception(error)
    text = " ".join(str(error).split()).rstrip(".")
    if isinstance(error, MemoryError):
        why = f" ({text})" if text else ""
        return (
            f"{label} needs more memory than there is{why}; {state}:"
            " lower the resolution of display or viewer, or raise the tolerance."
        )
    if isinstance(error, ReferenceError):  # by Blender's Python, of a datablock that is gone
        return (
            f"{label} was stopped, for undo or a script took away what it worked on: start it"
            f" again."
        )
    if isinstance(error, OSError):
        return f"{label} could not read or write a file ({text}); {state}: check the disk."
    return (
        f"{label} failed ({type(error).__name__}: {text}); {state}:"
        " please report this with the file and what the console says."
    )


@contextmanager
def told(operator: bpy.types.Operator, stays: Callable[[], str] = str) -> Iterator[None]:
    """Report whatever goes wrong within, and what stays then,
    as one sentence: no traceback reaches an artist.
    """
    try:
        yield
    except (Exception, KeyboardInterrupt) as error:
        operator.report({"ERROR"}, sentence(error, operator.bl_label, stays()))


def _at_pointer(
    context: bpy.types.Context, steps: Generator[float, None, Result]
) -> Generator[float, None, Result]:
    """Hand on the progress of work, and show it at the mouse
    pointer where there is one: nothing else is drawn.
    """
    if bpy.app.background or context.window is None:
        return (yield from steps)
    manager = context.window_manager
    manager.progress_begin(0, 100)
    try:
        while True:
            progress = next(steps)
            manager.progress_update(round(100 * progress))
            yield progress
    except StopIteration as done:
        return done.value
    finally:
        manager.progress_end()


class LongWork:
    """Mix-in for an operator with long work: stepped with Esc in the interface, drained elsewhere.

    `steps` yields progress 0..1 and returns the sentence to report; before its last step it changes
    nothing but what `stays` names, and that only where somebody watches.
    level : of the report at the end, which `steps` may raise
    """

    level = "INFO"

    @property
    def is_watched(self) -> bool:
        """Is the work stepped in the interface?"""
        return self in _running

    def stays(self) -> str:
        """The thing that would stay if the work were stopped now, as "a thing", '' for nothing."""
        return ""

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        with told(self):
            text = finish(_at_pointer(context, self.steps(context)))
            self.report({self.level}, text)
            return {"FINISHED"}
        return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if bpy.app.background or context.window is None:
            return self.execute(context)
        self._work = self.steps(context)
        self.window = context.window
        manager = context.window_manager
        self._timer = manager.event_timer_add(TICK, window=context.window)
        manager.progress_begin(0, 100)
        self._show(context, 0.0)
        manager.modal_handler_add(self)
        _running.append(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC":
            self.cancel(context)
            stays = self.stays()
            ways = f"{stays} stays: Undo brings back what was there, {self.bl_label} makes it final"
            self.report({"INFO"}, f"Stopped; {ways if stays else 'the scene is as it was'}.")
            # Blender makes an undo step of finished work
            return {"FINISHED"} if stays else {"CANCELLED"}
        if event.type != "TIMER":
            # no other key or button may change the scene meanwhile
            return {"PASS_THROUGH"} if only_looks(context, event) else {"RUNNING_MODAL"}
        end = perf_counter() + TURN
        is_done = False
        with told(self, self.stays):
            try:
                stays = self.stays()
                progress = next(self._work)
                # a new image is drawn at once
                while perf_counter() < end and self.stays() == stays:
                    progress = next(self._work)
                self._show(context, progress)
                return {"PASS_THROUGH"}
            except StopIteration as done:
                self.report({self.level}, done.value)
                is_done = True
        self._end(context)
        return {"FINISHED"} if is_done or self.stays() else {"CANCELLED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Stop; Blender calls this too when it closes or loads another file meanwhile."""
        try:
            self._work.close()
        finally:
            self._end(context)

    def _show(self, context: bpy.types.Context, progress: float) -> None:
        context.window_manager.progress_update(round(100 * progress))
        stays = self.stays()
        stop = f"shown is {stays}, Esc keeps it" if stays else "Esc stops"
        context.workspace.status_text_set(
            f"Kiriko: {self.bl_label} {100 * progress:.0f} %   ({stop})"
        )

    def _end(self, context: bpy.types.Context) -> None:
        _running.remove(self)
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        if context.window is not None:  # it is being closed
            context.workspace.status_text_set(None)
            for area in context.screen.areas:
                area.tag_redraw()
