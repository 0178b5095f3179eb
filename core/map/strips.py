"""Strips of light between a border and the dark, of which no corner of a cell knows.

At the rim of a hollow glass, light takes one branch after the other in less than a pixel before it
is lost. Each is thin on the viewer's image, and all that shows a part of the display. So the ray
just beyond a border to the dark is followed to its end; where it lands its branch is bisected, too,
and so on to the dark. Strips between two lit branches are left to the middles of cells
(docs/design.md, decision 5).
"""

from collections.abc import Generator
from typing import NamedTuple

import numpy as np

from ..arrays import Floats, Ints
from ..light.plan import Plan
from .bisection import last_on_branch
from .points import Points, trace_points

MOST_STRIPS = (
    3  # on an edge: of a bauble the third still takes 2 % of the error, the fourth nothing
)


class Strips(NamedTuple):
    """Strips on edges from a lit point to a dark one.

    key (e,) : near * n + far of an edge between two of n points, sorted
    ends (e, 2 MOST_STRIPS) : the first and the last point of each
        strip, from near to far: 1 + its index, 0 for none
    points : the ends
    """

    key: Ints
    ends: Ints
    points: Points

    def on_edges(self, near: Ints, far: Ints, n: int, n_before: int) -> Ints:
        """The ends (m, k, 2 MOST_STRIPS) on edges (m, k) between two of n points, in order: 1 +
        their index, where so many points come before them.
        """
        found = np.zeros((*near.shape, self.ends.shape[1]), np.int64)
        if not len(self.key):
            return found

        for wanted, turn in ((near * n + far, 1), (far * n + near, -1)):
            at = np.minimum(np.searchsorted(self.key, wanted), len(self.key) - 1)
            is_there = self.key[at] == wanted
            ends = self.ends[at[is_there], ::turn]
            found[is_there] = np.where(ends > 0, ends + n_before, 0)
        return found


def find_strips(
    plan: Plan, points: Points, key: Ints, ends: Floats
) -> Generator[int, None, Strips]:
    """Strips on edges (b,), by their points near * n + far, of n points, on which the near one's
    branch ends (b,), 0..1 of the way, before far ones that are dark.
    """
    n = len(points)
    near, far = key // n, key % n
    a = points.view[near]
    start = a + ends[:, None] * (points.view[far] - a)

    found_ends = np.zeros((len(key), 2 * MOST_STRIPS), np.int64)
    found = Points.none()
    seen = [points.branch[near]]

    asked = np.flatnonzero((points.branch[far] == 0) & (ends < 1))
    for k in range(MOST_STRIPS):
        first = yield from trace_points(plan, start[asked])
        # one that comes again is no strip
        is_new = (first.branch != 0) & (first.branch != np.stack(seen)[:, asked]).all(axis=0)
        asked = asked[is_new]
        if not len(asked):
            break
        first = first.at(is_new)

        # to where it ends, on the same way
        end, last = yield from last_on_branch(
            plan,
            points.and_more(first),
            n + np.arange(len(asked)),
            far[asked],
            np.ones(len(asked)),
        )
        number = 1 + len(found) + np.arange(len(asked))
        found_ends[asked, 2 * k] = number
        found_ends[asked, 2 * k + 1] = number + len(asked)
        found = found.and_more(first).and_more(last)

        start[asked] = first.view + end[:, None] * (points.view[far[asked]] - first.view)
        of_strip = np.zeros(len(key), np.uint64)
        of_strip[asked] = first.branch
        seen.append(of_strip)

    some = np.flatnonzero(found_ends[:, 0])
    return Strips(key[some], found_ends[some], found)
