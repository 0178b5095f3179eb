"""Glass so coarse that its mesh does not tell which surface was meant.

There neither a fit nor the facets tell how far they are off. How far apart light lands by both is
known, and about as far as one of them is off.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats
from ..base.steps import Pauses
from ..light.compile_plan import planning
from ..light.plan import Counts, Plan
from ..light.rays import Landings, main_landings
from ..light.trace import tracing
from ..rig.rig import ROLES, Rig, SurfaceChoice

# share of a part's smooth faces: where more are left as drawn because they are coarse, it is, too
MOSTLY = 0.5


class Coarse(NamedTuple):
    """How far apart As Drawn and Smooth land light through a part that is too coarse to tell.

    part : among the rig's glasses, then mirrors; -1 for none
    error : display px rms, of the light that goes the same way by both
    elsewhere : share, 0..1, of the light that arrives by either and goes another way by the other,
        or nowhere
    """

    part: int = -1
    error: float = 0.0
    elsewhere: float = 0.0


def looking_for_coarse(
    plan: Plan, whole: Landings, rays: tuple[Floats, Floats], automatic: Plan | None
) -> Pauses[Coarse]:
    """The part that is too coarse to tell which surface was meant, where there is one.

    What Automatic leaves as drawn is compared with Smooth. Smooth is compared with Automatic, which
    alone tells, where normals jump.

    Parameters
    ----------
    whole : landings (n,) of rays, origins and directions (n, 3)
    automatic : the plan with the part whose normals jump followed by Automatic; None without one
    """
    part = coarsest(plan.counts)
    if part >= 0:
        other = yield from planning(followed(plan.rig, "smooth", part), plan.settings)
    elif automatic is not None:
        other = automatic
        part = coarsest(other.counts)
    if part < 0:
        return Coarse()

    found = yield from tracing(other.seen_by(plan.viewer), *rays)
    moved = main_landings(found, len(rays[0]), whole.branch)
    n_same = int(go_alike(whole, moved).sum())
    n_either = int((whole.has_arrived | moved.has_arrived).sum())
    elsewhere = 1 - n_same / n_either if n_either else 0.0
    return Coarse(part, difference(whole, moved), elsewhere)


def difference(one: Landings, other: Landings) -> float:
    """Distance of landings on the same branch, rms in display px; 0 where there are none."""
    same = go_alike(one, other)
    return (
        float(np.sqrt(((one.xy - other.xy)[same] ** 2).sum(axis=1).mean())) if same.any() else 0.0
    )


def go_alike(one: Landings, other: Landings) -> Bools:
    """Which landings arrive on the same branch."""
    return one.has_arrived & other.has_arrived & (one.branch == other.branch)


def coarsest(counts: Counts) -> int:
    """Which of a rig's glasses, then mirrors, is left as drawn most of all because it is coarse; -1
    where none is for the most part.
    """
    # asked for whenever progress is told: numpy takes longer for a few numbers
    of_parts = zip(counts.n_coarse, counts.n_doubted, counts.n_curved, strict=True)
    shares = [n_coarse / max(n_doubted + n_curved, 1) for n_coarse, n_doubted, n_curved in of_parts]
    return shares.index(max(shares)) if max(shares, default=0.0) > MOSTLY else -1


def is_mostly_drawn(counts: Counts, part: int) -> bool:
    """Is most of a part, by its number among the glasses, then mirrors, left as drawn?"""
    n_doubted = counts.n_doubted[part]
    return n_doubted > MOSTLY * (n_doubted + counts.n_curved[part])


def followed(rig: Rig, surface: SurfaceChoice, part: int | None = None) -> Rig:
    """A rig whose curved parts, or the one of that number, are followed by another choice."""
    chosen = rig.curved_parts() if part is None else rig.curved_parts()[part : part + 1]
    changed = {id(one): replace(one, mesh=replace(one.mesh, surface=surface)) for one in chosen}
    fields = {
        role.field: tuple(changed.get(id(one), one) for one in rig.of(role))
        for role in ROLES
        if role.is_curved
    }
    return replace(rig, **fields)
