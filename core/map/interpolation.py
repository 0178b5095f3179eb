"""Cells of the viewer's image on which the view map is
smooth: biquartic through 5 x 5 traced nodes.

Nodes are numbered row by row from the upper left corner, a quarter of the cell's side apart.
"""

from functools import cache, reduce

import numpy as np

from ..base.arrays import Floats, Ints
from ..base.vectors import cross_2d

NODES_ALONG = 5  # nodes along a side: quartics
PARTS = NODES_ALONG - 1  # a cell's side in steps between nodes
COLUMN, ROW = (axis.ravel() for axis in np.meshgrid(np.arange(NODES_ALONG), np.arange(NODES_ALONG)))
# Where x (x - 1) ... (x - 4) is largest, as a part of the side, the interpolation errs most. The
# first two places differ in x only, in which the error is odd: errors along x and y do not cancel
# at both. The others are for what is not smooth within a cell, most often the edges of the mesh's
# faces: anywhere between the nodes that the first leave.
_WORST = 0.3555671 / PARTS
CHECKS = np.array(
    [[_WORST, _WORST], [1 - _WORST, _WORST], [0.4, 0.9], [0.62, 0.6], [0.11, 0.63], [0.9, 0.87]]
)
# The error of a quartic is that largest value, 3.63, times the fifth derivative / 5!. Of the fifth
# differences nothing is known: where the map is steep, beside grazing rays, they were found to be
# up to three times the fourth.
QUARTIC = 3 * 3.6314 / 120
DIFFERENCE_2 = np.array([1.0, -2.0, 1.0])
DIFFERENCE_4 = np.array([1.0, -4.0, 6.0, -4.0, 1.0])


def weights(t: Floats) -> Floats:
    """Lagrange's weights (..., 5) of five nodes along a side at places t (...) in 0..1."""
    x = PARTS * np.asarray(t, float)
    off = [x - j for j in range(NODES_ALONG)]
    found = np.empty((*x.shape, NODES_ALONG))
    for k in range(NODES_ALONG):
        others = (off[j] / (k - j) for j in range(NODES_ALONG) if j != k)
        found[..., k] = reduce(np.multiply, others)
    return found


@cache
def _to_grid(m: int) -> Floats:
    """Lagrange's weights (m + 1, 5) of a grid of m parts whose chords are right on average.

    A chord between points of a curve is off it to one side, by h^2 f'' / 12 on average. Points that
    are moved by that, a twelfth of the second difference, have chords that are off as far to either
    side. The ends stay: neighbours with other grids have them, too.
    """
    matrix = weights(np.arange(m + 1) / m)
    matrix[1:-1] -= np.diff(matrix, n=2, axis=0) / 12
    return matrix


def at_places(nodes: Floats, places: Floats) -> Floats:
    """Values (n, c) at places (n, 2), x and y in 0..1, of
    cells with values (n, 25, c) at their nodes.
    """
    return _weighed(nodes, *(weights(along) for along in places.T))


def at_checks(nodes: Floats) -> Floats:
    """Values (n, 6, c) at the places of CHECKS, as by `at_places`."""
    n, _, c = nodes.shape
    found = np.empty((n, len(CHECKS), c))
    for k, (by_x, by_y) in enumerate(weights(CHECKS)):
        both = (np.broadcast_to(by, (n, NODES_ALONG)) for by in (by_x, by_y))
        found[:, k] = _weighed(nodes, *both)
    return found


def _weighed(nodes: Floats, by_x: Floats, by_y: Floats) -> Floats:
    """Values (n, c) of cells with values (n, 25, c), by weights (n, 5) along x and y."""
    n, _, c = nodes.shape
    along_x = np.einsum("ni,njic->njc", by_x, nodes.reshape(n, NODES_ALONG, NODES_ALONG, c))
    return np.einsum("nj,njc->nc", by_y, along_x)


def on_grid(nodes: Floats, m: int) -> Floats:
    """Values (n, m + 1, m + 1, c) on a grid of m parts a side, rows first, of cells with values
    (n, 25, c): the corners of bilinear parts that are right on average, as far as they are not on
    the cell's border.
    """
    n, _, c = nodes.shape
    matrix = _to_grid(m)
    rows = np.matmul(matrix, nodes.reshape(n, NODES_ALONG, NODES_ALONG * c))
    return np.matmul(matrix, rows.reshape(n * (m + 1), NODES_ALONG, c)).reshape(n, m + 1, m + 1, c)


def _differences(nodes: Floats, stencil: Floats) -> Floats:
    """Largest length (n,) of differences along rows and columns of values (n, 25, 2)."""
    n = len(nodes)
    # cells last: numpy is slow where rows are a few numbers long
    grid = np.ascontiguousarray(nodes.reshape(n, 2 * NODES_ALONG**2).T)
    grid = grid.reshape(NODES_ALONG, NODES_ALONG, 2, n)
    last = NODES_ALONG - len(stencil) + 1
    along_x = sum(weight * grid[:, k : k + last] for k, weight in enumerate(stencil))
    along_y = sum(weight * grid[k : k + last] for k, weight in enumerate(stencil))
    squares = [(d * d).sum(axis=2).max(axis=(0, 1)) for d in (along_x, along_y)]
    return np.sqrt(np.maximum(*squares))


def expected_error(nodes: Floats) -> Floats:
    """About how far (n,) the biquartic through nodes (n, 25, 2) is off, in their unit."""
    return QUARTIC * _differences(nodes, DIFFERENCE_4)


def sag(nodes: Floats) -> Floats:
    """About how far (n,) bilinear cells between the nodes (n, 25, 2) are off, in their unit."""
    return _differences(nodes, DIFFERENCE_2) / 8


def parts_for(off: Floats, allowed: float, most: int) -> Ints:
    """Into how many parts (n,) a side is to be cut, a power of two, so that bilinear cells are off
    by less, which are off by so much (n,) between the nodes.
    """
    parts = PARTS * np.sqrt(off / allowed)
    return 2 ** np.ceil(np.log2(np.clip(parts, 1, most))).astype(np.int64)


def is_folded(nodes: Floats) -> np.ndarray:
    """Does det J of cells (n,) with nodes (n, 25, 2) change its sign, or come near to it?"""
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
