"""A hand in Blender's window, with a camera on it.

Frames are taken between steps, as soon as the window is drawn. Their time in the film does not
depend on the time of the work.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from manual.grab import grab
from manual.player import BREATH, MOMENT, Player

RATE = 15.0  # frames a second while the mouse moves


class Recorder(Player):
    """A player with a camera.

    scene : number of the current scene of the film
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.frames: list[dict[str, object]] = []
        self.scene = 0
        self.is_pressed = False
        self._n_taken = 0

    def take(self, seconds: float) -> Iterator[float]:
        """Take a frame as soon as Blender has drawn, and show it for some seconds."""
        yield BREATH
        name = f"{self._n_taken:04d}.rgb"
        self._n_taken += 1
        size = grab(self.window, self.folder / name)
        self.frames.append(
            {
                "file": name,
                "size": size,
                "scene": self.scene,
                "seconds": seconds,
                "mouse": (self.x, size[1] - self.y),
                "is_pressed": self.is_pressed,
            }
        )

    def thin_out(self, first: int, n: int) -> None:
        """Keep only n frames, evenly, from the first of a part on."""
        part = self.frames[first:]
        if len(part) > n:
            self.frames[first:] = [part[k * len(part) // n] for k in range(n)]

    def glide(self, x: float, y: float, n: int) -> Iterator[float]:
        """Move the mouse to a place within n frames."""
        start = self.x, self.y
        for k in range(1, n + 1):
            t = k / n
            t = t * t * (3 - 2 * t)
            yield from self.move(start[0] + t * (x - start[0]), start[1] + t * (y - start[1]))
            yield from self.take(1 / RATE)

    def click(self, button: str, n: int) -> Iterator[float]:
        """Move to a button of the sidebar within n frames, and press it."""
        start = self.x, self.y
        yield from self.find(button, "VIEW_3D", "UI")
        place = self.x, self.y
        yield from self.move(*start)
        yield from self.glide(*place, n)
        self.is_pressed = True
        yield from self.take(0.2)
        self.is_pressed = False
        self.event("LEFTMOUSE")
        yield MOMENT

    def drag(self, places: list[tuple[float, float, int]]) -> Iterator[float]:
        """Press where the mouse is, and drag to places, each within its number of frames."""
        self.window.event_simulate("LEFTMOUSE", "PRESS", x=self.x, y=self.y)
        yield MOMENT
        self.is_pressed = True
        for x, y, n in places:
            yield from self.glide(x, y, n)
        self.is_pressed = False
        self.window.event_simulate("LEFTMOUSE", "RELEASE", x=self.x, y=self.y)
        yield MOMENT

    def write(self) -> None:
        """Write the list of frames next to them."""
        (self.folder / "frames.json").write_text(json.dumps(self.frames), encoding="utf-8")
