"""The progress of a solve, told before its work is done: which part takes about how long.

Nothing but the bar that is watched depends on these numbers.
"""

import timeit
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Stages:
    """How far the work is when one of its parts ends, 0..1.

    Read off `Solution.seconds` of the balls and cubes of `dev.py bench`, and rounded: the ball's
    coverage takes 3 % of a solve. To measure its errors takes a tenth of what comes after tracing,
    and half of it where a mesh is irregular, so that rays are followed as drawn, too.

    painted : of a solve; its coverage comes after
    measured : of the work after tracing; then it is painted
    mesh_measured, leaks_measured : of the measuring; then light that was cut off is looked at
    settled : of the painting for several viewers; the places that they ask for come before
    glance_traced : of a coarse picture; then it is painted
    """

    painted: float = 0.97
    measured: float = 0.28
    mesh_measured: float = 0.8
    leaks_measured: float = 0.9
    settled: float = 0.5
    glance_traced: float = 0.5


@dataclass(frozen=True)
class Pace:
    """Seconds that parts of a solve take, about, where `times_slower` is 1.

    Fitted to the glass that artists bring (`dev.py glasses`, column *rest x*), with the kernel: the
    rest of the time is told within a factor of three, on half of that glass within two.

    after_pixel, after_ray : of the work after it, a viewer pixel and a ray
    painted_pixel, painted_cell, painted_share : of painting, a display pixel, a cell and a share
    """

    after_pixel: float = 0.53e-6
    after_ray: float = 1.46e-6
    painted_pixel: float = 0.15e-6
    painted_cell: float = 0.74e-6
    painted_share: float = 0.07e-6


STAGES = Stages()
PACE = Pace()

PROBE = np.ones((1 << 14, 3))
PROBE_SECONDS = 370e-6  # that the norms of its rows take on the machine of PACE


def times_slower() -> float:
    """How many times slower this machine is now than the one of PACE."""
    passes = timeit.repeat(lambda: np.linalg.norm(PROBE, axis=1), number=1, repeat=3)
    return min(passes) / PROBE_SECONDS
