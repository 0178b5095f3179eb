"""The steps of a play: all actions of a hand in the window, and the pictures.

A play is a list of steps. `player.py` plays them inside Blender, by events in the window's own
queue. No step has a place in pixels: to find a button, the mouse moves over a region until Blender
reports the wanted button under it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass


def does(operator: str, value: str = "") -> str:
    """Pattern of a button that runs an operator, with a value among its properties."""
    return rf"^bpy\.ops\.{re.escape(operator)}\(.*{re.escape(value)}"


@dataclass(frozen=True)
class Press:
    """Click the button whose Python command, or whose property's path, matches `button`."""

    button: str
    area: str = "VIEW_3D"
    region: str = "UI"
    up: float = 0  # rows above the matching button: Blender reports no menu under the mouse


@dataclass(frozen=True)
class Measure:
    """Note the upper edges of buttons of the sidebar, px, in a state of this name."""

    state: str
    buttons: tuple[str, ...]


@dataclass(frozen=True)
class Tab:
    """Click a tab of the sidebar of the 3D viewport."""

    name: str


@dataclass(frozen=True)
class Unfold:
    """Open a panel of Kiriko, and close all others: Ctrl and a click on its header."""

    panel: str


@dataclass(frozen=True)
class Key:
    """Press a key over the middle of an area, or where the mouse is."""

    key: str
    area: str = "VIEW_3D"
    modifiers: tuple[str, ...] = ()
    stays: bool = False  # the mouse stays where it is


@dataclass(frozen=True)
class Choose:
    """Choose an item of the open menu of an operator's property."""

    operator: str
    item: str


@dataclass(frozen=True)
class Open:
    """Click a file in the file browser, in the folder of pictures."""

    name: str


@dataclass(frozen=True)
class Until:
    """Wait until a question of `scenes.py` is answered with yes."""

    question: str
    seconds: float = 120.0


@dataclass(frozen=True)
class Still:
    """Wait until the window has not changed for a time: Cycles, which refines its image, has then
    ended.
    """

    seconds: float
    at_most: float = 400.0


@dataclass(frozen=True)
class Do:
    """A function of `scenes.py`, for changes no hand makes: preparing a scene, removing a file."""

    function: str
    name: str = ""  # its argument, if it has one


@dataclass(frozen=True)
class Shot:
    """A picture of a part of the window, with a mark around the button `at`.

    of, region : region of an area, such as the sidebar `UI`; without a region the whole area; `*`
        is the whole window
    panel : panel of the sidebar that the picture is cropped to, after `Unfold` of it
    near : height above and below the mark that the picture is cropped to, px; 0 for all
    """

    name: str
    of: str = "VIEW_3D"
    region: str = ""
    at: str = ""
    at_area: str = "VIEW_3D"
    at_region: str = "UI"
    stays: bool = False  # the mouse, which would close an open menu when it went away
    panel: str = ""
    near: int = 0


Step = Press | Measure | Tab | Unfold | Key | Choose | Open | Until | Still | Do | Shot
