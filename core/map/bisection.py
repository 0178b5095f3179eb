"""Where the border between two branches crosses the edges of cells.

A border is the last place on an edge whose ray takes the branch of the edge's end. A round of
2^k - 1 rays, evenly spread over the part in question, finds k binary digits of it. One digit a
round takes the fewest rays, and more time where few borders are left: a batch of rays costs as much
as hundreds of its rays. A ray is given up as soon as it leaves the course of its branch.
"""

from dataclasses import dataclass
from math import ceil
from typing import NamedTuple

import numpy as np

from .. import kernel
from ..arrays import Floats, Ints, taken
from ..light.landings import Words
from ..light.plan import Plan
from .points import Points
from .searches import Search, ask, side_by_side


@dataclass(frozen=True)
class Bisection:
    """How borders are looked for.

    least_digits : binary, a border is known to 2^-9 of an edge
    of_tolerance : and, where that is less, to this part of the tolerance, in viewer pixels
    most_digits : that are found in one step
    batch_rays, kernel_batch_rays : that numpy traces in not much more time than a few; and
        the kernel
    lengths : of courses, events: up to these they are looked for together by numpy
    """

    least_digits: int = 9
    of_tolerance: float = 0.1
    most_digits: int = 5
    batch_rays: int = 4096
    kernel_batch_rays: int = 512
    lengths: tuple[int, ...] = (8, 16)


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


def rays_of_border(plan: Plan, n_borders: float) -> int:
    """Rays that each of so many borders takes that are looked for together: the fewer there are,
    the more digits are found in a round.
    """
    left = _digits(plan)
    batch = _batch(plan)
    rays = 0
    while left:
        at_once = _digits_at_once(n_borders, left, batch)
        rays += 2**at_once - 1
        left -= at_once
    return rays


def _digits(plan: Plan) -> int:
    """Binary digits that a border is known by."""
    of_tolerance = BISECTION.of_tolerance * plan.settings.tolerance
    return max(BISECTION.least_digits, int(np.ceil(-np.log2(of_tolerance))))


def _batch(plan: Plan) -> int:
    """Rays that take not much more time than a few.

    Where several borders cross one way the kernel and numpy may thus find different ones.
    """
    return BISECTION.batch_rays if kernel.left_out(plan.layers) else BISECTION.kernel_batch_rays


def _digits_at_once(n_borders: float, left: int, batch: int) -> int:
    """Of the digits that are left, those found in a round: as many in each of the rounds that are
    to come, which are as few as a batch allows.
    """
    most = int(np.clip(np.log2(batch / max(n_borders, 1)), 1, BISECTION.most_digits))
    return ceil(left / ceil(left / most))


def last_on_branch(plan: Plan, points: Points, edges: Edges) -> Search[tuple[Floats, Points]]:
    """Last points (n,) on the branch of the near points of edges (n,), by bisection in several
    parts.

    They are looked for up to `end`, where the point itself is tried first unless it is the far one.
    Returned before the points is where (n,) the branch has ended.
    """
    groups = _by_length(plan, edges.course)
    found = yield from side_by_side([_bisected(plan, points, edges.at(some)) for some in groups])
    order = np.argsort(np.concatenate(groups))
    ends, landed = zip(*found, strict=True)
    return np.concatenate(ends)[order], Points.joined(landed).at(order)


def _by_length(plan: Plan, course: Words) -> list[Ints]:
    """Edges (n,) in groups, by the length of their courses (n, m).

    A batch takes as long as its longest way, so that long ones are
    looked for in more places at once; the kernel follows each by itself.
    """
    if not kernel.left_out(plan.layers):
        return [np.arange(len(course))]
    length = (course != 0).sum(axis=1)
    group = np.searchsorted(BISECTION.lengths, length)
    return [np.flatnonzero(group == k) for k in range(len(BISECTION.lengths) + 1)]


def _bisected(plan: Plan, points: Points, edges: Edges) -> Search[tuple[Floats, Points]]:
    """As `last_on_branch`, all edges together."""
    near, far, course, end = edges
    # as if there were nothing beyond the points themselves
    xy = taken(points.xy, near)
    throughput = points.throughput[near]
    a = taken(points.view, near)
    b = taken(points.view, far)
    low = np.zeros(len(near))
    width = end.copy()

    digits = _digits(plan)
    batch = _batch(plan)
    parts = 1
    todo = np.arange(len(near))
    while len(todo):
        # the first time the end alone is tried; then several places at once, the more the fewer
        # borders there are: a batch of rays costs as much as hundreds of its rays
        steps = np.arange(1, parts)[:, None] / parts if parts > 1 else np.ones((1, 1))
        at = low[todo] + width[todo] * steps
        view = (a[todo] + at[..., None] * (b - a)[todo]).reshape(-1, 2)

        if parts > 1 or (end < 1).any():
            found, _ = yield from ask(view, np.tile(course[todo], (len(steps), 1)))
            holds = found.branch.reshape(at.shape) == points.branch[near[todo]]
            n_held = np.logical_and.accumulate(holds).sum(axis=0)
            held = np.flatnonzero(n_held)

            # the last that holds, and the part beyond it
            last = (n_held[held] - 1) * len(todo) + held
            xy[todo[held]] = found.xy[last]
            throughput[todo[held]] = found.throughput[last]
            width[todo] /= parts
            low[todo] += width[todo] * n_held
            if parts == 1:
                width[todo[held]] = 0.0

        todo = todo[width[todo] > 2.0**-digits]
        left = max(1, digits + ceil(np.log2(width[todo].max(initial=2.0**-digits))))
        parts = 2 ** _digits_at_once(len(todo), left, batch)

    landed = Points(
        a + low[:, None] * (b - a), xy, points.branch[near], points.reason[near], throughput
    )
    return low + width, landed
