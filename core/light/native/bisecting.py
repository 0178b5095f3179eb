"""Looks for the last places of edges on their branches, as `bisection.py` does, edge by edge."""

import ctypes
from typing import NamedTuple

import numpy as np

from ...base.arrays import Floats, Ints
from ...base.steps import Pauses
from ...native.loading import library, loaded, n_threads
from ...native.structures import HalvingStructure, Made
from ...rig.viewer import Viewer
from ..landings import Words
from ..plan import Plan
from ..rays import Rays, ReachedError
from .plan_structures import made_of, making, making_whole
from .ray_states import state_of

# events, and edges, between two pauses: about as much work as between those of rays
EVENTS_AT_ONCE = 1 << 16
LEAST_AT_ONCE = 8


class Ends(NamedTuple):
    """Where the branches of edges (n,) end, 0..1 of their ways.

    low, width : the last places, and how far beyond them there may be others; xy (n, 2), throughput
        of the rays there; n_tried : rays
    """

    low: Floats
    width: Floats
    xy: Floats
    throughput: Floats
    n_tried: Ints


def can_bisect(plan: Plan) -> bool:
    """Can the kernel look for the ends of branches in a plan?"""
    return library() is not None and made_of(plan) is not None


class Halving(NamedTuple):
    """Edges (n,) to be bisected.

    start, way : (n, 2) viewer px, the near ends, and the ways from there to the far ones
    course : (n, m), as `recording` gives it, of the branch (n,) that is looked for
    begun : what is known; a width below 1 is tried as it is, first of all
    least : part of the way; one that is no longer is bisected no more
    """

    start: Floats
    way: Floats
    course: Words
    branch: Words
    begun: Ends
    least: float


def bisect(plan: Plan, edges: Halving) -> Pauses[Ends]:
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
    at_once = max(LEAST_AT_ONCE, EVENTS_AT_ONCE // (plan.settings.max_events * n_digits))

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
