"""About how many rays a view map takes, for the progress alone."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple, TypeVar

import numpy as np

from ..arrays import Floats, Ints
from ..light.landings import Words
from ..light.plan import Plan
from ..steps import Pauses
from . import interpolation
from .bisection import BISECTION, n_digits
from .doubts import CUT
from .faint import may_take_more
from .interpolation import NODES_ALONG, PARTS
from .points import Points
from .share_guess import CellsAndShares

T = TypeVar("T")


@dataclass(frozen=True)
class RayGuess:
    """Numbers of rays, fitted to the glasses of `dev.py glasses`, whose column
    *to come x* tells by how much the rays to come are guessed wrong with them.

    of_edge : a pixel's edge with a border on it takes so many, with all that comes of it, where
        borders are so many that a digit is found in a round
    of_lit_edge : and so many, in curved glass, where both its ends have a landing: of a pixel, a
        quarter of one, and a quarter of that; and of triangles, which are cut at the end
    of_bent : a pixel on one branch whose middle is missed, and a quarter of one: of a hundred
        quarters of these three have a border
    n_bent : pixels of the smallest squares beside borders that are bent, too
    of_quarters : share of these pixels' rays that look for the borders of quarters
    of_square : at the nodes that it does not share with those before
    cells_of_bent : and so many cells are put together for it, its quarters and theirs
    of_cell : until cells are counted, there is one for so many rays that are not searched with
    missed : share of the smallest squares that look bent and do not pass their checks
    of_faint : further samples for faint light, times those that all chaotic light has
    """

    of_edge: float = 13
    of_lit_edge: tuple[float, ...] = (100, 70, 43, 13)
    of_bent: tuple[float, ...] = (16, 4, 0)
    n_bent: float = 2
    of_quarters: float = 0.5
    of_square: float = 16
    cells_of_bent: tuple[float, ...] = (8, 4, 0)
    of_cell: float = 2.0
    missed: float = 0.7
    of_faint: float = 1.6


class Rays(NamedTuple):
    """Numbers of rays.

    every : all of them
    searched : those among them that take longer: they look for borders, and stay
        in the glass for long, or sample it where light is chaotic
    searches : how often borders are looked for, which takes its time for the fewest of them, too
    """

    every: float = 0.0
    searched: float = 0.0
    searches: float = 0.0

    def and_more(self, other: "Rays") -> "Rays":
        """These and others."""
        return Rays(*(a + b for a, b in zip(self, other, strict=True)))


class RaysAhead:
    """The rays of a view map: `done` so far, and about how many are still `to_come`.

    n_last : of these, to measure errors when all is cut
    n_shares : of the pieces that pixels are cut in, about; None until some are cut
    n_pieces : those pieces; None until some are cut
    n_joined : pixels and quarters of them that were put together, which takes time besides rays
    n_to_join : and those that are still to be; None until they are counted
    sums_light : is light still to be summed up on the display, to tell what samples are worth?
    smooth : smooth cells, and their shares
    n_pauses : in which the first squares were traced, the more the more events their rays have
    is_guessed : not so until squares are as small as can be
    can_be_told : nor is the work after them, where it waits for the shares: before a display of
        more pixels than the viewer has they may be most of it
    """

    def __init__(self, n_last: int, waits_for_shares: bool = False) -> None:
        self.waits_for_shares = waits_for_shares
        self.n_shares: float | None = None
        self.n_pieces: float | None = None
        self.n_joined = 0.0
        self.n_to_join: float | None = None
        self.sums_light = False
        self.n_last, self.n_pauses = n_last, 0
        self.smooth = CellsAndShares()
        self.done = Rays()
        self.to_come = Rays(np.inf)
        self.is_searching = False

    @property
    def is_guessed(self) -> bool:
        return isfinite(self.to_come.every)

    @property
    def can_be_told(self) -> bool:
        return self.is_guessed and not (self.waits_for_shares and self.n_shares is None)

    @property
    def to_join(self) -> float:
        """Cells that are still to be put together, about."""
        if self.n_to_join is not None:
            return self.n_to_join
        return (self.to_come.every - self.to_come.searched) / RAYS.of_cell

    def join(self, n: int, to_come: float) -> None:
        """So many cells more were put together, and so many are to come."""
        self.n_joined, self.n_to_join = self.n_joined + n, to_come

    @property
    def part_done(self) -> float:
        """Part of all rays that are done, about; 0 until it can be told."""
        return self.done.every / self.expected if self.can_be_told else 0.0

    @property
    def expected(self) -> float:
        """Rays in all, about."""
        return self.done.every + self.to_come.every

    def count(self, n: int) -> None:
        """So many more were traced."""
        self.n_pauses += not self.is_guessed
        searched = n if self.is_searching else 0
        self.done = self.done.and_more(Rays(n, searched))
        # more are always to come
        every = max(self.to_come.every - n, (MORE - 1) * self.done.every)
        left = min(max(self.to_come.searched - searched, 0.0), every)
        self.to_come = Rays(every, left, self.to_come.searches)

    def expect(self, rays: Rays) -> None:
        """So many are still to come before the last."""
        self.to_come = rays.and_more(Rays(self.n_last, self.n_last))

    def searching(self, work: Pauses[T]) -> Pauses[T]:
        """A search for borders, or samples."""
        self.is_searching = True
        found = yield from work
        self.is_searching = False
        fewer = max(self.to_come.searches - 1, 0.0)
        self.to_come = self.to_come._replace(searches=fewer)
        return found


RAYS = RayGuess()
N_SEARCHES = 2 + CUT.quarterings  # of pixels, of their quarters, and at the end
MORE = 1.01  # times the rays so far
UNKNOWN = 0.09  # progress until rays can be guessed: from a tenth on it can be relied on


def begun(first: int, size: int) -> float:
    """Progress while squares go from a first size to the smallest, and are of a size by now."""
    return UNKNOWN * float(np.log2(first / size) / np.log2(first / PARTS))


def rays_of_finest(plan: Plan, branch: Words, xy: Floats) -> Rays:
    """To cut the pixels of the smallest squares, with nodes
    on branches (n, 25) at places (n, 25, 2), display px.
    """
    tolerance = plan.settings.tolerance
    grid = branch.reshape(-1, NODES_ALONG, NODES_ALONG)
    along, across = _borders(grid, 1), _borders(grid, 2)
    n_edges, n_lit = (
        a.sum(axis=(1, 2)) + b.sum(axis=(1, 2)) for a, b in zip(along, across, strict=True)
    )
    is_mixed = n_edges > 0

    # of their five lines of nodes, squares side by side share one
    shared = PARTS / NODES_ALONG
    n_edges, n_lit = shared * n_edges.sum(), shared * n_lit.sum()
    searched = _of_edges(plan, n_edges, n_lit, RAYS.of_lit_edge[0])

    # all middles are traced beside a border
    n_bent = 0.0 if plan.is_flat else RAYS.n_bent
    n_bent *= is_mixed.sum() * RAYS.of_bent[0]
    n_searched = RAYS.of_quarters * n_bent * _times_more(plan)
    found = Rays((1 - RAYS.of_quarters) * n_bent + n_searched, n_searched)
    found = found.and_more(Rays(searched + is_mixed.sum() * PARTS**2, searched, N_SEARCHES))

    # on one branch all pixels are bent, or none
    one = xy[~is_mixed & (branch[:, 0] != 0)]
    sag = interpolation.sag(one)
    error = interpolation.expected_error(one)
    is_bent = (sag > tolerance) & (error > np.maximum(tolerance, sag / 4**CUT.quarterings))
    return found.and_more(Rays(is_bent.sum() * PARTS**2 * RAYS.of_bent[0]))


def rays_of_cut(
    plan: Plan,
    points: Points,
    n_edges: Sequence[tuple[int, int]],
    depth: int,
    chaotic: Sequence[Ints],
) -> Rays:
    """To find the borders that are not known of cells, quartered so often, and of triangles that
    are cut at the end, and to sample chaotic cells (c, 4).

    n_edges : of the cells, and of the triangles: those with a border, and
        those among them with a landing at both ends
    """
    cells, last = n_edges
    rays = _of_edges(plan, *cells, RAYS.of_lit_edge[depth])
    rays += _of_edges(plan, *last, RAYS.of_lit_edge[-1])
    return Rays(rays, rays).and_more(rays_of_samples(plan, points, chaotic))


def rays_of_samples(
    plan: Plan, points: Points, chaotic: Sequence[Ints], is_coarse: bool = False
) -> Rays:
    """To sample chaotic cells (c, 4), with further samples of faint light, but for a coarse map."""
    area = area_of(points, chaotic)
    times = 1 + RAYS.of_faint * (not is_coarse and may_take_more(plan, area))
    rays = times * plan.settings.effort * area
    return Rays(rays, rays)


def area_of(points: Points, cells: Sequence[Ints]) -> float:
    """Of square cells (c, 4), viewer px^2."""
    sides = [points.view[corners[:, 1], 0] - points.view[corners[:, 0], 0] for corners in cells]
    return sum(float((side**2).sum()) for side in sides)


def _borders(branch: Words, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Which steps along an axis lead to another branch, and which of them from light to light?"""
    n = branch.shape[axis]
    one, other = (branch.take(range(first, first + n - 1), axis) for first in (0, 1))
    differs = one != other
    return differs, differs & (one != 0) & (other != 0)


def _of_edges(plan: Plan, n_edges: float, n_lit: float, of_lit: float) -> float:
    """Rays for borders on edges, some of which have a landing at both ends."""
    rays = RAYS.of_edge * n_edges + (0.0 if plan.is_flat else of_lit - RAYS.of_edge) * n_lit
    return float(rays) * _times_more(plan)


def _times_more(plan: Plan) -> float:
    """How many times as many rays a border takes as at coarse tolerances."""
    return n_digits(plan) / BISECTION.least_digits
