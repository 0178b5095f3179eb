"""Borders on cells' edges that were found before, so that none is looked for again.

Cells share edges: with their neighbours, and with the triangles that they are cut into at the end.
"""

from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Ints
from .strips import MOST_STRIPS


class Borders(NamedTuple):
    """Borders on edges from a lit point to another.

    key (e,) : by `key_of` its near and its far point, sorted
    number (e,) : the last point on the near one's branch
    strips (e, 2 MOST_STRIPS) : the first and the last point of each strip
        beyond, from near to far: 1 + its number, 0 for none
    """

    key: Ints
    number: Ints
    strips: Ints

    @classmethod
    def none(cls) -> "Borders":
        """No border is known."""
        no_keys = np.empty(0, np.int64)
        return cls(no_keys, no_keys, np.empty((0, 2 * MOST_STRIPS), np.int64))

    def and_more(self, others: "Borders") -> "Borders":
        """These borders and others, of other edges."""
        joined = Borders(*(np.concatenate(pair) for pair in zip(self, others, strict=True)))
        order = np.argsort(joined.key, kind="stable")  # which merges the two
        return Borders(*(values[order] for values in joined))

    def find(self, key: Ints) -> tuple[Bools, Ints]:
        """Which edges (n,) have a border that is known, and its place (n,) among these."""
        at = np.minimum(np.searchsorted(self.key, key), max(len(self.key) - 1, 0))
        if not len(self.key):
            return np.zeros(len(key), bool), at
        return self.key[at] == key, at

    def strips_on(self, near: Ints, far: Ints) -> Ints:
        """The ends (m, k, 2 MOST_STRIPS) of strips on edges (m, k)
        between two points, in order: 1 + their number, 0 for none.
        """
        found = np.zeros((*near.shape, self.strips.shape[1]), np.int64)
        few = Borders(*(values[self.strips.any(axis=1)] for values in self))
        for wanted, turn in ((key_of(near, far), 1), (key_of(far, near), -1)):
            is_there, at = few.find(wanted)
            ends = few.strips[at[is_there], ::turn]
            found[is_there] = np.where(ends > 0, ends, found[is_there])
        return found


def key_of(near: Ints, far: Ints) -> Ints:
    """A number for an edge between points, by their numbers."""
    return near.astype(np.int64) << 32 | far


def points_of(key: Ints) -> tuple[Ints, Ints]:
    """The near and the far point of edges with such numbers."""
    return key >> 32, key & 0xFFFFFFFF
