"""Intersections of rays with surfaces, and the state of a search for them."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import Bools, Floats, Ints, take
from ..glass.curved import EDGE, CurvedFaces
from ..glass.curved_hits import RayLines


@dataclass(frozen=True, eq=False)
class Hits:
    """First hits of n rays.

    distance : (n,) m, inf for none
    triangle : (n,), -1 for none
    u, v : (n,) barycentric
    enters : (n,) the ray comes from the front
    cosine : (n,) of the angle between the ray and the face's normal, 0..1
    facing : (n, 3) normal of a curved face, not unit, 0 for flat ones; None if nothing is curved
    normal : (n, 3) refracting normal of a curved face; None if all use their own
    """

    distance: Floats
    triangle: Ints
    u: Floats
    v: Floats
    enters: Bools
    cosine: Floats
    facing: Floats | None = None
    normal: Floats | None = None

    @classmethod
    def none(cls, n: int, curved: CurvedFaces | None) -> "Hits":
        """Empty hits of n rays, for a surface with or without curved faces."""
        facing = None if curved is None else np.zeros((n, 3))
        normal = np.zeros((n, 3)) if curved is not None and curved.has_given_normals else None
        return cls(
            distance=np.full(n, np.inf),
            triangle=np.full(n, -1),
            u=np.zeros(n),
            v=np.zeros(n),
            enters=np.zeros(n, bool),
            cosine=np.ones(n),
            facing=facing,
            normal=normal,
        )

    def put(self, rays: Ints, hits: "Hits") -> None:
        """Set the hits of some rays."""
        for mine, theirs in zip(self._columns(), hits._columns(), strict=True):
            if mine is not None:
                mine[rays] = 0.0 if theirs is None else theirs

    def at(self, rays: Ints | Bools) -> "Hits":
        """The hits of some rays."""
        return Hits(*(None if column is None else take(column, rays) for column in self._columns()))

    def without_normals(self) -> "Hits":
        """The same hits without the normals of curved faces."""
        return replace(self, facing=None, normal=None)

    def or_where(self, chosen: Bools, others: "Hits") -> "Hits":
        """These hits, replaced by others if chosen (n,)."""
        return Hits(
            *(
                _either(chosen, *pair)
                for pair in zip(self._columns(), others._columns(), strict=True)
            )
        )

    def gap(self, others: "Hits") -> Floats:
        """Perpendicular distances (n,), m, between the faces of these hits and others of the same
        rays.

        Along a grazing ray, a nanometre between faces becomes a millimetre.
        """
        with np.errstate(invalid="ignore"):  # neither is hit
            along = np.abs(self.distance - others.distance)
        return along * np.maximum(self.cosine, others.cosine)

    def _columns(self) -> tuple[np.ndarray | None, ...]:
        return (
            *(self.distance, self.triangle, self.u, self.v, self.enters, self.cosine),
            *(self.facing, self.normal),
        )


def _either(chosen: Bools, mine: np.ndarray | None, theirs: np.ndarray | None) -> np.ndarray | None:
    """One column, replaced by the other if chosen; None counts as 0."""
    if mine is None and theirs is None:
        return None
    mine, theirs = (np.zeros((1, 3)) if column is None else column for column in (mine, theirs))
    return np.where(chosen if mine.ndim == 1 else chosen[:, None], theirs, mine)


# for hits of rays (indices): which are true, and which are impossible
Accept = Callable[[Ints, Hits], tuple[Bools, Bools]]


TIMES_FEW = 4  # least number of rays of an event for each deferred ray


class LayerSearch:
    """Progress of the search of a layer for the first hits of n rays.

    An engine call costs as much for one ray as for many. If only a few rays of an event still need
    a call, they may be deferred to the next event.

    live (m,) : the rays of this event
    within (m,) : m, hits further away are irrelevant
    is_open (m,) : the search is deferred
    """

    def __init__(self, n: int, may_wait: bool = False) -> None:
        self.may_wait = may_wait
        # start of the next engine query and the step after it, m; NaN before the first query
        self._start, self._step = np.full((2, n), np.nan)
        self._is_lost = np.zeros(n, bool)  # must have hit another face
        self.begin(np.arange(n), np.full(n, np.inf))

    def begin(self, live: Ints, within: Floats) -> None:
        """Begin an event of these rays."""
        self.live, self.within = live, within
        self.is_open = np.zeros(len(live), bool)

    def resume(self, rays: Ints, start: Floats, step: Floats) -> tuple[Floats, Floats]:
        """Start and step of some rays; the given ones for a new search."""
        i = self.live[rays]
        is_new = np.isnan(self._start[i])
        return np.where(is_new, start, self._start[i]), np.where(is_new, step, self._step[i])

    def put_off(self, rays: Ints, start: Floats, step: Floats) -> bool:
        """Defer the search for some rays if allowed and if they are few; returns whether it was
        deferred.
        """
        if not self.may_wait or len(rays) * TIMES_FEW > len(self.live):
            return False
        self.is_open[rays] = True
        self._start[self.live[rays]], self._step[self.live[rays]] = start, step
        return True

    def lost(self, rays: Ints, lost: Ints) -> Ints:
        """The subset of rays, not deferred, with a missed face now or earlier."""
        self._is_lost[self.live[lost]] = True
        return rays[self._is_lost[self.live[rays]] & ~self.is_open[rays]]

    def end(self, rays: Ints) -> None:
        """Reset the search for rays whose hits are found."""
        self._start[self.live[rays]], self._is_lost[self.live[rays]] = np.nan, False


@dataclass(frozen=True, eq=False)
class Question:
    """A query for the first true hits of rays in a layer.

    lines : n rays, world, float64
    accept : decides which hits are true
    is_inside : (n,) the ray is inside a closed solid of the layer, so a miss is impossible
    leaves : (n,) the ray is inside a solid, so only back faces can be hit; None if not all parts
        are solids
    search : progress of earlier searches of the layer
    """

    lines: RayLines
    accept: Accept
    is_inside: Bools | None = None
    leaves: Bools | None = None
    search: LayerSearch | None = None

    def leaves_at(self, rays: Ints) -> Bools | None:
        """Which of some rays leave a solid; None if not all parts are solids."""
        return None if self.leaves is None else self.leaves[rays]


def is_within(u: Floats, v: Floats, slack: float = EDGE) -> Bools:
    """Whether barycentric coordinates lie within their triangles, up to some slack."""
    return (u >= -slack) & (v >= -slack) & (u + v <= 1 + slack)


def slab(bounds: Floats, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
    """Distances (n,) at which rays enter and leave an axis-aligned box (2, 3).

    Enter > leave is a miss.
    """
    enter = np.full(len(origins), -np.inf)
    leave = np.full(len(origins), np.inf)

    with np.errstate(divide="ignore", invalid="ignore"):
        # one axis at a time: three times as fast as reductions over rows of three
        for axis in range(3):
            inverse = 1.0 / directions[:, axis]
            low = (bounds[0, axis] - origins[:, axis]) * inverse
            high = (bounds[1, axis] - origins[:, axis]) * inverse
            # fmax and fmin ignore the NaN of a ray within a face of the box
            enter = np.fmax(enter, np.fmin(low, high))
            leave = np.fmin(leave, np.fmax(low, high))

    return enter, leave
