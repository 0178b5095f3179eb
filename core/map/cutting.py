"""Cutting of pixels whose corners lie on several branches, along the borders of the branches.

Corners do not show everything within a pixel. A ray through its middle checks them: if it misses
its piece by more than the tolerance, the pixel is quartered. In chaotic light this would never end,
and some borders need more rays than a pixel may take: such pixels are sampled.
"""

from collections.abc import Generator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints, mean_at, take
from ..base.steps import Steps
from ..light.plan import Plan
from ..light.rays import Words
from .cut_cells import around_middles, cut_cells
from .points import Points, areas, in_triangles, is_seen, trace_points
from .ray_budget import RayBudget

# pixels in doubt that a square may have without being chaotic, as where edges meet
N_DOUBTFUL = 1
# display px between samples, the median of pixels on one branch: beyond it they leave gaps
APART_PX = 1.25
LEAST_ALONG = 4  # samples along a pixel's side for this median: less Effort is meant to be faster
GAP_SHARE = 1 / 16  # of a cell: a smaller part left out by its pieces is ignored


def is_dense(plan: Plan, points: Points, pixels: Ints) -> bool:
    """Whether samples of pixels such as these (m, 4), each on one branch, light all of the display
    without gaps.
    """
    lit = pixels[points.branch[pixels[:, 0]] != 0]
    if not len(lit):
        return True
    across = np.linalg.norm(points.xy[lit[:, 0]] - points.xy[lit[:, 2]], axis=1) / 2**0.5
    along = max(plan.settings.samples_along, LEAST_ALONG)
    return float(np.median(across)) <= APART_PX * along


def quarters_exceed_budget(
    points: Points, cells: Ints, middle: Ints, budget: RayBudget
) -> Steps[Bools]:
    """Mask of square cells (m, 4), with middles (m,), without enough rays for the corners and the
    middles of their quarters.
    """
    corners = take(points.view, cells)
    halfway = (corners + np.roll(corners, -1, axis=1)) / 2
    middles = (corners + points.view[middle][:, None]) / 2
    view = np.concatenate([halfway, middles], axis=1)
    yield 0
    return budget.exceeds(view.reshape(-1, 2)).reshape(len(cells), 8).any(axis=1)


def quartered(
    plan: Plan, points: Points, cells: Ints, middle: Ints, budget: RayBudget
) -> Generator[int, None, tuple[Points, Ints, Ints]]:
    """All points, the quarters (4 m, 4) of square cells (m, 4), and the quarters' middles (4 m,).

    middle : (m,) of the cells, traced already
    """
    if not len(cells):
        return points, cells, middle

    view = take(points.view, cells)
    halfway = (view + np.roll(view, -1, axis=1)) / 2

    # on a grid of half steps: integers compare faster than coordinates
    column, row = np.moveaxis(2 * halfway, 2, 0).astype(np.int64)
    _, first, number = np.unique(row << 32 | column, return_index=True, return_inverse=True)
    yield 0
    halfway = take(halfway.reshape(-1, 2), first)
    number = len(points) + number.reshape(cells.shape)
    quarters = [
        np.stack([cells[:, k], number[:, k], middle, number[:, k - 1]], axis=1) for k in range(4)
    ]

    # each starts at its corner of the cell: rotated to start at the upper left one
    quarters = np.concatenate([np.roll(q, k, axis=1) for k, q in enumerate(quarters)])

    # in one batch with their middles
    middles = mean_at(np.concatenate([points.view, halfway]), quarters)
    places = np.concatenate([halfway, middles])
    budget.take(places)
    found = yield from trace_points(plan, places)
    of_middle = len(points) + len(halfway) + np.arange(len(quarters))
    yield 0
    points = yield from Points.join_steps([points, found])
    return points, quarters, of_middle


@dataclass(frozen=True, eq=False)
class CutPixels:
    """Pixels cut into pieces.

    points : all of them
    quads : (q, 4) corners of whole pixels and quarters
    triangles : (t, 3) corners of other pieces
    chaotic : (c, 4) corners of cells in chaotic light, not cut
    budget : the remaining ray budget
    """

    points: Points
    quads: Ints
    triangles: Ints
    chaotic: Ints
    budget: RayBudget


class _Parts(NamedTuple):
    """Pixels, or quarters of them, to be cut: indices of corners (m, 4) and middles (m,).

    is_calm : (m,) they are cut while rays are left
    """

    corners: Ints
    middle: Ints
    is_calm: Bools

    def at(self, which: Ints) -> "_Parts":
        return _Parts(*(values[which] for values in self))


class _CutSamples(NamedTuple):
    """Result of cutting cells (m,).

    is_one : corners on one branch
    off : display px, distance from the middle, as in `_missed`
    has_gaps : pieces leave out a lit part
    is_over_budget : not cut, because they exceed the rays left to their pixels
    pieces, owner : (t, 3) lit pieces of cells on several branches, and the cell (t,) of each
    """

    is_one: Bools
    off: Floats
    has_gaps: Bools
    is_over_budget: Bools
    pieces: Ints
    owner: Ints


class Cutting:
    """Cuts pixels (m, 4) with corners on several branches along the borders between them: a round
    for the pixels, one for their quarters, and a last one.

    A ray through the middle checks each pixel. If it takes another branch than the piece it lies
    in, or lands further than the tolerance from the expected place, the pixel is quartered. Cells
    still off after the second round are cut as four triangles around the middle.

    Bisection has no end in chaotic light. If more than a few pixels of a square (m,), by number,
    are in doubt, two kinds of cells are sampled instead: its mixed quarters, and pixels with all
    corners lit whose pieces leave out a part, or light would be lost. If samples would leave gaps
    on the display, all are cut. Pixels and quarters whose borders exceed the ray budget are also
    sampled.

    is_coarse : no pixel is quartered
    last : (n, 5) corners and middles of cells to be cut around their middles at the end
    rough : (t, 4) their pieces by the corners alone, and the numbers of the cells
    """

    def __init__(self, plan: Plan, points: Points, is_coarse: bool) -> None:
        self.plan, self.points, self.is_coarse = plan, points, is_coarse
        self.budget = RayBudget(plan, points.view)
        self.quads: list[Ints] = []
        self.triangles: list[Ints] = []
        self.chaotic: list[Ints] = []
        self.last: list[Ints] = []
        self.rough: list[Ints] = []

    def pixels(self, corners: Ints, square: Ints) -> Generator[int, None, _Parts]:
        """Cut pixels (m, 4) in squares (m,), by number; returns the cells to be quartered."""
        middle = mean_at(self.points.view, corners)
        self.budget.take(middle)
        found = yield from trace_points(self.plan, middle)
        number = len(self.points) + np.arange(len(corners))
        self.points = self.points.and_more(found)
        yield 0
        cells = _Parts(corners, number, np.ones(len(corners), bool))
        found = yield from self._cut(cells)
        yield 0

        # calm if few are in doubt; cells bent by more than the tolerance do not count
        in_doubt = (found.has_gaps | np.isinf(found.off)) & ~found.is_over_budget
        n_in_doubt = np.bincount(square, in_doubt)
        is_dense_enough = is_dense(self.plan, self.points, corners[found.is_one])
        is_calm = (n_in_doubt <= N_DOUBTFUL)[square] | (not is_dense_enough)
        cells = cells._replace(is_calm=is_calm)
        return (yield from self._accept(cells, found, is_last=self.is_coarse))

    def quarters(self, some: _Parts) -> Generator[int, None, None]:
        """Cut the quarters of pixels."""
        yield 0
        self.points, corners, middle = yield from quartered(
            self.plan, self.points, some.corners, some.middle, self.budget
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
        yield from self._accept(cells, found, is_last=True)

    def finished(self) -> Generator[int, None, CutPixels]:
        """Cut the remaining cells."""
        yield 0
        last = np.concatenate(self.last)
        of_last = yield from self._cut_last(last)
        triangles = np.concatenate([*self.triangles, of_last])
        quads, chaotic = np.concatenate(self.quads), np.concatenate(self.chaotic)
        return CutPixels(self.points, quads, triangles, chaotic, self.budget)

    def _cut(self, cells: _Parts) -> Generator[int, None, _CutSamples]:
        """Cut cells on several branches, and compare all cells with their middles."""
        plan = self.plan
        branch = self.points.branch[cells.corners]
        is_one = (branch == branch[:, :1]).all(axis=1)
        one = np.flatnonzero(is_one)
        mixed = np.flatnonzero(~is_one)

        off = np.zeros(len(is_one))
        off[one] = missed_by_corners(
            plan, self.points, cells.corners[one], self.points.at(cells.middle[one])
        )
        yield 0

        corners, middle = cells.corners[mixed], cells.middle[mixed]
        cut = yield from cut_cells(plan, self.points, corners, self.budget, middle)
        self.points = cut.points
        yield 0
        off[mixed] = missed_by_pieces(
            plan, self.points, cut.pieces, cut.owner, self.points.at(middle)
        )
        gaps, is_over_budget = np.zeros((2, len(is_one)), bool)
        gaps[mixed] = has_gaps(self.points, corners, cut.pieces, cut.owner)
        is_over_budget[mixed] = cut.is_over_budget
        return _CutSamples(is_one, off, gaps, is_over_budget, cut.pieces, mixed[cut.owner])

    def _accept(self, cells: _Parts, found: _CutSamples, is_last: bool) -> Steps[_Parts]:
        """Store the pieces; returns the cells to be quartered, none in the last round."""
        again = found.off > self.plan.settings.tolerance

        is_unresolved = found.has_gaps | (is_last & np.isinf(found.off))
        is_sampled = found.is_over_budget | (is_unresolved & ~cells.is_calm)
        self.chaotic.append(cells.corners[is_sampled])

        is_lit = self.points.branch[cells.corners[:, 0]] != 0
        self.quads.append(cells.corners[found.is_one & is_lit & ~again])
        self.triangles.append(found.pieces[~(again | is_sampled)[found.owner]])
        yield 0

        # quarters need rays, too
        again &= ~is_sampled
        simple = again & (not is_last)
        parts = np.flatnonzero(simple)
        simple[parts] = ~(
            yield from quarters_exceed_budget(
                self.points, cells.corners[parts], cells.middle[parts], self.budget
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
        """Pieces (t, 3) of cells (n, 5): around their middles, or by corners if rays run out."""
        triangles = around_middles(last)
        branch = self.points.branch[triangles]
        is_one = (branch == branch[:, :1]).all(axis=1)
        mixed = np.flatnonzero(~is_one)
        found = yield from cut_cells(self.plan, self.points, triangles[mixed], self.budget)
        self.points = found.points
        yield 0

        cell = np.arange(len(triangles)) % max(len(last), 1)
        is_over_budget = np.zeros(len(last), bool)
        is_over_budget[cell[mixed[found.is_over_budget]]] = True
        rough = np.concatenate(self.rough)
        has_rough = np.bincount(rough[:, 3], minlength=len(last)) > 0
        self.chaotic.append(last[is_over_budget & ~has_rough, :4])

        is_whole = is_one & ~is_over_budget[cell] & (branch[:, 0] != 0)
        return np.concatenate([
            triangles[is_whole],
            found.pieces[~is_over_budget[cell[mixed[found.owner]]]],
            rough[is_over_budget[rough[:, 3]], :3],
        ])  # fmt: skip


def has_gaps(points: Points, cells: Ints, pieces: Ints, owner: Ints) -> Bools:
    """Mask of cells (m, 4) with all corners lit whose pieces (t, 3) leave out a part.

    owner : (t,) cell of each piece
    """
    covered = np.bincount(owner, areas(points.view, pieces), len(cells))
    side = points.view[cells[:, 1], 0] - points.view[cells[:, 0], 0]
    return (points.branch[cells] != 0).all(axis=1) & (covered < (1 - GAP_SHARE) * side**2)


def missed_by_corners(plan: Plan, points: Points, cells: Ints, middle: Points) -> Floats:
    """Distance (m,), display px, of the middles from the means of the corners of cells (m, 4), each
    on one branch, as `_missed`.
    """
    return _missed(plan, points.branch[cells[:, 0]], mean_at(points.xy, cells), middle)


def missed_by_pieces(
    plan: Plan, points: Points, pieces: Ints, owner: Ints, middle: Points
) -> Floats:
    """Distance (m,), display px, of cells' middles from their places in pieces (t, 3), as
    `_missed`.

    owner : (t,) cell of each piece. A middle outside all pieces is expected to be dark.
    """
    branch = np.zeros(len(middle), np.uint64)
    xy = np.full((len(middle), 2), np.nan)
    holds, at = in_triangles(
        *(take(of, pieces) for of in (points.view, points.xy)), take(middle.view, owner)
    )
    branch[owner[holds]], xy[owner[holds]] = points.branch[pieces[holds, 0]], at[holds]
    return _missed(plan, branch, xy, middle)


def _missed(plan: Plan, branch: Words, xy: Floats, middle: Points) -> Floats:
    """Distance (m,), display px, of middles from their expected places xy (m, 2) on branches (m,).

    inf on another branch, 0 outside the display.
    """
    seen = is_seen(xy, middle.xy, (plan.rig.display.width, plan.rig.display.height))
    off = np.where(seen, np.nan_to_num(np.linalg.norm(xy - middle.xy, axis=1)), 0.0)
    return np.where(branch == middle.branch, off, np.inf)
