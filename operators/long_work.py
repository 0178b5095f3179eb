"""Long work of operators: stepped with Esc in the interface, run to the end elsewhere.

Blender asks modal operators before its keymaps, so an operator that passes an event on does not
know its effect. The user's keymaps are therefore looked up here: an event passes if it only changes
the view.
"""

import re
import sys
from collections.abc import Generator
from time import perf_counter
from typing import TypeVar

import bpy

from ..core.base.messages import Message, as_message
from ..core.base.steps import run_steps
from ..core.blender.data.rigs import active_rig
from . import live, needed, work
from .reporting import errors_reported, in_words, report
from .windows import redraw_sidebars

VIEWS = re.compile(
    r"view3d\.(rotate|move|zoom|dolly|smoothview|ndof_\w+"
    r"|view_(all|axis|camera|center_camera|center_lock|center_pick|orbit|pan|persportho|roll|selected))"
    r"|view2d\.\w+|image\.view_\w+"
)
# Keymaps of the main region of an editor; left and right button also belong to gizmos and editing.
KEYMAPS = {
    "VIEW_3D": (
        "3D View",
        "3D View Generic",
        "Object Mode",
        "Object Non-modal",
        "Frames",
        "Screen",
        "Window",
    ),
    "IMAGE_EDITOR": ("Image", "Image Generic", "Frames", "Screen", "Window"),
}
POINTING = ("MIDDLEMOUSE", "WHEEL", "TRACKPAD", "MOUSEROTATE", "MOUSESMARTZOOM", "NDOF_MOTION")
KEYS = ("NUMPAD_", "HOME", "NDOF_BUTTON_")
SCROLLING = ("WHEEL", "TRACKPADPAN")
# timers animate smooth view changes
ALWAYS = ("MOUSEMOVE", "INBETWEEN_MOUSEMOVE", "WINDOW_DEACTIVATE", "TIMER")


def only_looks(context: bpy.types.Context, event: bpy.types.Event) -> bool:
    """Whether an event, anywhere in the window, changes at most the view of the scene."""
    if event.type.startswith(ALWAYS):
        return True

    area, region = under_mouse(context.window, event)
    if region is None:
        return False

    if region.type != "WINDOW" or area.type not in KEYMAPS:
        # with a modifier a wheel changes the number under the pointer
        is_plain = not (event.ctrl or event.alt or event.shift or event.oskey)
        return event.type.startswith(SCROLLING) and is_plain

    if not event.type.startswith(POINTING + KEYS):
        return False
    if area.type == "VIEW_3D" and area.spaces.active.lock_camera:
        return False  # the camera moves with the view

    found = meant(context.window_manager, KEYMAPS[area.type], event)
    if "view3d.view_camera" in found and context.scene.camera is None:
        return False  # Blender would choose one

    return all(map(VIEWS.fullmatch, found)) and (bool(found) or event.type.startswith(POINTING))


def under_mouse(
    window: bpy.types.Window, event: bpy.types.Event
) -> tuple[bpy.types.Area | None, bpy.types.Region | None]:
    """Area and region that receive an event of this window.

    Regions may overlap the main one.
    """
    x, y = event.mouse_x, event.mouse_y
    for area in window.screen.areas:
        within = [r for r in area.regions if 0 <= x - r.x < r.width and 0 <= y - r.y < r.height]
        if within:
            return area, min(within, key=lambda region: region.type == "WINDOW")
    return None, None


def meant(
    manager: bpy.types.WindowManager, names: tuple[str, ...], event: bpy.types.Event
) -> set[str]:
    """Operators that the given user keymaps bind to an event."""
    keymaps = (manager.keyconfigs.user.keymaps.get(name) for name in names)
    items = (keymap.keymap_items.match_event(event) for keymap in keymaps if keymap is not None)
    return {item.idname for item in items if item is not None}


Result = TypeVar("Result")

TICK = 0.02  # s between turns of work in the interface
SILENT = 5.0  # s between lines of progress on the terminal
TURN = 0.1  # s of a turn before the interface redraws and Esc is heard


def _on_terminal(
    label: str, steps: Generator[float, None, Result]
) -> Generator[float, None, Result]:
    """Pass on the progress of work, and print it every few seconds."""
    last = perf_counter()
    while True:
        try:
            progress = next(steps)
        except StopIteration as done:
            return done.value
        if perf_counter() >= last + SILENT:
            sys.stdout.write(f"Kiriko: {label} {100 * progress:.0f} %\n")
            sys.stdout.flush()
            last = perf_counter()
        yield progress


def _at_pointer(
    context: bpy.types.Context, label: str, steps: Generator[float, None, Result]
) -> Generator[float, None, Result]:
    """Pass on the progress of work, and show it at the mouse pointer, or on the terminal without
    window.
    """
    if not has_window(context):
        return (yield from _on_terminal(label, steps))

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


def has_window(context: bpy.types.Context) -> bool:
    """Whether there is a window for dialogues and steps."""
    return not bpy.app.background and context.window is not None


class LongWork:
    """Mix-in for an operator with long work: stepped with Esc in the interface, drained elsewhere.

    `steps` yields progress 0..1 and returns the report. Before its last step it changes only what
    `stays` names, and only in the interface.

    level : of the report, which `steps` may raise
    progress : 0 to 1, shown in the first panel
    """

    level = "INFO"
    progress = 0.0

    @property
    def is_watched(self) -> bool:
        """Whether the work is stepped in the interface."""
        return self in work._running

    def stays(self) -> str:
        """What would remain if the work stopped now, as "the thing"; '' for nothing."""
        return ""

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        with errors_reported(self):
            self._begin(context)
            text = run_steps(_at_pointer(context, self.bl_label, self.steps(context)))
            report(self, self.level, text)
            return {"FINISHED"}
        return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not has_window(context):
            return self.execute(context)
        if work._running:  # in another window; its own window hears no other button
            report(self, "WARNING", Message("{reason}.", reason=needed.AT_WORK))
            return {"CANCELLED"}

        self._begin(context)
        self._work = self.steps(context)
        self._rig = active_rig(context.scene)
        self.window = context.window
        manager = context.window_manager
        self._timer = manager.event_timer_add(TICK, window=context.window)
        manager.progress_begin(0, 100)
        self._show(context, 0.0)
        manager.modal_handler_add(self)
        work._running.append(self)

        return {"RUNNING_MODAL"}

    def _begin(self, context: bpy.types.Context) -> None:
        """Make undo of this work return to what Live has written."""
        if "UNDO" in self.bl_options:
            live.push_undo(context.scene)

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC":
            self.cancel(context)
            return self._stopped()

        if event.type != "TIMER":
            # No other key or button may change the scene in the meantime.
            return {"PASS_THROUGH"} if only_looks(context, event) else {"RUNNING_MODAL"}

        end = perf_counter() + TURN
        is_done = False

        with errors_reported(self, self.stays):
            try:
                if self._rig is not None:
                    self._rig.name  # noqa: B018 - raises if undo has replaced the scene
                stays = self.stays()
                progress = next(self._work)
                # draw a new image at once
                while perf_counter() < end and self.stays() == stays:
                    progress = next(self._work)
                self._show(context, progress)
                return {"PASS_THROUGH"}
            except StopIteration as done:
                report(self, self.level, done.value)
                is_done = True

        self._end(context)
        return {"FINISHED"} if is_done or self.stays() else {"CANCELLED"}

    def _stopped(self) -> set[str]:
        """Report a stop by Esc, and what was kept."""
        stays = self.stays()
        if not stays:
            report(self, "INFO", Message("Stopped. The scene is unchanged."))
            return {"CANCELLED"}

        report(
            self,
            "INFO",
            Message(
                "Stopped; {thing} was kept. Undo to restore the previous image, or press {button}"
                " to finish.",
                thing=stays,
                button=as_message(self.bl_label),
            ),
        )
        # Blender pushes an undo step for finished work.
        return {"FINISHED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Stop.

        Blender also calls this when it closes, loads another file, or a dialogue is dismissed
        before any work.
        """
        if not self.is_watched:
            return
        try:
            self._work.close()
        finally:
            self._end(context)

    def _show(self, context: bpy.types.Context, progress: float) -> None:
        context.window_manager.progress_update(round(100 * progress))
        if round(100 * progress) != round(100 * self.progress) or not progress:
            redraw_sidebars()
        self.progress = progress
        stays = self.stays()
        stop = Message("Esc keeps {thing}", thing=stays) if stays else Message("Esc stops")
        text = Message(
            "{button} {percent:.0f} % ({stop})",
            button=as_message(self.bl_label),
            percent=100 * progress,
            stop=stop,
        )
        context.workspace.status_text_set(in_words(text))

    def _end(self, context: bpy.types.Context) -> None:
        work._running.remove(self)
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        if context.window is not None:  # the window is being closed
            context.workspace.status_text_set(None)
            for area in context.screen.areas:
                area.tag_redraw()
