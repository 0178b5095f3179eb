"""The first hit of each ray among all layers of a plan, and which hits are true ones."""

import numpy as np

from ..base.arrays import Bools, Floats, Ints, taken
from ..base.steps import Pauses
from ..glass.curved_roots import Lines
from . import layer_hits
from .contact import NEAR, in_order
from .hits import Accept, Hits, Search, slab
from .plan import Plan
from .rays import Rays, ReachedError


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

    def is_in(self, bits: Floats) -> Bools:
        """Which rays are in solids of these bits (clusters,) in each cluster's mask?"""
        return (self.mask & bits[self.cluster]) != 0

    def of_layer(self, numbers: Ints, tolerance: float) -> Accept:
        """The question for a layer whose triangles have these numbers in the plan."""
        parts = self.plan.parts
        part_of = self.plan.triangles.part

        def accept(i: Ints, hits: Hits) -> tuple[Bools, Bools]:
            # a solid is entered from outside, and left from inside
            t = hits.distance
            part = part_of[numbers[hits.triangle]]
            bit = parts.bit[part]
            is_solid = bit != 0
            is_in = ((self.mask[i] & bit) != 0) & (self.cluster[i] == parts.cluster[part])
            fits = hits.enters != is_in

            # touching faces may be a little behind; not so others of
            # the surface just met, however thin it is
            is_last = parts.sheet[part] == self.last_part[i]
            is_new = (t > tolerance) | ~is_last & (t > -1e-3 * tolerance)
            is_true = np.where(
                is_solid, fits & (t > np.where(is_last, -1e-3, -1.0) * tolerance), is_new
            )

            # a face met from the wrong side, and not in the place that the ray comes from: a gap in
            # open glass, else another one was missed
            is_behind = is_solid & ~fits & (t * hits.cosine > tolerance)
            is_closed = parts.is_closed[part]
            if self.plan.open_parts:
                self._note_gaps(i, t, part, is_behind & ~is_closed)

            return is_true, is_behind & is_closed

        return accept

    def _note_gaps(self, i: Ints, distance: Floats, part: Ints, is_gap: Bools) -> None:
        nearer = np.flatnonzero(is_gap & (distance < self.gap_distance[i]))
        # nearest last, so that it is the one that stays
        nearer = nearer[np.argsort(-distance[nearer], kind="stable")]
        self.gap[i[nearer]] = part[nearer]
        self.gap_distance[i[nearer]] = distance[nearer]


def find_first_hits(
    plan: Plan, rays: Rays, searches: list[Search]
) -> Pauses[tuple[Hits, list[Hits], Bools]]:
    """First hits of the live rays (n,), those of each layer that are no further, without normals,
    and the rays (n,) of which the search is put off. Triangles are the plan's.

    searches : how far each layer was searched for all rays
    """
    live = rays.live
    origins = taken(rays.positions, live)
    directions = taken(rays.directions, live)
    sides = _Sides(plan, rays)
    by_layer = [None] * len(plan.layers)
    nearest, cosine = np.full(len(live), np.inf), np.ones(len(live))
    near = NEAR * plan.merge_distance if plan.display.is_by_glass else 0.0

    # glass comes first: most other parts lie beyond, and then need not be asked
    has_engine = [held.layer.has_engine for held in plan.layers]
    for number in sorted(range(len(plan.layers)), key=lambda number: not has_engine[number]):
        held = plan.layers[number]
        layer = held.layer
        tolerance = max(layer.tolerance, plan.merge_distance)
        has_sides = layer.curved is not None and held.solid_bits is not None
        # faces in one place are that far apart across, and further along the ray
        with np.errstate(divide="ignore"):
            searches[number].begin(live, nearest + max(tolerance, near) / cosine)
        hits = yield from layer_hits.find_first_hits(
            layer,
            Lines(origins, directions),
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
        first = in_order(plan, first, by_layer)

    is_open = np.zeros(len(live), bool)
    for search in searches:
        is_open |= search.is_open
    found = np.flatnonzero(~is_open)
    for search in searches:
        search.end(found)

    if plan.aside.glasses:
        _keep_clear(plan, origins[found], directions[found], first.distance[found])

    came_in = sides.gap_distance < first.distance
    rays.leak[live[came_in]] = sides.gap[came_in]
    return first, [hits.without_normals() for hits in by_layer], is_open


def _keep_clear(plan: Plan, origins: Floats, directions: Floats, distance: Floats) -> None:
    """Raise ReachedError when a ray, on its way of a length of
    `distance` (n,), enters the box of glass aside.
    """
    reached = set()
    for number, box in enumerate(plan.aside.boxes):
        enter, leave = slab(box, origins, directions)
        if ((enter <= leave) & (leave >= 0) & (enter <= distance)).any():
            reached.add(number)
    if reached:
        raise ReachedError(reached)
