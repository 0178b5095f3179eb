"""Long work of operators: stepped with Esc in the interface, drained elsewhere."""

import sys
from collections.abc import Generator
from time import perf_counter
from typing import TypeVar

import bpy

from ..core.base.messages import Message, as_message
from ..core.base.steps import finish
from . import live, needed, work
from .looking import only_looks
from .telling import in_words, report, told

Result = TypeVar("Result")

TICK = 0.02  # s between two turns of work in the interface
SILENT = 5.0  # s between two lines of progress on the terminal
TURN = 0.1  # s that a turn may take before the interface is drawn again and Esc is heard


def _on_terminal(
    label: str, steps: Generator[float, None, Result]
) -> Generator[float, None, Result]:
    """Hand on the progress of work, and print it every few seconds."""
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
    """Hand on the progress of work, and show it at the mouse pointer, since nothing else is drawn,
    or on the terminal if there is no window.
    """
    if bpy.app.background or context.window is None:
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
        return self in work._running

    def stays(self) -> str:
        """The thing that would stay if the work were stopped now, as "a thing", '' for nothing."""
        return ""

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        with told(self):
            self._begin(context)
            text = finish(_at_pointer(context, self.bl_label, self.steps(context)))
            report(self, self.level, text)
            return {"FINISHED"}
        return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if bpy.app.background or context.window is None:
            return self.execute(context)
        if work._running:  # in another window: in its own no other button is heard
            report(self, "WARNING", Message("{reason}.", reason=needed.AT_WORK))
            return {"CANCELLED"}

        self._begin(context)
        self._work = self.steps(context)
        self.window = context.window
        manager = context.window_manager
        self._timer = manager.event_timer_add(TICK, window=context.window)
        manager.progress_begin(0, 100)
        self._show(context, 0.0)
        manager.modal_handler_add(self)
        work._running.append(self)

        return {"RUNNING_MODAL"}

    def _begin(self, context: bpy.types.Context) -> None:
        """Have undo of this work return to what Live has written."""
        if "UNDO" in self.bl_options:
            live.push_undo(context.scene)

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC":
            self.cancel(context)
            return self._stopped()

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
                report(self, self.level, done.value)
                is_done = True

        self._end(context)
        return {"FINISHED"} if is_done or self.stays() else {"CANCELLED"}

    def _stopped(self) -> set[str]:
        """Report a stop by Esc, and the thing that stays all the same."""
        stays = self.stays()
        if not stays:
            report(self, "INFO", Message("Stopped; the scene is as it was."))
            return {"CANCELLED"}

        report(
            self,
            "INFO",
            Message(
                "Stopped; {thing} stays: Undo brings back what was there, {button} makes it final.",
                thing=stays,
                button=as_message(self.bl_label),
            ),
        )
        # Blender makes an undo step of finished work
        return {"FINISHED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Stop; Blender calls this too when it closes or loads another file meanwhile, and where a
        dialogue is left before any work.
        """
        if not self.is_watched:
            return
        try:
            self._work.close()
        finally:
            self._end(context)

    def _show(self, context: bpy.types.Context, progress: float) -> None:
        context.window_manager.progress_update(round(100 * progress))
        stays = self.stays()
        stop = (
            Message("shown is {thing}, Esc keeps it", thing=stays)
            if stays
            else Message("Esc stops")
        )
        text = Message(
            "Kiriko: {button} {percent:.0f} %   ({stop})",
            button=as_message(self.bl_label),
            percent=100 * progress,
            stop=stop,
        )
        context.workspace.status_text_set(in_words(text))

    def _end(self, context: bpy.types.Context) -> None:
        work._running.remove(self)
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        if context.window is not None:  # it is being closed
            context.workspace.status_text_set(None)
            for area in context.screen.areas:
                area.tag_redraw()
