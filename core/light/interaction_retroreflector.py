"""A retroreflector: light returns along its path; in simulations with spread and shift."""

import numpy as np

from ..base.arrays import Floats, Ints
from ..base.vectors import dot, normalise
from ..rig.rig import Retroreflector
from .hits import Hits
from .interaction_blocker import surface
from .meetings import Interaction
from .plan import Plan
from .rays import MIRROR, Rays


def interact(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """Reverse the rays, and act on their polarisation as a mirror; simulated ones scatter."""
    if plan.is_polarised:
        rays.pass_on(i, rays.passed(i, -rays.directions[i], -1.0, 1.0))
    rays.directions[i] = -rays.directions[i]
    if rays.light != "imaged":
        normals = plan.triangles.normals[hits.triangle]
        for sheet, some in plan.part_of(hits.triangle):
            _scatter(sheet, rays, i[some], normals[some])
    rays.add_to_branch(i, plan.triangles.patch[hits.triangle], MIRROR)


def _scatter(sheet: Retroreflector, rays: Rays, i: Ints, normals: Floats) -> None:
    """Shift rays within their corner cubes, and spread their directions."""
    if sheet.pitch:
        right, up = _across(normals)
        for side in (right, up):
            at = dot(rays.positions[i], side) / sheet.pitch
            rays.positions[i] += (2 * (np.floor(at) + 0.5 - at) * sheet.pitch)[:, None] * side
    if sheet.spread:
        # a number from the ray's own place: the same in any batch
        angle, chance = (_random(rays.positions[i], salt) for salt in (1, 2))
        size = sheet.spread * np.sqrt(-2 * np.log1p(-chance))
        right, up = _across(rays.directions[i])
        x, y = size * np.cos(2 * np.pi * angle), size * np.sin(2 * np.pi * angle)
        rays.directions[i] = normalise(rays.directions[i] + x[:, None] * right + y[:, None] * up)


def _across(normals: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors (n, 3) across unit vectors (n, 3) and each other."""
    least = np.argmin(np.abs(normals), axis=1)
    right = normalise(np.cross(np.eye(3)[least], normals))
    return right, np.cross(normals, right)


def _random(places: Floats, salt: int) -> Floats:
    """Numbers (n,) from 0 to below 1 from the bits of places (n, 3), as by splitmix64."""
    state = np.full(len(places), salt, np.uint64)
    with np.errstate(over="ignore"):
        for column in np.ascontiguousarray(places).view(np.uint64).T:
            state = (state ^ column) + np.uint64(0x9E3779B97F4A7C15)
            state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            state ^= state >> np.uint64(31)
    return (state >> np.uint64(11)) * 2.0**-53


INTERACTION = Interaction(interact, surface)
