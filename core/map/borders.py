"""Where branches meet: a pixel whose corners lie on several branches is cut along the borders.

Corners do not know all that goes on within a pixel. A ray through its middle tells: where it misses
its piece by more than the tolerance the pixel is quartered, twice at the most, since the error of
a cell that is bent falls as 1 / 4^quarterings. To go on until all middles agree was left: where
light is chaotic that has no end, and such pixels are sampled.
"""

from collections.abc import Generator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import Bools, Ints, mean_at, taken
from ..light.plan import Plan
from .cut_cells import cut_cells
from .doubts import (
    CUT,
    Doubts,
    has_gaps,
    in_chaos,
    is_dense,
    missed_by_corners,
    missed_by_pieces,
    n_branches,
)
from .known_borders import Borders
from .points import Points, trace_points
from .ray_guess import N_SEARCHES, NO_RAYS, RAYS, Rays, RaysAhead, of_quarters, rays_of_cut


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pixels cut in pieces: all points; indices of corners of whole
    pixels and quarters (q, 4), of other pieces (t, 3).

    chaotic (c, 4) : cells that are not cut, because light is chaotic there
    """

    points: Points
    quads: Ints
    triangles: Ints
    chaotic: Ints


def cut(
    plan: Plan, points: Points, cells: Ints, square: Ints, ahead: RaysAhead, quarterings: int
) -> Generator[int, None, Pieces]:
    """Cut pixels (m, 4) whose corners lie on several branches along the borders between them.

    A ray through the middle tells whether more goes on than the corners know. Where it takes
    another branch than the piece it lies in, or lands further than the tolerance from where it was
    expected, the pixel is quartered, and its quarters once more, `quarterings` times at the most.
    Of cells that are left then, or bent too much, four triangles around the middle are cut.

    Bisection has no end where light is chaotic. Not cut are all mixed pixels of a square (m,), by
    number, in which a good part of the middles lie on other branches than the corners; and, in one
    in which more than a few pixels are in doubt, those with more branches than can be told apart,
    those of which the pieces leave out a part, though all corners are lit, and all mixed quarters.

    `ahead` is told about how many rays are still to come.
    """
    work = _Cutting(plan, points, ahead, quarterings)
    some = yield from work.pixels(cells, square)
    for depth in range(1, quarterings + 1):
        some = yield from work.quarters(some, depth)
    return (yield from work.finished())


class _Parts(NamedTuple):
    """Pixels, or quarters of them, to be cut: indices of corners (m, 4) and middles (m,).

    is_calm (m,) : they are cut to the end, however many branches there are
    """

    corners: Ints
    middle: Ints
    is_calm: Bools

    def at(self, which: Ints) -> "_Parts":
        return _Parts(*(values[which] for values in self))


class _Cutting:
    """The work of cutting: all points and borders so far, and
    the pieces, `last` those to be cut at the end.
    """

    def __init__(self, plan: Plan, points: Points, ahead: RaysAhead, quarterings: int) -> None:
        self.plan, self.points, self.ahead = plan, points, ahead
        self.quarterings = quarterings
        self.known = Borders.none()
        self.quads: list[Ints] = []
        self.triangles: list[Ints] = []
        self.chaotic: list[Ints] = []
        self.last: list[Ints] = []

    def pixels(self, corners: Ints, square: Ints) -> Generator[int, None, _Parts]:
        """Cut pixels (m, 4) in squares (m,), by number; the quarters that are looked into."""
        found = yield from trace_points(self.plan, mean_at(self.points.view, corners))
        number = len(self.points) + np.arange(len(corners))
        self.points = self.points.and_more(found)
        yield 0
        cells = _Parts(corners, number, np.ones(len(corners), bool))
        branch = self.points.branch[corners]
        is_one = (branch == branch[:, :1]).all(axis=1)

        # squares that are chaotic by their middles alone are not cut at all
        dense = is_dense(self.plan, self.points, corners[is_one])
        of_middle = self.points.branch[cells.middle]
        is_given_up = dense & in_chaos(branch, of_middle, ~is_one, square)
        self.chaotic.append(corners[is_given_up])
        cells = cells.at(np.flatnonzero(~is_given_up))
        square = square[~is_given_up]
        yield 0

        # calm where few are in doubt: not by cells that are only bent by more than the tolerance
        found = yield from self._cut(cells, 0)
        yield 0
        in_doubt = found.has_gaps | np.isinf(found.off)
        n_in_doubt = np.bincount(square, in_doubt)
        is_calm = (n_in_doubt <= CUT.n_doubtful)[square] | (not dense)

        return self._settled(cells._replace(is_calm=is_calm), found, 0)

    def quarters(self, some: _Parts, depth: int) -> Generator[int, None, _Parts]:
        """Cut the quarters of cells, quartered so often; their quarters that are looked into."""
        yield 0
        self.points, corners, middle = yield from _quartered(
            self.plan, self.points, some.corners, some.middle
        )
        yield 0
        if depth == self.quarterings:  # none of these are quartered again
            self._expect(corners, depth)
            yield 0
        cells = _Parts(corners, middle, np.tile(some.is_calm, 4))
        branch = self.points.branch[corners]
        is_given_up = (branch != branch[:, :1]).any(axis=1) & ~cells.is_calm
        self.chaotic.append(corners[is_given_up])
        cells = cells.at(np.flatnonzero(~is_given_up))
        yield 0

        found = yield from self._cut(cells, depth)
        yield 0
        return self._settled(cells, found, depth)

    def finished(self) -> Generator[int, None, Pieces]:
        """Cut what is not looked into any further."""
        yield 0
        last = np.concatenate(self.last)
        yield 0
        self._expect(np.empty((0, 4), np.int64), N_SEARCHES - 1)
        yield 0
        self.points, of_last = yield from self.ahead.searching(
            _cut_last(self.plan, self.points, self.known, last)
        )
        return Pieces(
            self.points,
            np.concatenate(self.quads),
            np.concatenate([*self.triangles, of_last]),
            np.concatenate(self.chaotic),
        )

    def _cut(self, cells: _Parts, depth: int) -> Generator[int, None, Doubts]:
        """Cut cells on several branches, and compare all with their middles."""
        plan = self.plan
        tolerance = plan.settings.tolerance
        branch = self.points.branch[cells.corners]
        is_one = (branch == branch[:, :1]).all(axis=1)
        one = np.flatnonzero(is_one)
        mixed = np.flatnonzero(~is_one)

        # on one branch: no cut
        off = np.zeros(len(is_one))
        off[one] = missed_by_corners(
            plan, self.points, cells.corners[one], self.points.at(cells.middle[one])
        )
        n_bent = int((off[one] > tolerance).sum())
        yield 0
        self._expect(cells.corners, depth, of_quarters(RAYS.of_bent[depth] * n_bent))
        yield 0

        # on several
        self.points, self.known, pieces, owner = yield from self.ahead.searching(
            cut_cells(plan, self.points, cells.corners[mixed], self.known, cells.middle[mixed])
        )
        yield 0
        off[mixed] = missed_by_pieces(
            plan, self.points, pieces, owner, self.points.at(cells.middle[mixed])
        )
        yield 0
        gaps = np.zeros(len(is_one), bool)
        gaps[mixed] = has_gaps(self.points, cells.corners[mixed], pieces, owner)
        yield 0

        n_met = n_branches(self.points, np.column_stack([cells.corners, cells.middle]))
        return Doubts(
            is_one=is_one,
            off=off,
            n_met=n_met,
            has_gaps=gaps,
            pieces=pieces,
            owner=mixed[owner],
        )

    def _settled(self, cells: _Parts, found: Doubts, depth: int) -> _Parts:
        """Take up the pieces, and hand on the cells that are quartered."""
        tolerance = self.plan.settings.tolerance
        is_last = depth == self.quarterings
        again = found.off > tolerance

        # sampled
        is_tangled = (
            np.isinf(found.off) & ((found.n_met >= CUT.many_branches) | is_last) | found.has_gaps
        )
        is_tangled &= ~cells.is_calm
        self.chaotic.append(cells.corners[is_tangled])

        # as they are
        is_lit = self.points.branch[cells.corners[:, 0]] != 0
        self.quads.append(cells.corners[found.is_one & is_lit & ~again])
        self.triangles.append(found.pieces[~(again | is_tangled)[found.owner]])

        # looked into
        again &= ~is_tangled
        # quarters of quarters are of no use where the error is too large to get small
        simple = again & (found.n_met < CUT.many_branches) & (not is_last)

        if depth > 0:
            most = 4.0 ** (self.quarterings - depth) * max(CUT.least_error_px, tolerance)
            simple &= np.isinf(found.off) | (found.off < most)

        rest = cells.at(np.flatnonzero(again & ~simple))
        self.last.append(_around(rest.corners, rest.middle))
        return cells.at(np.flatnonzero(simple))

    def _expect(self, cells: Ints, depth: int, more: Rays = NO_RAYS) -> None:
        """Tell about how many rays it takes to find the borders in cells (m, 4), quartered so
        often, to cut those that were left for the end, and to sample; and more rays besides.
        """
        last = np.concatenate([np.empty((0, 3), np.int64), *self.last])
        rays = rays_of_cut(self.plan, self.points, cells, last, self.chaotic)
        searches = Rays(searches=N_SEARCHES - depth)
        self.ahead.expect(rays.and_more(more).and_more(searches))


def _cut_last(
    plan: Plan, points: Points, known: Borders, triangles: Ints
) -> Generator[int, None, tuple[Points, Ints]]:
    """Cut triangles (m, 3) that are not looked into any
    further: all points, and the lit pieces (t, 3).
    """
    branch = points.branch[triangles]
    is_one = (branch == branch[:, :1]).all(axis=1)
    points, _, pieces, _ = yield from cut_cells(plan, points, triangles[~is_one], known)
    yield 0
    return points, np.concatenate([triangles[is_one & (branch[:, 0] != 0)], pieces])


def _around(cells: Ints, middle: Ints) -> Ints:
    """Four triangles (4 m, 3) around the middle of each cell (m, 4)."""
    return np.concatenate(
        [np.stack([middle, cells[:, k], cells[:, (k + 1) % 4]], axis=1) for k in range(4)]
    )


def _quartered(
    plan: Plan, points: Points, cells: Ints, middle: Ints
) -> Generator[int, None, tuple[Points, Ints, Ints]]:
    """The quarters (4 m, 4) of square cells (m, 4), given their middles; and all
    points, among them the middles (4 m,) of the quarters.
    """
    if not len(cells):
        return points, cells, middle

    # points between the corners, each once
    view = taken(points.view, cells)
    halfway = (view + np.roll(view, -1, axis=1)) / 2

    # they lie on a grid so fine: whole numbers are told apart faster than places
    column, row = np.moveaxis(2**CUT.quarterings * halfway, 2, 0).astype(np.int64)
    _, first, number = np.unique(row << 32 | column, return_index=True, return_inverse=True)
    yield 0
    halfway = taken(halfway.reshape(-1, 2), first)
    number = len(points) + number.reshape(cells.shape)
    quarters = [
        np.stack([cells[:, k], number[:, k], middle, number[:, k - 1]], axis=1) for k in range(4)
    ]

    # each begins at its corner of the whole: turned back, so that all begin at the upper left
    quarters = np.concatenate([np.roll(q, k, axis=1) for k, q in enumerate(quarters)])

    # with their middles, in one go
    middles = mean_at(np.concatenate([points.view, halfway]), quarters)
    found = yield from trace_points(plan, np.concatenate([halfway, middles]))
    of_middle = len(points) + len(halfway) + np.arange(len(quarters))
    yield 0
    return points.and_more(found), quarters, of_middle
