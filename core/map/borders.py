"""Where branches meet: a pixel whose corners lie on several branches is cut along the borders.

Corners do not know all that goes on within a pixel. A ray through its middle tells: where it misses
its piece by more than the tolerance the pixel is quartered, twice at the most, since the error of
a cell that is bent falls as 1 / 4^quarterings. Where light is chaotic that has no end, and where
borders take more rays than a pixel is allowed: such pixels are sampled.
"""

from collections.abc import Generator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Ints, mean_at, taken
from ..base.steps import Pauses
from ..light.plan import Plan
from .cut_cells import around_middles, cut_cells, find_sides
from .cut_quality import (
    CUT,
    Doubts,
    has_gaps,
    in_chaos,
    is_dense,
    missed_by_corners,
    missed_by_pieces,
    n_branches,
    worth_rays,
)
from .known_borders import Borders
from .points import Points, trace_points
from .ray_budget import Allowance


def lack_quarters(points: Points, cells: Ints, middle: Ints, allowance: Allowance) -> Pauses[Bools]:
    """Which square cells (m, 4) with middles (m,) have no rays left for the corners and the
    middles of their quarters?
    """
    corners = taken(points.view, cells)
    halfway = (corners + np.roll(corners, -1, axis=1)) / 2
    middles = (corners + points.view[middle][:, None]) / 2
    view = np.concatenate([halfway, middles], axis=1)
    yield 0
    return allowance.lacks(view.reshape(-1, 2)).reshape(len(cells), 8).any(axis=1)


def quartered(
    plan: Plan, points: Points, cells: Ints, middle: Ints, allowance: Allowance
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
    asked = np.concatenate([halfway, middles])
    allowance.take(asked)
    found = yield from trace_points(plan, asked)
    of_middle = len(points) + len(halfway) + np.arange(len(quarters))
    yield 0
    points = yield from Points.joining([points, found])
    return points, quarters, of_middle


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pixels cut in pieces: all points; indices of corners of whole
    pixels and quarters (q, 4), of other pieces (t, 3).

    chaotic (c, 4) : cells that are not cut, because light is chaotic there
    allowance : what is left of it
    """

    points: Points
    quads: Ints
    triangles: Ints
    chaotic: Ints
    allowance: Allowance


class _Parts(NamedTuple):
    """Pixels, or quarters of them, to be cut: indices of corners (m, 4) and middles (m,).

    is_calm (m,) : they are cut, however many branches there are, while there are rays left
    """

    corners: Ints
    middle: Ints
    is_calm: Bools

    def at(self, which: Ints) -> "_Parts":
        return _Parts(*(values[which] for values in self))


class Cutting:
    """Cuts pixels (m, 4) whose corners lie on several branches along the borders between them: one
    round for the pixels, one for each quartering, and a last one.

    A ray through the middle tells whether more goes on than the corners know. Where it takes
    another branch than the piece it lies in, or lands further than the tolerance from where it was
    expected, the pixel is quartered, and its quarters once more, `quarterings` times at the most.
    Of cells that are left then, or bent too much, four triangles around the middle are cut.

    Bisection has no end where light is chaotic. Not cut are all mixed pixels of a square (m,), by
    number, in which a good part of the middles lie on other branches than the corners; and, in one
    in which more than a few pixels are in doubt, those with more branches than can be told apart,
    those of which the pieces leave out a part, though all corners are lit, and all mixed quarters.
    Nor are pixels and quarters whose borders take more rays than the allowance of a pixel has left.

    last : (n, 5) corners and middles of cells that are cut around their middles at the end
    rough : (t, 4) the pieces of these by their corners alone, and the numbers of the cells
    """

    def __init__(self, plan: Plan, points: Points, quarterings: int) -> None:
        self.plan, self.points, self.quarterings = plan, points, quarterings
        self.known = Borders.none()
        self.allowance = Allowance(plan, points.view)
        self.quads: list[Ints] = []
        self.triangles: list[Ints] = []
        self.chaotic: list[Ints] = []
        self.last: list[Ints] = []
        self.rough: list[Ints] = []

    def pixels(self, corners: Ints, square: Ints) -> Generator[int, None, _Parts]:
        """Cut pixels (m, 4) in squares (m,), by number; the quarters that are looked into."""
        middle = mean_at(self.points.view, corners)
        self.allowance.take(middle)
        found = yield from trace_points(self.plan, middle)
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
        found = yield from self._cut(cells)
        yield 0
        in_doubt = (found.has_gaps | np.isinf(found.off)) & ~found.lacks
        n_in_doubt = np.bincount(square, in_doubt)
        is_calm = (n_in_doubt <= CUT.n_doubtful)[square] | (not dense)

        return (yield from self._settled(cells._replace(is_calm=is_calm), found, 0))

    def quarters(self, some: _Parts, depth: int) -> Generator[int, None, _Parts]:
        """Cut the quarters of cells, quartered so often; their quarters that are looked into."""
        yield 0
        self.points, corners, middle = yield from quartered(
            self.plan, self.points, some.corners, some.middle, self.allowance
        )
        yield 0
        cells = _Parts(corners, middle, np.tile(some.is_calm, 4))
        branch = self.points.branch[corners]
        is_given_up = (branch != branch[:, :1]).any(axis=1) & ~cells.is_calm
        self.chaotic.append(corners[is_given_up])
        cells = cells.at(np.flatnonzero(~is_given_up))
        yield 0

        found = yield from self._cut(cells)
        yield 0
        return (yield from self._settled(cells, found, depth))

    def finished(self) -> Generator[int, None, Pieces]:
        """Cut what is not looked into any further."""
        yield 0
        last = np.concatenate(self.last)
        of_last = yield from self._cut_last(last)
        triangles = np.concatenate([*self.triangles, of_last])
        quads, chaotic = np.concatenate(self.quads), np.concatenate(self.chaotic)
        return Pieces(self.points, quads, triangles, chaotic, self.allowance)

    def _cut(self, cells: _Parts) -> Generator[int, None, Doubts]:
        """Cut cells on several branches, and compare all with their middles."""
        plan = self.plan
        branch = self.points.branch[cells.corners]
        is_one = (branch == branch[:, :1]).all(axis=1)
        one = np.flatnonzero(is_one)
        mixed = np.flatnonzero(~is_one)

        # on one branch: no cut
        off = np.zeros(len(is_one))
        off[one] = missed_by_corners(
            plan, self.points, cells.corners[one], self.points.at(cells.middle[one])
        )
        yield 0

        # on several
        corners, middle = cells.corners[mixed], cells.middle[mixed]
        sides = yield from find_sides(self.points, corners, self.known)
        yield 0
        found = yield from cut_cells(plan, self.points, sides, self.known, self.allowance, middle)
        self.points, self.known = found.points, found.known
        yield 0
        off[mixed] = missed_by_pieces(
            plan, self.points, found.pieces, found.owner, self.points.at(middle)
        )
        yield 0
        gaps, lacks = np.zeros((2, len(is_one)), bool)
        gaps[mixed] = has_gaps(self.points, corners, found.pieces, found.owner)
        lacks[mixed] = found.lacks
        yield 0

        n_met = n_branches(self.points, np.column_stack([cells.corners, cells.middle]))
        return Doubts(
            is_one=is_one,
            off=off,
            n_met=n_met,
            has_gaps=gaps,
            lacks=lacks,
            pieces=found.pieces,
            owner=mixed[found.owner],
        )

    def _settled(self, cells: _Parts, found: Doubts, depth: int) -> Pauses[_Parts]:
        """Take up the pieces, and hand on the cells that are quartered."""
        tolerance = self.plan.settings.tolerance
        is_last = depth == self.quarterings
        again = found.off > tolerance

        # sampled
        is_tangled = (
            np.isinf(found.off) & ((found.n_met >= CUT.many_branches) | is_last) | found.has_gaps
        )
        is_tangled &= ~cells.is_calm
        is_tangled |= found.lacks
        self.chaotic.append(cells.corners[is_tangled])

        # as they are
        is_lit = self.points.branch[cells.corners[:, 0]] != 0
        self.quads.append(cells.corners[found.is_one & is_lit & ~again])
        self.triangles.append(found.pieces[~(again | is_tangled)[found.owner]])
        yield 0

        # looked into
        again &= ~is_tangled
        # quarters of quarters are of no use where the error is too large to get small
        simple = again & (found.n_met < CUT.many_branches) & (not is_last)

        if depth > 0:
            least = worth_rays(tolerance, self.plan.settings.effort)
            most = 4.0 ** (self.quarterings - depth) * least
            simple &= np.isinf(found.off) | (found.off < most)

        # their quarters want rays, too
        self.allowance.keep(min(depth + 1, self.quarterings))
        parts = np.flatnonzero(simple)
        simple[parts] = ~(
            yield from lack_quarters(
                self.points, cells.corners[parts], cells.middle[parts], self.allowance
            )
        )
        yield 0

        rest = again & ~simple
        number = sum(len(some) for some in self.last) + np.cumsum(rest) - 1
        is_rough = (rest & ~found.has_gaps)[found.owner]
        owner = number[found.owner[is_rough]]
        self.rough.append(np.column_stack([found.pieces[is_rough], owner]))
        self.last.append(np.column_stack([cells.corners[rest], cells.middle[rest]]))
        yield 0
        return cells.at(np.flatnonzero(simple))

    def _cut_last(self, last: Ints) -> Generator[int, None, Ints]:
        """Pieces (t, 3) of cells (n, 5), around their middles, or where rays lack by corners."""
        triangles = around_middles(last)
        branch = self.points.branch[triangles]
        is_one = (branch == branch[:, :1]).all(axis=1)
        mixed = np.flatnonzero(~is_one)
        sides = yield from find_sides(self.points, triangles[mixed], self.known)
        yield 0
        found = yield from cut_cells(self.plan, self.points, sides, self.known, self.allowance)
        self.points = found.points
        yield 0

        cell = np.arange(len(triangles)) % max(len(last), 1)
        lacks = np.zeros(len(last), bool)
        lacks[cell[mixed[found.lacks]]] = True
        rough = np.concatenate(self.rough)
        has_rough = np.bincount(rough[:, 3], minlength=len(last)) > 0
        self.chaotic.append(last[lacks & ~has_rough, :4])

        is_whole = is_one & ~lacks[cell] & (branch[:, 0] != 0)
        return np.concatenate([
            triangles[is_whole],
            found.pieces[~lacks[cell[mixed[found.owner]]]],
            rough[lacks[rough[:, 3]], :3],
        ])  # fmt: skip
