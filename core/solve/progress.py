"""The progress of a solve, told before its work is done: which part takes about how long.

Nothing but the bar that is watched depends on these numbers.
"""

import timeit
from collections.abc import Generator
from dataclasses import dataclass
from functools import lru_cache
from time import perf_counter, thread_time
from typing import NamedTuple, TypeVar

import numpy as np

from .. import kernel
from ..light.plan import Plan
from ..map.ray_guess import RaysAhead
from ..map.view_map import ViewMap

Result = TypeVar("Result")


@dataclass(frozen=True)
class Stages:
    """How far the work is when one of its parts ends, 0..1.

    mesh_measured, leaks_measured : of the measuring; then light that was cut off is looked at
    settled : of the painting for several viewers; the places that they ask for come before
    glance_traced : of a coarse picture; then it is painted
    made : of painting, to make the shares; the rest is to paint and to add them
    """

    mesh_measured: float = 0.8
    leaks_measured: float = 0.9
    settled: float = 0.5
    glance_traced: float = 0.5
    made: float = 0.6


class GlassPace(NamedTuple):
    """The pace of solves through one kind of glass.

    searched : times as long as others takes a ray that is searched with
    search : what each of a map's searches takes besides, s, however few its rays are, for
        each pause that the first squares took: in small batches all events take their time
    after_pixel, after_ray : of the work after tracing but for measuring, s for a pixel
        that is lit, of the viewer or the display, and for a ray
    measured, measured_rays : to measure errors, s, and as long as so many rays of the view map
    """

    searched: float
    search: float
    after_pixel: float
    after_ray: float
    measured: float
    measured_rays: float


@dataclass(frozen=True)
class Pace:
    """Seconds that parts of a solve take, about, where `times_slower` is 1.

    Fitted to the glass that artists bring (`dev.py glasses`, column *rest x*).

    flat, curved, bent : glass without a curved face, with nothing else, and such as has flat
        triangles with bent normals: there errors take longest to measure
    painted_pixel, painted_cell, painted_share : of painting, a display pixel, a cell and a share
    after_view_pixel : of the work after tracing but for measuring, a viewer pixel, lit or not
    covered_pixel, covered_point : to find how much of the picture is shown, a viewer
        pixel and a point of the map
    """

    flat: GlassPace
    curved: GlassPace
    bent: GlassPace
    painted_pixel: float
    painted_cell: float
    painted_share: float
    after_view_pixel: float = 0.1e-6
    covered_pixel: float = 0.06e-6
    covered_point: float = 0.05e-6

    def through(self, plan: Plan) -> GlassPace:
        """The pace of solves through the glass of a plan."""
        if plan.is_flat:
            return self.flat
        return self.bent if plan.triangles.is_bent.any() else self.curved


STAGES = Stages()
PACE = Pace(
    flat=GlassPace(1.2, 0.16e-3, 0.64e-6, 0.04e-6, 0.0035, 0.7e3),
    curved=GlassPace(1.5, 0.36e-3, 1.36e-6, 1.1e-6, 0.0, 2e3),
    bent=GlassPace(1.5, 0.24e-3, 0.57e-6, 1e-6, 0.045, 14e3),
    painted_pixel=0.05e-6,
    painted_cell=0.24e-6,
    painted_share=0.1e-6,
)
NUMPY_PACE = Pace(
    flat=GlassPace(1.0, 1.2e-3, 3.2e-6, 0.4e-6, 0.01, 0.5e3),
    curved=GlassPace(1.5, 4e-3, 4.6e-6, 5.5e-6, 0.03, 1e3),
    bent=GlassPace(2.0, 6e-3, 1.8e-6, 4.0e-6, 0.1, 2e3),
    painted_pixel=0.05e-6,
    painted_cell=0.3e-6,
    painted_share=0.7e-6,
)

MOST_TOLD = 0.97  # before all is done: remarks come at the end
TINY = 1e-9  # s
TRUST = 0.3  # of a part of the work: what is expected of it weighs as much as if so much were done
PROBE = np.ones((1 << 14, 3))
STAYS = 10.0
PROBE_SECONDS = 300e-6  # that the norms of its rows take on the machine of PACE


def pace() -> Pace:
    """The pace of solves with the kernel, or by numpy alone."""
    return NUMPY_PACE if kernel.library() is None else PACE


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


class Bar:
    """How far a solve is, 0..1: the part of its time that has passed, by what is still to come."""

    def __init__(self) -> None:
        self._started = perf_counter()
        self._of_viewers: list[float] = []  # seconds of a solve for each that was traced alone
        self.told = 0.0

    @property
    def so_far(self) -> float:
        """Seconds since it was made."""
        return perf_counter() - self._started

    def at(self, rest: float) -> float:
        """Where it stands when so many seconds are to come: never further back than before."""
        whole = self.so_far + rest
        self.told = max(self.told, min(MOST_TOLD, self.so_far / whole if whole > 0 else 0.0))
        return self.told

    def tracing(
        self, work: Generator[float, None, Result], n_left: int
    ) -> Generator[float, None, Result]:
        """Tell of the tracing for one viewer, after which so many are left: it
        yields how far a solve for this one alone would be, 0..1.
        """
        begun, whole = self.so_far, 0.0
        while True:
            try:
                part = next(work)
            except StopIteration as done:
                self._of_viewers.append(whole)
                return done.value
            if part > 0:
                whole = (self.so_far - begun) / part
                known = self._of_viewers or [whole]
                others = sum(known) / len(known)
                yield self.at(sum(self._of_viewers) + whole + n_left * others - self.so_far)
            else:
                yield self.told

    def during(
        self, work: Generator[float, None, Result], expected: float, after: float
    ) -> Generator[float, None, Result]:
        """Tell of a part of the work, which yields 0..1 how much of it is done.

        Until it tells more the rest of its time passes, ever more slowly: it does not end so.

        expected : seconds that it takes, about; what it took so far tells that better
        after : seconds that the work after it takes
        """
        begun = perf_counter()
        told, told_at, left = 0.0, 0.0, expected
        while True:
            try:
                part = next(work)
            except StopIteration as done:
                return done.value
            took = perf_counter() - begun
            if part > told:
                told, told_at = part, took
                left = (1 - part) * (took + TRUST * expected) / (part + TRUST)
            since = took - told_at
            yield self.at(left / (1 + since / max(left, TINY)) + after)


class Searches:
    """The time that a map's searches take.

    seconds, n : of those that have ended, and how many of them took rays
    under_way, n_rays : seconds and rays of the one that goes on
    """

    def __init__(self) -> None:
        self.seconds, self.under_way = 0.0, 0.0
        self.n, self.n_rays = 0, 0.0
        self._since: float | None = None
        self._before = 0.0  # rays

    def take_up(self, rays: RaysAhead, so_far: float) -> None:
        """See the rays after so many seconds."""
        if rays.is_searching and self._since is None:
            self._since = so_far
        if self._since is None:
            return

        self.under_way = so_far - self._since
        self.n_rays = rays.done.searched - self._before
        if not rays.is_searching:
            self.seconds += self.under_way
            self.n += self.n_rays > 0
            self._before = rays.done.searched
            self._since, self.under_way, self.n_rays = None, 0.0, 0.0


class Ahead:
    """What is still to come of a solve while a view map of a plan is traced."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._of = pace()
        self._through = self._of.through(plan)
        self._searches = Searches()

    def seconds(self, rays: RaysAhead, so_far: float) -> float:
        """About how long it goes on after so many seconds of tracing."""
        to_trace = self._to_trace(rays, so_far)
        viewer, display = self._plan.viewer, self._plan.rig.display
        n_pixels = viewer.width * viewer.height
        after = times_slower() * (
            self._through.after_pixel * rays.lit * max(n_pixels, display.width * display.height)
            + self._of.after_view_pixel * n_pixels
            + self._through.after_ray * rays.expected
            + self._through.measured
        )
        of_ray = (so_far + to_trace) / rays.expected
        return to_trace + after + self._through.measured_rays * of_ray

    def _to_trace(self, rays: RaysAhead, so_far: float) -> float:
        """Seconds of tracing to come: searches take as much longer than expected as those before.

        Their first rays are many at once, and faster than the last: a search under way tells only
        that it takes longer.
        """
        done, to_come, searches = rays.done, rays.to_come, self._searches
        searches.take_up(rays, so_far)

        # seconds of a ray, of one that is searched with, and of a search besides
        of_others = so_far - searches.seconds - searches.under_way
        of_ray = of_others / max(done.every - done.searched, 1.0)
        of_searched = self._through.searched * of_ray
        of_search = times_slower() * self._through.search * rays.n_pauses

        begun = min(searches.under_way, of_search)
        expected = of_searched * done.searched + of_search * searches.n + begun
        taken = searches.seconds + max(searches.under_way, of_searched * searches.n_rays + begun)
        slower = (taken + of_search) / max(expected + of_search, TINY)
        # samples are no search
        left = max(of_search * to_come.searches - begun, 0.0)
        to_search = of_searched * to_come.searched + left
        return of_ray * (to_come.every - to_come.searched) + slower * to_search


def seconds_to_measure(plan: Plan, of_ray: float) -> float:
    """About how long it takes to measure the errors of a plan, a ray of which takes so long."""
    of = pace().through(plan)
    return times_slower() * of.measured + of.measured_rays * of_ray


def seconds_to_paint(view_map: ViewMap) -> float:
    """About how long it takes to paint a view map, with all that comes with it."""
    width, height = view_map.display_size
    n_cells, n_shares = view_map.n_by_kind.sum(axis=1)
    of = pace()
    return times_slower() * float(
        of.painted_pixel * (width * height)
        + of.painted_cell * n_cells
        + of.painted_share * n_shares
    )


def seconds_to_cover(view_map: ViewMap) -> float:
    """About how long it takes to find how much of the picture a viewer is shown."""
    of = pace()
    n_pixels = view_map.view_size[0] * view_map.view_size[1]
    return times_slower() * (of.covered_pixel * n_pixels + of.covered_point * len(view_map.points))
