"""Paints shares from a flat picture with the compiled kernel, as numpy does with taps."""

import ctypes
import weakref
from collections.abc import Sequence
from math import inf

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from ..map.shares import Shares
from ..native.image_passes import of_levels
from ..native.loading import loaded, n_threads
from ..native.structures import BYTES_OF_TAP, FlatTapsStructure, KeptTapsStructure, Made
from .flat_picture import FlatMapping

MOST_PIXELS = 1 << 31  # largest display with kept taps


class KeptTaps:
    """Taps in the kernel's memory."""

    def __init__(self) -> None:
        self.structure = KeptTapsStructure()
        self.at = ctypes.addressof(self.structure)
        weakref.finalize(self, _free, self.structure)

    @property
    def n_bytes(self) -> int:
        return BYTES_OF_TAP * sum(self.structure.n)

    @property
    def are_whole(self) -> bool:
        """Whether memory was enough for all of them."""
        return min(self.structure.room) >= 0


def _free(structure: ctypes.Structure) -> None:
    loaded().kiriko_free_taps(ctypes.addressof(structure))


class FlatTaps:
    """Shares and the mapping from the viewer's image to a flat picture.

    The first painting computes the taps; for the next picture it keeps them instead of the shares.

    Parameters
    ----------
    mapping : from the viewer's pixels to the picture's UV
    size : (width, height) of the picture, px
    """

    def __init__(self, shares: Shares, mapping: FlatMapping, size: tuple[int, int]) -> None:
        self.made: Made | None = Made(FlatTapsStructure)
        self.kept: KeptTaps | None = None

        made, index = self.made, shares.display_index
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

    @property
    def n_bytes(self) -> float:
        """Bytes of kept taps; infinite without room for them."""
        return inf if self.kept is None else self.kept.n_bytes


def paint(
    total: Floats, levels: Sequence[NDArray[np.float32]], flat_taps: FlatTaps, are_kept: bool
) -> None:
    """Add area * throughput * colour of shares to the sums (3, H, W) of display pixels.

    Kept taps give bit-identical sums.

    Parameters
    ----------
    levels : the picture at full, half, quarter ... size, (h, w, 4) float32 each, with contiguous
        rows; three channels are used
    are_kept : whether to keep the taps
    """
    structures = of_levels(levels)
    at = ctypes.addressof(structures)
    canvas = total.ctypes.data, total[0].size
    if flat_taps.kept is not None:
        loaded().kiriko_repaint(flat_taps.kept.at, at, *canvas, n_threads())
        return

    kept = KeptTaps() if are_kept and total[0].size < MOST_PIXELS else None
    shares = ctypes.addressof(flat_taps.made.structure)
    to_keep = kept and kept.at
    loaded().kiriko_paint(shares, at, len(levels), *canvas, to_keep, n_threads())
    if kept is not None and kept.are_whole:
        flat_taps.kept, flat_taps.made = kept, None
