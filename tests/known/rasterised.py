"""Shares of cells all at once, and sums over them: the tests' and benches' way in."""

import numpy as np
from numpy.typing import NDArray

from kiriko.core.base.arrays import Floats
from kiriko.core.map.native_divide import index_type
from kiriko.core.map.shares import Lot, Shares, divided, joined


def rasterise(
    display_size: tuple[int, int],
    view_size: tuple[int, int],
    view_polygons: Floats,
    display_polygons: Floats,
    throughput: Floats | None = None,
) -> Shares:
    """Find which display pixels each cell covers, and by how much.

    Parameters
    ----------
    display_size, view_size : (width, height), px
    view_polygons : (m, k, 2) float64, viewer px; k = 3 or 4,
        convex, corners in order, either way round
    display_polygons : (m, k, 2) float64, display px; images of the same corners, either way round.
        A polygon with a coordinate that is not finite is left out.
    throughput : (m,) float64 or None
    """
    sizes = display_size, view_size
    parts = (
        part for _, part in divided(*sizes, [Lot(view_polygons, display_polygons, throughput)])
    )
    return joined([no_shares(*sizes, throughput is not None), *parts])


def to_display(
    shares: Shares, values: NDArray[np.floating], weights: Floats | None = None
) -> Floats:
    """Sum area * weight * value over the shares of each display pixel.

    Parameters
    ----------
    values : (n,) or (n, c), one for each share
    weights : (n,) or None (1), for instance the throughput

    Returns
    -------
    (height, width) or (height, width, c) float64, row 0 at
    the top, viewer px^2 times the values' unit
    """
    return _sums_by(
        shares.display_index, shares.display_size, _weighted(shares.area, weights), values
    )


def to_view(shares: Shares, values: NDArray[np.floating], weights: Floats | None = None) -> Floats:
    """Sum area * weight * value over the shares of each
    viewer pixel; the transpose of `to_display`.

    Parameters and result are those of `to_display`, for the viewer's image.
    """
    return _sums_by(shares.view_index, shares.view_size, _weighted(shares.area, weights), values)


def _weighted(area: Floats, weights: Floats | None) -> Floats:
    return area if weights is None else area * weights


def _sums_by(
    index: NDArray[np.integer], size: tuple[int, int], weights: Floats, values: NDArray
) -> Floats:
    """Sum weights * values (n,) or (n, c) by pixel of an image of a size (width, height)."""
    width, height = size
    channels = [
        np.bincount(index, weights * channel, width * height)
        for channel in values.reshape(len(index), -1).T
    ]
    return np.stack(channels, axis=-1).reshape(height, width, *values.shape[1:])


def no_shares(
    display_size: tuple[int, int], view_size: tuple[int, int], has_throughput: bool
) -> Shares:
    none = np.empty(0)
    index = np.empty(0, index_type(display_size))
    place = np.empty((0, 2))
    covariance = np.empty((3, 0), np.float32)
    throughput = none if has_throughput else None
    return Shares(display_size, view_size, index, place, covariance, none, none, throughput)
