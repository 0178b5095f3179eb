"""A half mirror: light is reflected in a copy of its ray, and passes straight through."""

import numpy as np

from ..base.arrays import Ints
from ..base.vectors import normalise
from .hits import Hits
from .interaction_mirror import mirrored, surface
from .meetings import Interaction
from .plan import Plan
from .polarisation import Passed
from .rays import FACE_MIRROR, MIRROR, PASS, Rays


def interact(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """Let the rays through, and reflect copies of them."""
    out, is_own = mirrored(plan, rays.directions[i], hits)
    patch = plan.triangles.patch[hits.triangle]
    for mirror, some in plan.part_of(hits.triangle):
        if plan.is_polarised:
            pairs = mirror.amplitudes
            reflected, transmitted = (rays.passed(i[some], out[some], *pair) for pair in pairs)
        else:
            shares = mirror.reflectance, mirror.transmittance
            reflected, transmitted = (Passed(np.full(len(some), share)) for share in shares)
        splits, copies = rays.branch_off(i[some], reflected, transmitted, mirror.prefers)
        at = some[splits]
        rays.directions[copies] = normalise(out[at])
        rays.add_to_branch(copies, patch[at], np.where(is_own[at], FACE_MIRROR, MIRROR))
    rays.add_to_branch(i, patch, PASS)


INTERACTION = Interaction(interact, surface)
