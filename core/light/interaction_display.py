"""The display: ends rays, and gives the reason if a ray has not arrived, for every kind of end.

A ray ends on the display, on the plane of a flat display beyond the plate, or in empty space. Light
leaving glass placed directly on the display lands at the contact point. A thin layer of air
separates them, as between a glass block and a phone.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints, take
from ..base.products import turn
from ..base.vectors import dot
from ..glass.curved import EDGE
from ..glass.meshes import interpolate
from ..glass.surfaces import Surface, make_surface
from ..rig.rig import Display, Kind
from .display import uv_islands
from .hits import Hits
from .meetings import Interaction, key_of_facets
from .mesh_cache import MeshCache
from .plan import Plan
from .rays import LAND, Rays, Reason


def on_plane(plan: Plan, rays: Rays, i: Ints) -> tuple[Floats, Floats, Bools]:
    """Intersections of rays with a flat display's plane: display px (n, 2), distance (n,) m, and
    whether from the front.
    """
    plane = plan.display.plane
    origins, directions = take(rays.positions, i), take(rays.directions, i)
    slope = dot(directions, plane.normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = dot(plane.corner - origins, plane.normal) / slope
        at = origins + t[:, None] * directions - plane.corner
        xy = turn(plane.pixels, at) + plane.origin
    return xy, t, (slope < 0) & (t > 0)


def is_on_image(plan: Plan, xy: Floats) -> Bools:
    """Whether display pixels (n, 2) lie within the image, with a tolerance for rounding."""
    size = np.array([plan.rig.display.width, plan.rig.display.height])
    return ((xy >= -EDGE * size) & (xy <= (1 + EDGE) * size)).all(axis=1)


def land(plan: Plan, rays: Rays, i: Ints, place: Floats, triangle: Ints | int = 0) -> None:
    """Set the landings of rays (n,) at places (n, 2), px, on triangles (n,) of the display."""
    rays.xy[i] = place
    if plan.display.absorbing is not None:
        axes = np.broadcast_to(plan.display.absorbing[triangle], (len(i), 3))
        rays.reach_display(i, axes)


def _passes_glass(plan: Plan, rays: Rays, i: Ints) -> Bools:
    """Whether light passed by the glass, met the plate if one is required, and the settings follow
    such light.
    """
    is_past_glass = (rays.reason[i] == Reason.MISSED_GLASS) & plan.settings.looks_past_glass
    return is_past_glass & (rays.has_met_plate[i] | (not plan.needs_plate))


def give_reasons(
    plan: Plan, rays: Rays, i: Ints, is_met: Bools, is_front: Bools, is_on: Bools
) -> Bools:
    """Set the reasons of rays (n,) at their end; returns which of them have a landing.

    A ray that met neither glass nor plate has missed the glass, which comes first on its path. A
    ray that met the display needs no plate if all light is followed, and no glass unless the
    settings require it. A plate is only missed in a rig that needs one. Light without a picture
    may land outside the image or past the glass, so the map can be cut there.

    Parameters
    ----------
    is_met : (n,) the display is hit
    is_front : (n,) on its front
    is_on : (n,) and on its image
    """
    misses_glass = ~rays.has_met_glass[i] & (~is_met | plan.settings.only_through_glass)
    misses_glass &= plan.has_glass
    misses_plate = ~rays.has_met_plate[i] & (~is_met | (rays.light == "imaged")) & plan.needs_plate
    reason = np.select(
        [misses_glass, misses_plate, ~is_met, ~is_front, ~is_on],
        [
            Reason.MISSED_GLASS,
            Reason.MISSED_PLATE,
            Reason.MISSED_DISPLAY,
            Reason.BLOCKED,
            Reason.MISSED_DISPLAY,
        ],
        Reason.ARRIVED,
    )

    rays.reason[i] = reason
    lands = (reason == Reason.ARRIVED) | (reason == Reason.MISSED_DISPLAY)
    return lands | _passes_glass(plan, rays, i)


def end_beyond_plate(plan: Plan, rays: Rays, i: Ints) -> None:
    """End rays that can only meet a flat display."""
    rays.has_ended[i] = True
    i = i[rays.n_events[i] < plan.settings.max_events]
    xy, t, is_front = on_plane(plan, rays, i)
    with np.errstate(invalid="ignore"):
        is_met = (t > 0) & is_on_image(plan, xy)

    rays.positions[i[is_met]] += t[is_met, None] * rays.directions[i[is_met]]
    rays.n_events[i[is_met]] += 1

    lands = give_reasons(plan, rays, i, is_met, is_front, is_on=is_met) & is_front
    land(plan, rays, i[lands], xy[lands])
    rays.add_to_branch(i[lands], plan.triangles.patch[-1], LAND)


def end_without_hit(plan: Plan, rays: Rays, i: Ints) -> None:
    """End rays that hit nothing; some narrowly miss a flat display."""
    is_inside = rays.mask[i] != 0
    rays.reason[i[is_inside]] = Reason.LOST_INSIDE
    i = i[~is_inside]
    nowhere = np.zeros(len(i), bool)
    lands = give_reasons(plan, rays, i, is_met=nowhere, is_front=nowhere, is_on=nowhere)
    if plan.display.plane is None:
        return

    i = i[lands]
    xy, _, is_front = on_plane(plan, rays, i)
    land(plan, rays, i[is_front], xy[is_front])
    rays.add_to_branch(i[is_front], plan.triangles.patch[-1], LAND)


def surface(part: Display, mesh_cache: MeshCache) -> tuple[Surface, str]:
    """Its triangles, each flat; one patch for each UV island."""

    def make() -> Surface:
        return replace(make_surface(part.mesh.flat()), patch=uv_islands(part.mesh))

    key = key_of_facets(part.mesh)
    return mesh_cache.get(f"display {key}", make), key


def interact(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """End the rays; they land if they hit the front and have met the required parts.

    Light without a picture, followed for completeness, may pass by the plate.
    """
    display = plan.rig.display
    triangle = hits.triangle - plan.display.start
    place = display.place(interpolate(display.mesh.uv[triangle], hits.u, hits.v))

    is_front = dot(rays.directions[i], plan.triangles.normals[hits.triangle]) < 0
    is_met = np.ones(len(i), bool)
    lands = give_reasons(plan, rays, i, is_met, is_front, is_on=is_on_image(plan, place)) & is_front
    rays.add_to_branch(i, plan.triangles.patch[hits.triangle], LAND)
    land(plan, rays, i[lands], place[lands], triangle[lands])


INTERACTION = Interaction(interact, surface, ends=True)


# times the plan's merge distance: glass and display closer than this are in contact
NEAR = 4.0


class Contact(NamedTuple):
    """Hits of n rays on display and glass, and where glass in contact is left or entered."""

    display: Hits
    glass: Hits
    leaves: Bools
    enters: Bools


def _contact(plan: Plan, first: Hits, by_layer: list[Hits]) -> Contact:
    """Find contacts of glass and display from the first hits and the hits by layer."""
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


def order_contacts(plan: Plan, first: Hits, by_layer: list[Hits]) -> Hits:
    """The first hits of rays, corrected where glass and display are in contact."""
    contact = _contact(plan, first, by_layer)
    if contact.leaves.any():
        first = first.or_where(contact.leaves, contact.glass)
    if contact.enters.any():
        first = first.or_where(contact.enters, contact.display)
    return first


def end_beneath_glass(
    plan: Plan, rays: Rays, hits: Hits, by_layer: list[Hits], before: np.ndarray
) -> None:
    """End live rays that have just left glass in contact with the display.

    before : (n,) masks before the hits
    """
    contact = _contact(plan, hits, by_layer)
    at = np.flatnonzero(contact.leaves)
    i = rays.live[at]
    is_out = rays.mask[i] != before[at]

    # reflected light must not hit the display behind it
    shown = plan.triangles.part[contact.display.triangle[at[~is_out]]]
    rays.last_part[i[~is_out]] = plan.parts.sheet[shown]

    at, i = at[is_out], i[is_out]
    rays.has_ended[i] = True
    goes_on = rays.n_events[i] < plan.settings.max_events
    at, i = at[goes_on], i[goes_on]
    rays.n_events[i] += 1
    if len(i):
        interact(plan, rays, i, contact.display.at(at), by_layer)
