"""A mirror: light is reflected, on both sides."""

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.vectors import normalise
from ..glass.surfaces import Surface, make_surface
from ..rig.rig import HalfMirror, Mirror
from .hits import Hits
from .meetings import Interaction, reflect_before, shading_normals
from .mesh_cache import MeshCache
from .plan import Plan
from .rays import FACE_MIRROR, MIRROR, Rays


def surface(part: Mirror | HalfMirror, mesh_cache: MeshCache) -> tuple[Surface, str]:
    """The surface, possibly curved, and its key."""
    key = part.mesh.fingerprint
    return mesh_cache.get(key, lambda: make_surface(part.mesh)), f"{key}/0"


def mirrored(plan: Plan, directions: Floats, hits: Hits) -> tuple[Floats, Bools]:
    """Reflected directions (n, 3), and where (n,) by the face's own normal."""
    geometric, shading, is_own = shading_normals(plan, directions, hits)
    out, wrong = reflect_before(directions, geometric, shading)
    return out, is_own | wrong


def interact(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """Reflect the rays."""
    out, is_own = mirrored(plan, rays.directions[i], hits)
    if plan.is_polarised:
        rays.pass_on(i, rays.passed(i, out, -1.0, 1.0))
    rays.directions[i] = normalise(out)
    event = np.where(is_own, FACE_MIRROR, MIRROR)
    rays.add_to_branch(i, plan.triangles.patch[hits.triangle], event)


INTERACTION = Interaction(interact, surface)
