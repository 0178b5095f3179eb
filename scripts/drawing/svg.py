"""Words, lines and squares of an image, as SVG."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from html import escape
from textwrap import wrap

import numpy as np

from kiriko.core.base.arrays import Floats

# px of the drawing
PANEL_SIDE = 250
PANEL_TOP = 245
LINE_PX = 15
LINE_LETTERS = 42

GREY = "#666666"
FAINT = "#dddddd"


@dataclass(frozen=True, eq=False)
class Panel:
    """A square of the drawing that shows a square of an image.

    Parameters
    ----------
    left : px of the drawing
    low, extent : upper left corner (2,) and side of what is shown, px of the image
    """

    left: float
    low: Floats
    extent: float

    def at(self, points: Floats) -> Floats:
        """Places (n, 2) in the drawing of points (n, 2) of the image."""
        return np.array([self.left, PANEL_TOP]) + (points - self.low) / self.extent * PANEL_SIDE

    def polygon(self, corners: Floats, style: str) -> str:
        return self.polygons([corners], style)

    def polygons(self, polygons: Iterable[Floats], style: str) -> str:
        """Those of some polygons (k, 2) that reach into what is shown, as one path."""
        path = []
        for corners in polygons:
            is_off = (corners.max(axis=0) < self.low) | (
                corners.min(axis=0) > self.low + self.extent
            )
            if not is_off.any():
                places = " ".join(f"{x:.1f},{y:.1f}" for x, y in self.at(corners))
                path.append(f"M{places}z")
        return f'<path d="{"".join(path)}" {style}/>'

    def pixel(self, corner: Floats, style: str) -> str:
        """The borders of a pixel, by its upper left corner."""
        return self.polygon(corner + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]), style)

    def dot(self, point: Floats, radius: float, style: str) -> str:
        ((x, y),) = self.at(np.array([point]))
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius}" {style}/>'

    def label(self, point: Floats, words: str) -> str:
        """Words about a point of the image."""
        ((x, y),) = self.at(np.array([point]))
        return text(x, y + 4, words, NUMBER)

    def grid(self) -> Iterator[str]:
        """The borders of the image's pixels."""
        (x0, y0), end = self.low, self.extent
        for x in range(int(np.ceil(x0)), int(x0 + end) + 1):
            yield line(self.at(np.array([[x, y0], [x, y0 + end]])), FAINT)
        for y in range(int(np.ceil(y0)), int(y0 + end) + 1):
            yield line(self.at(np.array([[x0, y], [x0 + end, y]])), FAINT)

    def drawn(self, title: str, note: str, parts: Iterable[str]) -> Iterator[str]:
        """Its parts as far as they lie within it, a title above and a note below."""
        square = f'x="{self.left}" y="{PANEL_TOP}" width="{PANEL_SIDE}" height="{PANEL_SIDE}"'
        name = f"panel-{self.left}"
        yield text(self.left, PANEL_TOP - 10, title, TITLE)
        yield f'<clipPath id="{name}"><rect {square}/></clipPath>'
        yield f'<g clip-path="url(#{name})">'
        yield from self.grid()
        yield from parts
        yield "</g>"
        yield f'<rect {square} fill="none" stroke="{GREY}"/>'
        for n, words in enumerate(wrap(note, LINE_LETTERS)):
            yield text(self.left, PANEL_TOP + PANEL_SIDE + 18 + LINE_PX * n, words, NOTE)


@dataclass(frozen=True)
class Font:
    """How words are written. anchor : of SVG; size : px."""

    anchor: str = "start"
    size: int = 12
    weight: str = "normal"
    fill: str = "black"


PLAIN = Font()
TITLE = Font(size=13, weight="bold")
NOTE = Font(size=11)
VERB = Font("middle", weight="bold")
NOUN = Font("middle", size=13, weight="bold")
FILE = Font("middle", size=10, fill=GREY)
NUMBER = Font("middle", size=11)


def text(x: float, y: float, words: str, font: Font = PLAIN) -> str:
    """Words, at a place of the drawing."""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{font.anchor}" font-size="{font.size}"'
        f' font-weight="{font.weight}" fill="{font.fill}">{escape(words)}</text>'
    )


def line(ends: Floats, colour: str, more: str = "") -> str:
    """A line between two places (2, 2) of the drawing."""
    (x0, y0), (x1, y1) = ends
    return (
        f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}" stroke="{colour}" {more}/>'
    )
