"""Rays that meet a part of the rig, and how they go on."""

import numpy as np

from ..arrays import Bools, Floats, Ints
from ..glass.curved import EDGE
from ..glass.meshes import interpolate
from ..kinds import Kind
from ..products import turn
from ..vectors import dot, normalise
from .hits import Hits
from .landings import Reason
from .optics import plane_symmetry, reflect, refract
from .plan import Plan
from .plate import ArrayFrame, PlatePath
from .rays import LAND, MIRROR, PASS, PLATE, TIR, Rays


def on_plane(plan: Plan, rays: Rays, i: Ints) -> tuple[Floats, Floats, Bools]:
    """Where rays meet the plane of a flat display: display px
    (n, 2), distance (n,) m, and do they meet its front?
    """
    plane = plan.display_plane
    slope = dot(rays.directions[i], plane.normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = dot(plane.corner - rays.positions[i], plane.normal) / slope
        at = rays.positions[i] + t[:, None] * rays.directions[i] - plane.corner
        xy = turn(plane.pixels, at) + plane.origin
    return xy, t, (slope < 0) & (t > 0)


def _is_on_image(plan: Plan, xy: Floats) -> Bools:
    """Are display pixels (n, 2) within the image, or on its edge but for rounding?"""
    size = np.array([plan.rig.display.width, plan.rig.display.height])
    return ((xy >= -EDGE * size) & (xy <= (1 + EDGE) * size)).all(axis=1)


def is_beside_glass(plan: Plan, rays: Rays, i: Ints) -> Bools:
    """Is this light that comes by way of the plate, beside the glass, and is it looked for?"""
    return (
        (rays.reason[i] == Reason.MISSED_GLASS) & rays.has_met_plate[i] & plan.settings.looks_beside
    )


def _land_beyond_plate(plan: Plan, rays: Rays, i: Ints) -> None:
    """End rays that have nothing before them but a flat display."""
    rays.has_ended[i] = True
    i = i[rays.n_events[i] < plan.settings.max_events]
    xy, t, is_front = on_plane(plan, rays, i)
    with np.errstate(invalid="ignore"):
        hits = (t > 0) & _is_on_image(plan, xy)
    rays.positions[i[hits]] += t[hits, None] * rays.directions[i[hits]]
    rays.n_events[i[hits]] += 1
    has_met_glass = rays.has_met_glass[i]
    counts = has_met_glass | (not plan.settings.only_through_glass)
    rays.reason[i] = np.select(
        [hits & ~counts, hits & ~is_front, hits, ~has_met_glass],
        [Reason.MISSED_GLASS, Reason.BLOCKED, Reason.ARRIVED, Reason.MISSED_GLASS],
        Reason.MISSED_DISPLAY,
    )
    lands = np.isin(rays.reason[i], (Reason.ARRIVED, Reason.MISSED_DISPLAY)) | is_beside_glass(
        plan, rays, i
    )
    lands &= is_front
    rays.xy[i[lands]] = xy[lands]
    rays.add_to_branch(i[lands], plan.patch[-1], LAND)


def _shading_normals(plan: Plan, directions: Floats, hits: Hits) -> tuple[Floats, Floats]:
    """Geometric and shading normals (n, 3), both turned against the ray."""
    geometric = plan.normals[hits.triangle]
    shading = geometric
    if hits.facing is not None:
        curved = np.flatnonzero(_is_set(hits.facing))
        geometric[curved] = normalise(hits.facing[curved])
    if hits.normal is not None:
        curved = np.flatnonzero(_is_set(hits.normal))
        shading = geometric.copy()
        shading[curved] = normalise(hits.normal[curved])
    if plan.corner_normals is not None:
        bent = np.flatnonzero(plan.is_bent[hits.triangle])
        corners = plan.corner_normals[hits.triangle[bent]]
        shading = geometric.copy() if shading is geometric else shading
        shading[bent] = normalise(interpolate(corners, hits.u[bent], hits.v[bent]))
    front = hits.enters[:, None]
    if shading is geometric:
        geometric = np.where(front, geometric, -geometric)
        return geometric, geometric
    geometric = np.where(front, geometric, -geometric)
    shading = np.where(front, shading, -shading)
    # where the shading normal looks away from the ray the face's own one is kept
    away = dot(directions, shading) >= 0
    shading[away] = geometric[away]
    return geometric, shading


def _is_set(vectors: Floats) -> Bools:
    x, y, z = vectors.T  # a reduction over rows of three is several times slower
    return (x != 0) | (y != 0) | (z != 0)


def _meet_glass(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """Cross or mirror at an interface.

    Faces of other solids at the same place are crossed together with it.
    """
    part = plan.part[hits.triangle]
    # a ray inside one cluster meets no other, but where curved faces
    # stand out of their facets' boxes, or out of gaps
    before = np.where(rays.cluster[i] == plan.cluster[part], rays.mask[i], np.uint64(0))
    rays.cluster[i] = plan.cluster[part]
    after = before ^ plan.bit[part]
    for other in by_layer:
        same_place = (other.triangle >= 0) & (other.triangle != hits.triangle)
        # a mask is of one cluster
        same_place &= plan.cluster[plan.part[other.triangle]] == plan.cluster[part]
        same_place &= np.abs(other.distance - hits.distance) <= plan.merge_distance
        after[same_place] ^= plan.bit[plan.part[other.triangle[same_place]]]
    n1 = plan.media.index(part, before)
    n2 = plan.media.index(part, after)
    rays.has_met_glass[i] = True
    bends = n1 != n2
    if not bends.all():
        rays.mask[i[~bends]] = after[~bends]
        i = i[bends]
        n1 = n1[bends]
        n2 = n2[bends]
        before = before[bends]
        after = after[bends]
        hits = hits.at(bends)
    if not len(i):
        return
    directions = rays.directions[i]
    geometric, shading = _shading_normals(plan, directions, hits)
    out, is_tir, transmittance = refract(directions, shading, n1, n2)
    # a bent normal can send light to the wrong side of the face
    # it met: there the face's own normal is used
    wrong = (dot(out, geometric) > 0) != is_tir
    if wrong.any():
        again = refract(directions[wrong], geometric[wrong], n1[wrong], n2[wrong])
        out[wrong], is_tir[wrong], transmittance[wrong] = again
    rays.directions[i] = normalise(out)
    # a ray turned back may meet a sheet at this place again, but
    # not other faces of the glass that are behind it
    rays.last_part[i[is_tir]] = plan.part[hits.triangle[is_tir]]
    rays.mask[i] = np.where(is_tir, before, after)
    if plan.settings.brightness:
        rays.throughput[i] *= transmittance
    rays.add_to_branch(i, plan.patch[hits.triangle], np.where(is_tir, TIR, PASS))


def _meet_plate(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    part = plan.part[hits.triangle]
    is_ideal = np.ones(len(i), bool)
    for number, array in plan.arrays.items():
        some = np.flatnonzero(part == number)
        if len(some):
            _meet_array(plan, array, rays, i[some])
            is_ideal[some] = False
    if is_ideal.any():
        ideal = i[is_ideal]
        rays.directions[ideal] = plane_symmetry(
            rays.directions[ideal], plan.normals[hits.triangle[is_ideal]]
        )
        rays.plate_path[ideal] = np.maximum(rays.plate_path[ideal], PlatePath.IMAGED)
    rays.has_met_plate[i] = True
    rays.add_to_branch(i, plan.patch[hits.triangle], PLATE)
    goes_along = (dot(rays.directions[i], plan.normals[hits.triangle]) > 0).astype(int)
    clear = plan.is_clear[part, goes_along]
    if clear.any():
        _land_beyond_plate(plan, rays, i[clear])


def _meet_array(plan: Plan, array: ArrayFrame, rays: Rays, i: Ints) -> None:
    is_again = rays.has_met_plate[i]
    again = "folded" if rays.light == "reflected" else rays.light
    for light, some in ((rays.light, i[~is_again]), (again, i[is_again])):
        if not len(some):
            continue
        crossing = getattr(array, light)(rays.positions[some], rays.directions[some])
        rays.positions[some] = crossing.positions
        rays.directions[some] = crossing.directions
        before = rays.plate_path[some]
        rays.plate_path[some] = np.where(before > PlatePath.IMAGED, before, crossing.path)
        if plan.settings.brightness:
            rays.throughput[some] *= crossing.throughput


def _meet_mirror(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    directions = rays.directions[i]
    geometric, shading = _shading_normals(plan, directions, hits)
    out = reflect(directions, shading)
    wrong = dot(out, geometric) < 0
    out[wrong] = reflect(directions[wrong], geometric[wrong])
    rays.directions[i] = normalise(out)
    rays.add_to_branch(i, plan.patch[hits.triangle], MIRROR)


def _meet_blocker(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    rays.reason[i] = Reason.BLOCKED


def _meet_display(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """End here: with a landing when the light came by glass and plate to the display's front.

    Light that carries no picture, but is followed to see all there is, may come past the plate.
    """
    is_front = dot(rays.directions[i], plan.normals[hits.triangle]) < 0
    counts = rays.has_met_glass[i] | (not plan.settings.only_through_glass)
    reason = np.select(
        [~counts, ~rays.has_met_plate[i] & (rays.light == "imaged"), ~is_front],
        [Reason.MISSED_GLASS, Reason.MISSED_PLATE, Reason.BLOCKED],
        Reason.ARRIVED,
    )
    rays.reason[i] = reason
    rays.add_to_branch(i, plan.patch[hits.triangle], LAND)
    u, v = interpolate(
        plan.rig.display.mesh.uv[hits.triangle - plan.display_start], hits.u, hits.v
    ).T
    xy = np.stack([u * plan.rig.display.width, (1 - v) * plan.rig.display.height], axis=1)
    lands = (reason == Reason.ARRIVED) | is_beside_glass(plan, rays, i) & is_front
    rays.xy[i] = np.where(lands[:, None], xy, np.nan)
    is_off = (reason == Reason.ARRIVED) & ~_is_on_image(plan, xy)  # the UV map leaves the image
    rays.reason[i[is_off]] = Reason.MISSED_DISPLAY


MEETINGS = {
    Kind.GLASS: _meet_glass,
    Kind.PLATE: _meet_plate,
    Kind.MIRROR: _meet_mirror,
    Kind.BLOCKER: _meet_blocker,
    Kind.DISPLAY: _meet_display,
}
