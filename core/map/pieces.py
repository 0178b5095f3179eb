"""Quads and triangles of a view map, made when shares are needed, with squares around samples.

A sample represents all light of its stratum, but has one landing. If samples land far apart, and
from all over the view, a display pixel would show the colours of the few that happen to land in it,
or nothing. So each lights a square around its landing, wide enough for several to light each place:
a density estimate by nearest neighbours (Loftsgaarden and Quesenberry 1965; Silverman 1986, chapter
5). Light moves by half a width at most, and none is lost.

Samples that land close together and come from close together, as through facets with parts of the
picture side by side, must not mix their colours. The variance of their places on the view shows
this: it is less within small blocks of the display than in large ones there, but equal if light is
mixed. In such blocks, and where hardly any land, each sample lights only its pixel.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bools, Floats, Ints, mean_at, take, whole_within
from ..base.steps import Steps
from . import smooth_cells
from .points import Points, is_in_image

UNIT_SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
# Light between the nodes of a cell is limited to this factor below its faintest and above its
# brightest node: smooth light is far from it.
SWING = 2.0
TOGETHER = 16  # samples that light a place, about
MOST_PX = 16  # display px, side of the widest squares around samples, a power of two
LEAST_PX = 0.25  # display px, of samples that light their pixel alone
# light is mixed if the variance in smaller blocks is at least this fraction of a large block's,
# estimated with at least this many degrees of freedom
MIXED = 0.7
LEAST_FREE = 8


class Piece(NamedTuple):
    """Some pieces of a view map: quads or triangles.

    view, display : (n, 4 or 3, 2) corners, viewer px and display px
    throughput : (n,)
    branch : (n,) uint64, equal for pieces seen through the same surfaces
    beam : (n, 3, 2) of its light among the display's views, affine: derivatives by viewer px x and
        y, and the value at 0; None without views
    """

    view: Floats
    display: Floats
    throughput: Floats
    branch: NDArray[np.uint64]
    beam: Floats | None = None

    def at(self, which: Bools | Ints) -> "Piece":
        return Piece(*(None if values is None else take(values, which) for values in self))


def _affine(view: Floats, values: Floats | None) -> Floats | None:
    """The affine maps (n, 3, 2) nearest to values (n, k, 2) at viewer px (n, k, 2), constant where
    these are on a line; None for None.
    """
    if values is None:
        return None
    at, value = (x.mean(axis=1, keepdims=True) for x in (view, values))
    dx, dy = np.moveaxis(view - at, 2, 0)[..., None]
    by_x, by_y = ((d * (values - value)).sum(axis=1) for d in (dx, dy))
    xx, xy, yy = ((a * b).sum(axis=1) for a, b in ((dx, dx), (dx, dy), (dy, dy)))
    det = xx * yy - xy * xy
    scale = np.where(det > 1e-12 * xx * yy, 1 / np.where(det == 0, 1, det), 0.0)
    slopes = np.stack([yy * by_x - xy * by_y, xx * by_y - xy * by_x], axis=1) * scale[..., None]
    return np.concatenate([slopes, value - at @ slopes], axis=1)


def polygons(points: Points, corners: Ints) -> Piece:
    """Pieces with points (n, 4 or 3) as corners."""
    return Piece(
        view=take(points.view, corners),
        display=take(points.xy, corners),
        throughput=mean_at(points.throughput, corners),
        branch=points.branch[corners[:, 0]],
        beam=None
        if points.beam is None
        else _affine(take(points.view, corners), take(points.beam, corners)),
    )


def squares_around(
    samples: Points, area: Floats, width: Floats, display_size: tuple[int, int]
) -> Piece:
    """Squares with the area (n,), viewer px^2, of samples' strata around their places, and of some
    width (n,), display px, around their landings.

    They are clipped to the display, or to the landing's pixel if narrower than a pixel.
    """
    reach = width[:, None] / 2
    pixel = np.minimum(np.floor(samples.xy), np.array(display_size) - 1)
    first, last = (
        np.where(reach < 0.5, of_pixel, of_display)
        for of_pixel, of_display in ((pixel, 0), (pixel + 1, np.array(display_size)))
    )
    low, high = np.maximum(samples.xy - reach, first), np.minimum(samples.xy + reach, last)
    side = np.sqrt(area)[:, None, None]
    return Piece(
        view=samples.view[:, None] + side * (UNIT_SQUARE - 0.5),
        display=np.where(UNIT_SQUARE, high[:, None], low[:, None]),
        throughput=samples.throughput,
        branch=samples.branch,
        beam=None
        if samples.beam is None
        else np.pad(samples.beam[:, None], ((0, 0), (2, 0), (0, 0))),
    )


def kernel_widths(view: Floats, xy: Floats, display_size: tuple[int, int]) -> Steps[Floats]:
    """Sides (s,), display px, of the squares lit by samples at viewer px (s, 2) with landings at
    display px (s, 2); 0 for landings outside the display, or none. With pauses.
    """
    found = np.zeros(len(xy))
    lit = np.flatnonzero(is_in_image(xy, display_size))
    view = take(view, lit)
    columns, rows = display_size
    column, row = whole_within(take(xy, lit), (columns - 1, rows - 1))
    width = np.full(len(lit), LEAST_PX)
    most = np.full(len(lit), float(MOST_PX))
    yield 0

    # the smallest block around the landing with enough samples
    side = MOST_PX
    while side:
        x, y = column // side, row // side
        block = y * -(-columns // side) + x
        if side == MOST_PX:
            large, least_variance = block, MIXED * _variance(view, block, block)
        n = np.bincount(block)[block]
        has_many = n >= TOGETHER
        # the last blocks may extend beyond the display
        area = np.minimum(side, columns - side * x) * np.minimum(side, rows - side * y)
        width[has_many] = np.sqrt(area * TOGETHER / n)[has_many]
        yield 0
        most[(_variance(view, block, large) < least_variance)[large]] = side / 2
        side //= 2
        yield 0
    width = np.minimum(width, most)
    found[lit] = np.where(width > 0.5, np.minimum(width, min(display_size)), LEAST_PX)
    return found


def _variance(view: Floats, block: Ints, large: Ints) -> Floats:
    """Variance (l,) of viewer px (s, 2) within blocks (s,), over the blocks of each large one; NaN
    if unknown.

    large : (s,) number of the large block
    """
    n = np.maximum(np.bincount(block), 1)
    squared = sum((along - (np.bincount(block, along) / n)[block]) ** 2 for along in view.T)
    # a block of n samples has n - 1 degrees of freedom
    free = np.bincount(large, 1 - 1 / n[block])
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(free > LEAST_FREE - 0.5, np.bincount(large, squared) / free, np.nan)


def quads_of(points: Points, corner: Ints, size: Ints, nodes: Ints, m: int) -> Piece:
    """Quads of smooth cells, as many as m a side.

    corner, size, nodes : (n, 2), (n,) viewer px, (n, 25) indices of points
    """
    landed = smooth_cells.on_grid(take(points.xy, nodes), m)
    throughput = np.ones(len(nodes) * m * m)
    of_nodes = take(points.throughput, nodes)
    if (of_nodes != 1).any():
        # quartics overshoot their nodes where light falls steeply, possibly below 0
        faintest, brightest = (of(of_nodes, axis=1)[:, None, None] for of in (np.min, np.max))
        on_grid = smooth_cells.on_grid(of_nodes[..., None], m)[..., 0]
        on_grid = np.clip(on_grid, faintest / SWING, brightest * SWING)
        throughput = sum(_corners_of(on_grid)).ravel() / 4

    along = size[:, None] * (np.arange(m + 1) / m)
    view = np.empty((len(size), m + 1, m + 1), complex)
    view.real = (corner[:, :1] + along)[:, None]
    view.imag = (corner[:, 1:] + along)[:, :, None]

    quads, beam = _quads_between(view), None
    if points.beam is not None:
        of_grid = smooth_cells.on_grid(take(points.beam, nodes), m)
        beam = _affine(quads, _quads_between(of_grid.view(complex)[..., 0]))
    return Piece(
        view=quads,
        display=_quads_between(landed.view(complex)[..., 0]),
        throughput=throughput,
        branch=np.repeat(points.branch[nodes[:, 0]], m * m),
        beam=beam,
    )


def _quads_between(points: NDArray[np.complex128]) -> Floats:
    """Quads (n m^2, 4, 2) between the points x + i y of grids (n, m + 1, m + 1), corners in order.

    numpy copies complex numbers several times as fast as pairs of numbers.
    """
    n, m = len(points), points.shape[1] - 1
    quads = points.reshape(n, (m + 1) ** 2).take(_corners_between(m), axis=1, mode="wrap")
    return quads.view(float).reshape(-1, 4, 2)


@lru_cache(8)
def _corners_between(m: int) -> Ints:
    """Numbers (4 m^2,) of the corners, in order, of the quads in a grid of points."""
    number = np.arange((m + 1) ** 2).reshape(1, m + 1, m + 1)
    return np.stack(_corners_of(number), axis=3).ravel()


def _corners_of(grid: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Values (n, m, m) at each corner, in order, of the quads in grids (n, m + 1, m + 1)."""
    return grid[:, :-1, :-1], grid[:, :-1, 1:], grid[:, 1:, 1:], grid[:, 1:, :-1]
