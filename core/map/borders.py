"""Borders between two branches on the edges of cells, found by bisection.

A border is the last place on an edge whose ray takes the branch of the edge's near end. Each ray
halves the interval; it is given up as soon as it leaves the course of its branch. The kernel finds
each border on its own, from first to last; numpy all at once, round by round. Several places at
once would save rounds if borders are few, and trace up to five times the rays.
"""

from collections.abc import Generator
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints, take
from ..light.plan import Ends, Halving, Plan
from ..light.rays import Words
from .points import Points, trace_points
from .ray_budget import RayBudget

N_DIGITS = 9  # binary: a border is found to 2^-9 of an edge, with as many rays


class BorderEdges(NamedTuple):
    """Edges (n,) between points, by number, searched from the near one.

    course : (n, m) of the near one's ray
    end : (n,) limit of the search, 0..1 of the edge
    """

    near: Ints
    far: Ints
    course: Words
    end: Floats

    def at(self, which: Ints) -> "BorderEdges":
        return BorderEdges(*(column[which] for column in self))


def exceed_budget(points: Points, near: Ints, far: Ints, budget: RayBudget) -> Bools:
    """Mask of edges (n,), as for `find_borders`, whose borders need more rays than their pixels
    have.
    """
    n = len(near)
    # the second side takes one try, then bisection
    n_rays = N_DIGITS + ((points.branch[far] != 0) & (near > far))
    middle = (points.view[near] + points.view[far]) / 2  # rays on an edge start in the same pixel
    view = np.concatenate([middle, points.view[near]])
    exceeds = budget.exceeds(view, np.append(n_rays, np.ones(n, np.int64)))
    return exceeds[:n] | exceeds[n:]


def find_borders(
    plan: Plan, points: Points, near: Ints, far: Ints, budget: RayBudget
) -> Generator[int, None, Points]:
    """Borders on edges (n,) from points `near` to points `far`, sorted by near, then far: the last
    points (n,) on the near branch. Yields the number of rays traced since.

    If both ends have a landing, the far branch usually begins where the near one ends: its search
    starts there.
    """
    if not len(near):
        return Points.none()

    once, at_near = np.unique(near, return_inverse=True)
    view = take(points.view, once)
    budget.take(view)
    courses: list[Words] = []
    yield from trace_points(plan, view, courses=courses)
    edges = BorderEdges(near, far, _together(courses)[at_near], np.ones(len(near)))

    # second sides of borders, searched from the other end
    n = len(points)
    key, back = near * n + far, far * n + near
    at = np.minimum(np.searchsorted(key, back), len(key) - 1)
    is_second = (key[at] == back) & (near > far)
    first = np.flatnonzero(~is_second)
    second = np.flatnonzero(is_second)
    ends, found = yield from last_on_branch(plan, points, edges.at(first), budget)

    # second sides, limited by the end found from the first
    rank = np.empty(len(near), np.int64)
    rank[first] = np.arange(len(first))
    of_second = edges.at(second)._replace(end=np.minimum(1 - ends[rank[at[second]]], 1.0))
    _, others = yield from last_on_branch(plan, points, of_second, budget)
    return found.and_more(others).at(np.argsort(np.concatenate([first, second])))


def last_on_branch(
    plan: Plan, points: Points, edges: BorderEdges, budget: RayBudget
) -> Generator[int, None, tuple[Floats, Points]]:
    """End (n,) of the near points' branch on edges (n,), and the last points (n,) on it, by
    bisection.

    The search is limited by `end`; a place there is tried first, unless it is the far point. Yields
    the number of rays traced since.
    """
    near, far, course, end = edges
    # start with the near points themselves
    start = take(points.view, near)
    along = take(points.view, far) - start
    branch = points.branch[near]
    ends = Ends(
        low=np.zeros(len(near)),
        width=end.copy(),
        xy=take(points.xy, near),
        throughput=points.throughput[near],
        n_tried=np.zeros(len(near), np.int64),
    )
    least = 2.0**-N_DIGITS

    def tried(some: Ints, at: Floats) -> Generator[int, None, Bools]:
        """Trace some edges (k,) at places (k,), 0..1; returns a mask of edges still on their
        branch.
        """
        ends.n_tried[some] += 1
        view = start[some] + at[:, None] * along[some]
        found = yield from trace_points(plan, view, course[some])
        holds = found.branch == branch[some]
        ends.xy[some[holds]] = found.xy[holds]
        ends.throughput[some[holds]] = found.throughput[holds]
        ends.low[some[holds]] = at[holds]
        return holds

    if plan.tracer.bisect is not None and not plan.n_copies:
        edges = Halving(start, along, course, branch, ends, least)
        ends = yield from plan.tracer.bisect(plan, edges)
    else:
        # first the limits, then halves, all edges together
        nearer = np.flatnonzero(end < 1)
        holds = yield from tried(nearer, end[nearer])
        ends.width[nearer[holds]] = 0.0
        todo = np.flatnonzero(ends.width > least)
        while len(todo):
            ends.width[todo] /= 2
            yield from tried(todo, ends.low[todo] + ends.width[todo])
            todo = todo[ends.width[todo] > least]

    budget.take(start + along / 2, ends.n_tried)
    last = start + ends.low[:, None] * along
    beam = None
    if points.beam is not None:  # bisection finds places alone
        found = yield from trace_points(plan, last, course)
        beam = np.where((found.branch == branch)[:, None], found.beam, points.beam[near])
    return ends.low + ends.width, Points(
        last, ends.xy, branch, points.reason[near], ends.throughput, beam
    )


def _together(courses: list[Words]) -> Words:
    """Courses (n, m) of several widths m in one array, padded with 0."""
    width = max(course.shape[1] for course in courses)
    return np.concatenate(
        [np.pad(course, ((0, 0), (0, width - course.shape[1]))) for course in courses]
    )
