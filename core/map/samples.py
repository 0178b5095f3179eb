"""Where light is chaotic: stratified samples stand for a pixel, each for the area around it.

A pixel has along^2 strata, and a ray through a random place in each: with n of them the error of a
mean falls as 1 / n at best, and as 1 / sqrt(n) at worst, as that of random rays. Neither cells nor
bisection have an end there.
"""

from collections.abc import Generator

import numpy as np

from ..arrays import Floats
from ..free_memory import check_free
from ..light.plan import Plan
from ..messages import Message
from .points import BYTES_OF_POINT, Points, trace_points

TILE_CELLS = 64  # cells each way, after which the random places begin anew
MOST_JITTER = 1024  # random places each way, of all cells of a tile


def sample_cells(plan: Plan, corners: Floats) -> Generator[int, None, tuple[Points, Floats]]:
    """Trace samples of square cells with corners (m, 4, 2),
    viewer px; yields how many were traced since.

    Returns the samples (s,), those without a landing as well, and
    the areas (s,) that they stand for, viewer px^2.

    Raises
    ------
    RigError : they would take more memory than is free
    """
    _check_memory(plan, corners)
    places, area = strata(corners, plan.settings.samples_along)
    return (yield from trace_points(plan, places)), area


def _check_memory(plan: Plan, corners: Floats) -> None:
    viewer = plan.viewer
    effort = plan.settings.effort
    area = float((_sides(corners) ** 2).sum())
    check_free(
        BYTES_OF_POINT * effort * area,
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
    sides = _sides(corners)
    for side in np.unique(sides):
        first = corners[sides == side, 0]
        k = max(1, int(along * side))
        stratum = np.stack(np.meshgrid(np.arange(k), np.arange(k)), axis=-1).reshape(-1, 2)

        tile = max(1, min(TILE_CELLS, MOST_JITTER // k))
        jitter = np.random.default_rng(0).random((tile, tile, k * k, 2))
        column, row = (first / side).astype(np.int64).T % tile

        at = first[:, None] + side / k * (stratum + jitter[row, column])
        places.append(at.reshape(-1, 2))
        area.append(np.full(len(first) * k * k, (side / k) ** 2))

    return np.concatenate(places), np.concatenate(area)


def _sides(corners: Floats) -> Floats:
    return corners[:, 1, 0] - corners[:, 0, 0]
