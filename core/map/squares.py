"""Squares of the viewer's image, traced at 5 x 5 nodes, and which of them show nothing."""

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats, Ints, taken
from .interpolation import CHECKS, COLUMN, PARTS, ROW
from .points import bounds_of


@dataclass(frozen=True)
class Beside:
    """How far beside the display light is given up, by rays that were traced (docs/design.md,
    decision 5).

    margin_steps : of the lesser step from a node to its neighbours: so
        far points between them may be beyond the node
    lost_displays : times the display's size; light that lands so far beside
        it does not come back to it within a square
    """

    margin_steps: float = 0.25
    lost_displays: float = 1.0


BESIDE = Beside()
CORNERS = [0, 4, 24, 20]  # of the nodes, around the square


@dataclass(frozen=True, eq=False)
class Squares:
    """Squares of the viewer's image: upper left corner (n, 2), side (n,), px."""

    corner: Ints
    size: Ints

    def __len__(self) -> int:
        return len(self.size)

    def at(self, which: Bools | Ints) -> "Squares":
        return Squares(self.corner[which], self.size[which])

    def and_more(self, others: "Squares") -> "Squares":
        return Squares(
            np.concatenate([self.corner, others.corner]), np.concatenate([self.size, others.size])
        )

    @property
    def area(self) -> int:
        """Of all of them, px."""
        return int((self.size**2).sum())

    def quarters(self) -> "Squares":
        half = np.repeat(self.size // 2, 4)
        step = np.tile([[0, 0], [1, 0], [0, 1], [1, 1]], (len(self), 1))
        return Squares(np.repeat(self.corner, 4, axis=0) + half[:, None] * step, half)

    def nodes(self) -> tuple[Ints, Ints]:
        """Columns and rows (n, 25) of the nodes."""
        step = self.size[:, None] // PARTS
        return self.corner[:, :1] + step * COLUMN, self.corner[:, 1:] + step * ROW

    def checks(self) -> Floats:
        """Viewer px (n, 6, 2) of the places at which the interpolation is checked."""
        return self.corner[:, None] + self.size[:, None, None] * CHECKS

    def are_within(
        self, xy: Floats, view_size: tuple[int, int], display_size: tuple[int, int]
    ) -> Bools:
        """Are the squares (n,), with nodes at (n, 25, 2) display px, inside both images, wholly?"""
        low, high = bounds_of(xy)
        is_shown = ((low >= 0) & (high <= display_size)).all(axis=1)
        return is_shown & (self.corner + self.size[:, None] <= view_size).all(axis=1)


def is_beside_display(xy: Floats, branch: np.ndarray, display_size: Ints) -> Bools:
    """Do squares (n,) with nodes, k rows of k, that land
    at (n, k^2, 2) show nothing of the display?

    Those on one branch do so when all their nodes land beside it, on one side, and their limits do
    as well: along each row and column, a step beyond the last that lands, and a part of a step
    around the one nearest to the display.
    """
    # on one branch, beside the display by all nodes that land
    is_lost = branch == 0
    is_single = (is_lost | (branch == branch.max(axis=1, keepdims=True))).all(
        axis=1
    ) & ~is_lost.all(axis=1)
    # the one in the middle, where it lands, tells of most that they are not
    one = xy.shape[1] // 2
    is_beyond = ((xy[:, one] > display_size) | (xy[:, one] < 0)).any(axis=1)
    chosen = np.flatnonzero(is_single & (is_lost[:, one] | is_beyond))
    low, high = bounds_of(np.where(is_lost[chosen, :, None], np.nan, taken(xy, chosen)))
    chosen = chosen[((low > display_size) | (high < 0)).any(axis=1)]

    # by how much, on a grid, one side of the display after the other; squares
    # come last: numpy is slow where rows are a few numbers long
    n = len(chosen)
    k = round(xy.shape[1] ** 0.5)
    of_chosen = np.where(is_lost[chosen, :, None], np.nan, taken(xy, chosen))
    of_chosen = np.ascontiguousarray(of_chosen.reshape(n, 2 * k * k).T).reshape(k, k, 2, n)
    size = np.asarray(display_size)[:, None]
    beyond = np.stack([of_chosen - size, -of_chosen])  # the image, by so much
    holds = ~(beyond <= 0)

    for axis in (1, 2):
        along = np.moveaxis(beyond, axis, 1)
        step = np.diff(along, axis=1)
        outside = np.full_like(step[:, :1], np.inf)  # nothing is lost there
        before = np.concatenate([outside, -step], axis=1)
        after = np.concatenate([step, outside], axis=1)

        with np.errstate(invalid="ignore"):
            needed = np.where(
                np.isnan(before) | np.isnan(after), 1.0, BESIDE.margin_steps
            ) * np.fmin(before, after)
            needed = np.where(np.isfinite(needed), needed, BESIDE.lost_displays * size)
            holds &= ~np.moveaxis(along < needed, 1, axis)

    is_aside = np.zeros(len(xy), bool)
    is_aside[chosen] = holds.all(axis=(1, 2)).any(axis=(0, 1))
    return is_aside
