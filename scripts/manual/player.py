"""Plays steps in the real Blender: moves the mouse, clicks, types, and takes pictures.

Runs inside a Blender started with `--enable-event-simulate`. Each event enters the window's own
queue, and Blender handles it like a real one. A timer drives a play, which is a generator, since
Blender handles events and draws only between two calls of a timer.
"""

from __future__ import annotations

import json
import os
import re
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy

from manual import scenes
from manual.grab import SHOT, glance, grab, look
from manual.steps import (
    Choose,
    Do,
    Key,
    Measure,
    Open,
    Press,
    Shot,
    Step,
    Still,
    Tab,
    Unfold,
    Until,
)

STEP = 11  # px between two places at which the mouse asks for a button; buttons are 20 px high
# of a region's width: whole rows, icons at their ends, thirds; the file browser's last button
COLUMNS = {"UI": (0.45, 0.84, 0.2), "EXECUTE": (0.93,)}
MOMENT = 0.04  # s in which Blender handles an event
BREATH = 0.5  # s in which it draws
PAGE = 8  # turns of the wheel to scroll a sidebar in search of a button
PAGES = 10  # a third of them down, and then up, beyond the place where the search began
EDGE = 16  # px at a region's lower end, where a click would size it
TITLE = 0.2  # of a region's width: a panel's title, left of the rig's name
HEADER = 28  # px from one closed panel to the next
ROW = 25  # px from a row of a panel to the one above, with the space between two groups
OPENED = 10_000  # pixels of a window changed by a menu; a button under the mouse changes fewer
PATIENCE = 60  # breaths in which a busy Blender opens something


class StuckError(Exception):
    """An impossible step, in one sentence."""


class Player:
    """A hand in the first window, and its account of clicks and keys."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.clicks: list[str] = []
        self.keys: list[str] = []
        self.sent: Counter[str] = Counter()  # presses sent to the window's queue
        self.searches: Counter[str] = Counter()  # presses sent only to search for a place
        self.places: dict[str, dict[str, int]] = {}  # px, by state and button
        self.scrolls = 0
        self.seconds = 0.0  # spent waiting for Kiriko
        self.x = self.y = 100

    # Where things are

    @property
    def window(self) -> bpy.types.Window:
        return bpy.context.window_manager.windows[0]

    def area(self, kind: str) -> bpy.types.Area:
        """The largest area of a kind."""
        found = [area for area in self.window.screen.areas if area.type == kind]
        if not found:
            raise StuckError(f"The window has no area {kind}.")
        return max(found, key=lambda area: area.width * area.height)

    def region(self, area: str, kind: str) -> bpy.types.Region:
        """A region of an area."""
        found = [region for region in self.area(area).regions if region.type == kind]
        if not found or found[0].width < 2:
            raise StuckError(f"The area {area} shows no region {kind}.")
        return found[0]

    def under_mouse(self, area: str, region: str) -> str:
        """The Python command or the property path of the button under the mouse."""
        manager = bpy.context.window_manager
        before = manager.clipboard
        with bpy.context.temp_override(
            window=self.window,
            screen=self.window.screen,
            area=self.area(area),
            region=self.region(area, region),
        ):
            shown = bpy.context.property
            if shown is not None:
                return f"{shown[0].name}.{shown[1]}"
            if not bpy.ops.ui.copy_python_command_button.poll():
                return ""
            manager.clipboard = ""
            bpy.ops.ui.copy_python_command_button()
            command = manager.clipboard
            manager.clipboard = before
        return command

    # actions of the hand

    def move(self, x: float, y: float) -> Iterator[float]:
        self.x, self.y = int(x), int(y)
        self.window.event_simulate("MOUSEMOVE", "NOTHING", x=self.x, y=self.y)
        yield MOMENT

    @contextmanager
    def searching(self) -> Iterator[None]:
        """Presses inside this context only search, and do not count for the task."""
        before = self.sent.copy()
        try:
            yield
        finally:
            self.searches += self.sent - before

    @property
    def n_clicks(self) -> int:
        """Clicks sent for the task. A menu item chosen by the key Return counts as one, since a
        mouse would click it.
        """
        made = self.sent - self.searches
        return made["LEFTMOUSE"] + made["RET"]

    def event(self, kind: str, **more: object) -> None:
        """Press and let go of a key or a button of the mouse, where the mouse is."""
        self.sent[kind] += 1
        for value in ("PRESS", "RELEASE"):
            self.window.event_simulate(kind, value, x=self.x, y=self.y, **more)
            more.pop("unicode", None)

    def find(self, button: str, area: str, region: str) -> Iterator[float]:
        """Move the mouse onto a button, scrolling where it is not in sight."""
        yield from self.appear(area)
        yield from self.move(2, 2)  # or the button under it would be taken for the first one
        yield BREATH
        for page in range(PAGES):
            where = self.region(area, region)
            for column in COLUMNS[region]:
                for y in range(where.y + where.height - STEP, where.y + EDGE, -STEP):
                    yield from self.move(where.x + column * where.width, y)
                    if re.search(button, self.under_mouse(area, region)):
                        yield 3 * MOMENT  # it may be the button before: events wait for a redraw
                        if not re.search(button, self.under_mouse(area, region)):
                            continue
                        # one step on is nearer to the middle, where it is still the same button
                        yield from self.move(self.x, y - STEP / 2)
                        yield 3 * MOMENT
                        if not re.search(button, self.under_mouse(area, region)):
                            yield from self.move(self.x, y)
                        return
            yield from self.move(where.x + where.width / 2, where.y + where.height / 2)
            for _ in range(PAGE):
                self.event("WHEELDOWNMOUSE" if page < PAGES // 3 else "WHEELUPMOUSE")
                yield MOMENT
            self.scrolls += 1
        raise StuckError(f"No button {button} is in {region} of {area}.")

    def press(self, step: Press) -> Iterator[float]:
        yield from self.find(step.button, step.area, step.region)
        while scenes.kiriko("operators.look_over").have_moved(self.window.scene):
            yield BREATH
        self.clicks.append(plain(step.button))
        if step.up:
            yield from self.move(self.x, self.y + step.up * ROW)
            yield from self.open_menu()
            return
        self.event("LEFTMOUSE")
        yield BREATH

    def measure(self, step: Measure) -> Iterator[float]:
        """Go up from each button until the mouse has left it."""
        found = self.places[step.state] = {}
        for button in step.buttons:
            yield from self.find(button, "VIEW_3D", "UI")
            while re.search(button, self.under_mouse("VIEW_3D", "UI")):
                yield from self.move(self.x, self.y + 1)
                yield 2 * MOMENT
            found[plain(button)] = self.y

    def open_menu(self) -> Iterator[float]:
        """Click, and wait until a menu is visible: earlier keys would be lost."""
        yield 2 * BREATH
        path = self.folder / SHOT
        before = look(self.window, path)
        self.event("LEFTMOUSE")
        for _ in range(PATIENCE):
            yield BREATH
            if (look(self.window, path) != before).any(axis=2).sum() > OPENED:
                return
        raise StuckError("A click opened no menu.")

    def tab(self, step: Tab) -> Iterator[float]:
        """Click the tabs from the top down until the wanted one is open, then the first one, and
        the wanted one once more: only the last click counts. Blender does not report the positions
        of tabs.
        """
        region = self.region("VIEW_3D", "UI")
        is_open = lambda: region.active_panel_category == step.name  # noqa: E731
        if is_open():
            return
        places = [
            (region.x + region.width - 10, y)
            for y in range(region.y + region.height - 20, region.y, -20)
        ]
        with self.searching():
            yield from self.try_places(places, is_open)
            found = self.x, self.y
            if not is_open():
                raise StuckError(f"The sidebar has no tab {step.name}.")
            yield from self.try_places(places, lambda: not is_open())
        self.clicks.append(f"tab {step.name}")
        yield from self.move(*found)
        self.event("LEFTMOUSE")
        yield BREATH
        if not is_open():
            raise StuckError(f"One click did not open the tab {step.name}.")

    def try_places(
        self, places: list[tuple[float, float]], is_right: Callable[[], bool]
    ) -> Iterator[float]:
        """Click places, one after the other, until one was the right one."""
        for place in places:
            yield from self.move(*place)
            self.event("LEFTMOUSE")
            yield 3 * MOMENT
            if is_right():
                return

    def unfold(self, step: Unfold) -> Iterator[float]:
        """Close all panels, so their headers form a row, and open the wanted one."""
        region = self.region("VIEW_3D", "UI")
        header = HEADER * bpy.context.preferences.view.ui_scale
        x, top = region.x + TITLE * region.width, region.y + region.height - header / 2
        yield from self.move(x, top)
        for _ in range(PAGES * PAGE):
            self.event("WHEELUPMOUSE")
        yield BREATH
        for is_alone in (True, False):  # all others are closed, then this one
            yield from self.move(x, top)
            yield BREATH
            with self.searching():
                self.event("LEFTMOUSE", ctrl=is_alone)
            yield 4 * BREATH  # panels glide

        place = scenes.panels().index(step.panel)
        yield from self.move(x, top - place * header)
        yield BREATH
        self.clicks.append(step.panel)
        self.event("LEFTMOUSE", ctrl=True)
        yield 4 * BREATH

    def key(self, step: Key) -> Iterator[float]:
        if not step.stays:
            region = self.region(step.area, "WINDOW")
            yield from self.move(region.x + region.width / 2, region.y + region.height / 2)
        self.keys.append("+".join((*step.modifiers, step.key)))
        self.event(step.key, **dict.fromkeys(step.modifiers, True))
        yield BREATH

    def choose(self, step: Choose) -> Iterator[float]:
        """Go down by the keys: Blender does not report the positions of menu items."""
        group, verb = step.operator.split(".")
        kind = getattr(getattr(bpy.ops, group), verb).get_rna_type()
        items = [item.name for item in kind.properties["preset"].enum_items]
        self.clicks.append(step.item)
        for key in ("HOME", *("DOWN_ARROW",) * items.index(step.item), "RET"):
            self.event(key)
            yield MOMENT
        yield BREATH

    def appear(self, kind: str) -> Iterator[float]:
        """Wait until the window has an area: a busy Blender opens its file browser late."""
        for _ in range(PATIENCE):
            if any(area.type == kind for area in self.window.screen.areas):
                return
            yield BREATH

    def open(self, step: Open) -> Iterator[float]:
        """Click the files from the first on until the wanted one is chosen."""
        yield from self.appear("FILE_BROWSER")
        yield 3 * BREATH
        params = self.area("FILE_BROWSER").spaces.active.params
        params.directory = os.fsencode(f"{scenes.pictures()}{os.sep}")
        params.display_type = "LIST_VERTICAL"
        yield 3 * BREATH
        region = self.region("FILE_BROWSER", "WINDOW")
        is_chosen = lambda: params.filename == step.name  # noqa: E731
        places = [
            (region.x + 80, y) for y in range(region.y + region.height - 12, region.y, -2 * STEP)
        ]
        with self.searching():
            yield from self.try_places(places, is_chosen)
        if not is_chosen():
            raise StuckError(f"The file browser does not show {step.name}.")
        params.filename = ""
        yield BREATH  # or it would be a double click
        self.clicks.append(step.name)
        self.event("LEFTMOUSE")
        yield BREATH
        if not is_chosen():
            raise StuckError(f"One click did not choose {step.name}.")

    def until(self, step: Until) -> Iterator[float]:
        began = time.monotonic()
        question = getattr(scenes, step.question)
        while not question():
            if time.monotonic() - began > step.seconds:
                raise StuckError(f"{step.seconds:g} s were not enough: {step.question}.")
            yield 0.2
        self.seconds += time.monotonic() - began
        yield BREATH

    def still(self, step: Still) -> Iterator[float]:
        """Wait until nothing in the window has changed for some seconds."""
        began = since = time.monotonic()
        path = self.folder / SHOT
        shown = glance(self.window, path)
        while time.monotonic() - since < step.seconds:
            if time.monotonic() - began > step.at_most:
                raise StuckError(f"{step.at_most:g} s were not enough: the window still changes.")
            yield 4 * BREATH
            now = glance(self.window, path)
            if now != shown:
                shown, since = now, time.monotonic()

    def shot(self, step: Shot) -> Iterator[float]:
        """Take a picture, and write the wanted part and the position of the ring next to it."""
        ring = None
        if step.at:
            yield from self.find(step.at, step.at_area, step.at_region)
            yield from self.to_middle(step)
            ring = [self.x, self.y]
        elif not step.stays:
            yield from self.move(2, 2)
        yield BREATH
        path = self.folder / f"{step.name}.rgb"
        size = grab(self.window, path)
        told = {"size": size, "box": self.box(step, ring), "ring": ring}
        told["sidebar"] = step.region == "UI" and not step.near
        if step.panel:  # all panels but this one are closed
            shown = scenes.panels()
            place = shown.index(step.panel)
            told["closed"] = [place * HEADER, (len(shown) - 1 - place) * HEADER]
        path.with_suffix(".json").write_text(json.dumps(told), encoding="utf-8")
        print(f"picture {step.name}", flush=True)

    def to_middle(self, step: Shot) -> Iterator[float]:
        """Move the mouse to the middle of the button that it is over."""
        edges, start = [], self.y
        for up in (1, -1):
            yield from self.move(self.x, start)
            yield 2 * MOMENT
            while re.search(step.at, self.under_mouse(step.at_area, step.at_region)):
                yield from self.move(self.x, self.y + up)
                yield 2 * MOMENT
            edges.append(self.y)
        yield from self.move(self.x, sum(edges) / 2)

    def box(self, step: Shot, ring: list[int] | None) -> list[float]:
        """Left, bottom, width and height of the wanted part of the window, px."""
        if step.of == "*":
            return [0, 0, self.window.width, self.window.height]
        part = self.region(step.of, step.region) if step.region else self.area(step.of)
        left, bottom, width, height = part.x, part.y, part.width, part.height
        if step.of == "VIEW_3D" and step.region == "WINDOW":  # the sidebar stands in front of it
            width = self.region("VIEW_3D", "UI").x - left
        if step.near and ring is not None:
            top = min(ring[1] + step.near, bottom + height)
            bottom = max(ring[1] - step.near, bottom)
            height = top - bottom
        return [left, bottom, width, height]

    def play(self, steps: list[Step]) -> Iterator[float]:
        """All steps of a play, one after the other."""
        of_kind = {
            Press: self.press, Measure: self.measure, Tab: self.tab, Unfold: self.unfold,
            Key: self.key, Choose: self.choose, Open: self.open, Until: self.until,
            Still: self.still, Shot: self.shot,
        }  # fmt: skip
        for step in steps:
            if isinstance(step, Do):
                getattr(scenes, step.function)(*filter(None, [step.name]))
                yield BREATH
            else:
                yield from of_kind[type(step)](step)


def plain(button: str) -> str:
    """The pattern of a button, to be read."""
    name, _, value = button.removeprefix(r"^bpy\.ops\.").replace("\\", "").partition("(.*")
    return f"{name} {value}".strip()


def drive(play: Iterator[float], at_end: Callable[[BaseException | None], None]) -> None:
    """Have a timer take a play from step to step."""

    def go_on() -> float | None:
        try:
            return next(play)
        except StopIteration:
            at_end(None)
        except BaseException as error:  # whatever it is, Blender has to be closed
            at_end(error)
        return None

    bpy.app.timers.register(go_on, first_interval=1.0, persistent=True)
