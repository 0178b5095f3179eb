"""Quads and triangles, of which a view map is made where shares are asked for."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bools, Floats, Ints, mean_at, taken
from . import interpolation
from .points import Points

UNIT_SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])  # its corners
# Light between the nodes of a cell is taken to be so many times as faint as at the faintest, or as
# bright as at the brightest, and no more: smooth light is far from it.
SWING = 2.0


class Piece(NamedTuple):
    """Some pieces of a view map: quads or triangles.

    view, display : (n, 4 or 3, 2) corners, viewer px and display px; throughput : (n,)
    branch : (n,) uint64, the same for all that show the display by way of the same surfaces
    """

    view: Floats
    display: Floats
    throughput: Floats
    branch: NDArray[np.uint64]

    def at(self, which: Bools | Ints) -> "Piece":
        """Some of these pieces."""
        return Piece(*(taken(values, which) for values in self))


def polygons(points: Points, corners: Ints) -> Piece:
    """Pieces with these points (n, 4 or 3) as corners."""
    return Piece(
        view=taken(points.view, corners),
        display=taken(points.xy, corners),
        throughput=mean_at(points.throughput, corners),
        branch=points.branch[corners[:, 0]],
    )


def squares_around(
    samples: Points, area: Floats, width: Floats, display_size: tuple[int, int]
) -> Piece:
    """Squares around samples (n,) as large as their strata (n,), viewer px^2, and around their
    landings, so wide (n,), display px: as far as these lie in the display, or, where they are
    narrower than a pixel, in that pixel.
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
    )


def quads_of(points: Points, corner: Ints, size: Ints, nodes: Ints, m: int) -> Piece:
    """Quads of smooth cells, as many as m a side.

    corner, size, nodes : (n, 2), (n,) viewer px, (n, 25) indices of points
    """
    # landings and throughput on a grid of each cell
    values = np.concatenate([taken(points.xy, nodes), points.throughput[nodes][..., None]], axis=2)
    landed = interpolation.on_grid(values, m)

    # where light falls steeply, quartics swing beyond their nodes, and might swing below nothing
    faintest, brightest = (of(values[..., 2], axis=1)[:, None, None] for of in (np.min, np.max))
    throughput = np.clip(landed[..., 2], faintest / SWING, brightest * SWING)

    along = size[:, None] * (np.arange(m + 1) / m)
    view = np.empty((len(size), m + 1, m + 1), complex)
    view.real = (corner[:, :1] + along)[:, None]
    view.imag = (corner[:, 1:] + along)[:, :, None]

    return Piece(
        view=_quads_between(view),
        display=_quads_between(landed[..., :2].view(complex)[..., 0]),
        throughput=sum(_corners_of(throughput)).ravel() / 4,
        branch=np.repeat(points.branch[nodes[:, 0]], m * m),
    )


def _quads_between(points: NDArray[np.complex128]) -> Floats:
    """Quads (n m^2, 4, 2) between the points x + i y of grids (n, m + 1, m + 1), corners in order.

    numpy copies points as complex numbers several times as fast as pairs of numbers.
    """
    n, m = len(points), points.shape[1] - 1
    quads = points.reshape(n, (m + 1) ** 2).take(_corners_between(m), axis=1, mode="wrap")
    return quads.view(float).reshape(-1, 4, 2)


@lru_cache(8)
def _corners_between(m: int) -> Ints:
    """Numbers (4 m^2,) of the corners, in order, of the quads between the points of a grid."""
    number = np.arange((m + 1) ** 2).reshape(1, m + 1, m + 1)
    return np.stack(_corners_of(number), axis=3).ravel()


def _corners_of(grid: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Values (n, m, m) at each corner, in order, of quads between those of grids
    (n, m + 1, m + 1).
    """
    return grid[:, :-1, :-1], grid[:, :-1, 1:], grid[:, 1:, 1:], grid[:, 1:, :-1]
