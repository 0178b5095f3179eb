"""Where a ray leaves a shell that cuts itself.

All that the shell winds around, once or more, is glass. A ray within it counts the faces that it
enters and leaves, and passes by them, until it has left one more than it has entered: there it
leaves the glass.
"""

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Bools, Floats, Ints, taken
from ..vectors import dot
from .engines import Found
from .hits import Hits, Question

if TYPE_CHECKING:
    from .ray_engine import Layer


class Passed:
    """The faces of such shells that rays have passed, met one after the other."""

    def __init__(self, is_inside: Bools, tolerance: float) -> None:
        """Of rays (n,), inside a closed solid or not.

        tolerance : m, a face that is no further from the one before is the same
        """
        self._is_inside = is_inside
        self._tolerance = tolerance
        # of each ray, once there are some: faces entered more than left, how far the last is, and
        # its triangle, -1 where by itself it could not be met
        self._deeper: Ints | None = None
        self._distance: Floats | None = None
        self._triangle: Ints | None = None
        self._doubted: list[Ints] = []  # rays outside with a hit that cannot be

    def count(
        self, rays: Ints, hits: Hits, is_true: Bools, is_wrong: Bools
    ) -> tuple[Bools, Bools | None]:
        """Which hits (m,) of rays (m,) are true ones, with those passed, and which are passed now,
        None for none.

        is_true, is_wrong : (m,) are they true ones, or such that cannot be, of shells that do not
            cut themselves
        """
        if self._deeper is None and not is_wrong.any():
            return is_true, None

        is_inside = self._is_inside[rays]
        enters = is_wrong & is_inside
        self._doubted.append(rays[is_wrong & ~is_inside])
        if self._deeper is None:
            self._deeper = np.zeros(len(self._is_inside), np.int64)
            self._distance = np.full(len(self._is_inside), -np.inf)
            self._triangle = np.full(len(self._is_inside), -1)

        deeper, last = self._deeper[rays], self._triangle[rays]
        further = hits.distance - self._distance[rays]
        is_here = np.abs(further) <= self._tolerance

        # the same face may be met behind several triangles of the hull,
        # and rounding may change the order of two faces in one place
        is_same = is_here & (hits.triangle == last)
        is_swapped = is_here & (last < 0) & (deeper == 1)
        leaves = is_true & (deeper > 0) & ~is_swapped

        passes = (enters | leaves) & (further > self._tolerance)
        self._deeper[rays[passes]] = (deeper + np.where(enters, 1, -1))[passes]
        self._distance[rays[passes]] = hits.distance[passes]
        self._triangle[rays[passes]] = np.where(enters, -1, hits.triangle)[passes]
        return is_true & ~leaves & ~is_same, passes

    def last(self, rays: Ints) -> Floats:
        """How far the last face is that each of rays (m,) has passed, m, -inf for none."""
        return np.full(len(rays), -np.inf) if self._distance is None else self._distance[rays]

    def some_of(self, rays: Ints) -> Ints:
        """Those of rays (m,) that have passed a face."""
        return rays[:0] if self._distance is None else rays[np.isfinite(self._distance[rays])]

    def lost(self, ended: list[Ints]) -> Ints:
        """The rays that must have met another face: outside, those with a hit that cannot be;
        within, those among the ones that have ended without a hit.
        """
        ended = np.concatenate([np.empty(0, np.int64), *ended])
        return np.concatenate([ended[self._is_inside[ended]], *self._doubted])


def enter_again(
    layer: "Layer",
    question: Question,
    rays: Ints,
    shot: tuple[Found, Bools, Floats],
    hits: tuple[Hits, Bools],
    passed: Passed,
) -> None:
    """Put hits where rays (m,) within the glass enter it, beside those where they leave it.

    shot : what the engine has found, for which of its rays (n,), m of them, and how far (n,), m
    hits : where they meet the layer, and whether they do (m,)
    """
    if layer.curved is None or question.leaves is None:
        return
    found, chosen, far = shot
    some, is_met = hits
    enters = dot(taken(question.lines.directions, rays), taken(found.normal, chosen)) < 0
    enters &= question.leaves[rays] & question.is_inside[rays]
    # what is entered lies behind the hull: not where the ray leaves before
    asked = np.flatnonzero(enters & ~(is_met & (some.distance <= far[chosen])))
    if len(asked):
        which = np.flatnonzero(chosen)[asked]
        from_outside = np.zeros(len(asked), bool)
        more, is_more = layer.refine(found, which, question.lines.at(rays[asked]), from_outside)
        # before the ray leaves around there, and no face that it has passed
        t = more.distance
        is_more &= more.enters & (t > np.maximum(passed.last(rays[asked]), 0.0) + layer.tolerance)
        is_more &= ~(is_met[asked] & (some.distance[asked] < t))
        some.put(asked[is_more], more.at(is_more))
        is_met[asked[is_more]] = True
