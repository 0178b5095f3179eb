"""A sheet of paper as SVG in its own millimetres, which prints to scale."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ...base.arrays import Floats
from ...base.drawn_words import in_xml

Paper = Literal["A4", "A3"]
SIZES = {"A4": (297.0, 210.0), "A3": (420.0, 297.0)}  # mm, lying
MARGIN = 10.0  # mm, which printers leave white
FONT = "Helvetica, Arial, sans-serif"
TEXT = 2.8  # mm, height of letters

Anchor = Literal["start", "middle", "end"]


@dataclass(frozen=True)
class Pen:
    """How lines are drawn: colour, width in mm, dashes in mm."""

    colour: str = "black"
    width: float = 0.25
    dashes: str = ""


PART = Pen()
GLASS = Pen("#0b6e99", 0.18)
PICTURE = Pen("#7a3f9d", 0.25, "2 1")
THIN = Pen("#777777", 0.1)
SIGHT = Pen("#c8501e", 0.18, "4 1 0.5 1")


@dataclass
class Sheet:
    """Lines and texts on a sheet, mm from its upper left corner, y down."""

    paper: Paper
    parts: list[str] = field(default_factory=list)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, mm."""
        return SIZES[self.paper]

    def lines(self, ends: ArrayLike, pen: Pen) -> None:
        """Draw straight lines (n, 2, 2)."""
        ends = np.asarray(ends, float)
        ways = " ".join(
            f"M{a:.2f} {b:.2f}L{c:.2f} {d:.2f}" for a, b, c, d in ends.reshape(-1, 4).tolist()
        )
        if ways:
            dashes = f' stroke-dasharray="{pen.dashes}"' if pen.dashes else ""
            self.parts.append(
                f'<path d="{ways}" fill="none" stroke="{pen.colour}" stroke-width="{pen.width}"'
                f' stroke-linecap="round"{dashes}/>'
            )

    def dots(self, places: ArrayLike, radius: float) -> None:
        """Draw discs at places (n, 2)."""
        self.parts += [
            f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{radius}" fill="black"/>'
            for x, y in np.asarray(places, float).tolist()
        ]

    def text(
        self, place: Sequence[float], words: str, anchor: Anchor = "start", size: float = TEXT
    ) -> None:
        """Write words whose baseline begins, has its middle or ends at a place."""
        x, y = place
        self.parts.append(
            f'<text x="{x:.2f}" y="{y:.2f}" text-anchor="{anchor}" font-size="{size}">'
            f"{in_xml(words)}</text>"
        )

    def turned_text(self, place: Sequence[float], words: str, size: float = TEXT) -> None:
        """Write words that run upward and end below a place."""
        x, y = place
        self.parts.append(
            f'<text transform="translate({x:.2f} {y:.2f}) rotate(-90)" text-anchor="end"'
            f' font-size="{size}">{in_xml(words)}</text>'
        )

    def table(
        self,
        place: Sequence[float],
        widths: Sequence[float],
        rows: Sequence[Sequence[str]],
        room: float = np.inf,
    ) -> float:
        """Write rows of cells, the first as a heading; y below the last.

        Letters get smaller where the rows would be higher than the room.
        """
        left, y = place
        starts = left + np.cumsum([0.0, *widths])
        size = min(TEXT, (room / (len(rows) + 0.25)) / 1.6)

        for n, row in enumerate(rows):
            y += 1.6 * size
            for x, cell in zip(starts[:-1], row, strict=True):
                self.text((x, y), cell, size=size)
            if n == 0:
                under = y + 0.4 * size
                self.lines(np.array([[[left, under], [starts[-1], under]]]), THIN)
                y = under
        return y

    def svg(self) -> str:
        """The file's text."""
        width, height = self.size
        return "\n".join(
            [
                f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}mm" height="{height:g}mm"'
                f' viewBox="0 0 {width:g} {height:g}" font-family="{FONT}">',
                f'<rect width="{width:g}" height="{height:g}" fill="white"/>',
                *self.parts,
                "</svg>",
                "",
            ]
        )


def decimal(number: float) -> str:
    """A number with one decimal, and no minus at 0."""
    return f"{round(float(number), 1) + 0.0:.1f}"


def spread(places: Sequence[float], gap: float) -> Floats:
    """Places (n,) of labels, at least a gap apart, in the same order and as near as may be to
    where they belong: least squares, by merging neighbours that push each other.
    """
    order = np.argsort(places, kind="stable")
    wished = np.asarray(places, float)[order] - gap * np.arange(len(order))
    groups: list[list[float]] = []  # mean and number of each

    for at in wished:
        groups.append([at, 1])
        while len(groups) > 1 and groups[-2][0] > groups[-1][0]:
            mean, n = groups.pop()
            other, m = groups.pop()
            groups.append([(mean * n + other * m) / (n + m), n + m])

    found = np.empty(len(order))
    found[order] = np.concatenate([np.full(int(n), mean) for mean, n in groups] or [[]])
    found[order] += gap * np.arange(len(order))
    return found
