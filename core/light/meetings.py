"""A meeting of rays with a part of the rig: its form, and the questions that several laws ask."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Bools, Floats, Ints
from ..fingerprint import fingerprint
from ..glass.curved import EDGE
from ..glass.meshes import interpolate
from ..glass.surfaces import Surface
from ..products import turn
from ..rig import Mesh
from ..vectors import dot, normalise
from .hits import Hits
from .kept import Kept
from .landings import Reason
from .plan import Plan
from .rays import Rays


class Law(NamedTuple):
    """The effect of a kind of part on light, as its file `law_<role>.py` has it.

    meet : takes the plan, the rays, the numbers of those that meet such a part, their hits, and the
        hits of each layer at the same rays; says how these rays go on
    surface : the surface of a part, and its key; takes the part, and surfaces kept from before.
        None for solids, whose surfaces are found together
    ends : does no ray go on from it?
    """

    meet: Callable[[Plan, Rays, Ints, Hits, list[Hits]], None]
    surface: Callable[[Any, Kept], tuple[Surface, str]] | None
    ends: bool = False


def key_of_facets(mesh: Mesh) -> str:
    """A key for the surface of a mesh that is flat, whatever its shading."""
    return f"{fingerprint(mesh.flat())}/0"


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


def is_on_image(plan: Plan, xy: Floats) -> Bools:
    """Are display pixels (n, 2) within the image, or on its edge but for rounding?"""
    size = np.array([plan.rig.display.width, plan.rig.display.height])
    return ((xy >= -EDGE * size) & (xy <= (1 + EDGE) * size)).all(axis=1)


def is_beside_glass(plan: Plan, rays: Rays, i: Ints) -> Bools:
    """Is this light that comes by way of the plate, beside the glass, and is it looked for?"""
    return (
        (rays.reason[i] == Reason.MISSED_GLASS) & rays.has_met_plate[i] & plan.settings.looks_beside
    )


def shading_normals(plan: Plan, directions: Floats, hits: Hits) -> tuple[Floats, Floats]:
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
