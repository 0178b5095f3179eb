"""What the operators share: reading the scene, the session, and work that takes its time."""

import traceback
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from time import perf_counter
from typing import Any

import bpy

from ..core import blender_scene
from ..core.errors import KirikoError
from ..core.plan import Settings
from ..core.session import Session, finish

TICK = 0.02  # s between two turns of work in the interface
TURN = 0.1  # s that a turn may take before the interface is drawn again and Esc is heard

_sessions: list[Session] = []
_running: list["LongWork"] = []

NEEDED = {
    "GLASS": "No glass: set an object's role to Glass",
    "PLATE": "No plate: set a plane's role to Plate",
    "DISPLAY": "No display: set a plane's role to Display",
    "PICTURE": "No picture: set a textured plane's role to Picture, or choose an image",
    "VIEWER": "No viewer: choose a camera",
}


def session() -> Session:
    """The one session; it keeps what need not be computed again from click to click."""
    if not _sessions:
        _sessions.append(Session())
    return _sessions[0]


def forget() -> None:
    """Stop what is running, which Blender would drop without a word, and drop the session and what it keeps."""
    for operator in list(_running):
        with bpy.context.temp_override(window=operator.window):
            operator.cancel(bpy.context)
    _sessions.clear()


def is_busy() -> bool:
    """Is one of the operators at work, or a render, so that nothing else may touch session and results?"""
    return bool(_running) or bpy.app.is_job_running("RENDER")


def read(context: bpy.types.Context, kept: blender_scene.Kept | None = None) -> Any:
    """The scene, evaluated as it is now, as blender_scene.Reading."""
    context.view_layer.update()
    return blender_scene.read(context.evaluated_depsgraph_get(), context.scene, kept)


def settings_of(scene: bpy.types.Scene) -> Settings:
    """How the scene wants to be solved."""
    ours = scene.kiriko
    return Settings(
        tolerance=ours.tolerance,
        max_events=ours.max_events,
        only_through_glass=ours.only_through_glass,
        brightness=ours.brightness,
        margin=ours.margin,
    )


def parts(scene: bpy.types.Scene) -> dict[str, list[bpy.types.Object]]:
    """Objects of the scene by role, those in instanced collections too."""
    found: dict[str, list[bpy.types.Object]] = {}
    seen = set()
    todo = list(scene.objects)
    while todo:
        thing = todo.pop()
        if thing in seen:
            continue
        seen.add(thing)
        if thing.kiriko.role != "NONE":
            found.setdefault(thing.kiriko.role, []).append(thing)
        if thing.instance_collection is not None:
            todo.extend(thing.instance_collection.all_objects)
    return found


def missing(scene: bpy.types.Scene) -> list[str]:
    """One phrase for each part that the rig still lacks."""
    found = set(parts(scene))
    if scene.kiriko.viewer or scene.camera:
        found.add("VIEWER")
    if scene.kiriko.picture_source == "IMAGE" and scene.kiriko.picture_image:
        found.add("PICTURE")
    return [phrase for part, phrase in NEEDED.items() if part not in found]


def lacking(scene: bpy.types.Scene) -> list[str]:
    """Of what is missing, what no object in the whole file can be: modifiers may instance what is not in the scene."""
    roles = {thing.kiriko.role for thing in bpy.data.objects}
    return [phrase for phrase in missing(scene) if not any(NEEDED[r] == phrase for r in roles if r in NEEDED)]


def unsolved(scene: bpy.types.Scene) -> list[str]:
    """The reason why nothing can be done with a source image, where there is none."""
    result = scene.kiriko.result
    if result.source is None:
        return ["There is no source image yet: solve first"]
    return ["The source image is a coarse one of Live: let it finish, or solve"] if result.is_coarse else []


def can_run(operator: type[bpy.types.Operator], reasons: list[str]) -> bool:
    """What `poll` returns: are there no reasons against it? The first one is told where the button is grey."""
    if reasons:
        operator.poll_message_set(f"{reasons[0]}.")
    return not reasons


def sentence(error: BaseException, label: str) -> str:
    """What to tell of an error, foreseen or not, in the work called `label`, which has changed nothing yet.

    The traceback of one that was not foreseen is in the console, for whoever has to find its cause.
    """
    if isinstance(error, KirikoError):
        return str(error)
    if isinstance(error, KeyboardInterrupt):
        return f"{label} was stopped; the scene is as it was."
    traceback.print_exception(error)
    text = " ".join(str(error).split()).rstrip(".")
    if isinstance(error, MemoryError):
        why = f" ({text})" if text else ""
        return (
            f"{label} needs more memory than there is{why}; the scene is as it was:"
            " lower the resolution of display or viewer, or raise the tolerance."
        )
    if isinstance(error, ReferenceError):  # what Blender's Python says of a datablock that is gone
        return f"{label} was stopped, for undo or a script took away what it worked on: start it again."
    if isinstance(error, OSError):
        return f"{label} could not read or write a file ({text}); the scene is as it was: check the disk."
    return (
        f"{label} failed ({type(error).__name__}: {text}); the scene is as it was:"
        " please report this with the file and what the console says."
    )


@contextmanager
def told(operator: bpy.types.Operator) -> Iterator[None]:
    """Report whatever goes wrong within as one sentence: no traceback reaches an artist."""
    try:
        yield
    except (Exception, KeyboardInterrupt) as error:
        operator.report({"ERROR"}, sentence(error, operator.bl_label))


class LongWork:
    """Mix-in for an operator whose work is a generator: stepped with Esc in the interface, drained elsewhere.

    `steps` yields progress 0..1 and returns the sentence to report; it changes nothing before its last step.
    """

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        with told(self):
            self.report({"INFO"}, finish(self.steps(context)))
            return {"FINISHED"}
        return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if bpy.app.background or context.window is None:
            return self.execute(context)
        self._work, self.window = self.steps(context), context.window
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
            self.report({"INFO"}, "Stopped; the scene is as it was.")
            return {"CANCELLED"}
        if event.type != "TIMER":
            # no other key or button may change what is being worked on
            return {"PASS_THROUGH"} if event.type in {"MOUSEMOVE", "WINDOW_DEACTIVATE"} else {"RUNNING_MODAL"}
        end = perf_counter() + TURN
        outcome = {"CANCELLED"}
        with told(self):
            try:
                progress = next(self._work)
                while perf_counter() < end:
                    progress = next(self._work)
                self._show(context, progress)
                return {"PASS_THROUGH"}
            except StopIteration as done:
                self.report({"INFO"}, done.value)
                outcome = {"FINISHED"}
        self._end(context)
        return outcome

    def cancel(self, context: bpy.types.Context) -> None:
        """Stop; Blender calls this too when it closes or loads another file meanwhile."""
        try:
            self._work.close()
        finally:
            self._end(context)

    def _show(self, context: bpy.types.Context, progress: float) -> None:
        context.window_manager.progress_update(round(100 * progress))
        context.workspace.status_text_set(f"Kiriko: {self.bl_label} {100 * progress:.0f} %   (Esc stops)")

    def _end(self, context: bpy.types.Context) -> None:
        _running.remove(self)
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        if context.window is not None:  # it is being closed
            context.workspace.status_text_set(None)
            for area in context.screen.areas:
                area.tag_redraw()
