"""Where the border between two branches crosses the edges of cells.

A border is the last place on an edge whose ray takes the branch of the edge's end. A round of
2^k - 1 rays, evenly spread over the part in question, finds k binary digits of it. One digit a
round takes the fewest rays, and more time where few borders are left: a batch of rays costs as much
as hundreds of its rays. A ray is given up as soon as it leaves the course of its branch.
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from .. import kernel
from ..arrays import Floats, Ints, taken
from ..light.landings import Words
from ..light.plan import Plan
from .points import Points, trace_points


@dataclass(frozen=True)
class Bisection:
    """How borders are looked for.

    least_digits : binary, a border is known to 2^-9 of an edge
    of_tolerance : and, where that is less, to this part of the tolerance, in viewer pixels
    most_digits : that are found in one step
    batch_rays, kernel_batch_rays : that numpy traces in not much more time than a few; and
        the kernel
    """

    least_digits: int = 9
    of_tolerance: float = 0.1
    most_digits: int = 4
    batch_rays: int = 8192
    kernel_batch_rays: int = 512


BISECTION = Bisection()


def with_courses(plan: Plan, view: Floats) -> Generator[int, None, tuple[Points, Words]]:
    """Trace viewer points (n, 2): with their courses (n, m).

    Yields the number of rays after each chunk of them.
    """
    parts: list[Words] = [np.empty((0, 1), np.uint64)]
    points = yield from trace_points(plan, view, courses=parts)
    width = max(part.shape[1] for part in parts)
    return points, np.concatenate(
        [np.pad(part, ((0, 0), (0, width - part.shape[1]))) for part in parts]
    )


def both_ways(
    plan: Plan, points: Points, near: Ints, far: Ints
) -> Generator[int, None, tuple[Floats, Points]]:
    """Last points (n,) on the branch of points `near` (n,) towards points `far`, sorted by near,
    then far; before them where (n,) it has ended, 0..1 of the way.

    Where both have a landing the other's branch most often begins
    where the one's ends: it is looked for there first.
    """
    # the other side of each border, where it is looked for, too
    n = len(points)
    key, back = near * n + far, far * n + near
    at = np.minimum(np.searchsorted(key, back), len(key) - 1)
    is_second = (key[at] == back) & (near > far)
    first = np.flatnonzero(~is_second)
    second = np.flatnonzero(is_second)
    # several borders begin at one point
    once, at_near = np.unique(near, return_inverse=True)
    _, course = yield from with_courses(plan, taken(points.view, once))
    course = course[at_near]
    place, found = yield from last_on_branch(
        plan, points, near[first], far[first], np.ones(len(first)), course[first]
    )
    ends = np.empty(len(key))
    ends[first] = place
    if not len(second):
        return ends, found

    # the second side, where the first has told about where it ends
    rank = np.empty(len(key), np.int64)
    rank[first] = np.arange(len(first))
    end = np.minimum(1 - place[rank[at[second]]], 1.0)
    ends[second], others = yield from last_on_branch(
        plan, points, near[second], far[second], end, course[second]
    )
    order = np.argsort(np.concatenate([first, second]))

    return ends, found.and_more(others).at(order)


def last_on_branch(
    plan: Plan, points: Points, near: Ints, far: Ints, end: Floats, course: Words
) -> Generator[int, None, tuple[Floats, Points]]:
    """Last points (n,) on the branch of points `near`, on courses (n,
    m), towards points `far`, by bisection in several parts.

    They are looked for up to `end` (n,), 0..1 of the way, where the point itself is tried first
    unless it is `far`. Returned before the points is where (n,) the branch has ended.
    """
    # as if there were nothing beyond the points themselves
    xy = taken(points.xy, near)
    throughput = points.throughput[near]
    a = taken(points.view, near)
    b = taken(points.view, far)
    low = np.zeros(len(near))
    width = end.copy()

    digits = max(
        BISECTION.least_digits,
        int(np.ceil(-np.log2(BISECTION.of_tolerance * plan.settings.tolerance))),
    )

    # where several borders cross one way the kernel and numpy may thus find different ones
    batch = BISECTION.batch_rays if kernel.left_out(plan.layers) else BISECTION.kernel_batch_rays

    parts = 1
    todo = np.arange(len(near))
    while len(todo):
        # the first time the end alone is tried; then several places at once, the more the fewer
        # borders there are: a batch of rays costs as much as hundreds of its rays
        steps = np.arange(1, parts)[:, None] / parts if parts > 1 else np.ones((1, 1))
        at = low[todo] + width[todo] * steps
        view = (a[todo] + at[..., None] * (b - a)[todo]).reshape(-1, 2)

        if parts > 1 or (end < 1).any():
            found = yield from trace_points(plan, view, np.tile(course[todo], (len(steps), 1)))
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
        left = digits + np.ceil(np.log2(width[todo].max(initial=2.0**-digits)))
        parts = 2 ** int(
            np.clip(np.log2(batch / max(len(todo), 1)), 1, max(1, min(left, BISECTION.most_digits)))
        )

    landed = Points(
        a + low[:, None] * (b - a), xy, points.branch[near], points.reason[near], throughput
    )
    return low + width, landed
