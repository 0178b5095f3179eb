"""Rays that the compiled kernel follows to their ends, one by one."""

import ctypes

import numpy as np

from ...base.steps import Pauses
from ...native.loading import library, loaded, n_threads
from ..plan import Plan
from ..rays import Rays
from .plan_structures import is_whole, left_out, made_of, making_whole
from .ray_states import Ways, state_of

# events, and rays, between two pauses: less than 0.1 s of work
EVENTS_AT_ONCE = 1 << 16
LEAST_AT_ONCE = 64
# bytes of a batch's ways or courses; beyond, they are recorded event by event by numpy
MOST_RECORDED = 1 << 26
PLACE, WORD = 32, 8  # bytes of an event of a ray, in its way and in its course


def can_follow(plan: Plan, rays: Rays, has_ways: bool) -> bool:
    """Can the kernel follow these rays, and write down their ways if asked to?"""
    if library() is None or made_of(plan) is None:
        return False
    per_event = PLACE * has_ways + WORD * rays.is_recorded
    return len(rays.live) * per_event * (plan.settings.max_events + 1) <= MOST_RECORDED


def recorded_at_once(plan: Plan, most: int) -> int:
    """How many rays, at most, the kernel follows at once and writes down the ways or courses of;
    the given number where it follows none.
    """
    if left_out(plan.layers, plan.parts.kind) is not None:
        return most
    return min(most, max(1, MOST_RECORDED // (PLACE * (plan.settings.max_events + 1))))


def follow(plan: Plan, rays: Rays, has_ways: bool) -> Pauses[tuple[Ways | None, set[int]]]:
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
