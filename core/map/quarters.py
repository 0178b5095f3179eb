"""Quarters of pixels, and of their quarters: where more goes on than the corners know."""

from collections.abc import Generator

import numpy as np

from ..base.arrays import Bools, Ints, mean_at, taken
from ..base.steps import Pauses
from ..light.plan import Plan
from .cut_quality import CUT
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
