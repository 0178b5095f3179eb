"""The compiled kernel as a tracer: it follows rays to their ends and bisects edges, one by
one. It reads and writes the arrays of rays where they are.
"""

import ctypes
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...base.arrays import Floats, Ints, taken
from ...base.steps import Pauses
from ...native.loading import loaded, n_threads
from ...native.structures import HalvingStructure, Made, RayStateStructure
from ...rig.viewer import Viewer
from ..plan import Ends, Halving, Plan
from ..rays import Rays, ReachedError, Step
from ..trace import by_events
from .plan_structures import is_whole, left_out, made_of, making, making_whole

# events, rays and edges between two pauses: less than 0.1 s of work
EVENTS_AT_ONCE = 1 << 16
LEAST_AT_ONCE = 64
LEAST_EDGES_AT_ONCE = 8
# bytes of a batch's ways or courses; beyond, they are recorded event by event by numpy
MOST_RECORDED = 1 << 26
PLACE, WORD = 32, 8  # bytes of an event of a ray, in its way and in its course

LIGHTS = "imaged", "folded", "reflected"
STATE = {  # of rays.py's Rays: what the kernel reads and writes where it is
    **dict.fromkeys(("positions", "directions", "xy", "throughput"), np.float64),
    **dict.fromkeys(("mask", "branch"), np.uint64),
    **dict.fromkeys(("cluster", "n_events", "last_part", "leak", "n_words"), np.int64),
    **dict.fromkeys(("reason", "plate_path"), np.uint8),
    **dict.fromkeys(("has_met_glass", "has_met_plate", "is_astray", "has_ended"), np.bool_),
    "is_begun": np.bool_,
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
    made.set(n_asked=rays.n_asked, n_copies=rays.n_copies)
    made.set(is_recorded=rays.is_recorded, light=LIGHTS.index(rays.light))
    return made


class Kernel:
    """Follows rays by the compiled kernel, which bisects edges, too."""

    left_out = staticmethod(left_out)

    def rays_at_once(self, plan: Plan, most: int) -> int:
        """How many rays, up to `most`, are followed at once when their ways or courses are
        recorded.
        """
        return min(most, max(1, MOST_RECORDED // (PLACE * (plan.settings.max_events + 1))))

    def follow(self, plan: Plan, rays: Rays, steps: list[Step] | None = None) -> Pauses[None]:
        """Follow rays to their ends, all of which are under way."""
        yield from making(plan)
        has_ways = steps is not None
        per_event = PLACE * has_ways + WORD * rays.is_recorded
        if len(rays.mask) * per_event * (plan.settings.max_events + 1) > MOST_RECORDED:
            yield from by_events(plan, rays, steps)
            return

        n = len(rays.live)
        n_events = plan.settings.max_events
        if rays.is_recorded:
            rays.course = np.zeros((len(rays.mask), n_events + 1), np.uint64)

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
        if is_reached.any():
            raise ReachedError(set(np.flatnonzero(is_reached).tolist()))
        if has_ways:
            steps += _steps_of(plan, rays, ways)

    def bisect(self, plan: Plan, edges: Halving) -> Pauses[Ends]:
        """Bisect edges; yields how many rays were traced since.

        Raises
        ------
        ReachedError : a ray comes near glass that stands aside
        """
        yield from making(plan)
        n = len(edges.start)
        rays = Rays(np.zeros((n, 3)), np.zeros((n, 3)), edges.course, is_recorded=False)
        is_reached = np.zeros(len(plan.aside.boxes), np.uint8)
        state = state_of(rays, None, is_reached)
        is_unready = state.point("is_unready", np.zeros(1, np.uint8), np.uint8)

        ends = Ends(*(np.array(values, order="C") for values in edges.begun))
        made = _made_of(plan.viewer, edges, ends)
        structures = [ctypes.addressof(one.structure) for one in (made_of(plan), state, made)]
        n_digits = max(1, int(np.ceil(-np.log2(edges.least))))
        at_once = max(LEAST_EDGES_AT_ONCE, EVENTS_AT_ONCE // (plan.settings.max_events * n_digits))

        for first in range(0, n, at_once):
            some = slice(first, min(first + at_once, n))
            loaded().kiriko_bisect(*structures, some.start, some.stop, n_threads())
            if is_unready[0]:
                # a ray was lost behind a hull: all go once more, with all faces to ask
                yield from making_whole(plan)
                for values, before in zip(ends, edges.begun, strict=True):
                    values[some] = before[some]
                is_unready[0] = 0
                loaded().kiriko_bisect(*structures, some.start, some.stop, n_threads())
            yield int(ends.n_tried[some].sum())

        if is_reached.any():
            raise ReachedError(set(np.flatnonzero(is_reached).tolist()))
        return ends


def _steps_of(plan: Plan, rays: Rays, ways: Ways) -> Iterator[Step]:
    """The rays at each event, from their ways."""
    for event, (places, met) in enumerate(zip(ways.places, ways.met, strict=True)):
        some = np.flatnonzero(met)
        left = np.flatnonzero(ways.left_at == event)
        if not len(some) + len(left):
            return

        triangle = met[some] - 1
        yield Step(
            rays=some,
            place=taken(places, some),
            patch=plan.triangles.patch[triangle],
            triangle=triangle,
            left=left,
            start=taken(rays.positions, left),
            direction=taken(rays.directions, left),
        )


def _made_of(viewer: Viewer, edges: Halving, ends: Ends) -> Made:
    """Edges as the kernel reads them, and their ends, which it writes where they are."""
    made = Made(HalvingStructure)
    made.point("start", edges.start, float)
    made.point("way", edges.way, float)
    made.point("branch", edges.branch, np.uint64)
    for name, values in zip(Ends._fields, ends, strict=True):
        made.point(name, values, values.dtype)

    made.set(
        least=edges.least,
        position=viewer.position,
        axes=viewer.axes,
        window=np.array(viewer.window, float),
        size=np.array([viewer.width, viewer.height], float),
        is_orthographic=viewer.projection == "orthographic",
    )
    return made
