"""How many rays start in each pixel of a viewer."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from kiriko.core.rig import Viewer


@contextmanager
def counted_rays(viewer: Viewer) -> Iterator[NDArray[np.int64]]:
    """Count the rays (h + 1, w + 1) that start in each pixel of a viewer like this one meanwhile.

    Places on the lower and the right border are in one more row and column.
    """
    width, height = viewer.width, viewer.height
    counts = np.zeros((height + 1, width + 1), np.int64)
    rays_of = Viewer.rays

    def rays(viewer: Viewer, xy: NDArray) -> tuple[NDArray, NDArray]:
        column, row = np.clip(np.floor(xy), 0, (width, height)).astype(np.int64).T
        counts.ravel()[:] += np.bincount(row * (width + 1) + column, minlength=counts.size)
        return rays_of(viewer, xy)

    Viewer.rays = rays
    try:
        yield counts
    finally:
        Viewer.rays = rays_of
