"""Where the border between two branches crosses the edges of cells.

A border is the last place on an edge whose ray takes the branch of the edge's end. Each ray halves
the part in question; it is given up as soon as it leaves the course of its branch. The kernel looks
for each border by itself, from first to last; numpy for all at once, round by round. To try several
places at once was left: it saves rounds where borders are few, and takes up to five times the rays.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints, taken
from ..light.plan import Ends, Halving, Plan
from ..light.rays import Words
from .points import Points
from .searches import Halve, Search, ask


@dataclass(frozen=True)
class Bisection:
    """How borders are looked for.

    least_digits : binary, a border is known to 2^-9 of an edge
    of_tolerance : and, where that is less, to this part of the tolerance, in viewer pixels
    """

    least_digits: int = 9
    of_tolerance: float = 0.1


BISECTION = Bisection()


class Edges(NamedTuple):
    """Edges (n,) between points, by number, from the near one, whose ray takes a course (n, m).

    end (n,) : a border is looked for up to here, 0..1 of the way
    """

    near: Ints
    far: Ints
    course: Words
    end: Floats

    def at(self, which: Ints) -> "Edges":
        """Some of the edges."""
        return Edges(*(column[which] for column in self))


def n_digits(plan: Plan) -> int:
    """Binary digits that a border is known by: the rays that it takes."""
    of_tolerance = BISECTION.of_tolerance * plan.settings.tolerance
    return max(BISECTION.least_digits, int(np.ceil(-np.log2(of_tolerance))))


def last_on_branch(
    plan: Plan, points: Points, edges: Edges, takes: bool = True
) -> Search[tuple[Floats, Points, Ints]]:
    """Last points (n,) on the branch of the near points of edges (n,), by bisection.

    They are looked for up to `end`, where the point itself is tried first unless it is the far one.
    Returned before the points is where (n,) the branch has ended, after them how many rays (n,)
    that took.

    takes : are rays taken of the allowance as they are traced?
    """
    near, far, course, end = edges
    # as if there were nothing beyond the points themselves
    xy = taken(points.xy, near)
    throughput = points.throughput[near]
    a = taken(points.view, near)
    b = taken(points.view, far)
    low = np.zeros(len(near))
    width = end.copy()
    n_tried = np.zeros(len(near), np.int64)
    least = 2.0 ** -n_digits(plan)

    if plan.tracer.bisect is not None and not plan.n_copies:
        begun = Ends(low, width, xy, throughput, n_tried)
        wanted = Halving(a, b - a, course, points.branch[near], begun, least)
        (found,) = yield [Halve(wanted, takes)]
        return found.low + found.width, _landed(points, near, a, b - a, found), found.n_tried

    def tried(some: Ints, at: Floats) -> Search[Bools]:
        """Which of some edges (k,) are on their branch so far (k,), 0..1 of the way?"""
        n_tried[some] += 1
        found, _ = yield from ask(a[some] + at[:, None] * (b - a)[some], course[some], takes)
        holds = found.branch == points.branch[near[some]]
        xy[some[holds]] = found.xy[holds]
        throughput[some[holds]] = found.throughput[holds]
        low[some[holds]] = at[holds]
        return holds

    # the ends alone
    nearer = np.flatnonzero(end < 1)
    holds = yield from tried(nearer, end[nearer])
    width[nearer[holds]] = 0.0

    # then halves, all together
    todo = np.flatnonzero(width > least)
    while len(todo):
        width[todo] /= 2
        yield from tried(todo, low[todo] + width[todo])
        todo = todo[width[todo] > least]

    ends = Ends(low, width, xy, throughput, n_tried)
    return low + width, _landed(points, near, a, b - a, ends), n_tried


def _landed(points: Points, near: Ints, start: Floats, way: Floats, ends: Ends) -> Points:
    """The last points on the branches of near points."""
    return Points(
        start + ends.low[:, None] * way,
        ends.xy,
        points.branch[near],
        points.reason[near],
        ends.throughput,
    )
