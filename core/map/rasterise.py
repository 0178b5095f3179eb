"""Division of cells among display pixels: area in each pixel, and place on the viewer's image.

A walk around the outline of a cell's image gives the area of the cell in each pixel, with its first
and second moments, hence its centroid and extent. The inverse of the cell's map takes these to the
viewer's image.

In each row of pixels every edge adds the area on its left to the pixels it passes, and its height
in full to the pixels further left. Edges going up subtract as much as edges going down add: the sum
over the closed outline is the area inside, pixel by pixel, and no polygon is clipped. moment = sum
over edges of x^(k+1) / (k+1) y^m dy, Green's theorem. Font rasterisers accumulate areas along rows
in the same way. The tests compare with clipping, in fractions.

Areas on the display are exact up to rounding, 1e-12 px^2 or better for cells of moderate size.
Areas on the viewer's image are divided in proportion to them: exact for triangles and
parallelograms, right to first order in the cell's size otherwise. The part of a cell beyond the
display is left out. A cell squeezed to a line or point gives its whole area to the pixels it lies
in.

A quad's image is bilinear in (s, t), both in -1/2..1/2: p = centre + s a + t b + s t c. With (s0,
t0) the solution for c = 0, the product k = s t solves the quadratic equation k = (s0 - k cx) (t0 -
k cy). The root with k = s0 t0 for c = 0 is the one within the quad.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, Ints
from ..base.products import turn_covariance
from . import native_divide
from .cells import (
    FARTHEST,
    INSIDE,
    LEVEL,
    SMALLEST,
    THINNEST,
    Cells,
    centroid,
    corner_bounds,
    covariance_of,
    is_unfolded,
    signed_area,
    split_xy,
    thickened,
    unfolded,
)
from .native_divide import Divided, index_type

SHARES_AT_ONCE = 1 << 18  # in a batch; smaller ones are joined
POLYGONS_AT_ONCE = 1 << 15  # arrays of a step stay in the processor's cache
PARTS_AT_ONCE = 1 << 16  # pixels of cells, for the same reason


def divided(
    display_size: tuple[int, int], lots: Sequence[tuple[Floats, Floats]], is_numbered: bool
) -> Iterator[tuple[int, Divided]]:
    """Shares of lots of cells, a few at a time, with the number of the lot, and of each share's
    cell if requested.

    Lots are polygons (n, k, 2) on the viewer's image and on the display. The kernel's other threads
    start with this call, before the first shares are requested.
    """
    if all(native_divide.can_divide(*lot) for lot in lots):
        return native_divide.divided(display_size, lots, SHARES_AT_ONCE, is_numbered)
    return ((n, part) for n, lot in enumerate(lots) for part in parts_by_rows(display_size, *lot))


class Bilinear(NamedTuple):
    """Coefficients (c,) of a map from (s, t), both in -1/2..1/2, to quads."""

    constant: Floats
    s: Floats
    t: Floats
    st: Floats


def cell_from_display(x: Floats, y: Floats, total: Floats) -> Floats:
    """Coefficients (8, c) from a point on the display to (s, t) in the cell.

    A triangle is p = corner + s a + t b, a quad as in the head of this file. Six coefficients
    invert the part without c, two are c in that frame.
    """
    if len(x) == 3:
        px = x[0]
        py = y[0]
        ax = x[1] - x[0]
        ay = y[1] - y[0]
        bx = x[2] - x[0]
        by = y[2] - y[0]
        cx = cy = np.zeros_like(px)
        det = 2 * total
    else:
        px, ax, bx, cx = _bilinear(x)
        py, ay, by, cy = _bilinear(y)
        det = total

    # the inverse of the linear part
    s_x = by / det
    s_y = -bx / det
    t_x = -ay / det
    t_y = ax / det

    return np.stack([
        *(s_x, s_y, -(s_x * px + s_y * py)),
        *(t_x, t_y, -(t_x * px + t_y * py)),
        *(s_x * cx + s_y * cy, t_x * cx + t_y * cy),
    ])  # fmt: skip


def view_from_cell(u: Floats, v: Floats) -> Floats:
    """Coefficients (8, c) of the viewer's u and v: constant, s, t and s t."""
    if len(u) == 3:
        zero = np.zeros_like(u[0])
        return np.stack([
            *(u[0], u[1] - u[0], u[2] - u[0], zero),
            *(v[0], v[1] - v[0], v[2] - v[0], zero),
        ])  # fmt: skip
    return np.stack([*_bilinear(u), *_bilinear(v)])


def _bilinear(x: Floats) -> Bilinear:
    """Bilinear map to quads (4, c)."""
    return Bilinear(
        0.25 * (x[0] + x[1] + x[2] + x[3]),
        0.5 * (x[1] + x[2] - x[0] - x[3]),
        0.5 * (x[2] + x[3] - x[0] - x[1]),
        x[0] - x[1] + x[2] - x[3],
    )


def on_view(
    inverse: Floats, forward: Floats, x: Floats, y: Floats, is_triangle: bool
) -> tuple[Floats, Floats]:
    """Viewer's u, v of points x, y on the display, clamped to the cell: rounding must not move
    slivers out of it.
    """
    s_x, s_y, s_1, t_x, t_y, t_1, cx, cy = inverse
    s = s_x * x + s_y * y + s_1
    t = t_x * x + t_y * y + t_1

    if is_triangle:
        s = np.clip(s, INSIDE, 1 - 2 * INSIDE)
        t = np.clip(t, INSIDE, 1 - INSIDE - s)
    else:
        linear = 1 + s * cy + t * cx
        root = np.sqrt(np.maximum(linear * linear - 4 * cx * cy * s * t, 0))
        k = 2 * s * t / np.maximum(linear + root, THINNEST)
        s, t = (np.clip(number, INSIDE - 0.5, 0.5 - INSIDE) for number in (s - k * cx, t - k * cy))

    k = s * t
    u0, us, ut, uk, v0, vs, vt, vk = forward
    return u0 + s * us + t * ut + k * uk, v0 + s * vs + t * vt + k * vk


def spread_on_view(
    inverse: Floats, forward: Floats, xx: Floats, xy: Floats, yy: Floats
) -> NDArray[np.float32]:
    """Covariance (3, n) on the viewer's image from the one on the display, as if cells were
    parallelograms.

    It is limited to values possible within the cell, because rounding spoils slivers.
    """
    s_x, s_y, _, t_x, t_y, *_ = inverse
    _, us, ut, _, _, vs, vt, _ = forward
    ss, st, tt = turn_covariance((xx, xy, yy), s_x, s_y, t_x, t_y)

    ss = np.clip(ss, 0, 0.25)
    tt = np.clip(tt, 0, 0.25)
    most = np.sqrt(ss * tt)
    in_cell = ss, np.clip(st, -most, most), tt

    return turn_covariance(in_cell, us, ut, vs, vt).astype(np.float32)


class _Part(NamedTuple):
    """Shares in the making, all (n,) except the covariance (3, n)."""

    number: Ints
    pixel: Ints
    u: Floats
    v: Floats
    covariance: NDArray[np.float32]
    area: Floats
    display_area: Floats


def parts_by_rows(
    display_size: tuple[int, int], view_polygons: Floats, display_polygons: Floats
) -> Iterator[Divided]:
    """Shares of cells (n, 4 or 3, 2), a few at a time: rows of many cells at once."""
    for start in range(0, len(display_polygons), POLYGONS_AT_ONCE):
        some = slice(start, start + POLYGONS_AT_ONCE)
        number = np.arange(start, start + len(display_polygons[some]))
        cells = Cells(number, *split_xy(display_polygons[some]), *split_xy(view_polygons[some]))
        for part in _divide(cells, *display_size):
            place = np.stack([part.u, part.v], axis=1)
            pixel = part.pixel.astype(index_type(display_size))
            yield Divided(
                display_index=pixel,
                view_xy=place,
                covariance=part.covariance,
                area=part.area,
                display_area=part.display_area,
                number=part.number,
            )


def _divide(cells: Cells, width: int, height: int) -> Iterator[_Part]:
    """Divide cells among the display's pixels."""
    left, right, top, bottom = corner_bounds(cells.x, cells.y)
    with np.errstate(invalid="ignore", over="ignore"):
        view_area = np.abs(signed_area(cells.u, cells.v))
        is_seen = (right >= 0) & (left < width) & (bottom >= 0) & (top < height)
        is_seen &= (left > -FARTHEST) & (right < FARTHEST) & (top > -FARTHEST) & (bottom < FARTHEST)
        is_seen &= (view_area > 0) & (view_area < np.inf)

        column = np.floor(left)
        row = np.floor(top)

        # a right or lower edge on a grid line touches the next pixel without entering it
        is_whole = (
            is_seen & (right <= column + 1) & (bottom <= row + 1) & (column >= 0) & (row >= 0)
        )

    whole = np.flatnonzero(is_whole)
    if len(whole):
        some = cells.pick(whole)
        pixel = (row[whole] * width + column[whole]).astype(np.int64)
        area = np.abs(signed_area(some.x, some.y))
        place = *centroid(some.u, some.v), covariance_of(some.u, some.v)
        yield _Part(some.number, pixel, *place, view_area[whole], area)

    rest = np.flatnonzero(is_seen & ~is_whole)
    if len(rest):
        yield from _divide_crossing(cells.pick(rest), width, height)


def _divide_crossing(cells: Cells, width: int, height: int) -> Iterator[_Part]:
    """Divide cells that cross a grid line."""
    if len(cells.x) == 3:
        yield from _spread(thickened(cells), np.abs(signed_area(cells.x, cells.y)), width, height)
        return

    is_plain = is_unfolded(cells.x, cells.y)
    plain = cells if is_plain.all() else cells.pick(np.flatnonzero(is_plain))
    if len(plain.number):
        yield from _spread(plain, np.abs(signed_area(plain.x, plain.y)), width, height)

    if len(plain.number) < len(cells.number):
        for triangles in unfolded(cells.pick(np.flatnonzero(~is_plain))):
            yield from _divide(triangles, width, height)


def _spread(cells: Cells, display_area: Floats, width: int, height: int) -> Iterator[_Part]:
    """Divide cells that cross grid lines; display_area (c,): before they were widened."""
    # a window of whole pixels around each cell: coordinates from its corner are small, and exact if
    # the cell lies in the window
    left, right, top, bottom = corner_bounds(cells.x, cells.y)
    x0 = np.clip(np.floor(left), 0, width - 1)
    y0 = np.clip(np.floor(top), 0, height - 1)
    columns = np.clip(np.ceil(right), x0 + 1, width) - x0
    rows = np.clip(np.ceil(bottom), y0 + 1, height) - y0
    x = cells.x - x0
    y = cells.y - y0

    # data of a cell for the walk and the inverse map
    total = signed_area(x, y)
    outline = np.stack([*x, *y, *slopes_of(x, y), columns - 1])
    origin = (y0 * width + x0).astype(np.int64)
    view_area = np.abs(signed_area(cells.u, cells.v))
    inverse = cell_from_display(x, y, total)
    forward = view_from_cell(cells.u, cells.v)

    n_pixels = np.minimum(columns * rows, np.abs(total) + 2 * (columns + rows))
    for cell, row in _batches(rows.astype(np.int64), n_pixels):
        first, n_columns, pieces = walk(np.take(outline, cell, axis=1), row)
        moments = sums(n_columns, pieces)

        of_row, step = ragged(n_columns)
        share = moments.area / total[cell][of_row]
        covered = np.flatnonzero(share > SMALLEST)
        moments = Moments(*(values[covered] for values in moments))
        share = share[covered]

        of_row = of_row[covered]
        of_cell = cell[of_row]
        column = first[of_row] + step[covered]
        row = row[of_row]

        # centroid and covariance of each part
        mean_x = np.clip(moments.x / moments.area, 0, 1)
        mean_y = np.clip(moments.y / moments.area, 0, 1)
        to_cell = np.take(inverse, of_cell, axis=1)
        to_view = np.take(forward, of_cell, axis=1)
        u, v = on_view(to_cell, to_view, column + mean_x, row + mean_y, is_triangle=len(x) == 3)

        xx = moments.xx / moments.area
        xy = moments.xy / moments.area
        yy = moments.yy / moments.area
        on_display = xx - mean_x * mean_x, xy - mean_x * mean_y, yy - mean_y * mean_y
        yield _Part(
            number=cells.number[of_cell],
            pixel=origin[of_cell] + row * width + column,
            u=u,
            v=v,
            covariance=spread_on_view(to_cell, to_view, *on_display),
            area=share * view_area[of_cell],
            display_area=share * display_area[of_cell],
        )


def _batches(rows: Ints, n_pixels: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Cell and row (r,) of all rows of all cells, in batches of about PARTS_AT_ONCE pixels."""
    for start, stop in _runs(n_pixels):
        cell, row = ragged(rows[start:stop])
        cell += start
        if n_pixels[start:stop].sum() < 2 * PARTS_AT_ONCE:
            yield cell, row
        else:
            for first, last in _runs((n_pixels / rows)[cell]):
                yield cell[first:last], row[first:last]


def _runs(cost: Floats) -> Iterator[tuple[int, int]]:
    """Cut a sequence into runs of about PARTS_AT_ONCE each; a member that costs more is a run of
    its own.
    """
    number = np.floor(np.cumsum(cost) / PARTS_AT_ONCE)
    ends = [*(np.flatnonzero(np.diff(number)) + 1), len(cost)]
    yield from pairwise([0, *ends])


FAR_AWAY = 1e300  # px, for edges outside a row


def ragged(counts: Ints) -> tuple[Ints, Ints]:
    """Owner and place within the owner of each member of ragged groups: [2, 3] gives [0 0 1 1 1],
    [0 1 0 1 2].
    """
    owner = np.repeat(np.arange(len(counts)), counts)
    starts = np.cumsum(counts) - counts
    return owner, np.arange(len(owner)) - starts[owner]


def slopes_of(x: Floats, y: Floats) -> Floats:
    """dx/dy of each edge; any number for a level edge, which bounds no area."""
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


class EdgeParts(NamedTuple):
    """Parts of edges in one pixel, all (p,): the pixel, and both ends in 0..1 from its upper left
    corner.
    """

    pixel: Ints
    xa: Floats
    ya: Floats
    xb: Floats
    yb: Floats


def walk(outline: Floats, row: Ints) -> tuple[Ints, Ints, EdgeParts]:
    """Cut outlines at the grid lines of their rows.

    Returns the first column and the number of columns each row of a cell enters, and the pieces of
    the edges, their pixels counted through all these rows.
    """
    last_column = outline[-1]
    ends = _ends(outline, row)

    low = np.minimum(ends.xa, ends.xb)
    high = np.maximum(ends.xa, ends.xb)
    is_crossing = ends.ya != ends.yb
    away = FAR_AWAY * ~is_crossing
    first = np.clip(np.floor((low + away).min(axis=0)), 0, last_column)
    last = np.clip(np.ceil((high - away).max(axis=0)) - 1, first, last_column)
    n_columns = (last - first).astype(np.int64) + 1
    starts = np.cumsum(n_columns) - n_columns

    # columns of each edge, one piece in each: left of the window (column -1) counts as on its
    # border; an edge right of the row's columns adds nothing
    begin = np.clip(np.floor(low), -1, last_column + 1)
    end = np.clip(np.floor(high), -1, last)
    of_edge, step = ragged((is_crossing * np.maximum(end - begin + 1, 0)).astype(np.int64).ravel())

    def of_piece(values: NDArray) -> NDArray:
        return np.take(values.ravel(), of_edge)

    # each edge relative to the left border of a piece's pixel
    slope_y = (ends.yb - ends.ya) / (ends.xb - ends.xa + (ends.xa == ends.xb))
    edges = EdgeParts(
        pixel=of_piece((starts - first + begin).astype(np.int64)) + step,
        xa=of_piece(ends.xa - begin) - step,
        ya=of_piece(ends.ya),
        xb=of_piece(ends.xb - begin) - step,
        yb=of_piece(ends.yb),
    )
    is_left = (
        np.flatnonzero((of_piece(begin) < 0) & (step == 0)) if begin.min(initial=0) < 0 else ()
    )
    return first.astype(np.int64), n_columns, _cut(edges, of_piece(slope_y), is_left)


class _Ends(NamedTuple):
    """Ends of edges (k, r) within rows of pixels, from the window's left border and the row's upper
    one.
    """

    xa: Floats
    ya: Floats
    xb: Floats
    yb: Floats


def _ends(outline: Floats, row: Ints) -> _Ends:
    """Ends of edges within their rows."""
    # corners relative to the row's upper border
    k = len(outline) // 3
    x = outline[:k]
    y = outline[k : 2 * k] - row
    slope = outline[2 * k : -1]

    inside = np.clip(y, 0, 1)
    off = inside - y
    following = [*range(1, k), 0]

    # x is rounded to steps of at least 2^-51: distances to a grid line are exact, also just left of
    # 0
    xa = (x + off * slope + 4) - 4
    xb = (x[following] + off[following] * slope + 4) - 4
    return _Ends(xa, inside, xb, inside[following])


def _cut(edges: EdgeParts, slope_y: Floats, is_left: Ints | tuple[()]) -> EdgeParts:
    """Edges (p,), with slopes dy/dx, cut at the left and right borders of their pixels.

    Edges left of the window count as on its border.
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

    return EdgeParts(pixel, ua, ya, ub, yb)


def sums(n_columns: Ints, pieces: EdgeParts) -> Moments:
    """Signed area (n,) of the cell in each pixel of its rows, and its moments of x, y, x^2, x y and
    y^2 from the pixel's upper left corner.

    Green's theorem: each is a sum of x^(k+1) / (k+1) y^m dy over the outline. Edges in the pixel
    count with their own x, edges further left with 0, edges further right with 1. As dy sums to 0
    along a row, and y^m dy too, the last group is minus the cover: the sum up to and including the
    pixel.
    """
    n = int(n_columns.sum())
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

    # edges further left
    cover = _along_rows(of_pixel(dy), n_columns)
    cover_y = _along_rows(of_pixel(dy * ys * 0.5), n_columns)
    cover_yy = _along_rows(of_pixel(dy * (ys * ys + yy) * (1 / 6)), n_columns)

    return Moments(
        area=of_pixel(dy * xs * 0.5) - cover,
        x=of_pixel(dy * (xs * xs + xx) * (1 / 12)) - 0.5 * cover,
        y=of_pixel(dy * (total + xy) * (1 / 6)) - cover_y,
        xx=of_pixel(dy * xs * xx * (1 / 12)) - (1 / 3) * cover,
        xy=of_pixel(dy * (xx * ys + 2 * xs * xy) * (1 / 24)) - 0.5 * cover_y,
        yy=of_pixel(dy * (xs * yy + 2 * ys * xy) * (1 / 12)) - cover_yy,
    )


def _along_rows(values: Floats, n_columns: Ints) -> Floats:
    """Cumulative sums within each row."""
    sums = np.cumsum(values)
    before = np.concatenate([[0.0], sums[np.cumsum(n_columns)[:-1] - 1]])
    return sums - np.repeat(before, n_columns)
