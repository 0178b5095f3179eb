"""The progress of a solve, told before its work is done: which part takes about how long.

Nothing but the bar that is watched depends on these numbers.
"""

import timeit
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from time import perf_counter, thread_time

import numpy as np

from .. import kernel
from ..light.plan import Plan
from ..map.view_map import ViewMap
from ..viewer import Viewer


@dataclass(frozen=True)
class Stages:
    """How far the work is when one of its parts ends, 0..1.

    Read off `Solution.seconds` of the balls and cubes of `dev.py bench`, and rounded: the ball's
    coverage takes 3 % of a solve.

    measured : of a solve; its remarks come after
    mesh_measured, leaks_measured : of the measuring; then light that was cut off is looked at
    settled : of the painting for several viewers; the places that they ask for come before
    glance_traced : of a coarse picture; then it is painted
    """

    measured: float = 0.97
    mesh_measured: float = 0.8
    leaks_measured: float = 0.9
    settled: float = 0.5
    glance_traced: float = 0.5


@dataclass(frozen=True)
class Pace:
    """Seconds that parts of a solve take, about, where `times_slower` is 1.

    Fitted to the glass that artists bring (`dev.py glasses`, column *rest x*). To measure the
    errors of curved glass takes from a third of that time to eight times as long: longest where a
    mesh is irregular, so that rays are followed as drawn, too, and the whole takes seconds.

    later : times that of a ray so far is one that is still to come: by numpy alone those that look
        for borders come in small batches, which cost as much as hundreds of their rays
    after_curved, after_flat : of the work after tracing, a viewer pixel and a ray
    measured_curved, measured_flat : of it, to measure errors
    painted_pixel, painted_cell, painted_share : of painting, a display pixel, a cell and a share
    covered : a viewer pixel, to find how much of the picture is shown
    """

    later: float = 1.0
    after_curved: tuple[float, float] = (0.75e-6, 1.2e-6)
    after_flat: tuple[float, float] = (0.2e-6, 0.7e-6)
    measured_curved: float = 0.03
    measured_flat: float = 0.004
    painted_pixel: float = 0.15e-6
    painted_cell: float = 0.3e-6
    painted_share: float = 0.1e-6
    covered: float = 0.1e-6


STAGES = Stages()
PACE = Pace()
NUMPY_PACE = Pace(
    later=1.8,
    after_curved=(3e-6, 2.5e-6),
    after_flat=(0.5e-6, 1.8e-6),
    measured_curved=0.08,
    painted_pixel=0.5e-6,
    painted_cell=0.3e-6,
    painted_share=0.45e-6,
)

PROBE = np.ones((1 << 14, 3))
STAYS = 10.0
PROBE_SECONDS = 370e-6  # that the norms of its rows take on the machine of PACE


def pace() -> Pace:
    """The pace of solves with the kernel, or by numpy alone."""
    return NUMPY_PACE if kernel.library() is None else PACE


def times_slower() -> float:
    """How many times slower this machine is than the one of PACE, whatever else it does: found
    anew after STAYS seconds.
    """
    return _times_slower(int(perf_counter() / STAYS))


@lru_cache(maxsize=1)
def _times_slower(_: int) -> float:
    passes = timeit.repeat(
        lambda: np.linalg.norm(PROBE, axis=1), number=1, repeat=3, timer=thread_time
    )
    return min(passes) / PROBE_SECONDS


def seconds_to_paint(view_map: ViewMap) -> float:
    """About how long it takes to paint a view map, with all that comes with it."""
    width, height = view_map.display_size
    n_cells, n_shares = view_map.n_by_kind.sum(axis=1)
    of = pace()
    return times_slower() * float(
        of.painted_pixel * (width * height)
        + of.painted_cell * n_cells
        + of.painted_share * n_shares
    )


def seconds_after_painting(viewers: Sequence[Viewer], plans: Sequence[Plan]) -> float:
    """About how long it takes to find how much of the picture viewers are shown, and to measure
    the errors of plans.
    """
    of = pace()
    n_pixels = sum(viewer.width * viewer.height for viewer in viewers)
    to_measure = [of.measured_flat if plan.is_flat else of.measured_curved for plan in plans]
    return times_slower() * (of.covered * n_pixels + sum(to_measure))
