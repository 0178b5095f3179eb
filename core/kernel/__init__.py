"""The compiled kernel: follows rays, divides cells, paints
shares, fits curved faces, one by one, not many at once.

These are the ways of `trace.py`, `rasterise.py`, `source_image.py`
and `surface_fit.py`, with the same slacks.

It is a small library in C (the sources beside this file), brought as a wheel called `kiriko_kernel`
and loaded by ctypes, which lets go of Python's lock during each call. numpy's way stays the
reference, and takes the place of the kernel where there is none, where the environment has
KIRIKO_KERNEL=off, and for what the kernel does not know.
"""

import ctypes
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Floats, Ints
from ..steps import Pauses
from .dividing import add, add_at, can_add, can_divide, divided, find_across
from .fitting import Fit, agree, make_faces
from .loading import library, loaded, n_threads, off, use_threads
from .painting import FlatStrokes, paint
from .pixels import decode, finish, halved, quantise
from .plans import is_whole, left_out, made_of, making, making_whole
from .structures import Made, RayStateStructure
from .touching import Boxes
from .trees import HullEngine

if TYPE_CHECKING:
    from ..light.plan import Plan
    from ..light.rays import Rays

__all__ = [
    "Boxes",
    "Fit",
    "FlatStrokes",
    "HullEngine",
    "Ways",
    "add",
    "add_at",
    "agree",
    "can_add",
    "can_divide",
    "can_follow",
    "decode",
    "divided",
    "find_across",
    "finish",
    "follow",
    "halved",
    "left_out",
    "library",
    "make_faces",
    "making",
    "off",
    "paint",
    "quantise",
    "use_threads",
]

# events, and rays, between two pauses: less than 0.1 s of work
EVENTS_AT_ONCE = 1 << 16
LEAST_AT_ONCE = 64
# bytes of a batch's ways or courses; beyond, they are recorded event by event by numpy
MOST_RECORDED = 1 << 26
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


def can_follow(plan: "Plan", rays: "Rays", has_ways: bool) -> bool:
    """Can the kernel follow these rays, and write down their ways if asked to?"""
    if library() is None or made_of(plan) is None:
        return False
    per_event = 32 * has_ways + 8 * rays.is_recorded
    return len(rays.live) * per_event * (plan.settings.max_events + 1) <= MOST_RECORDED


def state_of(rays: "Rays", ways: Ways | None = None, is_reached: np.ndarray | None = None) -> Made:
    """State of rays as the kernel reads and writes it."""
    made = Made(RayStateStructure)
    for name, dtype in STATE.items():
        if made.point(name, getattr(rays, name), dtype) is not getattr(rays, name):
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


def follow(plan: "Plan", rays: "Rays", has_ways: bool) -> "Pauses[tuple[Ways | None, set[int]]]":
    """Follow rays to their ends, all of which are under way; yields how many ended since.

    Returns their ways, if asked to write them down, and the
    numbers of the boxes of glass aside that they entered.
    """
    n = len(rays.live)
    n_events = plan.settings.max_events
    if rays.is_recorded:
        rays.course = np.zeros((n, n_events + 1), np.uint64)

    ways = Ways.none(n, n_events) if has_ways else None

    is_reached = np.zeros(len(plan.aside.boxes), np.uint8)
    made = state_of(rays, ways, is_reached)
    is_unready = made.point("is_unready", np.zeros(1, np.uint8), np.uint8)
    of_plan = made_of(plan)
    structures = ctypes.addressof(of_plan.structure), ctypes.addressof(made.structure)

    kernel = loaded()
    at_once = max(LEAST_AT_ONCE, EVENTS_AT_ONCE // n_events)
    for first in range(0, n, at_once):
        last = min(first + at_once, n)
        some = slice(first, last)
        if not is_whole(of_plan):
            begun = rays.positions[some].copy(), rays.directions[some].copy()
            reached = is_reached.copy()
        kernel.kiriko_follow(*structures, first, last, n_threads())
        if is_unready[0]:
            # a ray was lost behind a hull: all of them go once more, with all faces to ask
            yield from making_whole(plan)
            rays.begin_again(some, *begun)
            if ways is not None:
                ways.begin_again(some)
            is_reached[:], is_unready[0] = reached, 0
            kernel.kiriko_follow(*structures, first, last, n_threads())
        yield last - first

    rays.live = rays.live[:0]
    return ways, set(np.flatnonzero(is_reached).tolist())
