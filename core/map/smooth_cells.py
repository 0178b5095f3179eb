"""Smooth cells: squares of the viewer's image, biquartic through 5 x 5 nodes, cut into quads.

Nodes are numbered row by row from the upper left corner, a quarter of the square's side apart.

A quad is bilinear, the cell biquartic: n parts a side leave an error that falls as 1 / n^2. A
display pixel takes one colour from each quad in it, so quads are also smaller than display pixels,
by the number of places. With the tolerance alone a colour would come from one or two places, and
cost more in the source image than the whole map's error.
"""

from dataclasses import dataclass
from functools import cache, reduce

import numpy as np

from ..base.arrays import Bools, Floats, Ints, take
from ..base.vectors import cross_2d
from .points import bounds_of

NODES_ALONG = 5  # nodes along a side: quartics
PARTS = NODES_ALONG - 1  # a cell's side in steps between nodes
COLUMN, ROW = (axis.ravel() for axis in np.meshgrid(np.arange(NODES_ALONG), np.arange(NODES_ALONG)))
# The interpolation error is largest where x (x - 1) ... (x - 4) is, as a fraction of the side. The
# first two places differ in x only, in which the error is odd: errors along x and y do not cancel
# at both. The others find features within a cell, mostly the edges of the mesh's faces, anywhere
# between the nodes not covered by the first.
_WORST = 0.3555671 / PARTS
CHECKS = np.array(
    [[_WORST, _WORST], [1 - _WORST, _WORST], [0.4, 0.9], [0.62, 0.6], [0.11, 0.63], [0.9, 0.87]]
)
# The error of a quartic is the largest value of the product, 3.63, times the fifth derivative / 5!.
# Fifth differences are unknown: where the map is steep, next to grazing rays, they were up to three
# times the fourth.
QUARTIC = 3 * 3.6314 / 120
DIFFERENCE_2 = np.array([1.0, -2.0, 1.0])
DIFFERENCE_4 = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
CORNERS = [0, 4, 24, 20]  # of the nodes, around the square

# Quads, tuned on the ball and on flat glass: error of the source image against number of shares
# (docs/decisions/05-cells-not-samples.md)
OF_TOLERANCE = 0.5  # for quads against their smooth cell; the rest is for the cell
CHEAP_ERROR_PX = 0.01  # display px, error of quads, unless they would be smaller than viewer pixels
N_PLACES = 4  # places of colour along a display pixel larger than a viewer pixel
N_PLACES_FEW = 2.0  # along a smaller one
MOST_PARTS = 128  # along the side of a smooth cell


@dataclass(frozen=True, eq=False)
class Squares:
    """Squares of the viewer's image: upper left corner (n, 2), side (n,), px."""

    corner: Ints
    size: Ints

    def __len__(self) -> int:
        return len(self.size)

    def at(self, which: Bools | Ints) -> "Squares":
        return Squares(self.corner[which], self.size[which])

    def and_more(self, others: "Squares") -> "Squares":
        return Squares(
            np.concatenate([self.corner, others.corner]), np.concatenate([self.size, others.size])
        )

    @property
    def area(self) -> int:
        """Total area, px^2."""
        return int((self.size**2).sum())

    def quarters(self) -> "Squares":
        half = np.repeat(self.size // 2, 4)
        step = np.tile([[0, 0], [1, 0], [0, 1], [1, 1]], (len(self), 1))
        return Squares(np.repeat(self.corner, 4, axis=0) + half[:, None] * step, half)

    def nodes(self) -> tuple[Ints, Ints]:
        """Columns and rows (n, 25) of the nodes."""
        step = self.size[:, None] // PARTS
        return self.corner[:, :1] + step * COLUMN, self.corner[:, 1:] + step * ROW

    def checks(self) -> Floats:
        """Viewer px (n, 6, 2) at which the interpolation is checked."""
        return self.corner[:, None] + self.size[:, None, None] * CHECKS

    def are_within(
        self, xy: Floats, view_size: tuple[int, int], display_size: tuple[int, int]
    ) -> Bools:
        """Mask of squares (n,), with nodes at (n, 25, 2) display px, entirely in both images."""
        low, high = bounds_of(xy)
        is_shown = ((low >= 0) & (high <= display_size)).all(axis=1)
        return is_shown & (self.corner + self.size[:, None] <= view_size).all(axis=1)


def are_off_display(xy: Floats, branch: np.ndarray, display_size: Ints) -> Bools:
    """Mask of squares (n,), with nodes landing at (n, k, 2) on branches (n, k), that show nothing
    of the display: all landings are on one branch, and outside the display on one side.
    """
    is_lost = branch == 0
    is_single = (is_lost | (branch == branch.max(axis=1, keepdims=True))).all(axis=1)
    some = np.flatnonzero(is_single & ~is_lost.all(axis=1))
    low, high = bounds_of(np.where(is_lost[some, :, None], np.nan, take(xy, some)))
    found = np.zeros(len(xy), bool)
    found[some] = ((low > display_size) | (high < 0)).any(axis=1)
    return found


def weights(t: Floats) -> Floats:
    """Lagrange weights (..., 5) of five nodes along a side at places t (...) in 0..1."""
    x = PARTS * np.asarray(t, float)
    off = [x - j for j in range(NODES_ALONG)]
    found = np.empty((*x.shape, NODES_ALONG))
    for k in range(NODES_ALONG):
        others = (off[j] / (k - j) for j in range(NODES_ALONG) if j != k)
        found[..., k] = reduce(np.multiply, others)
    return found


@cache
def _to_grid(m: int) -> Floats:
    """Lagrange weights (m + 1, 5) of a grid of m parts whose chords are right on average.

    A chord between points of a curve is off to one side, by h^2 f'' / 12 on average. Points moved
    by this, a twelfth of the second difference, have chords off equally far to both sides. The ends
    stay: neighbours with other grids have them, too.
    """
    matrix = weights(np.arange(m + 1) / m)
    matrix[1:-1] -= np.diff(matrix, n=2, axis=0) / 12
    return matrix


def at_places(nodes: Floats, places: Floats) -> Floats:
    """Values (n, c) at places (n, 2), x and y in 0..1, of cells with values (n, 25, c) at their
    nodes.
    """
    return np.einsum("nk,nkc->nc", _by_node(places), nodes)


def at_checks(nodes: Floats) -> Floats:
    """Values (n, 6, c) at the places of CHECKS, as `at_places`."""
    return np.matmul(_by_node(CHECKS), nodes)


def _by_node(places: Floats) -> Floats:
    """Weights (n, 25) of a cell's nodes at places (n, 2)."""
    by_x, by_y = weights(places).transpose(1, 0, 2)
    return (by_y[:, :, None] * by_x[:, None]).reshape(-1, NODES_ALONG**2)


def on_grid(nodes: Floats, m: int) -> Floats:
    """Values (n, m + 1, m + 1, c) on a grid of m parts a side, rows first, of cells with values (n,
    25, c).

    The bilinear parts between them are right on average, except along the cell's border.
    """
    n, _, c = nodes.shape
    matrix = _to_grid(m)
    rows = np.matmul(matrix, nodes.reshape(n, NODES_ALONG, NODES_ALONG * c))
    return np.matmul(matrix, rows.reshape(n * (m + 1), NODES_ALONG, c)).reshape(n, m + 1, m + 1, c)


def _differences(nodes: Floats, stencil: Floats) -> Floats:
    """Largest length (n,) of differences along rows and columns of values (n, 25, 2)."""
    n = len(nodes)
    # cells last: numpy is slow on rows of a few numbers
    grid = np.ascontiguousarray(nodes.reshape(n, 2 * NODES_ALONG**2).T)
    grid = grid.reshape(NODES_ALONG, NODES_ALONG, 2, n)
    last = NODES_ALONG - len(stencil) + 1
    along_x = sum(weight * grid[:, k : k + last] for k, weight in enumerate(stencil))
    along_y = sum(weight * grid[k : k + last] for k, weight in enumerate(stencil))
    squares = [(d * d).sum(axis=2).max(axis=(0, 1)) for d in (along_x, along_y)]
    return np.sqrt(np.maximum(*squares))


def expected_error(nodes: Floats) -> Floats:
    """Approximate error (n,) of the biquartic through nodes (n, 25, 2), in their unit."""
    return QUARTIC * _differences(nodes, DIFFERENCE_4)


def sag(nodes: Floats) -> Floats:
    """Approximate error (n,) of bilinear cells between the nodes (n, 25, 2), in their unit."""
    return _differences(nodes, DIFFERENCE_2) / 8


def parts_within(xy: Floats, *errors: float) -> list[Ints]:
    """Number of quads (c,) along the sides of smooth cells with nodes at display px (c, 25, 2), a
    power of two, for each of some errors, display px.
    """
    off = PARTS * np.sqrt(sag(xy))
    return [
        2 ** np.ceil(np.log2(np.clip(off / error**0.5, 1, MOST_PARTS))).astype(np.int64)
        for error in errors
    ]


def n_parts(xy: Floats, size: Ints, is_inside: Bools, tolerance: float) -> Ints:
    """Number of quads (c,) along the sides of smooth cells.

    Parameters
    ----------
    xy : (c, 25, 2) display px, of the nodes
    size : (c,) viewer px, side of the cells
    is_inside : (c,) a cell lies entirely in both images
    tolerance : display px
    """
    parts, cheap = parts_within(xy, OF_TOLERANCE * tolerance, CHEAP_ERROR_PX)
    parts = np.maximum(parts, np.minimum(cheap, size))

    # for the places: on flat glass, where one quad would keep the tolerance, only they keep the
    # picture sharp
    low, high = bounds_of(xy)
    span = (high - low).max(axis=1)
    per_pixel = np.maximum(span / (N_PLACES_FEW * size), 1.0)
    pixels = np.clip(N_PLACES * span, 1.0, size) / per_pixel
    parts = np.maximum(parts, 2 ** np.log2(np.maximum(pixels, 1.0)).astype(np.int64))

    # one for each pixel if the image folds or crosses the display's edge
    return np.where(is_inside & ~is_folded(xy), parts, np.maximum(parts, size))


def is_folded(nodes: Floats) -> np.ndarray:
    """Whether det J of cells (n,) with nodes (n, 25, 2) changes its sign, or comes near to it."""
    grid = nodes.reshape(len(nodes), NODES_ALONG, NODES_ALONG, 2)
    by_x = np.diff(grid, axis=2)
    by_y = np.diff(grid, axis=1)
    turn = [
        cross_2d(a, b)
        for a in (by_x[:, :-1], by_x[:, 1:])
        for b in (by_y[:, :, :-1], by_y[:, :, 1:])
    ]
    area = np.stack(turn, axis=1)

    return np.sign(area.min(axis=(1, 2, 3))) * np.sign(area.max(axis=(1, 2, 3))) <= 0


def bilinear(corners: Floats, place: Floats) -> Floats:
    """Points (n, 2) at places (n, 2), in 0..1, of quads (n, 4, 2)."""
    x = place[:, :1]
    y = place[:, 1:]
    a, b, c, d = np.moveaxis(corners, 1, 0)
    return (1 - y) * ((1 - x) * a + x * b) + y * ((1 - x) * d + x * c)
