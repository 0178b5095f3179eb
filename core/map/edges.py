"""Borders on edges between two points, from each side that has a landing, and strips beyond."""

import numpy as np

from ..arrays import Ints, taken
from ..light.plan import Plan
from .bisection import Edges, last_on_branch
from .points import Points
from .searches import Search, ask, side_by_side
from .strips import find_strips


def find_borders(
    plan: Plan, points: Points, near: Ints, far: Ints
) -> Search[tuple[Points, Ints, Points]]:
    """Borders on edges (n,) from points `near` to points `far`, sorted by near, then far.

    Returns the last points (n,) on the branch of the near ones; and the ends (n, 2 MOST_STRIPS) of
    strips beyond, with their points, as of `find_strips`. Where both ends have a landing the
    other's branch most often begins where the one's ends: it is looked for there first.
    """
    # several borders begin at one point
    once, at_near = np.unique(near, return_inverse=True)
    _, course = yield from ask(taken(points.view, once))
    edges = Edges(near, far, course[at_near], np.ones(len(near)))

    # the other side of each border, where it is looked for, too
    n = len(points)
    key, back = near * n + far, far * n + near
    at = np.minimum(np.searchsorted(key, back), len(key) - 1)
    is_second = (key[at] == back) & (near > far)
    first = np.flatnonzero(~is_second)
    second = np.flatnonzero(is_second)
    ends, found = yield from last_on_branch(plan, points, edges.at(first))

    # the second side, where the first has told about where it
    # ends; meanwhile strips, none of which has a second side
    rank = np.empty(len(near), np.int64)
    rank[first] = np.arange(len(first))
    of_second = edges.at(second)._replace(end=np.minimum(1 - ends[rank[at[second]]], 1.0))
    (_, others), (strips_of_first, of_strips) = yield from side_by_side([
        last_on_branch(plan, points, of_second),
        find_strips(plan, points, near[first], far[first], ends),
    ])  # fmt: skip

    strips = np.zeros((len(near), strips_of_first.shape[1]), np.int64)
    strips[first] = strips_of_first
    order = np.argsort(np.concatenate([first, second]))
    return found.and_more(others).at(order), strips, of_strips
