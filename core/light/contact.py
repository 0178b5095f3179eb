"""Glass that lies on the display: which of the two does a ray meet first?

There is air between them, however little, as between a lump of glass and a telephone: light that
leaves the glass there lands where it stands, unless it is turned back. Display that is met from
outside hides the glass behind it.
"""

from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools
from ..rig.kinds import Kind
from .hits import Hits
from .interaction_display import meet as meet_display
from .plan import Plan
from .rays import Rays

# times the plan's merge distance: glass and display that differ by rounding are that near
NEAR = 4.0


class Contact(NamedTuple):
    """The display as n rays meet it, and where glass that
    they leave, or that they enter, is in the same place.
    """

    display: Hits
    glass: Hits
    leaves: Bools
    enters: Bools


def _contact(plan: Plan, first: Hits, by_layer: list[Hits]) -> Contact:
    """Hits of rays at glass and display in one place, from the first ones and those by layer."""
    n = len(first.distance)
    display, glass = Hits.none(n, None), Hits.none(n, None)
    part_of, parts = plan.triangles.part, plan.parts

    for hits in by_layer:
        display = display.or_where(hits.triangle >= plan.display.start, hits)
        is_solid = (hits.triangle >= 0) & (parts.bit[part_of[hits.triangle]] != 0)
        glass = glass.or_where(is_solid & ~hits.enters & (hits.distance < glass.distance), hits)

    near = NEAR * plan.merge_distance
    is_entered = (first.triangle >= 0) & (parts.kind[part_of[first.triangle]] == Kind.GLASS)
    is_first = (display.gap(first) <= near) | (glass.gap(first) <= near)
    leaves = is_first & (display.gap(glass) <= near)
    enters = ~leaves & is_entered & first.enters & (display.gap(first) <= near)

    return Contact(display, glass, leaves, enters)


def in_order(plan: Plan, first: Hits, by_layer: list[Hits]) -> Hits:
    """The first hits of rays, with those changed for which glass and display are in one place."""
    contact = _contact(plan, first, by_layer)
    if contact.leaves.any():
        first = first.or_where(contact.leaves, contact.glass)
    if contact.enters.any():
        first = first.or_where(contact.enters, contact.display)
    return first


def land(plan: Plan, rays: Rays, hits: Hits, by_layer: list[Hits], before: np.ndarray) -> None:
    """End live rays that have just left glass where it lies on the display.

    before : (n,) masks, those in which rays came to their hits
    """
    contact = _contact(plan, hits, by_layer)
    at = np.flatnonzero(contact.leaves)
    i = rays.live[at]
    is_out = rays.mask[i] != before[at]

    # light that was turned back must not meet the display behind it
    shown = plan.triangles.part[contact.display.triangle[at[~is_out]]]
    rays.last_part[i[~is_out]] = plan.parts.sheet[shown]

    at, i = at[is_out], i[is_out]
    rays.has_ended[i] = True
    goes_on = rays.n_events[i] < plan.settings.max_events
    at, i = at[goes_on], i[goes_on]
    rays.n_events[i] += 1
    if len(i):
        meet_display(plan, rays, i, contact.display.at(at), by_layer)
