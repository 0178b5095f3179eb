"""Borders on edges between two points, from each side that has a landing, and strips beyond."""

import numpy as np

from ..base.arrays import Bools, Floats, Ints, taken
from ..light.plan import Plan
from .bisection import Edges, last_on_branch, n_digits
from .points import Points
from .ray_budget import Allowance
from .searches import Search, ask, side_by_side
from .strips import find_strips


def lack(plan: Plan, points: Points, near: Ints, far: Ints, allowance: Allowance) -> Bools:
    """Do borders on edges (n,), as for `find_borders`, take more rays than their pixels have?"""
    n = len(near)
    # by bisection, from the other side after one try, and the ray beyond a border to the dark
    is_second = (points.branch[far] != 0) & (near > far)
    n_rays = n_digits(plan) + (is_second | (points.branch[far] == 0))
    view = np.concatenate([_middle(points, near, far), points.view[near]])
    lacks = allowance.lacks(view, np.append(n_rays, np.ones(n, np.int64)))
    return lacks[:n] | lacks[n:]


def _middle(points: Points, near: Ints, far: Ints) -> Floats:
    """Viewer px (n, 2) of the middles of edges: their rays start in the same pixel."""
    return (points.view[near] + points.view[far]) / 2


def find_borders(
    plan: Plan, points: Points, near: Ints, far: Ints, allowance: Allowance
) -> Search[tuple[Points, Ints, Points, Bools]]:
    """Borders on edges (n,) from points `near` to points `far`, sorted by near, then far.

    Returns the last points (n,) on the branch of the near ones; and the ends (n, 2 MOST_STRIPS) of
    strips beyond, with their points, as of `find_strips`, and where (n,) these were given up for
    want of rays. Where both ends have a landing the other's branch most often begins where the
    one's ends: it is looked for there first.
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
    ends, found, _ = yield from last_on_branch(plan, points, edges.at(first))

    # the second side, where the first has told about where it
    # ends; meanwhile strips, none of which has a second side
    rank = np.empty(len(near), np.int64)
    rank[first] = np.arange(len(first))
    of_second = edges.at(second)._replace(end=np.minimum(1 - ends[rank[at[second]]], 1.0))
    # the most that these may take counts until it is known what they have taken, so that the
    # strips' rays are the same however far they are
    pending = _middle(points, near[second], far[second])
    allowance.take(pending, n_digits(plan) + 1)
    (_, others, n_tried), (strips_of_first, of_strips, is_given_up) = yield from side_by_side([
        last_on_branch(plan, points, of_second, takes=False),
        find_strips(plan, points, near[first], far[first], ends, allowance),
    ])  # fmt: skip
    allowance.take(pending, n_tried - n_digits(plan) - 1)

    strips = np.zeros((len(near), strips_of_first.shape[1]), np.int64)
    strips[first] = strips_of_first
    given_up = np.zeros(len(near), bool)
    given_up[first] = is_given_up
    order = np.argsort(np.concatenate([first, second]))
    return found.and_more(others).at(order), strips, of_strips, given_up
