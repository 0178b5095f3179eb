"""A retroreflector: light returns along its path."""

from ..base.arrays import Ints
from .hits import Hits
from .interaction_blocker import surface
from .meetings import Interaction
from .plan import Plan
from .rays import MIRROR, Rays


def interact(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """Reverse the rays, as ideal corner cubes do."""
    rays.directions[i] = -rays.directions[i]
    rays.add_to_branch(i, plan.triangles.patch[hits.triangle], MIRROR)


INTERACTION = Interaction(interact, surface)
