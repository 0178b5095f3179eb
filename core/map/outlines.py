"""Areas and moments of cells in each pixel, by a walk around their outlines.

In each row of pixels every edge adds to the pixels it passes the area on its left, and to the
pixels further left its height in full. Edges going up take away as much as edges going down have
added, so the sum over the closed outline is the area inside, pixel by pixel, and no polygon is ever
clipped: moment = sum over edges of x^(k+1) / (k+1) y^m dy, Green's theorem. Font rasterisers sum
areas so, accumulated along rows. Clipping, in fractions, is the way that tests compare with.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, Ints
from .cells import LEVEL

NOWHERE = 1e300  # px, for edges that do not reach a row


def ragged(counts: Ints) -> tuple[Ints, Ints]:
    """Owner and place within the owner of each member of
    ragged groups: [2, 3] gives [0 0 1 1 1], [0 1 0 1 2].
    """
    owner = np.repeat(np.arange(len(counts)), counts)
    starts = np.cumsum(counts) - counts
    return owner, np.arange(len(owner)) - starts[owner]


def slopes_of(x: Floats, y: Floats) -> Floats:
    """dx/dy of each edge; a level edge has no area beside it, so any number will do."""
    dx = np.roll(x, -1, axis=0) - x
    dy = np.roll(y, -1, axis=0) - y
    return dx / np.where(np.abs(dy) < LEVEL, 1.0, dy)


class Moments(NamedTuple):
    """Signed areas (n,) of parts of cells, and their moments of x, y, x^2, x y and y^2, px."""

    area: Floats
    x: Floats
    y: Floats
    xx: Floats
    xy: Floats
    yy: Floats


class Pieces(NamedTuple):
    """Parts of edges that lie in one pixel, all (p,): the pixel,
    and both ends in 0..1 from its upper left corner.
    """

    pixel: Ints
    xa: Floats
    ya: Floats
    xb: Floats
    yb: Floats


def walk(outline: Floats, row: Ints) -> tuple[Ints, Ints, Pieces]:
    """Cut outlines at the grid lines of their rows.

    Returns the first column and the number of columns that each row of a cell enters, and
    the pieces of the edges, their pixels counted through all these rows.
    """
    last_column = outline[-1]
    ends = _ends(outline, row)

    # the columns that the row enters
    low = np.minimum(ends.xa, ends.xb)
    high = np.maximum(ends.xa, ends.xb)
    is_there = ends.ya != ends.yb
    away = NOWHERE * ~is_there
    first = np.clip(np.floor((low + away).min(axis=0)), 0, last_column)
    last = np.clip(np.ceil((high - away).max(axis=0)) - 1, first, last_column)
    widths = (last - first).astype(np.int64) + 1
    starts = np.cumsum(widths) - widths

    # and those that each edge passes, one piece in each:
    # left of the window (column -1) counts as on its border; an
    # edge further right than the row adds nothing to it
    begin = np.clip(np.floor(low), -1, last_column + 1)
    end = np.clip(np.floor(high), -1, last)
    of_edge, step = ragged((is_there * np.maximum(end - begin + 1, 0)).astype(np.int64).ravel())

    def of_piece(values: NDArray) -> NDArray:
        return np.take(values.ravel(), of_edge)

    # each edge from the left border of a piece's pixel
    slope_y = (ends.yb - ends.ya) / (ends.xb - ends.xa + (ends.xa == ends.xb))
    edges = Pieces(
        pixel=of_piece((starts - first + begin).astype(np.int64)) + step,
        xa=of_piece(ends.xa - begin) - step,
        ya=of_piece(ends.ya),
        xb=of_piece(ends.xb - begin) - step,
        yb=of_piece(ends.yb),
    )
    is_left = (
        np.flatnonzero((of_piece(begin) < 0) & (step == 0)) if begin.min(initial=0) < 0 else ()
    )
    return first.astype(np.int64), widths, _cut(edges, of_piece(slope_y), is_left)


class _Ends(NamedTuple):
    """Ends of edges (k, r) within rows of pixels, from the window's left border and the row's
    upper one.
    """

    xa: Floats
    ya: Floats
    xb: Floats
    yb: Floats


def _ends(outline: Floats, row: Ints) -> _Ends:
    """The ends of edges within their rows."""
    # corners from the upper border of the row
    k = len(outline) // 3
    x = outline[:k]
    y = outline[k : 2 * k] - row
    slope = outline[2 * k : -1]

    inside = np.clip(y, 0, 1)
    off = inside - y
    following = [*range(1, k), 0]

    # x is rounded to steps of 2^-51 at the least, so that distances to
    # a grid line are exact, also just left of 0
    xa = (x + off * slope + 4) - 4
    xb = (x[following] + off[following] * slope + 4) - 4
    return _Ends(xa, inside, xb, inside[following])


def _cut(edges: Pieces, slope_y: Floats, is_left: Ints | tuple[()]) -> Pieces:
    """Edges (p,), of slopes dy/dx, cut at the left and right borders of their pixels.

    Those that are left of the window count as on its border.
    """
    pixel, xa, ya, xb, yb = edges
    ua = np.clip(xa, 0, 1)
    ub = np.clip(xb, 0, 1)
    if len(is_left):
        ua[is_left], ub[is_left] = np.minimum(xa[is_left], 1), np.minimum(xb[is_left], 1)

    ya = ya + (ua - xa) * slope_y
    yb = yb + (ub - xb) * slope_y

    if len(is_left):
        ua[is_left] = ub[is_left] = 0
        pixel[is_left] += 1

    return Pieces(pixel, ua, ya, ub, yb)


def sums(widths: Ints, pieces: Pieces) -> Moments:
    """Signed area (n,) of the cell in each pixel of its rows,
    and its moments of x, y, x^2, x y and y^2.

    These count from the pixel's upper left corner. Green's theorem: each is a sum of x^(k+1) /
    (k+1) y^m dy over the outline. Edges in the pixel count with their own x, those further left
    with 0, those further right with 1. As dy sums to 0 along a row, and y^m dy too, the last make
    up minus the cover: the sum up to and with the pixel.
    """
    n = int(widths.sum())
    pixel, xa, ya, xb, yb = pieces

    # symmetric sums of both ends
    dy = yb - ya
    xs = xa + xb
    ys = ya + yb
    xx = xa * xa + xb * xb
    xy = xa * ya + xb * yb
    yy = ya * ya + yb * yb
    total = xs * ys

    def of_pixel(values: Floats) -> Floats:
        return np.bincount(pixel, values, n)

    # of edges further left
    cover = _along_rows(of_pixel(dy), widths)
    cover_y = _along_rows(of_pixel(dy * ys * 0.5), widths)
    cover_yy = _along_rows(of_pixel(dy * (ys * ys + yy) * (1 / 6)), widths)

    return Moments(
        area=of_pixel(dy * xs * 0.5) - cover,
        x=of_pixel(dy * (xs * xs + xx) * (1 / 12)) - 0.5 * cover,
        y=of_pixel(dy * (total + xy) * (1 / 6)) - cover_y,
        xx=of_pixel(dy * xs * xx * (1 / 12)) - (1 / 3) * cover,
        xy=of_pixel(dy * (xx * ys + 2 * xs * xy) * (1 / 24)) - 0.5 * cover_y,
        yy=of_pixel(dy * (xs * yy + 2 * ys * xy) * (1 / 12)) - cover_yy,
    )


def _along_rows(values: Floats, widths: Ints) -> Floats:
    """Cumulative sums within each row."""
    sums = np.cumsum(values)
    before = np.concatenate([[0.0], sums[np.cumsum(widths)[:-1] - 1]])
    return sums - np.repeat(before, widths)
