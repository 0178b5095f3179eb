"""Follows a batch of rays to their landings."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .. import kernel
from ..arrays import Bools, Floats, Ints, taken
from ..kinds import Kind
from ..steps import Pauses, finish
from .hits import Accept, Hits, slab
from .landings import Landings, Reason, Words, join
from .laws import ENDS, LAWS
from .meetings import is_beside_glass, on_plane
from .plan import Plan
from .rays import LAND, PlateLight, Rays, ReachedError

CHUNK = 1 << 16  # rays traced together: their arrays stay in the cache


def trace_all(
    plan: Plan, origins: Floats, directions: Floats, light: PlateLight = "imaged"
) -> Landings:
    """Trace any number of rays (n, 3), in chunks; parameters are those of `trace`."""
    parts = []
    for first in range(0, max(len(origins), 1), CHUNK):
        some = trace(
            plan, origins[first : first + CHUNK], directions[first : first + CHUNK], light=light
        )
        some.sample[:] += first
        parts.append(some)
    return join(parts)


class Step(NamedTuple):
    """Rays between two events: those that met something, where and on which patch; and the others.

    rays (h,) and left (l,) indices; place (h, 3), patch and
    triangle (h,) of the surface; start and direction (l, 3)
    """

    rays: Ints
    place: Floats
    patch: Ints
    triangle: Ints
    left: Ints
    start: Floats
    direction: Floats


def courses(plan: Plan, origins: Floats, directions: Floats) -> Pauses[Words]:
    """The branch of each ray (n, 3) after each of its m
    events at the most: (n, m), for `trace` to compare.
    """
    rays = Rays(origins, directions, np.zeros((len(origins), 8), np.uint64), is_recorded=True)
    yield from _following(plan, rays)
    return rays.course[:, : max(1, int(rays.n_words.max(initial=0)))]


def trace(
    plan: Plan, origins: Floats, directions: Floats, light: PlateLight = "imaged"
) -> Landings:
    """Landings of rays, traced at once; parameters as for `tracing`."""
    return finish(tracing(plan, origins, directions, light=light))


def tracing(
    plan: Plan,
    origins: Floats,
    directions: Floats,
    course: Words | None = None,
    steps: list[Step] | None = None,
    light: PlateLight = "imaged",
) -> Pauses[Landings]:
    """Follow rays backward from the viewer until each has
    landed on the display or is lost; pauses now and then.

    Parameters
    ----------
    origins, directions : (n, 3) float64, m, world; unit directions; all starting in air
    course : (n, m) as `courses` gives them: a ray is given up,
        without a landing, as soon as it leaves its course
    steps : is filled with a step for each event
    light : which light is followed at mirror arrays: that of the mid-air image, as the mean over
        all phases; what goes where the mirrors stand, stray light and all; or first light reflected
        by the plate's face, then such light. At ideal plates it is all the same.
    """
    rays = Rays(origins, directions, course, False, light)
    yield from _following(plan, rays, steps)
    rays.xy[rays.is_astray] = np.nan
    return Landings(
        np.arange(len(origins)),
        rays.reason,
        np.where(np.isfinite(rays.xy[:, 0]), np.maximum(rays.branch, np.uint64(1)), np.uint64(0)),
        rays.xy,
        rays.positions,
        rays.directions,
        rays.throughput,
        rays.n_events,
        rays.plate_path,
        rays.leak,
    )


def _following(plan: Plan, rays: Rays, steps: list[Step] | None = None) -> Pauses[None]:
    """Follow rays to their ends: by the compiled kernel where it can, else event by event."""
    if not kernel.can_follow(plan, rays, steps is not None):
        yield from _by_events(plan, rays, steps)
        return
    ways, reached = yield from kernel.follow(plan, rays, steps is not None)
    if reached:
        raise ReachedError(reached)
    if ways is not None:
        steps += _steps_of(plan, rays, ways)


def _steps_of(plan: Plan, rays: Rays, ways: kernel.Ways) -> Iterator[Step]:
    """The rays at each event, from their ways."""
    for event, (places, met) in enumerate(zip(ways.places, ways.met, strict=True)):
        some = np.flatnonzero(met >= 0)
        left = np.flatnonzero(ways.left_at == event)
        if not len(some) + len(left):
            return
        triangle = met[some]
        ends = left, taken(rays.positions, left), taken(rays.directions, left)
        yield Step(some, taken(places, some), plan.patch[triangle], triangle, *ends)


def _by_events(plan: Plan, rays: Rays, steps: list[Step] | None) -> Pauses[None]:
    """Follow rays, all of them from one event to the next."""
    for _ in range(plan.settings.max_events):
        if not len(rays.live):
            break
        hits, by_layer = yield from _first_hits(plan, rays)
        hit = hits.triangle >= 0
        left = rays.live[~hit]
        if not hit.all():
            _leave_gaps(plan, rays, left)
            _end_without_hit(plan, rays, left)
            rays.live = rays.live[hit]
            hits = hits.at(hit)
            by_layer = [other.at(hit) for other in by_layer]
        rays.positions[rays.live] += hits.distance[:, None] * rays.directions[rays.live]
        rays.n_events[rays.live] += 1
        _leave_gaps(plan, rays, rays.live, hits)
        if steps is not None:
            where = rays.live, rays.positions[rays.live], plan.patch[hits.triangle], hits.triangle
            steps.append(Step(*where, left, rays.positions[left], rays.directions[left]))
        part = plan.part[hits.triangle]
        kind = plan.kind[part]
        # glass in the same place as a sheet just met: the
        # sheet must not be met once more from there
        is_beside = (kind == Kind.GLASS) & (hits.distance <= plan.merge_distance)
        rays.last_part[rays.live[~is_beside]] = plan.sheet[part[~is_beside]]
        for of_kind, law in LAWS.items():
            chosen = np.flatnonzero(kind == of_kind)
            if len(chosen):
                law.meet(
                    plan,
                    rays,
                    rays.live[chosen],
                    hits.at(chosen),
                    [other.at(chosen) for other in by_layer],
                )
        rays.live = rays.live[~ENDS[kind] & ~rays.has_ended[rays.live]]
        yield 0


class _Sides:
    """Which hits in a layer are true (decision 1): one enters a
    solid from outside and leaves it from inside.

    Sheets are met from either side, but the one just left not again at once. `gap` and
    `gap_distance` (n,) tell of the nearest face of an open solid that a ray came upon from the
    wrong side: it has gone in or out through a gap.
    """

    def __init__(self, plan: Plan, rays: Rays) -> None:
        self.plan = plan
        live = rays.live
        self.mask = rays.mask[live]
        self.cluster = rays.cluster[live]
        self.last_part = rays.last_part[live]
        self.gap = np.full(len(live), -1)
        self.gap_distance = np.full(len(live), np.inf)

    def of_layer(self, numbers: Ints, tolerance: float) -> Accept:
        """The question for a layer whose triangles have these numbers in the plan."""
        plan = self.plan

        def accept(i: Ints, hits: Hits) -> tuple[Bools, Bools]:
            # touching faces may be a little behind; not so others of
            # the surface just met, however thin it is
            t = hits.distance
            part = plan.part[numbers[hits.triangle]]
            bit = plan.bit[part]
            is_solid = bit != 0
            fits = hits.enters != (
                ((self.mask[i] & bit) != 0) & (self.cluster[i] == plan.cluster[part])
            )
            is_last = plan.sheet[part] == self.last_part[i]
            is_new = (t > tolerance) | ~is_last & (t > -1e-3 * tolerance)
            is_behind = is_solid & ~fits & (t > tolerance)
            if plan.open_parts:
                self._note_gaps(i, t, part, is_behind & ~plan.is_closed[part])
            is_true = np.where(
                is_solid, fits & (t > np.where(is_last, -1e-3, -1.0) * tolerance), is_new
            )
            return is_true, is_behind & plan.is_closed[part]

        return accept

    def _note_gaps(self, i: Ints, distance: Floats, part: Ints, is_gap: Bools) -> None:
        nearer = np.flatnonzero(is_gap & (distance < self.gap_distance[i]))
        # nearest last, so that it is the one that stays
        nearer = nearer[np.argsort(-distance[nearer], kind="stable")]
        self.gap[i[nearer]], self.gap_distance[i[nearer]] = part[nearer], distance[nearer]


def _first_hits(plan: Plan, rays: Rays) -> Pauses[tuple[Hits, list[Hits]]]:
    """First hits of the live rays, and those of each layer
    that are no further. Triangles are the plan's.
    """
    live = rays.live
    origins = rays.positions[live]
    directions = rays.directions[live]
    sides = _Sides(plan, rays)
    by_layer = [None] * len(plan.layers)
    nearest = np.full(len(live), np.inf)
    # glass comes first: most other parts lie beyond, and then need not be asked
    for number in sorted(
        range(len(plan.layers)), key=lambda number: not plan.layers[number].has_engine
    ):
        layer = plan.layers[number]
        (numbers, closed_bits, bits) = plan.layer_parts[number]
        tolerance = max(layer.tolerance, plan.merge_distance)
        leaves = (
            None
            if layer.curved is None or bits is None
            else (sides.mask & bits[sides.cluster]) != 0
        )
        is_inside = (sides.mask & closed_bits[sides.cluster]) != 0
        accept = sides.of_layer(numbers, tolerance)
        hits = yield from layer.find_first_hits(
            origins, directions, is_inside, accept, leaves, nearest + tolerance
        )
        found = hits.triangle >= 0
        hits.triangle[found] = numbers[hits.triangle[found]]
        nearest = np.minimum(nearest, hits.distance)
        by_layer[number] = hits
    first = by_layer[0]
    for hits in by_layer[1:]:
        nearer = hits.distance < first.distance
        if nearer.any():
            first = first.or_where(nearer, hits)
    if plan.aside:
        _keep_clear(plan, origins, directions, first.distance)
    came_in = sides.gap_distance < first.distance
    rays.leak[live[came_in]] = sides.gap[came_in]
    return first, by_layer


def _leave_gaps(plan: Plan, rays: Rays, i: Ints, hits: Hits | None = None) -> None:
    """Take rays out of open solids that they have left through a
    gap: beyond the box, or where they meet nothing.
    """
    for number, box in plan.open_parts:
        is_in = ((rays.mask[i] & plan.bit[number]) != 0) & (rays.cluster[i] == plan.cluster[number])
        if hits is not None:
            at = rays.positions[i]
            part = plan.part[hits.triangle]
            is_beyond = ((at < box[0]) | (at > box[1])).any(axis=1)
            is_beyond |= (plan.bit[part] != 0) & (plan.cluster[part] != plan.cluster[number])
            is_in &= is_beyond & (part != number)
        gone = i[is_in]
        rays.mask[gone] &= ~plan.bit[number]
        rays.leak[gone] = number


def _keep_clear(plan: Plan, origins: Floats, directions: Floats, distance: Floats) -> None:
    """Raise ReachedError when a ray, on its way of a length of
    `distance` (n,), enters the box of glass aside.
    """
    reached = set()
    for number, box in enumerate(plan.aside_boxes):
        enter, leave = slab(box, origins, directions)
        if ((enter <= leave) & (leave >= 0) & (enter <= distance)).any():
            reached.add(number)
    if reached:
        raise ReachedError(reached)


def _end_without_hit(plan: Plan, rays: Rays, lost: Ints) -> None:
    rays.reason[lost] = np.select(
        [rays.mask[lost] != 0, ~rays.has_met_glass[lost], ~rays.has_met_plate[lost]],
        [Reason.LOST_INSIDE, Reason.MISSED_GLASS, Reason.MISSED_PLATE],
        Reason.MISSED_DISPLAY,
    )
    if plan.display_plane is not None:
        asked = lost[
            (rays.reason[lost] == Reason.MISSED_DISPLAY) | is_beside_glass(plan, rays, lost)
        ]
        xy, _, is_front = on_plane(plan, rays, asked)
        rays.xy[asked[is_front]] = xy[is_front]
        rays.add_to_branch(asked[is_front], plan.patch[-1], LAND)
