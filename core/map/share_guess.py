"""About how many shares a view map makes: of its pieces, and before these are all there.

A piece makes a share for each display pixel that it touches. Borders that were cut once tell how
far their light spreads: cut anew, in quarters or around their middles, the pieces are smaller and
more, but cover as much of the display.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..arrays import Bools, Floats, Ints, taken
from ..light.plan import Plan
from . import interpolation
from .cells import area_within
from .doubts import Doubts
from .points import Points, bounds_of
from .squares import Squares
from .subdivision import n_parts
from .thinning import THINNING

if TYPE_CHECKING:
    from .ray_guess import RaysAhead

COUNTED = 1 << 16  # pieces at the least of which the shares are counted, where there are more
COUNTED_EARLY = 1 << 11  # the same while there are more to come
FEW_SQUARES = 1 << 9
CORNERS = [0, 4, 24, 20]  # of the nodes of a smooth cell, around it


@dataclass(frozen=True)
class ShareGuess:
    """Numbers of shares, fitted to the glasses of `dev.py glasses`.

    of_ray, of_flat_ray : pieces of cut pixels of curved and of flat glass make so many for each
        ray to come, until some are cut
    times_cut : when pixels are cut, quarters of them, and quarters of these, times as many as
        their pieces make: there will be more pieces
    of_anew : a cell that is cut anew makes so many besides, as
        quarters, or in the end as triangles around its middle
    of_sample : where light is chaotic a sample makes so many, times the cube root of the display's
        pixels for a viewer's
    cells_of_ray : cells, for each ray, until some are cut
    most_thinned : where light spreads far, times the pieces that light a pixel in its mean light
    """

    of_ray: float = 5
    of_flat_ray: float = 0.2
    times_cut: tuple[float, ...] = (1.7, 2.3, 2.3)
    of_anew: float = 24
    of_sample: float = 8
    cells_of_ray: float = 0.5
    most_thinned: float = 4.0


SHARES = ShareGuess()


class CellsAndShares(NamedTuple):
    """Numbers of cells of a map, and of the shares that they make."""

    n_cells: float = 0.0
    n_shares: float = 0.0


class SharesOfPieces:
    """The shares of a plan's pixels that are cut in pieces, about, so far as they are cut.

    settled : of pieces that are not cut anew before the end
    """

    def __init__(self, plan: Plan) -> None:
        display = plan.rig.display
        self._display_size = (display.width, display.height)
        self.settled = 0.0

    def take_up(
        self, points: Points, found: Doubts, is_sampled: Bools, is_quartered: Bools
    ) -> float:
        """Of pieces that there are when cells (m,) were cut, some of which are sampled instead, or
        quartered next.
        """
        of_cut = np.flatnonzero(~is_sampled[found.owner])
        n, step = shares_of(points, found.pieces[of_cut], self._display_size, COUNTED_EARLY)
        stays = ~is_quartered[found.owner[of_cut[::step]]]
        so_far = self.settled + step * float(n.sum())
        self.settled += step * float(n[stays].sum())
        return so_far

    def of_all(self, points: Points, kinds: list[Ints]) -> float:
        """Of all in the end: of some kinds of pieces (t, 3) or (q, 4)."""
        size = self._display_size
        by_kind = [shares_of(points, kind, size, COUNTED_EARLY) for kind in kinds]
        return sum(step * float(n.sum()) for n, step in by_kind)


def more_shares(n_shares: float, depth: int, n_anew: int) -> float:
    """How many there will be in the end, when cells that were quartered so often have pieces that
    make so many, and so many cells are to be cut anew.
    """
    return SHARES.times_cut[depth] * n_shares + SHARES.of_anew * n_anew


def shares_of(
    points: Points,
    pieces: Ints,
    display_size: tuple[int, int],
    most: int = COUNTED,
    n_parts: Ints | None = None,
) -> tuple[Floats, int]:
    """About how many shares each of some pieces (n, 4 or 3) makes, cut into n_parts a side;
    and for how many pieces each of them stands, where there are more than `most`.

    A convex part wide w and high h, of area a, touches a + w + h + 1 pixels on average.
    """
    step = 1 + len(pieces) // most
    some = pieces[::step]
    parts = np.ones(len(some)) if n_parts is None else n_parts[::step]
    corners = [taken(points.xy, number) for number in some.T]
    low, high = (reduce(bound, corners) for bound in (np.minimum, np.maximum))
    size = np.clip(high, 0, display_size) - np.clip(low, 0, display_size)
    is_seen = ((high > 0) & (low < display_size)).all(axis=1)

    area = area_within(*np.moveaxis(corners, 2, 0), display_size)
    area = np.fmin(area, size.prod(axis=1))
    # of many parts those beside the image make none
    with np.errstate(invalid="ignore", divide="ignore"):
        within = np.nan_to_num((size / (high - low)).prod(axis=1), nan=1.0)
    n_seen = 1 + (parts**2 - 1) * within
    lines = 1 + (parts - 1) * np.sqrt(within)
    return np.where(is_seen, area + lines * size.sum(axis=1) + n_seen, 0.0), step


def is_within(
    xy: Floats, squares: Squares, view_size: tuple[int, int], display_size: tuple[int, int]
) -> Bools:
    """Are squares (n,), with nodes at (n, 25, 2) display px, inside of both images, wholly?"""
    low, high = bounds_of(xy)
    return (
        ((low >= 0) & (high <= display_size)).all(axis=1)
        & (squares.corner + squares.size[:, None] <= view_size).all(axis=1)
    )  # fmt: skip


def smooth_ahead(
    plan: Plan, points: Points, squares: Squares, n_passed: int, nodes: Callable[[Squares], Ints]
) -> CellsAndShares:
    """Of squares (n,), the nodes (n, 25) of which can be asked for, that are smooth cells, so many
    of them, or will be, the others: told by some.

    Of those others the ones that look bent, as only the smallest may, do not pass their checks for
    the most part. As cells they would be of very many quads.
    """
    step = 1 + len(squares) // FEW_SQUARES
    squares = squares.at(slice(None, None, step))
    viewer, display = plan.viewer, plan.rig.display
    display_size = (display.width, display.height)
    number = nodes(squares)
    is_cell = np.arange(len(squares)) * step < n_passed
    is_cell |= interpolation.expected_error(taken(points.xy, number)) <= plan.settings.tolerance
    squares, number = squares.at(is_cell), number[is_cell]
    xy = taken(points.xy, number)
    is_inside = is_within(xy, squares, (viewer.width, viewer.height), display_size)
    parts = n_parts(xy, squares.size, is_inside, plan.settings.tolerance)
    shares, _ = shares_of(points, number[:, CORNERS], display_size, n_parts=parts)
    return CellsAndShares(step * float((parts**2).sum()), step * float(shares.sum()))


def shares_ahead(plan: Plan, rays: "RaysAhead") -> CellsAndShares:
    """About how many cells and shares a map of a plan will have, by its rays so far."""
    n_cut = SHARES.cells_of_ray * rays.expected
    if rays.n_pieces is not None:
        n_cut = rays.n_pieces + rays.to_come.searched  # as many as these are samples
    display, viewer = plan.rig.display, plan.viewer
    n_pixels = display.width * display.height
    if rays.n_shares is None:
        cut = (SHARES.of_flat_ray if plan.is_flat else SHARES.of_ray) * rays.to_come.every
    else:
        of_sample = SHARES.of_sample * np.cbrt(n_pixels / (viewer.width * viewer.height))
        cut = rays.n_shares + of_sample * rays.to_come.searched

    most = SHARES.most_thinned * THINNING.per_pixel * n_pixels
    return CellsAndShares(rays.smooth.n_cells + n_cut, rays.smooth.n_shares + min(cut, most))
