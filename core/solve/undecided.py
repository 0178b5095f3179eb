"""Light that passes two solids so near each other that another mesh would send it elsewhere."""

import numpy as np

from ..base.arrays import Bools, Floats
from ..light.plan import Plan
from ..light.rays import Landings, Step
from ..rig.rig import Kind

NEAR_OF_GLASS = 1e-3  # of the glass's size


def undecided(
    plan: Plan,
    landings: tuple[Landings, Landings],
    origins: tuple[Floats, Floats],
    ways: tuple[list[Step], list[Step]],
) -> float:
    """Share of the light that arrives elsewhere by another
    degree, having passed near two solids on either way.
    """
    here, other = landings
    is_changed = other.branch != here.branch
    if not is_changed.any():
        return 0.0

    with np.errstate(invalid="ignore"):
        off = np.abs(other.xy - here.xy).max(axis=1)
        is_changed &= ~(other.has_arrived & (off <= plan.settings.tolerance))

    is_near = _passes_near(plan, origins[0], ways[0])[here.sample] | _passes_near(
        plan, origins[1], ways[1]
    )
    return float((is_changed & is_near).mean())


def _passes_near(plan: Plan, origins: Floats, steps: list[Step]) -> Bools:
    """Which rays (n,) meet two solids one after the other
    within NEAR_OF_GLASS of the glass's size of each other?
    """
    size = max(float(np.ptp(glass.mesh.bounds, axis=0).max()) for glass in plan.rig.glasses)
    last = origins.copy()
    solid = np.full(len(origins), -1)
    is_near = np.zeros(len(origins), bool)

    for step in steps:
        part = plan.triangles.part[step.patch]  # a patch has the number of one of its triangles
        part = np.where(plan.parts.kind[part] == Kind.GLASS, part, -1)
        is_other = (part >= 0) & (solid[step.rays] >= 0) & (part != solid[step.rays])
        is_near[step.rays] |= is_other & (
            np.linalg.norm(step.place - last[step.rays], axis=1) < NEAR_OF_GLASS * size
        )
        last[step.rays], solid[step.rays] = step.place, part

    return is_near
