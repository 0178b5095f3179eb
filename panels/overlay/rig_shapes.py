"""Lines and labels of a drawing, grouped by style, as plain arrays in Blender units."""

from typing import NamedTuple

import numpy as np

from ...core.base.arrays import Floats
from ...core.bench.sketch import Sketch
from ...operators.sketcher import SketchDrawing
from . import colours

N_DASHES = 16  # along each edge of the display's mid-air image
BEYOND = 1.06  # length of extension lines, in distances to the dimension line


class Strokes(NamedTuple):
    """Lines of one style: ends (n, 2, 3), colour and alpha, width in px."""

    ends: Floats
    colour: tuple[float, float, float]
    alpha: float
    width: float


class Label(NamedTuple):
    """A label at a place (3,): a text, or a length in m."""

    place: Floats
    text: str
    length: float | None
    colour: tuple[float, float, float]


class Mark(NamedTuple):
    """The end (3,) of a light path: a dot if the light arrives, a cross if it is lost."""

    place: Floats
    has_arrived: bool


def strokes_of(drawing: SketchDrawing) -> list[Strokes]:
    """All lines, in drawing order."""
    sketch = drawing.sketch
    aerial, picture, lost, arrives = (
        _segments(sketch, state) for state in ("aerial", "picture", "lost", "arrives")
    )
    dimensions = _dimension_lines(sketch)
    found = [
        Strokes(sketch.light.hatch, colours.LOST, colours.HATCH_ALPHA, colours.HATCH_PX),
        Strokes(dimensions, colours.DIMENSION, 1.0, colours.DIMENSION_PX),
        Strokes(_dashed(aerial), colours.AERIAL, 1.0, colours.OUTLINE_PX),
        Strokes(picture, colours.AERIAL, 1.0, colours.OUTLINE_PX),
        Strokes(lost, colours.LOST, 1.0, colours.WAY_PX),
        Strokes(arrives, colours.ARRIVES, 1.0, colours.WAY_PX),
    ]
    return [s._replace(ends=s.ends / drawing.metres) for s in found if len(s.ends)]


def contour_strokes(drawing: SketchDrawing) -> list[Strokes]:
    """The outline of the glass."""
    if not len(drawing.contours):
        return []
    ends = drawing.contours / drawing.metres
    return [Strokes(ends, colours.CONTOUR, colours.CONTOUR_ALPHA, colours.OUTLINE_PX)]


def labels_of(drawing: SketchDrawing) -> list[Label]:
    """All labels, the most important first."""
    sketch = drawing.sketch
    found = [
        Label(note.place, note.text, None, colours.OF_STATE[note.state]) for note in sketch.notes
    ]
    found += [
        Label((d.start + d.end) / 2 + d.offset, "", d.length, colours.DIMENSION)
        for d in sketch.dimensions
    ]
    return [label._replace(place=label.place / drawing.metres) for label in found]


def marks_of(drawing: SketchDrawing) -> list[Mark]:
    """The ends of the light paths."""
    ways = drawing.sketch.light.ways
    return [Mark(way.points[-1] / drawing.metres, way.has_arrived) for way in ways]


def arrows_of(drawing: SketchDrawing) -> Floats:
    """The dimension lines (n, 2, 3) with arrowheads."""
    lines = [(d.start + d.offset, d.end + d.offset) for d in drawing.sketch.dimensions]
    return np.array(lines).reshape(-1, 2, 3) / drawing.metres


def _segments(sketch: Sketch, state: str) -> Floats:
    """The straight pieces (n, 2, 3) of the lines of a state."""
    pieces = [
        np.stack([line.points[:-1], line.points[1:]], axis=1)
        for line in sketch.lines
        if line.state == state
    ]
    return np.concatenate([np.empty((0, 2, 3)), *pieces])


def _dashed(ends: Floats) -> Floats:
    """Dashes (m, 2, 3) along lines (n, 2, 3), one at each end."""
    at = np.arange(2 * N_DASHES - 1) / (2 * N_DASHES - 1)
    pairs = np.stack([at, at + at[1]], axis=1)[::2]
    start, end = ends[:, None, None, 0], ends[:, None, None, 1]
    return (start + pairs[..., None] * (end - start)).reshape(-1, 2, 3)


def _dimension_lines(sketch: Sketch) -> Floats:
    """Dimension lines and their extension lines (n, 2, 3)."""
    lines = []
    for d in sketch.dimensions:
        lines.append((d.start + d.offset, d.end + d.offset))
        lines += [(at, at + BEYOND * d.offset) for at in (d.start, d.end)]
    return np.array(lines).reshape(-1, 2, 3)
