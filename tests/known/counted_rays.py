"""How many rays start in each pixel of a viewer: those that are asked of it, and those that the
kernel lets start when it bisects edges.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from kiriko.core.light.kernel_tracer import Kernel
from kiriko.core.light.plan import Ends, Halving
from kiriko.core.rig.rig import Viewer


@contextmanager
def counted_rays(viewer: Viewer) -> Iterator[NDArray[np.int64]]:
    """Count the rays (h + 1, w + 1) that start in each pixel of a viewer like this one meanwhile.

    Places on the lower and the right border are in one more row and column.
    """
    width, height = viewer.width, viewer.height
    counts = np.zeros((height + 1, width + 1), np.int64)
    rays_of, bisect_of = Viewer.rays, Kernel.bisect

    def count(xy: NDArray) -> None:
        column, row = np.clip(np.floor(xy), 0, (width, height)).astype(np.int64).T
        counts.ravel()[:] += np.bincount(row * (width + 1) + column, minlength=counts.size)

    def rays(viewer: Viewer, xy: NDArray) -> tuple[NDArray, NDArray]:
        count(xy)
        return rays_of(viewer, xy)

    def bisect(self: Kernel, plan: object, edges: Halving) -> Iterator[int]:
        ends = yield from bisect_of(self, plan, edges)
        for xy in _tried(edges, ends):
            count(xy)
        return ends

    Viewer.rays, Kernel.bisect = rays, bisect
    try:
        yield counts
    finally:
        Viewer.rays, Kernel.bisect = rays_of, bisect_of


def _tried(edges: Halving, ends: Ends) -> Iterator[NDArray]:
    """The places (k, 2) that were tried one after the other: a place was on its branch where the
    last one is no nearer to the start.
    """
    low, width = np.zeros_like(edges.begun.low), edges.begun.width.copy()
    n_tried = np.zeros_like(ends.n_tried)

    def places(some: NDArray, part: NDArray) -> NDArray:
        n_tried[some] += 1
        holds = some & (ends.low >= part)
        low[holds] = part[holds]
        return edges.start[some] + part[some, None] * edges.way[some]

    # where they are likely to end, then halves
    first = width.copy()
    yield places(first < 1, first)
    width[(first < 1) & (low == first)] = 0
    while (width > edges.least).any():
        some = width > edges.least
        width[some] /= 2
        yield places(some, low + width)

    assert np.array_equal(n_tried, ends.n_tried)
