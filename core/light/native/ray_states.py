"""The state of rays as the kernel reads and writes it."""

from dataclasses import dataclass

import numpy as np

from ...base.arrays import Floats, Ints
from ...native.structures import Made, RayStateStructure
from ..rays import Rays

LIGHTS = "imaged", "folded", "reflected"
STATE = {  # of rays.py's Rays: what the kernel reads and writes where it is
    **dict.fromkeys(("positions", "directions", "xy", "throughput"), np.float64),
    **dict.fromkeys(("mask", "branch"), np.uint64),
    **dict.fromkeys(("cluster", "n_events", "last_part", "leak", "n_words"), np.int64),
    **dict.fromkeys(("reason", "plate_path"), np.uint8),
    **dict.fromkeys(("has_met_glass", "has_met_plate", "is_astray", "has_ended"), np.bool_),
}


@dataclass(frozen=True, eq=False)
class Ways:
    """What n rays met at m events at the most.

    places (m, n, 3) m; met (m, n) triangles, by their numbers + 1, 0 after the last; left_at (n,),
    the event at which a ray met nothing more, -1 where it ended otherwise
    """

    places: Floats
    met: Ints
    left_at: Ints

    @classmethod
    def none(cls, n: int, m: int) -> "Ways":
        """Ways of which nothing is known yet."""
        # most rays meet few things, so that most of the zeros are never fetched
        return cls(np.empty((m, n, 3)), np.zeros((m, n), np.int64), np.full(n, -1, np.int64))

    def begin_again(self, some: slice) -> None:
        """Forget what is known of some rays."""
        self.met[:, some] = 0
        self.left_at[some] = -1


def state_of(rays: Rays, ways: Ways | None = None, is_reached: np.ndarray | None = None) -> Made:
    """State of rays as the kernel reads and writes it."""
    made = Made(RayStateStructure)
    for name, dtype in STATE.items():
        given = getattr(rays, name)
        # not by `is`: an array that was pickled has a type of its own, though an equal one
        if made.point(name, given, dtype).ctypes.data != given.ctypes.data:
            raise TypeError(f"{name} is no array of {np.dtype(dtype)} in one piece")

    if rays.course is not None:
        rays.course = made.point("course", rays.course, np.uint64)
        made.set(width=rays.course.shape[1])

    if ways is not None:
        made.point("places", ways.places, float)
        made.point("met", ways.met, np.int64)
        made.point("left_at", ways.left_at, np.int64)
        made.set(n_rays=ways.met.shape[1], n_steps=len(ways.met))

    made.point("is_reached", is_reached, np.uint8)
    made.set(is_recorded=rays.is_recorded, light=LIGHTS.index(rays.light))
    return made
