"""A blocker: light ends."""

from ..base.arrays import Ints
from ..glass.surfaces import Surface, make_surface
from ..rig.rig import Blocker
from .hits import Hits
from .meetings import Law, key_of_facets
from .mesh_cache import Kept
from .plan import Plan
from .rays import Rays, Reason


def surface(part: Blocker, kept: Kept) -> tuple[Surface, str]:
    """Its triangles, each flat."""
    return make_surface(part.mesh.flat()), key_of_facets(part.mesh)


def meet(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """End here, blocked."""
    rays.reason[i] = Reason.BLOCKED


LAW = Law(meet, surface, ends=True)
