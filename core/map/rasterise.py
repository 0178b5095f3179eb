"""Which display pixels does a cell cover, how much of
each, and where is that on the viewer's image?

A cell is a small polygon on the viewer's image together with its image on the display. Walk once
around that image: in each row of pixels, every edge adds to the pixels it passes what lies on its
left, and to the pixels further left its height in full. Edges going up take away what edges going
down have added, so the sum over the closed outline is the area inside, pixel by pixel, and no
polygon is ever clipped. The same walk gives the first moments, hence the centroid of the part of
the cell that lies in a pixel; the inverse of the cell's map takes it back to the viewer's image.

Areas on the display are exact up to rounding, 1e-12 px^2 or better for cells of moderate size. The
edges are summed as font rasterisers do (signed areas, accumulated along rows); the moments are
Green's theorem on the same edges. A cell's area on the viewer's image is divided in proportion to
the area on the display, which is exact for triangles and parallelograms and right to first order in
the cell's size otherwise. The part of a cell beyond the display's border is left out. A quad whose
image is folded (at a caustic) counts as the two triangles that a diagonal makes of it, and a cell
squeezed to a line or point gives its whole area to the pixels it lies in.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Floats, Ints
from ..products import turn_covariance
from .shares import index_type

# px: a cell that a caustic squeezed thinner than this is spread as if it were this wide
THINNEST = 1e-5
SMALLEST = 1e-14  # of a cell: smaller shares are rounding errors
LEVEL = 1e-100  # px: an edge that falls by less has no area beside it
INSIDE = 1e-9  # of a cell: a share's centroid keeps this far from the border
FARTHEST = 1e15  # px: beyond it a double cannot tell one pixel from the next
NOWHERE = 1e300  # px, for edges that do not reach a row
POLYGONS_AT_ONCE = 1 << 15  # so that a step's arrays stay in the processor's cache
PIXELS_AT_ONCE = 1 << 16


def parts_by_rows(
    display_size: tuple[int, int], view_polygons: Floats, display_polygons: Floats
) -> Iterator[tuple]:
    """Index, place, covariance and both areas of shares, and the numbers of their cells.

    The rows of many at once.
    """
    for start in range(0, len(display_polygons), POLYGONS_AT_ONCE):
        some = slice(start, start + POLYGONS_AT_ONCE)
        number = np.arange(start, start + len(display_polygons[some]))
        cells = _Cells(number, *_columns(display_polygons[some]), *_columns(view_polygons[some]))
        for part in _divide(cells, *display_size):
            place = np.stack([part.u, part.v], axis=1)
            pixel = part.pixel.astype(index_type(display_size))
            yield pixel, place, part.covariance, part.area, part.display_area, part.number


class _Cells(NamedTuple):
    """Cells with their corners, one corner a row: numbers
    (c,), display x, y and viewer u, v (k, c).
    """

    number: Ints
    x: Floats
    y: Floats
    u: Floats
    v: Floats

    def pick(self, which: Ints) -> "_Cells":
        # np.take keeps one corner a row in memory too, indexing would not
        return _Cells(
            self.number[which], *(np.take(corners, which, axis=1) for corners in self[1:])
        )

    def triangle(self, corners: tuple[int, int, int]) -> "_Cells":
        return _Cells(self.number, *(values[list(corners)] for values in self[1:]))


class _Part(NamedTuple):
    """Shares in the making, all (n,) but for the covariance (3, n)."""

    number: Ints
    pixel: Ints
    u: Floats
    v: Floats
    covariance: NDArray[np.float32]
    area: Floats
    display_area: Floats


def _columns(polygons: Floats) -> tuple[Floats, Floats]:
    """First and second coordinate (k, c) of polygons (c, k, 2), contiguous."""
    turned = np.asarray(polygons, float).transpose(2, 1, 0)
    return np.ascontiguousarray(turned[0]), np.ascontiguousarray(turned[1])


def _bounds(x: Floats, y: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Least and greatest x, least and greatest y (c,) of polygons (k, c)."""
    return x.min(axis=0), x.max(axis=0), y.min(axis=0), y.max(axis=0)


def _cross(ax: Floats, ay: Floats, bx: Floats, by: Floats) -> Floats:
    return ax * by - ay * bx


def _signed_area(x: Floats, y: Floats) -> Floats:
    """Signed area (c,) of triangles or quads (k, c)."""
    if len(x) == 3:
        return 0.5 * _cross(x[1] - x[0], y[1] - y[0], x[2] - x[0], y[2] - y[0])
    return 0.5 * _cross(x[2] - x[0], y[2] - y[0], x[3] - x[1], y[3] - y[1])


def _centroid(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Centroid of triangles or convex quads (k, c)."""
    if len(x) == 3:
        return (x[0] + x[1] + x[2]) / 3, (y[0] + y[1] + y[2]) / 3
    dx = x[1:] - x[0]
    dy = y[1:] - y[0]
    first = _cross(dx[0], dy[0], dx[1], dy[1])
    second = _cross(dx[1], dy[1], dx[2], dy[2])
    second /= first + second
    return (
        x[0] + (dx[0] + dx[1] + second * (dx[2] - dx[0])) / 3,
        y[0] + (dy[0] + dy[1] + second * (dy[2] - dy[0])) / 3,
    )


def _covariance(x: Floats, y: Floats) -> NDArray[np.float32]:
    """Covariance (3, c) of points in triangles or quads (k, c):
    xx, xy and yy. A quad is taken for a parallelogram.
    """
    found = np.empty((3, x.shape[1]), np.float32)
    if len(x) == 3:
        ax = x[1] - x[0]
        ay = y[1] - y[0]
        bx = x[2] - x[0]
        by = y[2] - y[0]
        found[0] = (ax * ax + bx * bx - ax * bx) / 18
        found[1] = (ax * ay + bx * by - 0.5 * (ax * by + ay * bx)) / 18
        found[2] = (ay * ay + by * by - ay * by) / 18
        return found

    # by the diagonals: the sides of a parallelogram are half their sum and half their difference
    ax = x[2] - x[0]
    ay = y[2] - y[0]
    bx = x[3] - x[1]
    by = y[3] - y[1]
    found[0] = (ax * ax + bx * bx) / 24
    found[1] = (ax * ay + bx * by) / 24
    found[2] = (ay * ay + by * by) / 24
    return found


def _divide(cells: _Cells, width: int, height: int) -> Iterator[_Part]:
    """Divide cells among the display's pixels."""
    left, right, top, bottom = _bounds(cells.x, cells.y)
    with np.errstate(invalid="ignore", over="ignore"):
        view_area = np.abs(_signed_area(cells.u, cells.v))
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
    rest = np.flatnonzero(is_seen & ~is_whole)
    if len(whole):
        some = cells.pick(whole)
        pixel = (row[whole] * width + column[whole]).astype(np.int64)
        area = np.abs(_signed_area(some.x, some.y))
        place = *_centroid(some.u, some.v), _covariance(some.u, some.v)
        yield _Part(some.number, pixel, *place, view_area[whole], area)
    if len(rest):
        yield from _divide_crossing(cells.pick(rest), width, height)


def _divide_crossing(cells: _Cells, width: int, height: int) -> Iterator[_Part]:
    """Divide cells that cross a grid line."""
    if len(cells.x) == 3:
        yield from _spread(_thickened(cells), np.abs(_signed_area(cells.x, cells.y)), width, height)
        return
    is_unfolded = _is_unfolded(cells.x, cells.y)
    plain = cells if is_unfolded.all() else cells.pick(np.flatnonzero(is_unfolded))
    if len(plain.number):
        yield from _spread(plain, np.abs(_signed_area(plain.x, plain.y)), width, height)
    if len(plain.number) < len(cells.number):
        for triangles in _unfolded(cells.pick(np.flatnonzero(~is_unfolded))):
            yield from _divide(triangles, width, height)


def _corner_areas(x: Floats, y: Floats) -> Floats:
    """Signed area (4, c) of the triangle at each corner of quads (4, c)."""
    ex = np.roll(x, -1, axis=0) - x
    ey = np.roll(y, -1, axis=0) - y
    return 0.5 * _cross(np.roll(ex, 1, axis=0), np.roll(ey, 1, axis=0), ex, ey)


def _is_unfolded(x: Floats, y: Floats) -> NDArray[np.bool_]:
    """Whether the bilinear map of a quad (4, c) turns the same
    way all over: it does where the quad is convex.
    """
    corner = _corner_areas(x, y)
    extent = np.maximum(np.ptp(x, axis=0), np.ptp(y, axis=0))
    return np.maximum(corner.min(axis=0), -corner.max(axis=0)) > 0.5 * THINNEST * extent


def _unfolded(quads: _Cells) -> tuple[_Cells, _Cells]:
    """Two triangles for each quad, by the diagonal that makes
    the smaller ones: a quad bent in keeps its area.
    """
    corner = np.abs(_corner_areas(quads.x, quads.y))
    turn = np.where(corner[0] + corner[2] < corner[1] + corner[3], 1, 0)
    order = (np.arange(4)[:, None] + turn) % 4
    turned = _Cells(
        quads.number, *(np.take_along_axis(values, order, axis=0) for values in quads[1:])
    )
    return turned.triangle((0, 1, 2)), turned.triangle((2, 3, 0))


def _thickened(cells: _Cells) -> _Cells:
    """Give triangles squeezed to a line or a point a width that rounding cannot touch.

    The width goes to the right (down, for a level line), so that a line along a grid line
    fills the pixels it bounds on the left or from above, as a point there would.
    """
    x, y = cells.x, cells.y
    dx = np.roll(x, -1, axis=0) - x
    dy = np.roll(y, -1, axis=0) - y
    lengths = np.sqrt(dx * dx + dy * dy)
    longest = lengths.max(axis=0)
    first = lengths.argmax(axis=0)
    thin = np.flatnonzero(2 * np.abs(_signed_area(x, y)) < THINNEST * longest)
    thin = np.union1d(thin, np.flatnonzero(longest < THINNEST))
    if len(thin) == 0:
        return cells
    x = x.copy()
    y = y.copy()
    start, end, apex = ((first[thin] + step) % 3 for step in range(3))
    is_point = longest[thin] < THINNEST
    along_x = np.where(is_point, 0.0, x[end, thin] - x[start, thin])
    along_y = np.where(is_point, THINNEST, y[end, thin] - y[start, thin])
    length = np.sqrt(along_x * along_x + along_y * along_y)
    along_x = along_x / length
    along_y = along_y / length
    reach = (x[apex, thin] - x[start, thin]) * along_x + (y[apex, thin] - y[start, thin]) * along_y
    side = THINNEST * np.where((along_y > 0) | ((along_y == 0) & (along_x < 0)), 1.0, -1.0)
    x[end, thin], y[end, thin] = (
        x[start, thin] + length * along_x,
        y[start, thin] + length * along_y,
    )
    x[apex, thin] = x[start, thin] + reach * along_x + side * along_y
    y[apex, thin] = y[start, thin] + reach * along_y - side * along_x
    return cells._replace(x=x, y=y)


def _spread(cells: _Cells, display_area: Floats, width: int, height: int) -> Iterator[_Part]:
    """Divide cells that cross grid lines; `display_area` is theirs from before they were
    thickened.
    """
    left, right, top, bottom = _bounds(cells.x, cells.y)
    x0 = np.clip(np.floor(left), 0, width - 1)
    y0 = np.clip(np.floor(top), 0, height - 1)
    columns = np.clip(np.ceil(right), x0 + 1, width) - x0
    rows = np.clip(np.ceil(bottom), y0 + 1, height) - y0
    # coordinates from the window's corner: exact where the cell lies in the window, and small
    x, y = cells.x - x0, cells.y - y0
    total = _signed_area(x, y)
    outline = np.stack([*x, *y, *_slopes(x, y), columns - 1])
    origin = (y0 * width + x0).astype(np.int64)
    view_area = np.abs(_signed_area(cells.u, cells.v))
    inverse = _view_from_display(x, y, total)
    forward = _view_from_cell(cells.u, cells.v)

    n_pixels = np.minimum(columns * rows, np.abs(total) + 2 * (columns + rows))
    for cell, row in _batches(rows.astype(np.int64), n_pixels):
        first, widths, pieces = _walk(np.take(outline, cell, axis=1), row)
        area, mx, my, mxx, mxy, myy = _sums(widths, pieces)
        of_row, step = _ragged(widths)
        share = area / total[cell][of_row]
        kept = np.flatnonzero(share > SMALLEST)
        area = area[kept]
        share = share[kept]
        of_row = of_row[kept]
        of_cell = cell[of_row]
        column = first[of_row] + step[kept]
        row = row[of_row]
        mean_x = np.clip(mx[kept] / area, 0, 1)
        mean_y = np.clip(my[kept] / area, 0, 1)
        to_cell = np.take(inverse, of_cell, axis=1)
        to_view = np.take(forward, of_cell, axis=1)
        u, v = _on_view(to_cell, to_view, column + mean_x, row + mean_y, is_triangle=len(x) == 3)
        xx = mxx[kept] / area
        xy = mxy[kept] / area
        yy = myy[kept] / area
        on_display = xx - mean_x * mean_x, xy - mean_x * mean_y, yy - mean_y * mean_y
        yield _Part(
            cells.number[of_cell],
            origin[of_cell] + row * width + column,
            u,
            v,
            _spread_on_view(to_cell, to_view, *on_display),
            share * view_area[of_cell],
            share * display_area[of_cell],
        )


def _ragged(counts: Ints) -> tuple[Ints, Ints]:
    """Owner and place within the owner of each member of
    ragged groups: [2, 3] gives [0 0 1 1 1], [0 1 0 1 2].
    """
    owner = np.repeat(np.arange(len(counts)), counts)
    starts = np.cumsum(counts) - counts
    return owner, np.arange(len(owner)) - starts[owner]


def _batches(rows: Ints, n_pixels: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Cell and row (r,) of all rows of all cells, in batches of about PIXELS_AT_ONCE pixels."""
    for start, stop in _runs(n_pixels):
        cell, row = _ragged(rows[start:stop])
        cell += start
        if n_pixels[start:stop].sum() < 2 * PIXELS_AT_ONCE:
            yield cell, row
        else:
            for first, last in _runs((n_pixels / rows)[cell]):
                yield cell[first:last], row[first:last]


def _runs(cost: Floats) -> Iterator[tuple[int, int]]:
    """Cut a sequence into runs of about PIXELS_AT_ONCE each,
    or of one member where that costs more.
    """
    number = np.floor(np.cumsum(cost) / PIXELS_AT_ONCE)
    ends = [*(np.flatnonzero(np.diff(number)) + 1), len(cost)]
    yield from pairwise([0, *ends])


def _slopes(x: Floats, y: Floats) -> Floats:
    """dx/dy of each edge; a level edge has no area beside it, so any number will do."""
    dx = np.roll(x, -1, axis=0) - x
    dy = np.roll(y, -1, axis=0) - y
    return dx / np.where(np.abs(dy) < LEVEL, 1.0, dy)


class _Pieces(NamedTuple):
    """Parts of edges that lie in one pixel, all (p,): the pixel,
    and both ends in 0..1 from its upper left corner.
    """

    pixel: Ints
    xa: Floats
    ya: Floats
    xb: Floats
    yb: Floats


def _walk(outline: Floats, row: Ints) -> tuple[Ints, Ints, _Pieces]:
    """Cut outlines at the grid lines of their rows.

    Returns the first column and the number of columns that each row of a cell enters, and
    the pieces of the edges, their pixels counted through all these rows.
    """
    k = len(outline) // 3
    x = outline[:k]
    y = outline[k : 2 * k] - row
    slope = outline[2 * k : -1]
    last_column = outline[-1]
    inside = np.clip(y, 0, 1)
    off = inside - y
    following = [*range(1, k), 0]
    # rounded to steps of 2^-51 at the least, so that distances to
    # a grid line are exact, also just left of 0
    xa = (x + off * slope + 4) - 4
    xb = (x[following] + off[following] * slope + 4) - 4
    ya = inside
    yb = inside[following]
    low = np.minimum(xa, xb)
    high = np.maximum(xa, xb)
    is_there = ya != yb
    away = NOWHERE * ~is_there

    first = np.clip(np.floor((low + away).min(axis=0)), 0, last_column)
    last = np.clip(np.ceil((high - away).max(axis=0)) - 1, first, last_column)
    widths = (last - first).astype(np.int64) + 1
    starts = np.cumsum(widths) - widths

    # left of the window (column -1) counts as on its border; an
    # edge further right than the row adds nothing to it
    begin = np.clip(np.floor(low), -1, last_column + 1)
    end = np.clip(np.floor(high), -1, last)
    of_edge, step = _ragged((is_there * np.maximum(end - begin + 1, 0)).astype(np.int64).ravel())
    slope_y = (yb - ya) / (xb - xa + (xa == xb))

    def of_piece(values: NDArray) -> NDArray:
        return np.take(values.ravel(), of_edge)

    pixel = of_piece((starts - first + begin).astype(np.int64)) + step
    ya = of_piece(ya)
    yb = of_piece(yb)
    slope_y = of_piece(slope_y)
    xa = of_piece(xa - begin) - step
    xb = of_piece(xb - begin) - step
    ua = np.clip(xa, 0, 1)
    ub = np.clip(xb, 0, 1)
    is_left = (
        np.flatnonzero((of_piece(begin) < 0) & (step == 0)) if begin.min(initial=0) < 0 else ()
    )
    if len(is_left):
        ua[is_left], ub[is_left] = np.minimum(xa[is_left], 1), np.minimum(xb[is_left], 1)
    ya = ya + (ua - xa) * slope_y
    yb = yb + (ub - xb) * slope_y
    if len(is_left):
        ua[is_left] = ub[is_left] = 0
        pixel[is_left] += 1
    return first.astype(np.int64), widths, _Pieces(pixel, ua, ya, ub, yb)


def _sums(widths: Ints, pieces: _Pieces) -> tuple[Floats, ...]:
    """Signed area (n,) of the cell in each pixel of its rows,
    and its moments of x, y, x^2, x y and y^2.

    These count from the pixel's upper left corner. Green's theorem: each is a sum of x^(k+1) /
    (k+1) y^m dy over the outline. Edges in the pixel count with their own x, those further left
    with 0, those further right with 1. As dy sums to 0 along a row, and y^m dy too, the last make
    up minus the cover: the sum up to and with the pixel.
    """
    n = int(widths.sum())
    pixel, xa, ya, xb, yb = pieces
    dy = yb - ya
    xs = xa + xb
    ys = ya + yb
    xx = xa * xa + xb * xb
    xy = xa * ya + xb * yb
    yy = ya * ya + yb * yb
    total = xs * ys

    def of_pixel(values: Floats) -> Floats:
        return np.bincount(pixel, values, n)

    cover = _along_rows(of_pixel(dy), widths)
    cover_y = _along_rows(of_pixel(dy * ys * 0.5), widths)
    cover_yy = _along_rows(of_pixel(dy * (ys * ys + yy) * (1 / 6)), widths)
    return (
        of_pixel(dy * xs * 0.5) - cover,
        of_pixel(dy * (xs * xs + xx) * (1 / 12)) - 0.5 * cover,
        of_pixel(dy * (total + xy) * (1 / 6)) - cover_y,
        of_pixel(dy * xs * xx * (1 / 12)) - (1 / 3) * cover,
        of_pixel(dy * (xx * ys + 2 * xs * xy) * (1 / 24)) - 0.5 * cover_y,
        of_pixel(dy * (xs * yy + 2 * ys * xy) * (1 / 12)) - cover_yy,
    )


def _spread_on_view(
    inverse: Floats, forward: Floats, xx: Floats, xy: Floats, yy: Floats
) -> NDArray[np.float32]:
    """The covariance (3, n) on the viewer's image of that on
    the display, as if cells were parallelograms.

    Within the cell it is limited to the values that points of it
    can have, however rounding spoilt that of a sliver.
    """
    s_x, s_y, _, t_x, t_y, *_ = inverse
    _, us, ut, _, _, vs, vt, _ = forward
    ss, st, tt = turn_covariance((xx, xy, yy), s_x, s_y, t_x, t_y)

    ss = np.clip(ss, 0, 0.25)
    tt = np.clip(tt, 0, 0.25)
    most = np.sqrt(ss * tt)
    in_cell = ss, np.clip(st, -most, most), tt
    return turn_covariance(in_cell, us, ut, vs, vt).astype(np.float32)


def _along_rows(values: Floats, widths: Ints) -> Floats:
    """Cumulative sums within each row."""
    sums = np.cumsum(values)
    before = np.concatenate([[0.0], sums[np.cumsum(widths)[:-1] - 1]])
    return sums - np.repeat(before, widths)


def _view_from_display(x: Floats, y: Floats, total: Floats) -> Floats:
    """Coefficients (8, c) that take a point on the display to (s, t) in the cell.

    A quad is p = centre + s a + t b + s t c with s, t in -1/2..1/2, a triangle p = corner + s a
    + t b. Six coefficients invert the part without c, two are c in that frame.
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
        (px, ax, bx, cx) = _bilinear(x)
        (py, ay, by, cy) = _bilinear(y)
        det = total
    s_x = by / det
    s_y = -bx / det
    t_x = -ay / det
    t_y = ax / det
    return np.stack(
        [
            s_x,
            s_y,
            -(s_x * px + s_y * py),
            t_x,
            t_y,
            -(t_x * px + t_y * py),
            s_x * cx + s_y * cy,
            t_x * cx + t_y * cy,
        ]
    )


def _view_from_cell(u: Floats, v: Floats) -> Floats:
    """Coefficients (8, c) of the viewer's u and v: constant, s, t and s t."""
    if len(u) == 3:
        zero = np.zeros_like(u[0])
        return np.stack(
            [u[0], u[1] - u[0], u[2] - u[0], zero, v[0], v[1] - v[0], v[2] - v[0], zero]
        )
    return np.stack([*_bilinear(u), *_bilinear(v)])


def _bilinear(x: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Constant, s, t and s t coefficients of the map from s, t in -1/2..1/2 to a quad (4, c)."""
    return (
        0.25 * (x[0] + x[1] + x[2] + x[3]),
        0.5 * (x[1] + x[2] - x[0] - x[3]),
        0.5 * (x[2] + x[3] - x[0] - x[1]),
        x[0] - x[1] + x[2] - x[3],
    )


def _on_view(
    inverse: Floats, forward: Floats, x: Floats, y: Floats, is_triangle: bool
) -> tuple[Floats, Floats]:
    """The viewer's u, v of points x, y on the display, kept
    within the cell so that no sliver is rounded out of it.

    With (s0, t0) the solution for c = 0, the product k = s t
    solves k = (s0 - k cx)(t0 - k cy), a quadratic equation.
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
