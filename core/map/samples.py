"""Where light is chaotic: stratified samples stand for a pixel, each for the area around it.

A pixel has along^2 strata, and a ray through a random place in each: with n of them the error of a
mean falls as 1 / n at best, and as 1 / sqrt(n) at worst, as that of random rays. Neither cells nor
bisection have an end there. Cells whose light falls where the display is faint take further ones
(importance.py), and all samples of a cell count alike. On the display each lights a square
(kernel_width.py).
"""

from collections.abc import Generator, Iterator
from typing import NamedTuple

import numpy as np

from ..base.arrays import Floats, Ints
from ..base.free_memory import check_free
from ..base.messages import Message
from ..light.plan import Plan
from .importance import further_along, light_on_blocks, may_take_more, samples_worth
from .points import BYTES_OF_POINT, Points, trace_points
from .ray_budget import Allowance
from .view_map import ViewMap

TILE_CELLS = 64  # cells each way, after which the random places begin anew
MOST_JITTER = 1024  # random places each way, of all cells of a tile


class Samples(NamedTuple):
    """Samples (s,) of chaotic cells, those without a landing as well.

    area : viewer px^2, that each stands for
    reach : viewer px, the side of its stratum
    """

    points: Points
    area: Floats
    reach: Floats


def sample_cells(
    plan: Plan, view_map: ViewMap, corners: Floats, allowance: Allowance | None
) -> Generator[int, None, Samples]:
    """Trace samples of square cells with corners (m, 4, 2),
    viewer px; yields how many were traced since.

    view_map : all but the samples
    allowance : of rays, for further samples of faint light; None for none

    Raises
    ------
    RigError : they would take more memory than is free
    """
    along = plan.settings.samples_along
    _check_memory(plan, n_strata(corners, along))
    places, area = strata(corners, along)
    points = yield from trace_points(plan, places)
    samples = Samples(points, area, np.sqrt(area))

    whole = _sides(corners) ** 2
    if allowance is None or not may_take_more(plan, float(whole.sum())):
        return samples

    # which cells are worth more
    owner = _cells_of(corners, along)
    middle = corners.mean(axis=1)
    light = yield from light_on_blocks(view_map)
    worth = yield from samples_worth(plan, light, points, area, owner, middle)
    more = further_along(worth, middle, _sides(corners), along, allowance)
    asked = [(n, np.flatnonzero(more == n)) for n in np.unique(more[more > 0])]
    if not asked:
        return samples

    # by other random numbers than those that have told so
    n_rays = sum(n_strata(corners[cells], n) for n, cells in asked)
    _check_memory(plan, len(points) + n_rays)
    parts = [strata(corners[cells], n, seed=1) for n, cells in asked]
    places, area = map(np.concatenate, zip(*parts, strict=True))
    found = yield from trace_points(plan, places)

    # all of a cell count alike
    of_found = [cells[_cells_of(corners[cells], n)] for n, cells in asked]
    owner = np.concatenate([owner, *of_found])
    yield 0
    share = whole / np.bincount(owner, minlength=len(whole))
    reach = np.append(samples.reach, np.sqrt(area))
    yield 0
    points = points.and_more(found)
    yield 0
    return Samples(points, share[owner], reach)


def _check_memory(plan: Plan, n_rays: int) -> None:
    viewer = plan.viewer
    effort = plan.settings.effort
    check_free(
        BYTES_OF_POINT * n_rays,
        Message("Sampling where light is chaotic"),
        Message(
            "lower Effort ({effort}), or the resolution of the viewer '{viewer}'"
            " ({viewer_width} x {viewer_height})",
            effort=effort,
            viewer=viewer.name,
            viewer_width=viewer.width,
            viewer_height=viewer.height,
        ),
    )


def strata(corners: Floats, along: int, seed: int = 0) -> tuple[Floats, Floats]:
    """Random places (s, 2), one in each stratum of square cells
    (m, 4, 2), and the strata's areas (s,), viewer px.

    A pixel has so many strata along its side, a smaller cell its part of them, or one. Places
    within a stratum are the same in each solve of a view of any size: noise that changed with the
    smallest step would flicker. Another seed has others.
    """
    places = [np.empty((0, 2))]
    area = [np.empty(0)]
    for side, k, cells in _by_side(corners, along):
        first = corners[cells, 0]
        stratum = np.stack(np.meshgrid(np.arange(k), np.arange(k)), axis=-1).reshape(-1, 2)

        tile = max(1, min(TILE_CELLS, MOST_JITTER // k))
        jitter = np.random.default_rng(seed).random((tile, tile, k * k, 2))
        column, row = (first / side).astype(np.int64).T % tile

        at = first[:, None] + side / k * (stratum + jitter[row, column])
        places.append(at.reshape(-1, 2))
        area.append(np.full(len(first) * k * k, (side / k) ** 2))

    return np.concatenate(places), np.concatenate(area)


def n_strata(corners: Floats, along: int) -> int:
    """How many strata square cells (m, 4, 2) have."""
    return sum(k * k * len(cells) for _, k, cells in _by_side(corners, along))


def _cells_of(corners: Floats, along: int) -> Ints:
    """The cells (s,), by number, of the strata of cells (m, 4, 2)."""
    numbers = [np.repeat(cells, k * k) for _, k, cells in _by_side(corners, along)]
    return np.concatenate([np.empty(0, np.int64), *numbers])


def _by_side(corners: Floats, along: int) -> Iterator[tuple[float, int, Ints]]:
    """Sides of cells (m, 4, 2), viewer px, how many strata lie along each, and the cells (c,)."""
    sides = _sides(corners)
    for side in np.unique(sides):
        yield float(side), max(1, int(along * side)), np.flatnonzero(sides == side)


def _sides(corners: Floats) -> Floats:
    return corners[:, 1, 0] - corners[:, 0, 0]
