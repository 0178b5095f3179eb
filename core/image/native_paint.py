"""Paints shares from a flat picture with the compiled kernel, as numpy does with taps."""

import ctypes
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from ..base.free_memory import available
from ..map.shares import Shares
from ..native.image_passes import of_levels
from ..native.loading import loaded, n_threads
from ..native.structures import TAP, FlatTapsStructure, Made
from .flat_picture import FlatMapping

STRIPE = 1024  # display pixels per unit of a thread's work
MOST_PIXELS = 1 << 31  # largest display with cached taps
STAYS_FREE = 1 << 30  # bytes kept free, as cached taps only save time


class FlatTaps:
    """Shares and the mapping from the viewer's image to a flat picture.

    The first painting computes the taps and discards them. A second painting suggests many more, as
    for a moving picture, so it caches the taps and drops the shares.

    Parameters
    ----------
    mapping : from the viewer's pixels to the picture's UV
    size : (width, height) of the picture, px
    """

    def __init__(self, shares: Shares, mapping: FlatMapping, size: tuple[int, int]) -> None:
        self.made = made = Made(FlatTapsStructure)
        self.is_painted = False
        self.taps: NDArray[np.void] | None = None
        self.first = np.zeros(1, np.int64)  # first tap of each stripe, and the total

        index = shares.display_index
        self.span = (int(index.min()), int(index.max()) + 1) if len(index) else (0, 0)
        is_wide = index.dtype == np.int64
        made.point(
            "wide_pixel" if is_wide else "pixel",
            index,
            np.int64 if is_wide else np.int32,
        )
        made.point("view_xy", shares.view_xy, float)
        # rows may be apart in a larger buffer
        covariance = np.asarray(shares.covariance, np.float32)
        if covariance.strides[1] != covariance.itemsize:
            covariance = np.ascontiguousarray(covariance)
        made.keep(covariance)
        made.point("area", shares.area, float)
        made.point("throughput", shares.throughput, float)
        made.set(
            n=len(shares),
            covariance=covariance.ctypes.data,
            apart=covariance.strides[0] // covariance.itemsize,
            matrix=mapping.matrix,
            low=mapping.low,
            high=mapping.high,
            size=np.array(size, float),
        )


def paint(total: Floats, levels: Sequence[NDArray[np.float32]], flat_taps: FlatTaps) -> None:
    """Add area * throughput * colour of shares to the sums (3, H, W) of display pixels.

    Cached taps give bit-identical sums.

    Parameters
    ----------
    levels : the picture at full, half, quarter ... size, (h, w, 4) float32 each, with contiguous
        rows; three channels are used
    """
    structures = of_levels(levels)
    canvas = total.ctypes.data, total[0].size, n_threads()
    if flat_taps.is_painted and flat_taps.taps is None and total[0].size < MOST_PIXELS:
        _store_taps(flat_taps, structures, total[0].size)
    flat_taps.is_painted = True

    at = ctypes.addressof(structures)
    if flat_taps.taps is None:
        structure = ctypes.addressof(flat_taps.made.structure)
        loaded().kiriko_paint(structure, at, len(levels), *canvas)
    else:
        first = flat_taps.first.ctypes.data, len(flat_taps.first) - 1
        loaded().kiriko_paint_taps(flat_taps.taps.ctypes.data, *first, at, *canvas)


def _store_taps(flat_taps: FlatTaps, structures: ctypes.Array, n_pixels: int) -> None:
    """Compute the taps of shares for levels of these sizes, each display pixel's in the order of
    its shares, and drop the shares.
    """
    low, high = np.clip(flat_taps.span, 0, n_pixels)
    if low >= high:
        return
    n = np.zeros(high - low, np.int64)
    arguments = (
        ctypes.addressof(flat_taps.made.structure),
        ctypes.addressof(structures),
        len(structures),
    )

    def find(taps: int | None) -> None:
        into = n.ctypes.data, int(low), taps
        loaded().kiriko_find_taps(*arguments, n_pixels, *into, n_threads())

    find(None)
    ends = np.cumsum(n)
    free = available()
    if free is not None and TAP.itemsize * ends[-1] > free - STAYS_FREE:
        return
    flat_taps.taps = np.empty(ends[-1], TAP)
    flat_taps.first = np.concatenate([[0], ends[STRIPE - 1 : -1 : STRIPE], ends[-1:]])
    np.subtract(ends, n, out=n)  # now the index of each pixel's next tap
    find(flat_taps.taps.ctypes.data)
    flat_taps.made = Made(FlatTapsStructure)
