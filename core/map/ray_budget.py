"""How many rays may a viewer pixel take? So many times Effort, whatever the glass is.

Where the display has more pixels than the viewer's image they are for each of those that there are
for a viewer's pixel: fewer, and samples in the place of cells, would leave holes between them.

Rays are counted where they start. Before borders are looked for, or a cell is quartered, the most
rays are known that this takes in each pixel; where they are more than are left, no ray of them is
traced. So the bound holds for every pixel, and what is sampled instead depends on no other part of
the view, on no batch and on no machine.
"""

import numpy as np

from ..base.arrays import Bools, Floats, Ints, whole_within
from ..light.plan import Plan

TIMES_EFFORT = 24  # rays, for each display pixel that there is for one of the viewer
# of these, for rays that make no map: those that measure it, and look for glare
APART = 4
N_QUARTERS = 4  # of a pixel: where it is sampled, each takes a ray


def most_rays(plan: Plan) -> int:
    """The most rays that a viewer pixel of a plan may take."""
    viewer, display = plan.viewer, plan.rig.display
    ratio = display.width * display.height // (viewer.width * viewer.height)
    return TIMES_EFFORT * plan.settings.effort * max(1, ratio)


class RayBudget:
    """The rays that are left to each viewer pixel, and those of them that are kept for samples."""

    def __init__(self, plan: Plan, view: Floats) -> None:
        """After rays at viewer px (n, 2)."""
        viewer = plan.viewer
        self.size = (viewer.width, viewer.height)
        self.kept = max(plan.settings.samples_along**2, N_QUARTERS)

        most = most_rays(plan) - APART
        # places on the lower and the right border are those of pixels beyond
        self.left = np.full((viewer.width + 1) * (viewer.height + 1), most, np.int64)
        self.take(view)

    def take(self, view: Floats, n_rays: Ints | int = 1) -> None:
        """Rays (n,) at viewer px (n, 2) are traced, or will be."""
        n_rays = np.broadcast_to(n_rays, len(view))
        np.subtract.at(self.left, self._pixel(view), n_rays)

    def lacks(self, view: Floats, n_rays: Ints | int = 1) -> Bools:
        """Which rays (n,) at viewer px (n, 2) are more than their pixel has left, if each pixel
        takes them row by row?
        """
        pixel = self._pixel(view)
        n_rays = np.broadcast_to(n_rays, len(view))
        # only where all that a pixel is asked for is too much does it matter which comes first
        in_all = np.bincount(pixel, n_rays)
        some = np.flatnonzero(in_all[pixel] > self.left[pixel] - self.kept)
        order = some[np.lexsort((*view[some].T, pixel[some]))]
        pixel = pixel[order]
        asked = np.cumsum(n_rays[order])
        before = np.append(0, asked)[np.searchsorted(pixel, pixel)]

        found = np.zeros(len(view), bool)
        found[order] = asked - before > self.left[pixel] - self.kept
        return found

    def _pixel(self, view: Floats) -> Ints:
        """Numbers (n,) of the pixels of viewer px (n, 2)."""
        column, row = whole_within(view, self.size)
        return row * (self.size[0] + 1) + column
