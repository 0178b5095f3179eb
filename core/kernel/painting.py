"""Paints shares straight from a picture, as `find_strokes` and
`Painting` of `source_image.py` do by way of taps.
"""

import ctypes
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..arrays import Floats
from .loading import loaded, n_threads
from .structures import LevelStructure, Made, StrokesStructure

if TYPE_CHECKING:
    from ..image.flat_picture import FlatWay
    from ..map.shares import Shares


class FlatStrokes:
    """Shares and the way from the viewer's image to a flat
    picture: colours are read whenever they are painted.

    Parameters
    ----------
    way : from the viewer's pixels to the picture's UV
    size : (width, height) of the picture, px
    """

    def __init__(self, shares: "Shares", way: "FlatWay", size: tuple[int, int]) -> None:
        self.made = made = Made(StrokesStructure)

        is_wide = shares.display_index.dtype == np.int64
        made.point(
            "wide_pixel" if is_wide else "pixel",
            shares.display_index,
            np.int64 if is_wide else np.int32,
        )
        made.point("view_xy", shares.view_xy, float)
        made.point("covariance", shares.covariance, np.float32)
        made.point("area", shares.area, float)
        made.point("throughput", shares.throughput, float)
        made.set(
            n=len(shares),
            matrix=way.matrix,
            low=way.low,
            high=way.high,
            size=np.array(size, float),
        )


def paint(total: Floats, levels: Sequence[NDArray[np.float32]], strokes: FlatStrokes) -> None:
    """Add area * throughput * colour of shares to the sums (3, H, W) of display pixels.

    Parameters
    ----------
    levels : of the picture at full, half, quarter ... size, (3, h, w) float32 each, in one piece
    """
    made = (LevelStructure * len(levels))()
    for of_level, pixels in zip(made, levels, strict=True):
        of_level.pixels = pixels.ctypes.data
        of_level.height, of_level.width = pixels.shape[1:]
    structures = ctypes.addressof(strokes.made.structure), ctypes.addressof(made)
    loaded().kiriko_paint(*structures, len(levels), total.ctypes.data, total[0].size, n_threads())
