"""Interactions of light with parts of the rig: their interface, and functions shared by several."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints, take
from ..base.fingerprint import fingerprint
from ..base.vectors import dot, normalise
from ..glass.meshes import interpolate
from ..glass.surfaces import Surface
from ..rig.rig import Mesh
from .hits import Hits
from .mesh_cache import MeshCache
from .optics import reflect
from .plan import Plan
from .rays import Rays


class Interaction(NamedTuple):
    """The effect of a kind of part on light, defined in its file `interaction_<role>.py`.

    interact : updates rays that hit such a part; arguments: the plan, the rays, the numbers of the
        rays, their hits, and the hits of each layer at the same rays
    surface : the surface of a part, and its key, from the part and a cache; None for solids, whose
        surfaces are found together
    ends : no ray continues from it
    crosses : coincident faces of other layers are handled together; otherwise no hits of layers are
        passed
    element : a part with the data computed once for a plan, as `plan.part_of` passes it to
        `interact`; from the part and its surface
    """

    interact: Callable[[Plan, Rays, Ints, Hits, list[Hits]], None]
    surface: Callable[[Any, MeshCache], tuple[Surface, str]] | None
    ends: bool = False
    crosses: bool = False
    element: Callable[[Any, Surface], Any] = lambda part, surface: part


def key_of_facets(mesh: Mesh) -> str:
    """A key for the surface of a mesh whose triangles are all flat, regardless of its shading."""
    return f"{fingerprint(mesh.flat())}/0"


def shading_normals(plan: Plan, directions: Floats, hits: Hits) -> tuple[Floats, Floats, Bools]:
    """Geometric and shading normals (n, 3), both against the ray, and where (n,) the face's own
    normal replaces a bent one facing away.
    """
    # of curved faces
    geometric = take(plan.triangles.normals, hits.triangle)
    shading = geometric

    if hits.facing is not None:
        curved = np.flatnonzero(_is_set(hits.facing))
        geometric[curved] = normalise(take(hits.facing, curved))

    if hits.normal is not None:
        curved = np.flatnonzero(_is_set(hits.normal))
        shading = geometric.copy()
        shading[curved] = normalise(take(hits.normal, curved))

    if plan.triangles.corner_normals is not None:
        bent = np.flatnonzero(plan.triangles.is_bent[hits.triangle])
        corners = plan.triangles.corner_normals[hits.triangle[bent]]
        shading = geometric.copy() if shading is geometric else shading
        shading[bent] = normalise(interpolate(corners, hits.u[bent], hits.v[bent]))

    front = hits.enters[:, None]
    if shading is geometric:
        geometric = np.where(front, geometric, -geometric)
        return geometric, geometric, np.zeros(len(geometric), bool)

    geometric = np.where(front, geometric, -geometric)
    shading = np.where(front, shading, -shading)

    away = dot(directions, shading) >= 0
    shading[away] = geometric[away]
    return geometric, shading, away


def reflect_before(directions: Floats, geometric: Floats, shading: Floats) -> tuple[Floats, Bools]:
    """Reflected directions (n, 3), and where (n,) by the face's own normal, because a bent one
    would send light through.
    """
    out = reflect(directions, shading)
    wrong = dot(out, geometric) < 0
    out[wrong] = reflect(directions[wrong], geometric[wrong])
    return out, wrong


def _is_set(vectors: Floats) -> Bools:
    x, y, z = vectors.T  # a reduction over rows of three is several times slower
    return (x != 0) | (y != 0) | (z != 0)
