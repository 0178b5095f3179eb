"""A blocker: light ends."""

from ..base.arrays import Ints
from ..glass.surfaces import Surface, make_surface
from ..rig.rig import Blocker, Retroreflector
from .hits import Hits
from .meetings import Interaction, key_of_facets
from .mesh_cache import MeshCache
from .plan import Plan
from .rays import Rays, Reason


def surface(part: Blocker | Retroreflector, mesh_cache: MeshCache) -> tuple[Surface, str]:
    """Its triangles, each flat."""
    return make_surface(part.mesh.flat()), key_of_facets(part.mesh)


def interact(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """End the rays as blocked."""
    rays.reason[i] = Reason.BLOCKED


INTERACTION = Interaction(interact, surface, ends=True)
