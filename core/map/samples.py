"""Where light is chaotic: stratified samples stand for a pixel, each for the area around it.

A pixel has along^2 strata, and a ray through a random place in each: with n of them the error of a
mean falls as 1 / n at best, and as 1 / sqrt(n) at worst, as that of random rays. Neither cells nor
bisection have an end there. Cells whose light falls where the display is faint are sampled anew,
by more (faint.py): other samples than those that have told so, which keeps the light right on
average.
"""

from collections.abc import Generator, Iterator

import numpy as np

from ..arrays import Floats, Ints
from ..free_memory import check_free
from ..light.plan import Plan
from ..messages import Message
from .allowance import Allowance
from .faint import light_on_blocks, more_along, samples_worth
from .points import BYTES_OF_POINT, Points, trace_points
from .ray_guess import Rays, RaysAhead
from .view_map import ViewMap

TILE_CELLS = 64  # cells each way, after which the random places begin anew
MOST_JITTER = 1024  # random places each way, of all cells of a tile


def sample_cells(
    plan: Plan, view_map: ViewMap, corners: Floats, allowance: Allowance | None, ahead: RaysAhead
) -> Generator[int, None, tuple[Points, Floats]]:
    """Trace samples of square cells with corners (m, 4, 2),
    viewer px; yields how many were traced since.

    Returns the samples (s,), those without a landing as well, and
    the areas (s,) that they stand for, viewer px^2.

    view_map : all but the samples; allowance : of rays, for more samples of faint light, None for
    none; ahead : is told how many these are

    Raises
    ------
    RigError : they would take more memory than is free
    """
    along = plan.settings.samples_along
    places, area = strata(corners, along)
    _check_memory(plan, len(places))
    points = yield from trace_points(plan, places)
    if allowance is None or not len(corners):
        return points, area

    # cells that are worth more
    owner = cells_of(corners, along)
    yield 0
    light = yield from light_on_blocks(view_map, points, area)
    worth = samples_worth(plan, light, points, area, owner, len(corners))
    more = more_along(worth, corners.mean(axis=1), _sides(corners), along, allowance)
    yield 0

    # these anew, the others as they are
    kept = np.flatnonzero(more[owner] == 0)
    none = strata(corners[:0], 1)
    anew = [strata(corners[more == n], n) for n in np.unique(more[more > 0])]
    places, areas = map(np.concatenate, zip(none, *anew, strict=True))
    _check_memory(plan, len(kept) + len(places))
    ahead.expect(Rays(len(places), len(places)))
    found = yield from trace_points(plan, places)
    return points.at(kept).and_more(found), np.append(area[kept], areas)


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


def strata(corners: Floats, along: int) -> tuple[Floats, Floats]:
    """Random places (s, 2), one in each stratum of square cells
    (m, 4, 2), and the strata's areas (s,), viewer px.

    A pixel has so many strata along its side, a smaller cell its part of them, or one. Places
    within a stratum are the same in each solve of a view of any size: noise that changed with the
    smallest step would flicker.
    """
    places = [np.empty((0, 2))]
    area = [np.empty(0)]
    for side, k, cells in _by_side(corners, along):
        first = corners[cells, 0]
        stratum = np.stack(np.meshgrid(np.arange(k), np.arange(k)), axis=-1).reshape(-1, 2)

        tile = max(1, min(TILE_CELLS, MOST_JITTER // k))
        jitter = np.random.default_rng(0).random((tile, tile, k * k, 2))
        column, row = (first / side).astype(np.int64).T % tile

        at = first[:, None] + side / k * (stratum + jitter[row, column])
        places.append(at.reshape(-1, 2))
        area.append(np.full(len(first) * k * k, (side / k) ** 2))

    return np.concatenate(places), np.concatenate(area)


def cells_of(corners: Floats, along: int) -> Ints:
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
