"""Cells as polygons: area, centroid, covariance; thin ones are widened, folded ones split.

A cell is a small polygon on the viewer's image together with its image on the display. A quad with
a folded image, as at a caustic, counts as the two triangles on either side of a diagonal: the
signed sum of its parts would lose overlapping area. A triangle squeezed to a line or a point has no
area to divide, so it gets a width well above rounding errors.
"""

from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, Ints, take

COUNTED = 1 << 16  # most pieces whose shares are counted; of more, a sample

# Tolerances for the division of cells, the same in core/native/shares.c.
# px: a cell squeezed thinner than this by a caustic is spread to this width
THINNEST = 1e-5
SMALLEST = 1e-14  # of a cell: smaller shares are rounding errors
LEVEL = 1e-100  # px: an edge with a smaller fall bounds no area
INSIDE = 1e-9  # of a cell: least distance of a share's centroid from the border
LEAST_LEAN = 1e-3  # px: an edge with less lean is upright
FARTHEST = 1e15  # px: beyond it a double cannot resolve pixels


class Cells(NamedTuple):
    """Cells with their corners in rows: numbers (c,), display x, y and viewer u, v (k, c)."""

    number: Ints
    x: Floats
    y: Floats
    u: Floats
    v: Floats

    def pick(self, which: Ints) -> "Cells":
        # np.take leaves each corner contiguous, indexing would not
        return Cells(self.number[which], *(np.take(corners, which, axis=1) for corners in self[1:]))

    def triangle(self, corners: tuple[int, int, int]) -> "Cells":
        return Cells(self.number, *(values[list(corners)] for values in self[1:]))


class Bounds(NamedTuple):
    """Least and greatest x, least and greatest y (c,) of polygons, px."""

    left: Floats
    right: Floats
    top: Floats
    bottom: Floats


def split_xy(polygons: Floats) -> tuple[Floats, Floats]:
    """First and second coordinate (k, c) of polygons (c, k, 2), contiguous."""
    transposed = np.asarray(polygons, float).transpose(2, 1, 0)
    return np.ascontiguousarray(transposed[0]), np.ascontiguousarray(transposed[1])


def corner_bounds(x: Floats, y: Floats) -> Bounds:
    """Bounds of polygons (k, c)."""
    return Bounds(x.min(axis=0), x.max(axis=0), y.min(axis=0), y.max(axis=0))


def cross(ax: Floats, ay: Floats, bx: Floats, by: Floats) -> Floats:
    """Cross product (c,) of vectors a and b in the plane: twice the area between them."""
    return ax * by - ay * bx


def signed_area(x: Floats, y: Floats) -> Floats:
    """Signed area (c,) of triangles or quads (k, c)."""
    if len(x) == 3:
        return 0.5 * cross(x[1] - x[0], y[1] - y[0], x[2] - x[0], y[2] - y[0])
    return 0.5 * cross(x[2] - x[0], y[2] - y[0], x[3] - x[1], y[3] - y[1])


def area_within(x: Floats, y: Floats, size: tuple[int, int]) -> Floats:
    """Area (c,) of polygons (k, c) within the rectangle from (0, 0) to a size.

    Green's theorem: the sum over the edges of the integral of x dy, with x and y clamped to the
    rectangle. The integral over a straight edge has a closed form: with F' = clip(x, 0, w) it is
    the slope of F between both ends times their height.
    """
    width, height = size
    bx, by = np.roll(x, -1, axis=0), np.roll(y, -1, axis=0)
    low, high = np.clip(y, 0, height), np.clip(by, 0, height)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        slope = (bx - x) / (by - y)
        ends = x + (low - y) * slope, x + (high - y) * slope
        inside = [np.clip(end, 0, width) for end in ends]
        # F is quadratic in the rectangle, and linear beyond
        first, last = (
            0.5 * near**2 + np.maximum(end - width, 0) * width
            for near, end in zip(inside, ends, strict=True)
        )
        is_upright = np.abs(ends[1] - ends[0]) < LEAST_LEAN
        mean = np.where(is_upright, inside[0], (last - first) / (ends[1] - ends[0]))
        mean = np.clip(mean, np.minimum(*inside), np.maximum(*inside))
        strips = np.where(low == high, 0, (high - low) * mean)
    return np.abs(strips.sum(axis=0))


def centroid(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Centroid of triangles or convex quads (k, c)."""
    if len(x) == 3:
        return (x[0] + x[1] + x[2]) / 3, (y[0] + y[1] + y[2]) / 3

    # two triangles, weighted by their areas
    dx = x[1:] - x[0]
    dy = y[1:] - y[0]
    first = cross(dx[0], dy[0], dx[1], dy[1])
    second = cross(dx[1], dy[1], dx[2], dy[2])
    second /= first + second

    return (
        x[0] + (dx[0] + dx[1] + second * (dx[2] - dx[0])) / 3,
        y[0] + (dy[0] + dy[1] + second * (dy[2] - dy[0])) / 3,
    )


def covariance_of(x: Floats, y: Floats) -> NDArray[np.float32]:
    """Covariance (3, c) of points in triangles or quads (k, c): xx, xy and yy. A quad counts as a
    parallelogram.
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

    # from the diagonals: sides of a parallelogram are half their sum and half their difference
    ax = x[2] - x[0]
    ay = y[2] - y[0]
    bx = x[3] - x[1]
    by = y[3] - y[1]
    found[0] = (ax * ax + bx * bx) / 24
    found[1] = (ax * ay + bx * by) / 24
    found[2] = (ay * ay + by * by) / 24

    return found


def _corner_areas(x: Floats, y: Floats) -> Floats:
    """Signed area (4, c) of the triangle at each corner of quads (4, c)."""
    ex = np.roll(x, -1, axis=0) - x
    ey = np.roll(y, -1, axis=0) - y
    return 0.5 * cross(np.roll(ex, 1, axis=0), np.roll(ey, 1, axis=0), ex, ey)


def is_unfolded(x: Floats, y: Floats) -> NDArray[np.bool_]:
    """Whether the bilinear map of a quad (4, c) has one orientation: the quad is convex."""
    corner = _corner_areas(x, y)
    extent = np.maximum(np.ptp(x, axis=0), np.ptp(y, axis=0))
    return np.maximum(corner.min(axis=0), -corner.max(axis=0)) > 0.5 * THINNEST * extent


def unfolded(quads: Cells) -> tuple[Cells, Cells]:
    """Two triangles for each quad, by the diagonal with the smaller ones: a concave quad keeps its
    area.
    """
    corner = np.abs(_corner_areas(quads.x, quads.y))
    turn = np.where(corner[0] + corner[2] < corner[1] + corner[3], 1, 0)
    order = (np.arange(4)[:, None] + turn) % 4
    rotated = Cells(
        quads.number, *(np.take_along_axis(values, order, axis=0) for values in quads[1:])
    )
    return rotated.triangle((0, 1, 2)), rotated.triangle((2, 3, 0))


def thickened(cells: Cells) -> Cells:
    """Widen triangles squeezed to a line or a point, well above rounding errors.

    The width goes to the right (down, for a level line): a line along a grid line fills the pixels
    it bounds on the left or from above, as a point there would.
    """
    x, y = cells.x, cells.y

    dx = np.roll(x, -1, axis=0) - x
    dy = np.roll(y, -1, axis=0) - y
    lengths = np.sqrt(dx * dx + dy * dy)
    longest = lengths.max(axis=0)
    first = lengths.argmax(axis=0)
    thin = np.flatnonzero(2 * np.abs(signed_area(x, y)) < THINNEST * longest)
    thin = np.union1d(thin, np.flatnonzero(longest < THINNEST))
    if len(thin) == 0:
        return cells

    # direction of the longest side; of a point, straight down
    start, end, apex = ((first[thin] + step) % 3 for step in range(3))
    is_point = longest[thin] < THINNEST
    along_x = np.where(is_point, 0.0, x[end, thin] - x[start, thin])
    along_y = np.where(is_point, THINNEST, y[end, thin] - y[start, thin])
    length = np.sqrt(along_x * along_x + along_y * along_y)
    along_x = along_x / length
    along_y = along_y / length

    # the longest side stays, and the third corner moves off it
    x = x.copy()
    y = y.copy()
    reach = (x[apex, thin] - x[start, thin]) * along_x + (y[apex, thin] - y[start, thin]) * along_y
    side = THINNEST * np.where((along_y > 0) | ((along_y == 0) & (along_x < 0)), 1.0, -1.0)
    x[end, thin], y[end, thin] = (
        x[start, thin] + length * along_x,
        y[start, thin] + length * along_y,
    )
    x[apex, thin] = x[start, thin] + reach * along_x + side * along_y
    y[apex, thin] = y[start, thin] + reach * along_y - side * along_x

    return cells._replace(x=x, y=y)


def count_shares(
    xy: Floats, pieces: Ints, display_size: tuple[int, int], n_parts: Ints | None = None
) -> tuple[Floats, int]:
    """Approximate number of shares each of some pieces makes, and the number of pieces it
    represents, above 1 if there are more than `COUNTED`.

    xy : (p, 2) display px of points
    pieces : (n, 4 or 3) points of their corners
    n_parts : (n,) parts along each side; None: one

    A convex part of width w, height h and area a touches a + w + h + 1 pixels on average.
    """
    step = 1 + len(pieces) // COUNTED
    some = pieces[::step]
    parts = np.ones(len(some)) if n_parts is None else n_parts[::step]
    corners = [take(xy, number) for number in some.T]
    low, high = (reduce(bound, corners) for bound in (np.minimum, np.maximum))
    size = np.clip(high, 0, display_size) - np.clip(low, 0, display_size)
    is_seen = ((high > 0) & (low < display_size)).all(axis=1)

    area = area_within(*np.moveaxis(corners, 2, 0), display_size)
    area = np.fmin(area, size.prod(axis=1))
    # parts outside the image make none
    with np.errstate(invalid="ignore", divide="ignore"):
        within = np.nan_to_num((size / (high - low)).prod(axis=1), nan=1.0)
    n_seen = 1 + (parts**2 - 1) * within
    lines = 1 + (parts - 1) * np.sqrt(within)
    return np.where(is_seen, area + lines * size.sum(axis=1) + n_seen, 0.0), step
