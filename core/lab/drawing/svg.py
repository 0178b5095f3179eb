"""SVG drawings: sheets of paper to scale in mm, and diagrams of curves in px."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from math import ceil, floor, log10
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ...base.arrays import Floats


def in_xml(words: str) -> str:
    """Escaped text, with a blank for each unprintable character: names in Blender may contain
    any.
    """
    return escape("".join(letter if letter.isprintable() else " " for letter in words))


def document(size: tuple[float, float], style: str, parts: Sequence[str], unit: str = "px") -> str:
    """An SVG file with a white background; `style` has attributes for all parts."""
    width, height = (f"{side:g}" for side in size)
    of = "" if unit == "px" else unit
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}{of}" height="{height}{of}"'
        f' viewBox="0 0 {width} {height}" {style}>',
        f'<rect width="{width}" height="{height}" fill="white"/>',
        *parts,
        "</svg>",
        "",
    ])  # fmt: skip


Paper = Literal["A4", "A3"]
SIZES = {"A4": (297.0, 210.0), "A3": (420.0, 297.0)}  # mm, landscape
MARGIN = 10.0  # mm, not printable
FONT = "Helvetica, Arial, sans-serif"
TEXT = 2.8  # mm, height of letters

Anchor = Literal["start", "middle", "end"]


@dataclass(frozen=True)
class Pen:
    """Line style: colour, width in mm, dashes in mm."""

    colour: str = "black"
    width: float = 0.25
    dashes: str = ""


PART = Pen()
GLASS = Pen("#0b6e99", 0.18)
PICTURE = Pen("#7a3f9d", 0.25, "2 1")
THIN = Pen("#777777", 0.1)
SIGHT = Pen("#c8501e", 0.18, "4 1 0.5 1")


@dataclass
class PaperSheet:
    """Lines and texts on a sheet, in mm from its upper left corner, y down."""

    paper: Paper
    parts: list[str] = field(default_factory=list)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, mm."""
        return SIZES[self.paper]

    def lines(self, ends: ArrayLike, pen: Pen) -> None:
        """Draw straight lines (n, 2, 2)."""
        ends = np.asarray(ends, float)
        path = " ".join(
            f"M{a:.2f} {b:.2f}L{c:.2f} {d:.2f}" for a, b, c, d in ends.reshape(-1, 4).tolist()
        )
        if path:
            dashes = f' stroke-dasharray="{pen.dashes}"' if pen.dashes else ""
            self.parts.append(
                f'<path d="{path}" fill="none" stroke="{pen.colour}" stroke-width="{pen.width}"'
                f' stroke-linecap="round"{dashes}/>'
            )

    def dots(self, places: ArrayLike, radius: float) -> None:
        """Draw discs at positions (n, 2)."""
        self.parts += [
            f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{radius}" fill="black"/>'
            for x, y in np.asarray(places, float).tolist()
        ]

    def text(
        self, place: Sequence[float], words: str, anchor: Anchor = "start", size: float = TEXT
    ) -> None:
        """Write a text with the start, middle or end of its baseline at a position."""
        x, y = place
        self.parts.append(
            f'<text x="{x:.2f}" y="{y:.2f}" text-anchor="{anchor}" font-size="{size}">'
            f"{in_xml(words)}</text>"
        )

    def turned_text(self, place: Sequence[float], words: str, size: float = TEXT) -> None:
        """Write an upward text that ends at a position."""
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
        """Write rows of cells, the first as a heading; returns y of the end.

        If the rows are higher than `room`, letters are smaller.
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
        """The SVG file."""
        width, height = self.size
        return document((width, height), f'font-family="{FONT}"', self.parts, "mm")


def decimal(number: float) -> str:
    """A number with one decimal, never -0.0."""
    return f"{round(float(number), 1) + 0.0:.1f}"


def spread(places: Sequence[float], gap: float) -> Floats:
    """Positions (n,) of labels in the same order, at least `gap` apart and as near as possible to
    `places` in the least-squares sense. Neighbours that push each other are merged into groups.
    """
    order = np.argsort(places, kind="stable")
    wished = np.asarray(places, float)[order] - gap * np.arange(len(order))
    groups: list[list[float]] = []  # mean and size of each

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


# px
WIDTH = 760
HEIGHT = 520
# margins around the axes, px
LEFT = 90
RIGHT = 30
TOP = 56
BOTTOM = 64
SHRUNK = 0.6  # scale of a diagram on a sheet of several
MOST_WRITTEN_OUT = 3  # largest exponent of ten, positive or negative, written out
LABEL = (48, 11)  # px; a label nearer to another label of its curve is omitted
# distinguishable for colour-blind people, and by their marks
COLOURS = ("#0b6e99", "#c8501e", "#3f7d20", "#7a3f9d")


@dataclass(frozen=True)
class Curve:
    """Points (x, y) with optional labels; positive on logarithmic axes."""

    name: str
    points: tuple[tuple[float, float], ...]
    labels: tuple[str, ...] = ()


@dataclass(frozen=True)
class Axis:
    """An axis of a diagram.

    label : with its unit
    ticks : values and their texts, from one end of the axis to the other
    """

    label: str
    ticks: tuple[tuple[float, str], ...]
    is_log: bool = False

    def part(self, value: float) -> float:
        """Position of a value along the axis, 0..1."""
        first, last, value = (
            log10(x) if self.is_log else x for x in (self.ticks[0][0], self.ticks[-1][0], value)
        )
        return (value - first) / (last - first)


def log_log(
    title: str, x_label: str, y_label: str, curves: Sequence[Curve], notes: Sequence[str] = ()
) -> str:
    """Draw curves on logarithmic axes with ticks at powers of ten.

    notes : lines below the title
    """
    x, y = ([point[k] for curve in curves for point in curve.points] for k in (0, 1))
    return draw(title, curves, _decades(x_label, x), _decades(y_label, y), notes)


def linear(
    title: str,
    x_label: str,
    y_label: str,
    curves: Sequence[Curve],
    notes: Sequence[str] = (),
    is_rising: bool = False,
) -> str:
    """Draw curves on linear axes from 0; parameters as in `log_log` and `draw`."""
    x, y = ([point[k] for curve in curves for point in curve.points] for k in (0, 1))
    return draw(title, curves, from_zero(x_label, x), from_zero(y_label, y), notes, is_rising)


def draw(
    title: str,
    curves: Sequence[Curve],
    x_axis: Axis,
    y_axis: Axis,
    notes: Sequence[str] = (),
    is_rising: bool = False,
) -> str:
    """Draw curves.

    notes : lines below the title
    is_rising : puts the legend at the upper left instead of the upper right
    """
    top = TOP + 16 * len(notes)

    def place(x: float, y: float) -> tuple[float, float]:
        across = x_axis.part(x)
        up = y_axis.part(y)
        return LEFT + across * (WIDTH - LEFT - RIGHT), HEIGHT - BOTTOM - up * (
            HEIGHT - BOTTOM - top
        )

    (left, right), (bottom, above) = (
        (axis.ticks[0][0], axis.ticks[-1][0]) for axis in (x_axis, y_axis)
    )
    low = place(left, bottom)
    high = place(right, above)

    parts = [
        text_at((LEFT, 28), title, size=16),
        *(text_at((LEFT, 48 + 16 * n), note, fill="#555555") for n, note in enumerate(notes)),
    ]

    for value, text in x_axis.ticks:
        x, _ = place(value, bottom)
        parts += [
            _line(x, low[1], x, high[1]),
            text_at((x, low[1] + 18), text, "middle", css="x tick"),
        ]

    for value, text in y_axis.ticks:
        _, y = place(left, value)
        parts += [
            _line(low[0], y, high[0], y),
            text_at((LEFT - 8, y + 4), text, "end", css="y tick"),
        ]

    middle = (low[1] + high[1]) / 2
    parts += [
        f'<rect x="{low[0]:.2f}" y="{high[1]:.2f}" width="{high[0] - low[0]:.2f}"'
        f' height="{low[1] - high[1]:.2f}"'
        ' fill="none" stroke="black"/>',
        text_at(((low[0] + high[0]) / 2, HEIGHT - 18), x_axis.label, "middle", size=14),
        f'<g transform="translate(24 {middle:.2f})'
        f' rotate(-90)">{text_at((0, 0), y_axis.label, "middle", size=14)}</g>',
    ]

    for n, curve in enumerate(curves):
        parts += _drawn(curve, n, [place(*point) for point in curve.points])

    side, sign = (low[0], 1) if is_rising else (high[0], -1)
    parts.append(_legend(curves, side + 12 * sign, high[1] + 20, sign))
    return document((WIDTH, HEIGHT), f'font-family="{FONT}" font-size="12"', parts)


def sheet(columns: Sequence[Sequence[str]]) -> str:
    """One drawing of several diagrams; a column lists its diagrams from the top."""
    width, height = WIDTH * len(columns), HEIGHT * max(map(len, columns))
    parts = [
        diagram.replace("<svg ", f'<svg x="{x * WIDTH}" y="{y * HEIGHT}" ', 1).rstrip()
        for x, column in enumerate(columns)
        for y, diagram in enumerate(column)
    ]
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{SHRUNK * width:g}"'
        f' height="{SHRUNK * height:g}" viewBox="0 0 {width} {height}">',
        *parts,
        "</svg>",
        "",
    ])  # fmt: skip


def points_mm(
    metres: Sequence[float], values: Sequence[float | None]
) -> tuple[tuple[float, float], ...]:
    """Points of a curve over a distance, mm, without None values."""
    there = zip(metres, values, strict=True)
    return tuple((1e3 * x, y) for x, y in there if y is not None)


def _decades(label: str, values: Sequence[float]) -> Axis:
    """An axis of powers of ten around all values, at least one decade long."""
    low, high = (floor(log10(min(values))), ceil(log10(max(values)))) if values else (0, 1)
    powers = range(low, max(high, low + 1) + 1)
    return Axis(label, tuple((10.0**k, _power(k)) for k in powers), is_log=True)


def from_zero(label: str, values: Sequence[float]) -> Axis:
    """An axis from 0 to a round number above the largest value, with five to eleven ticks."""
    most = max(values, default=1.0) or 1.0
    power = 10.0 ** floor(log10(most))
    step = next(
        power * part for part in (0.1, 0.2, 0.5, 1.0, 2.0) if most <= 10 * power * part * (1 + 1e-9)
    )
    n_steps = ceil(most / step - 1e-9)
    return Axis(label, tuple((step * k, f"{step * k:.4g}") for k in range(n_steps + 1)))


def _power(k: int) -> str:
    return f"{10.0**k:.{max(-k, 0)}f}" if abs(k) <= MOST_WRITTEN_OUT else f"1e{k}"


def _drawn(curve: Curve, n: int, at: Sequence[tuple[float, float]]) -> list[str]:
    colour = COLOURS[n % len(COLOURS)]
    line = " ".join(f"{x:.2f},{y:.2f}" for x, y in at)
    parts = [f'<g class="curve" fill="{colour}">', f"<title>{in_xml(curve.name)}</title>"]
    parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="1.5"/>')

    written: list[tuple[float, float]] = []
    for (x, y), label in zip(at, curve.labels, strict=bool(curve.labels)):
        parts.append(_mark(n, x, y))
        if all(abs(x - a) > LABEL[0] or abs(y - b) > LABEL[1] for a, b in written):
            is_last = x > WIDTH - RIGHT - LABEL[0]
            at_x, anchor = (x - 7, "end") if is_last else (x + 7, "start")
            parts.append(
                text_at((at_x, y + (14 if n % 2 else -5)), label, anchor, size=10, fill=colour)
            )
            written.append((x, y))

    return [*parts, "</g>"]


def _mark(n: int, x: float, y: float) -> str:
    if n % 2 == 0:
        return f'<circle cx="{x:.2f}" cy="{y:.2f}" r="4"/>'
    return f'<rect class="mark" x="{x - 3.5:.2f}" y="{y - 3.5:.2f}" width="7" height="7"/>'


def _legend(curves: Sequence[Curve], x: float, top: float, sign: int) -> str:
    """Names of curves from x to the right with a sign of 1, to the left with -1."""
    anchor = "start" if sign > 0 else "end"
    parts = []
    for n, curve in enumerate(curves):
        y = top + 18 * n
        parts += [
            _mark(n, x + 4 * sign, y - 4),
            text_at((x + 16 * sign, y), curve.name, anchor, fill="black"),
        ]
        parts[-2] = parts[-2].replace("/>", f' fill="{COLOURS[n % len(COLOURS)]}"/>')

    return "\n".join(['<g class="legend">', *parts, "</g>"])


def _line(x0: float, y0: float, x1: float, y1: float) -> str:
    return f'<line x1="{x0:.2f}" y1="{y0:.2f}" x2="{x1:.2f}" y2="{y1:.2f}" stroke="#dddddd"/>'


def text_at(
    at: tuple[float, float],
    text: str,
    anchor: str = "start",
    size: int = 12,
    fill: str = "black",
    css: str = "",
) -> str:
    """A line of text, px; `anchor` says if x is its start, middle or end, and y is its baseline."""
    x, y = at
    kind = f' class="{css}"' if css else ""
    return (
        f'<text{kind} x="{x:.2f}" y="{y:.2f}" text-anchor="{anchor}" font-size="{size}"'
        f' fill="{fill}">'
        f"{in_xml(text)}</text>"
    )
