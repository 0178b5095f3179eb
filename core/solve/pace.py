"""The pace of a solve: about how long its parts take, by how much there is to do.

Parts that the kernel's threads share take less by the clock, the more threads there are; what numpy
does takes its time all the same.
"""

import timeit
from dataclasses import dataclass
from functools import lru_cache
from time import perf_counter, thread_time
from typing import NamedTuple

import numpy as np

from ..light.plan import Plan
from ..map.share_guess import COUNTED, CellsAndShares
from ..map.view_map import ViewMap
from ..native import loading
from ..settings import Settings
from .coarse_parts import coarsest

PROBE = np.ones((1 << 14, 3))
STAYS = 10.0
PROBE_SECONDS = 300e-6  # that the norms of its rows take on the machine of PACE


class Seconds(NamedTuple):
    """Of a part of the work, on the machine of PACE: of the one
    thread that does it, and those that the kernel's threads share.
    """

    alone: float
    shared: float = 0.0

    @property
    def by_clock(self) -> float:
        """On this machine, with as many threads as there are."""
        return times_slower() * (self.alone + self.shared / loading.n_threads())


class GlassPace(NamedTuple):
    """The pace of solves through one kind of glass.

    searched : times as long as others takes a ray that is searched with
    search : what each of a map's searches takes besides, s, however few its rays are, for
        each pause that the first squares took: in small batches all events take their time
    measured : to measure errors, s, by numpy for the most part, beside what their map takes
    measured_rays : and by so many rays, each of which takes as long as one of the map: where
        flat triangles have bent normals, light is followed through other surfaces in their place
    """

    searched: float
    search: float
    measured: float
    measured_rays: float = 0.0


@dataclass(frozen=True)
class Pace:
    """Seconds that parts of a solve take, about, where `times_slower` is 1.

    Fitted to the glass that artists bring (`dev.py glasses`, column *rest x*).

    flat, curved, bent : glass without a curved face, with nothing else, and such as has flat
        triangles with bent normals: there errors take longest to measure
    painted_pixel, painted_cell, painted_share : of painting, a display pixel, a cell and a share
    made_share : part of a share's time that it takes to make it; then it is painted
    found_share : to find the strongest paths, where that is asked for, a share
    covered_pixel, covered_point : to find how much of the picture is shown, a viewer
        pixel and a point of the map
    joined_cell : while pixels are cut, to put one or a quarter of one together, beside its rays
    summed_cell : to sum up the light of a cell, where samples of faint light are asked for
    guessed_cell, most_guessed : to guess how many shares a cell makes; of so many at the most
    measured_point : to make a map ready to be asked where it has a place, for each of its points
    planned_again : times as long as its plan takes glass that is compared with
        another surface, because it is coarse
    """

    flat: GlassPace
    curved: GlassPace
    bent: GlassPace
    painted_pixel: Seconds
    painted_cell: Seconds
    painted_share: Seconds
    made_share: float
    found_share: float = 0.22e-6
    covered_pixel: float = 0.06e-6
    covered_point: float = 0.05e-6
    joined_cell: float = 1.2e-6
    summed_cell: float = 0.22e-6
    guessed_cell: float = 0.2e-6
    most_guessed: int = 3 * COUNTED
    measured_point: float = 0.12e-6
    planned_again: float = 2.5

    def through(self, plan: Plan) -> GlassPace:
        """The pace of solves through the glass of a plan."""
        if plan.is_flat:
            return self.flat
        return self.bent if plan.triangles.is_bent.any() else self.curved

    def to_paint(self, n_pixels: int, made: CellsAndShares) -> float:
        """Seconds to paint so many display pixels, cells and shares."""
        return (
            self.painted_pixel.by_clock * n_pixels
            + self.painted_cell.by_clock * made.n_cells
            + self.painted_share.by_clock * made.n_shares
        )

    def to_find(self, n_shares: float, settings: Settings) -> float:
        """Seconds to find the strongest paths of so many shares, where that is asked for."""
        return times_slower() * self.found_share * n_shares * (settings.ghosts == "strongest")

    def to_cover(self, n_pixels: int, n_points: float) -> float:
        """Seconds to find how much of the picture a viewer of so many pixels is shown."""
        return times_slower() * (self.covered_pixel * n_pixels + self.covered_point * n_points)

    def to_join(self, n_cells: float) -> float:
        """Seconds to put so many cells together."""
        return times_slower() * self.joined_cell * n_cells

    def to_sum(self, n_cells: float) -> float:
        """Seconds to sum up the light of so many cells."""
        return times_slower() * self.summed_cell * n_cells

    def to_guess(self, n_cells: float) -> float:
        """Seconds to guess how many shares a map of so many cells makes."""
        return times_slower() * self.guessed_cell * min(n_cells, self.most_guessed)

    def to_measure(self, plan: Plan, of_plan: float, of_ray: float, n_points: float) -> float:
        """Seconds to measure the errors of a plan that was made in so many, each ray in so many,
        and of its map of so many points.
        """
        again = self.planned_again * of_plan if coarsest(plan.counts) >= 0 else 0.0
        through = self.through(plan)
        of_map = through.measured + self.measured_point * n_points
        return times_slower() * of_map + through.measured_rays * of_ray + again


PACE = Pace(
    flat=GlassPace(1.0, 0.15e-3, 0.009),
    curved=GlassPace(1.5, 0.36e-3, 0.02),
    bent=GlassPace(1.5, 0.24e-3, 0.015, 17e3),
    painted_pixel=Seconds(0.05e-6),
    painted_cell=Seconds(0.04e-6, 0.165e-6),
    painted_share=Seconds(0.075e-6, 0.035e-6),
    made_share=0.25,
)
NUMPY_PACE = Pace(
    flat=GlassPace(1.0, 1.2e-3, 0.045),
    curved=GlassPace(1.5, 4e-3, 0.09),
    bent=GlassPace(2.0, 6e-3, 0.23),
    painted_pixel=Seconds(0.05e-6),
    painted_cell=Seconds(0.3e-6),
    painted_share=Seconds(0.7e-6),
    made_share=0.6,
)


def pace() -> Pace:
    """The pace of solves with the kernel, or by numpy alone."""
    return NUMPY_PACE if loading.library() is None else PACE


def times_slower() -> float:
    """How many times slower this machine is than the one of PACE, whatever else it does: found
    anew after STAYS seconds.
    """
    return _times_slower(int(perf_counter() / STAYS))


@lru_cache(maxsize=1)
def _times_slower(_: int) -> float:
    passes = timeit.repeat(
        lambda: np.linalg.norm(PROBE, axis=1), number=1, repeat=10, timer=thread_time
    )
    return min(passes) / PROBE_SECONDS


def seconds_to_measure(plan: Plan, view_map: ViewMap, of_plan: float, of_rays: float) -> float:
    """About how long it takes to measure the errors of a plan that was made in so many seconds, and
    of its map, whose rays took so many.
    """
    of_ray = of_rays / max(view_map.n_rays, 1)
    return pace().to_measure(plan, of_plan, of_ray, len(view_map.points))


def seconds_to_paint(view_map: ViewMap, settings: Settings) -> float:
    """About how long it takes to paint a view map, with all that comes with it."""
    width, height = view_map.display_size
    made = CellsAndShares(*view_map.n_by_kind.sum(axis=1))
    return pace().to_paint(width * height, made) + pace().to_find(made.n_shares, settings)


def seconds_to_cover(view_map: ViewMap) -> float:
    """About how long it takes to find how much of the picture a viewer is shown."""
    width, height = view_map.view_size
    return pace().to_cover(width * height, len(view_map.points))
