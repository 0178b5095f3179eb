"""The progress of a solve, told before its work is done: which part takes about how long.

Nothing but the bar that is watched depends on these numbers.
"""

from collections.abc import Generator
from dataclasses import dataclass
from math import inf
from time import perf_counter
from typing import TypeVar

from ..light.plan import Plan
from ..map.ray_guess import RaysAhead
from ..map.share_guess import shares_ahead
from .pace import pace, times_slower

Result = TypeVar("Result")


@dataclass(frozen=True)
class Stages:
    """How far the work is when one of its parts ends, 0..1.

    mesh_measured, leaks_measured : of the measuring; then light that was cut off is looked at
    settled : of the painting for several viewers; the places that they ask for come before
    glance_traced : of a coarse picture; then it is painted
    found : of painting, to make the shares and find the strongest paths, where that is asked for
    """

    mesh_measured: float = 0.8
    leaks_measured: float = 0.9
    settled: float = 0.5
    glance_traced: float = 0.5
    found: float = 0.85


STAGES = Stages()
MOST_TOLD = 0.97  # before all is done: remarks come at the end
TINY = 1e-9  # s
LOOKED_ANEW = 0.02  # s after which it is guessed anew how many are to come
TRUST = 0.3  # of a part of the work: what is expected of it weighs as much as if so much were done


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

    def __init__(self, plan: Plan, of_plan: float) -> None:
        """For a plan that was made in so many seconds."""
        self._plan, self._of_plan = plan, of_plan
        self._of = pace()
        self._through = self._of.through(plan)
        self._searches = Searches()
        self._looked = -inf  # after so many seconds

    def is_due(self, rays: RaysAhead, so_far: float) -> bool:
        """Is it worth a guess how long it goes on after so many seconds? The last one may hold."""
        self._searches.take_up(rays, so_far)
        return so_far >= self._looked + LOOKED_ANEW

    def seconds(self, rays: RaysAhead, so_far: float) -> float:
        """About how long it goes on after so many seconds of tracing."""
        self._looked = so_far
        to_trace = self._to_trace(rays, so_far)
        viewer, display = self._plan.viewer, self._plan.rig.display
        made = shares_ahead(self._plan, rays)
        of_ray = so_far / max(rays.done.every, 1.0)
        return (
            to_trace
            + self._of.to_join(rays.to_join)
            + self._of.to_sum(made.n_cells * rays.sums_light)
            + self._of.to_guess(made.n_cells)
            + self._of.to_paint(display.width * display.height, made)
            + self._of.to_find(made.n_shares, self._plan.settings)
            + self._of.to_cover(viewer.width * viewer.height, rays.expected)
            + self._of.to_measure(self._plan, self._of_plan, of_ray, rays.expected)
        )

    def _to_trace(self, rays: RaysAhead, so_far: float) -> float:
        """Seconds of tracing to come: searches take as much longer than expected as those before.

        Their first rays are many at once, and faster than the last: a search under way tells only
        that it takes longer.
        """
        done, to_come, searches = rays.done, rays.to_come, self._searches
        searches.take_up(rays, so_far)

        # seconds of a ray, of one that is searched with, and of a search besides
        of_others = so_far - searches.seconds - searches.under_way
        of_others -= min(self._of.to_join(rays.n_joined), of_others / 2)
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
