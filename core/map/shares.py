"""Shares: from which parts of the viewer's image each display pixel is seen.

A cell is a small polygon on the viewer's image together with its image on the display. It
makes a share for each display pixel that its image covers a part of (rasterise.py).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, taken
from ..native import loading
from . import native_divide


@dataclass(frozen=True, eq=False)
class Shares:
    """The sparse matrix between viewer and display: one entry for
    each part of a cell that lies in one display pixel.

    Parameters
    ----------
    display_size, view_size : (width, height), px
    display_index : (n,) int32 or int64, row * width + column on the display, row 0 at the top
    view_xy : (n, 2) float64, viewer px, centroid on the viewer's image. Double precision, because a
        share may be a thousandth of a pixel wide, and single precision resolves only 2e-4 px at
        4096.
    covariance : (3, n) float32, viewer px^2: xx, xy and yy of the share's points on the viewer's
        image, evenly spread. It tells how far a share reaches in which direction.
    area : (n,) float64, viewer px^2, area on the viewer's image
    display_area : (n,) float64, display px^2, area on the display
    throughput : (n,) float64, or None where it is 1 everywhere
    path : (n,) uint64, the way that light takes, or None where nobody asked
    """

    display_size: tuple[int, int]
    view_size: tuple[int, int]
    display_index: NDArray[np.integer]
    view_xy: Floats
    covariance: NDArray[np.float32]
    area: Floats
    display_area: Floats
    throughput: Floats | None = None
    path: NDArray[np.uint64] | None = None

    def at(self, which: NDArray) -> "Shares":
        """Some of these shares."""

        def some(values: NDArray | None) -> NDArray | None:
            return None if values is None else values[..., which]

        return Shares(
            self.display_size,
            self.view_size,
            self.display_index[which],
            taken(self.view_xy, which),
            *(
                some(v)
                for v in (self.covariance, self.area, self.display_area, self.throughput, self.path)
            ),
        )

    def __len__(self) -> int:
        return len(self.area)

    @property
    def weight(self) -> Floats:
        """How much (n,) each counts in its display pixel: area * throughput^2, viewer px^2."""
        return self.area if self.throughput is None else self.area * self.throughput**2

    @property
    def view_index(self) -> NDArray[np.integer]:
        """Viewer pixel (n,) int32 or int64 that holds each share's centroid: row * width
        + column.
        """
        width, height = self.view_size
        column, row = self.view_xy.T.astype(index_type(self.view_size))
        return np.clip(row, 0, height - 1) * width + np.clip(column, 0, width - 1)


class Coverage:
    """How much display and viewer see of each other: sums over
    shares, all of which are added before it is asked.

    weight : (H, W) sum of the weights of the shares that each display pixel shows, viewer px^2
    """

    def __init__(self, display_size: tuple[int, int], view_size: tuple[int, int]) -> None:
        self.weight, self._display, self._view = (
            np.zeros(size[::-1]) for size in (display_size, display_size, view_size)
        )

    def add(self, shares: Shares, shown: Shares | None = None) -> None:
        """Add some of the shares.

        Shown : those of them that the display shows, where it does not show all.
        """
        shown = shares if shown is None else shown
        if loading.library() is not None:
            native_divide.add(
                (self.weight, shown.display_index, shown.weight),
                (self._display, shares.display_index, shares.display_area),
                (self._view, shares.view_xy, shares.area),
            )
            return
        add_at(self.weight, shown.display_index, shown.weight)
        add_at(self._display, shares.display_index, shares.display_area)
        add_at(self._view, shares.view_index, shares.area)

    @cached_property
    def of_display(self) -> Floats:
        """Part (H, W) of each display pixel that the viewer sees, 0..1.

        Areas seen several times count once.
        """
        return np.minimum(self._display, 1.0, out=self._display)

    @cached_property
    def of_view(self) -> Floats:
        """Part (h, w) of each viewer pixel that is connected to the display, 0..1."""
        return np.minimum(self._view, 1.0, out=self._view)


def add_at(image: Floats, index: NDArray[np.integer], weights: NDArray[np.floating]) -> None:
    """Add weights (n,) to the pixels (n,) of an image (h, w): row * width + column."""
    if native_divide.can_add(image, index, weights):
        native_divide.add((image, index, weights))
    elif len(index):
        # a batch of shares may lie in a few rows of a large image
        first = int(index.min())
        last = int(index.max())
        image.reshape(-1)[first : last + 1] += np.bincount(index - first, weights)


def index_type(size: tuple[int, int]) -> type[np.signedinteger]:
    """The integers that number the pixels of an image of a size (width, height)."""
    return np.int32 if size[0] * size[1] <= np.iinfo(np.int32).max else np.int64
