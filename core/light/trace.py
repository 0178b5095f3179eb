"""Follows a batch of rays to their landings, from hit to hit through all layers of a plan."""

from collections.abc import Sequence

import numpy as np

from ..base.arrays import Bools, Floats, Ints, take
from ..base.steps import Steps, run_steps
from ..glass.curved_hits import RayLines
from ..rig.rig import Kind
from . import layer_hits
from .hits import Accept, Hits, LayerSearch, slab
from .interaction_display import NEAR, end_beneath_glass, end_without_hit, order_contacts
from .interactions import ENDS, INTERACTIONS
from .plan import Plan, PlannedLayer
from .rays import (
    DeferredObjectError,
    Landings,
    PlateLight,
    Rays,
    Step,
    Words,
    copied_steps,
    join,
    main_of,
    main_steps,
)


class _HitSides:
    """Decides which hits in a layer are true: solids are entered from outside and left from inside
    (docs/decisions/01-true-hits.md).

    Thin surfaces are hit from either side, but not again immediately.

    gap, gap_distance : (n,) the nearest face of an open solid hit from the wrong side, through a
        gap
    """

    def __init__(self, plan: Plan, rays: Rays) -> None:
        self.plan = plan
        live = rays.live
        self.mask = rays.mask[live]
        self.cluster = rays.cluster[live]
        self.last_part = rays.last_part[live]
        self.gap = np.full(len(live), -1)
        self.gap_distance = np.full(len(live), np.inf)

    def is_in(self, bits: Floats) -> Bools:
        """Which rays are in solids with these bits (clusters,) in each cluster's mask."""
        return (self.mask & bits[self.cluster]) != 0

    def of_layer(self, numbers: Ints, tolerance: float) -> Accept:
        """The test of hits for a layer whose triangles have these numbers in the plan."""
        parts = self.plan.parts
        part_of = self.plan.triangles.part

        def accept(i: Ints, hits: Hits) -> tuple[Bools, Bools]:
            t = hits.distance
            part = part_of[numbers[hits.triangle]]
            bit = parts.bit[part]
            is_solid = bit != 0
            is_in = ((self.mask[i] & bit) != 0) & (self.cluster[i] == parts.cluster[part])
            fits = hits.enters != is_in

            # touching faces may lie slightly behind; other faces of the surface just left may not,
            # however thin it is
            is_last = parts.sheet[part] == self.last_part[i]
            is_new = (t > tolerance) | ~is_last & (t > -1e-3 * tolerance)
            is_true = np.where(
                is_solid, fits & (t > np.where(is_last, -1e-3, -1.0) * tolerance), is_new
            )

            # a back face away from the ray's origin: a gap in open glass, or else a missed face
            is_behind = is_solid & ~fits & (t * hits.cosine > tolerance)
            is_closed = parts.is_closed[part]
            if self.plan.open_parts:
                self._note_gaps(i, t, part, is_behind & ~is_closed)

            return is_true, is_behind & is_closed

        return accept

    def _note_gaps(self, i: Ints, distance: Floats, part: Ints, is_gap: Bools) -> None:
        nearer = np.flatnonzero(is_gap & (distance < self.gap_distance[i]))
        # nearest last, so it overwrites the others
        nearer = nearer[np.argsort(-distance[nearer], kind="stable")]
        self.gap[i[nearer]] = part[nearer]
        self.gap_distance[i[nearer]] = distance[nearer]


def find_first_hits(
    plan: Plan, rays: Rays, searches: list[LayerSearch]
) -> Steps[tuple[Hits, list[Hits], Bools]]:
    """First hits of the live rays (n,), hits of each layer up to there without normals, and the
    deferred rays (n,).

    Triangles are numbered as in the plan.

    searches : progress of the search of each layer, for all rays
    """
    live = rays.live
    origins = take(rays.positions, live)
    directions = take(rays.directions, live)
    sides = _HitSides(plan, rays)
    by_layer = [None] * len(plan.layers)
    nearest, cosine = np.full(len(live), np.inf), np.ones(len(live))
    near = NEAR * plan.merge_distance if plan.display.is_by_glass else 0.0

    # glass first: most other parts lie beyond it and can then be skipped
    has_engine = [held.layer.has_engine for held in plan.layers]
    for number in sorted(range(len(plan.layers)), key=lambda number: not has_engine[number]):
        held = plan.layers[number]
        layer = held.layer
        tolerance = max(layer.tolerance, plan.merge_distance)
        has_sides = layer.curved is not None and held.solid_bits is not None
        # coincident faces are this far apart perpendicularly, and further along the ray
        with np.errstate(divide="ignore"):
            searches[number].begin(live, nearest + max(tolerance, near) / cosine)
        hits = yield from layer_hits.find_first_hits(
            layer,
            RayLines(origins, directions),
            sides.is_in(held.closed_bits),
            sides.of_layer(held.numbers, tolerance),
            sides.is_in(held.solid_bits) if has_sides else None,
            searches[number],
        )
        found = hits.triangle >= 0
        hits.triangle[found] = held.numbers[hits.triangle[found]]
        is_nearer = hits.distance < nearest
        nearest = np.where(is_nearer, hits.distance, nearest)
        cosine = np.where(is_nearer, hits.cosine, cosine)
        by_layer[number] = hits

    first = by_layer[0]
    for hits in by_layer[1:]:
        nearer = hits.distance < first.distance
        if nearer.any():
            first = first.or_where(nearer, hits)

    if plan.display.is_by_glass:
        first = order_contacts(plan, first, by_layer)

    is_open = np.zeros(len(live), bool)
    for search in searches:
        is_open |= search.is_open
    found = np.flatnonzero(~is_open)
    for search in searches:
        search.end(found)

    if plan.deferred.glasses:
        _keep_clear(plan, origins[found], directions[found], first.distance[found])

    came_in = sides.gap_distance < first.distance
    rays.leak[live[came_in]] = sides.gap[came_in]
    return first, [hits.without_normals() for hits in by_layer], is_open


def _keep_clear(plan: Plan, origins: Floats, directions: Floats, distance: Floats) -> None:
    """Raise DeferredObjectError if a ray enters a box of deferred glass within `distance` (n,)."""
    reached = set()
    for number, box in enumerate(plan.deferred.boxes):
        enter, leave = slab(box, origins, directions)
        if ((enter <= leave) & (leave >= 0) & (enter <= distance)).any():
            reached.add(number)
    if reached:
        raise DeferredObjectError(reached)


TRACED_AT_ONCE = 1 << 16  # rays
LIVE_AT_ONCE = 1 << 14  # rays per event, so their arrays stay in the cache


def trace_all(
    plan: Plan, origins: Floats, directions: Floats, light: PlateLight = "imaged"
) -> Landings:
    """Trace any number of rays (n, 3), in chunks; parameters as for `trace`."""
    parts = []
    for first in range(0, max(len(origins), 1), TRACED_AT_ONCE):
        some = slice(first, first + TRACED_AT_ONCE)
        landings = trace(plan, origins[some], directions[some], light=light)
        landings.sample[:] += first
        parts.append(landings)
    return join(parts)


def recording(plan: Plan, origins: Floats, directions: Floats) -> Steps[tuple[Landings, Words]]:
    """Landings of rays (n, 3), and the course of each: its branch after each of at most m events,
    for comparison in `tracing`.
    """
    n = (1 + plan.n_copies) * len(origins)
    course = np.zeros((n, 8), np.uint64)
    rays = Rays(origins, directions, course, True, n_copies=plan.n_copies)
    rays.begin_polarisation(plan.is_polarised)
    yield from plan.tracer.follow(plan, rays)
    width = max(1, int(rays.n_words.max(initial=0)))
    return _landings_of(rays), rays.course[rays.is_begun, :width]


def trace(
    plan: Plan, origins: Floats, directions: Floats, light: PlateLight = "imaged"
) -> Landings:
    """Landings of rays, traced at once; parameters as for `tracing`."""
    return run_steps(tracing(plan, origins, directions, light=light))


def tracing(
    plan: Plan,
    origins: Floats,
    directions: Floats,
    course: Words | None = None,
    steps: list[Step] | None = None,
    light: PlateLight = "imaged",
) -> Steps[Landings]:
    """Follow rays backward from the viewer until each has landed on the display or is lost; yields
    the number ended since the last yield.

    Parameters
    ----------
    origins, directions : (n, 3) float64, m, world; unit directions; all starting in air
    course : (n, m) from `recording`: a ray is dropped, without a landing, as soon as it leaves its
        course
    steps : receives a step for each event, without copies of rays
    light : light followed at mirror arrays: "imaged", the mid-air image averaged over all phases;
        "folded", all light by the mirrors' actual positions, stray light included; "reflected",
        light reflected by the first plate's face, then folded. The same for ideal plates.
    """
    rays = Rays(origins, directions, course, False, light, plan.n_copies)
    rays.begin_polarisation(plan.is_polarised)
    yield from plan.tracer.follow(plan, rays, steps)
    landings = _landings_of(rays)
    if steps and plan.n_copies:
        rows = np.flatnonzero(rays.is_begun)
        main = rows[main_of(landings, rays.n_originals)]
        steps[:] = main_steps(steps, main, rays.n_originals)
    return landings


def _landings_of(rays: Rays) -> Landings:
    """The landings of rays at their end."""
    rays.xy[rays.is_astray] = np.nan
    has_place = np.isfinite(rays.xy[:, 0])
    landings = Landings(
        sample=np.tile(np.arange(rays.n_originals), 1 + rays.n_copies),
        reason=rays.reason,
        branch=np.where(has_place, np.maximum(rays.branch, np.uint64(1)), np.uint64(0)),
        xy=rays.xy,
        positions=rays.positions,
        directions=rays.directions,
        throughput=rays.throughput,
        n_events=rays.n_events,
        rank=rays.rank,
        plate_path=rays.plate_path,
        leak=rays.leak,
    )
    return landings.at(rays.is_begun) if rays.n_copies else landings


def by_events(plan: Plan, rays: Rays, steps: list[Step] | None) -> Steps[None]:
    """Follow rays from one event to the next.

    New rays start as others end, because an event costs nearly as much for few rays as for many. If
    steps are recorded, all rays go through events together.
    """
    waiting = rays.live
    rays.live = waiting[:0]
    at_once = LIVE_AT_ONCE if steps is None else len(waiting)
    # gaps depend on everything a ray encounters
    may_wait = steps is None and not plan.open_parts
    searches = [LayerSearch(len(rays.mask), may_wait) for _ in plan.layers]

    while True:
        room = at_once - len(rays.live)
        rays.live = np.concatenate([rays.live, waiting[:room]])
        waiting = waiting[room:]
        n_live = len(rays.live)
        if not n_live:
            break

        hits, by_layer, is_open = yield from find_first_hits(plan, rays, searches)
        put_off = rays.live[is_open]
        if len(put_off):
            rays.live = rays.live[~is_open]
            hits, *by_layer = (some.at(~is_open) for some in (hits, *by_layer))

        hit = hits.triangle >= 0
        left = rays.live[~hit]

        if not hit.all():
            _leave_gaps(plan, rays, left)
            end_without_hit(plan, rays, left)
            rays.live = rays.live[hit]
            hits = hits.at(hit)
            by_layer = [other.at(hit) for other in by_layer]

        if plan.media.absorptions is not None:
            rays.throughput[rays.live] *= np.exp(-rays.absorption[rays.live] * hits.distance)
        rays.positions[rays.live] += hits.distance[:, None] * take(rays.directions, rays.live)
        rays.n_events[rays.live] += 1
        _leave_gaps(plan, rays, rays.live, hits)
        if steps is not None:
            steps.append(_step_of(plan, rays, hits, left))

        # glass coincident with the thin surface just left: do not hit the surface again from there
        part = plan.triangles.part[hits.triangle]
        kind = plan.parts.kind[part]
        is_coincident = (kind == Kind.GLASS) & (hits.distance * hits.cosine <= plan.merge_distance)
        rays.last_part[rays.live[~is_coincident]] = plan.parts.sheet[part[~is_coincident]]

        before = rays.mask[rays.live]
        _interact(plan, rays, hits, by_layer, kind)
        if plan.display.is_by_glass:
            end_beneath_glass(plan, rays, hits, by_layer, before)
        is_over = rays.n_events[rays.live] >= plan.settings.max_events
        on = rays.live[~(ENDS[kind] | is_over | rays.has_ended[rays.live])]
        born, parents = rays.born, rays.parents
        rays.born = rays.parents = born[:0]
        if steps is not None:
            steps[:] = copied_steps(steps, parents, born)
        is_over = rays.n_events[born] >= plan.settings.max_events
        rays.live = np.concatenate([on, put_off, born[~(is_over | rays.has_ended[born])]])
        yield n_live - len(rays.live)


def _interact(plan: Plan, rays: Rays, hits: Hits, by_layer: list[Hits], kind: Ints) -> None:
    """Apply the interaction of each kind of part to the live rays that hit it."""
    for of_kind, interaction in INTERACTIONS.items():
        some = np.flatnonzero(kind == of_kind)
        if len(some):
            others = [other.at(some) for other in by_layer] if interaction.crosses else []
            interaction.interact(plan, rays, rays.live[some], hits.at(some), others)


def _step_of(plan: Plan, rays: Rays, hits: Hits, left: Ints) -> Step:
    """The step of live rays to their hits, and of rays without one."""
    return Step(
        rays=rays.live,
        place=rays.positions[rays.live],
        patch=plan.triangles.patch[hits.triangle],
        triangle=hits.triangle,
        left=left,
        start=rays.positions[left],
        direction=rays.directions[left],
    )


def _leave_gaps(plan: Plan, rays: Rays, i: Ints, hits: Hits | None = None) -> None:
    """Remove rays from open solids left through a gap: beyond the box, or without a hit."""
    parts = plan.parts
    for number, box in plan.open_parts:
        has_bit = (rays.mask[i] & parts.bit[number]) != 0
        is_in = has_bit & (rays.cluster[i] == parts.cluster[number])

        if hits is not None:
            at = rays.positions[i]
            part = plan.triangles.part[hits.triangle]
            is_out = ((at < box[0]) | (at > box[1])).any(axis=1)
            is_elsewhere = (parts.bit[part] != 0) & (parts.cluster[part] != parts.cluster[number])
            is_in &= (is_out | is_elsewhere) & (part != number)

        gone = i[is_in]
        rays.mask[gone] &= ~parts.bit[number]
        rays.absorption[gone] = 0.0
        rays.leak[gone] = number


class EventByEvent:
    """Follows the rays of any plan with numpy and a ray engine."""

    bisect = None

    def left_out(self, layers: Sequence[PlannedLayer], kind: Ints, is_polarised: bool) -> None:
        """It traces every plan."""

    def rays_at_once(self, plan: Plan, most: int) -> int:
        """All rays at once: recording needs no limit."""
        return most

    def follow(self, plan: Plan, rays: Rays, steps: list[Step] | None = None) -> Steps[None]:
        """Follow rays to their ends."""
        yield from by_events(plan, rays, steps)
