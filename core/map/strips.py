"""Strips of light between a border and the dark, of which no corner of a cell knows.

At the rim of a hollow glass, light takes one branch after the other in less than a pixel before it
is lost. Each is thin on the viewer's image, and all that shows a part of the display. So the ray
just beyond a border to the dark is followed to its end; where it lands its branch is bisected, too,
and so on to the dark. Strips between two lit branches are left to the middles of cells
(docs/design.md, decision 5).
"""

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..light.plan import Plan
from .bisection import Edges, last_on_branch, n_digits
from .points import Points
from .ray_budget import Allowance
from .searches import Search, ask

MOST_STRIPS = (
    3  # on an edge: of a bauble the third still takes 2 % of the error, the fourth nothing
)


def find_strips(
    plan: Plan, points: Points, near: Ints, far: Ints, ends: Floats, allowance: Allowance
) -> Search[tuple[Ints, Points, Bools]]:
    """Strips on edges (b,) between two points, on which the near one's branch ends (b,), 0..1
    of the way, before far ones that are dark.

    Returns the ends (b, 2 MOST_STRIPS) of strips, from near to far, the first and the last point of
    each, 1 + its index, 0 for none; these points; and where (b,) there was no allowance to go on.
    """
    a = points.view[near]
    start = a + ends[:, None] * (points.view[far] - a)
    middle = (a + points.view[far]) / 2

    found_ends = np.zeros((len(near), 2 * MOST_STRIPS), np.int64)
    found = Points.none()
    is_given_up = np.zeros(len(near), bool)
    seen = [points.branch[near]]

    asked = np.flatnonzero((points.branch[far] == 0) & (ends < 1))
    for k in range(MOST_STRIPS):
        first, course = yield from ask(start[asked])
        # one that comes again is no strip
        is_new = (first.branch != 0) & (first.branch != np.stack(seen)[:, asked]).all(axis=0)
        asked = asked[is_new]
        first = first.at(is_new)
        course = course[is_new]

        # its last place, and the next strip's first
        lacks = allowance.lacks(middle[asked], n_digits(plan) + 1)
        is_given_up[asked[lacks]] = True
        asked = asked[~lacks]
        if not len(asked):
            break
        first = first.at(~lacks)

        # to where it ends, on the same way; among the points of these edges alone, for all are many
        some = np.arange(len(asked))
        of_edges = first.and_more(points.at(far[asked]))
        edges = Edges(some, len(asked) + some, course[~lacks], np.ones(len(asked)))
        end, last, _ = yield from last_on_branch(plan, of_edges, edges)
        number = 1 + len(found) + some
        found_ends[asked, 2 * k] = number
        found_ends[asked, 2 * k + 1] = number + len(asked)
        found = Points.joined([found, first, last])

        start[asked] = first.view + end[:, None] * (points.view[far[asked]] - first.view)
        of_strip = np.zeros(len(near), np.uint64)
        of_strip[asked] = first.branch
        seen.append(of_strip)

    return found_ends, found, is_given_up
