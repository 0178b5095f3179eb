"""Ray budget of each viewer pixel: a multiple of Effort, the same for any glass.

If the display has more pixels than the viewer's image, the budget counts for each display pixel of
a viewer pixel: fewer rays, and samples in place of cells, would leave holes between them.

Rays are counted where they start. Before borders are searched, or a cell is quartered, the largest
number of rays in each pixel is computed; if fewer are left, none of them is traced. The bound holds
for every pixel, and sampling in one depends on no other part of the view, no batch and no machine.
"""

import numpy as np

from ..base.arrays import Bools, Floats, Ints, whole_within
from ..light.plan import Plan

TIMES_EFFORT = 24  # rays, for each display pixel of a viewer pixel
# reserved for rays that make no map: to measure it, and to look for glare
OTHER_RAYS = 4
N_QUARTERS = 4  # of a pixel: one ray each if it is sampled


def most_rays(plan: Plan) -> int:
    """Largest number of rays a viewer pixel of a plan may take."""
    viewer, display = plan.viewer, plan.rig.display
    ratio = display.width * display.height // (viewer.width * viewer.height)
    return TIMES_EFFORT * plan.settings.effort * max(1, ratio)


class RayBudget:
    """Rays left to each viewer pixel, with a reserve for samples."""

    def __init__(self, plan: Plan, view: Floats) -> None:
        """The budget after rays at viewer px (n, 2)."""
        viewer = plan.viewer
        self.size = (viewer.width, viewer.height)
        self.reserve = max(plan.settings.samples_along**2, N_QUARTERS)

        most = most_rays(plan) - OTHER_RAYS
        # places on the lower and the right border belong to pixels beyond
        self.left = np.full((viewer.width + 1) * (viewer.height + 1), most, np.int64)
        self.take(view)

    def take(self, view: Floats, n_rays: Ints | int = 1) -> None:
        """Count rays (n,) at viewer px (n, 2), traced now or later."""
        n_rays = np.broadcast_to(n_rays, len(view))
        np.subtract.at(self.left, self._pixel(view), n_rays)

    def exceeds(self, view: Floats, n_rays: Ints | int = 1) -> Bools:
        """Mask of rays (n,) at viewer px (n, 2) beyond the budget of their pixel, served row by
        row.
        """
        pixel = self._pixel(view)
        n_rays = np.broadcast_to(n_rays, len(view))
        # the order matters only in pixels with too many in total
        in_all = np.bincount(pixel, n_rays)
        some = np.flatnonzero(in_all[pixel] > self.left[pixel] - self.reserve)
        order = some[np.lexsort((*view[some].T, pixel[some]))]
        pixel = pixel[order]
        total = np.cumsum(n_rays[order])
        before = np.append(0, total)[np.searchsorted(pixel, pixel)]

        found = np.zeros(len(view), bool)
        found[order] = total - before > self.left[pixel] - self.reserve
        return found

    def _pixel(self, view: Floats) -> Ints:
        """Numbers (n,) of the pixels at viewer px (n, 2)."""
        column, row = whole_within(view, self.size)
        return row * (self.size[0] + 1) + column
