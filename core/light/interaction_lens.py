"""A thin lens: each slope changes by the distance from the axis over the focal length."""

from typing import NamedTuple

import numpy as np

from ..base.arrays import Floats, Ints
from ..base.vectors import dot, normalise
from ..rig.rig import Lens
from .hits import Hits
from .interaction_plate import flat_surface
from .meetings import Interaction
from .plan import Plan
from .rays import PASS, Rays


class LensFrame(NamedTuple):
    """A lens in place: centre (3,) m, and focal length, m."""

    centre: Floats
    focal_length: float


def lens_frame(lens: Lens) -> LensFrame:
    """The frame of a lens, centred at the centroid of its outline."""
    a, b, c = np.moveaxis(lens.mesh.corners, 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    centre = area @ lens.mesh.corners.mean(axis=1) / area.sum()
    return LensFrame(centre, lens.focal_length)


def interact(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """Bend the rays by the paraxial law, which is the same from both sides."""
    normals = plan.triangles.normals[hits.triangle]
    for lens, some in plan.part_of(hits.triangle):
        these, normal = i[some], normals[some]
        directions = rays.directions[these]
        slopes = directions / np.abs(dot(directions, normal))[:, None]
        away = rays.positions[these] - lens.centre
        away -= dot(away, normal)[:, None] * normal
        out = normalise(slopes - away / lens.focal_length)
        if plan.is_polarised:
            rays.pass_on(these, rays.passed(these, out, 1.0, 1.0))
        rays.directions[these] = out
    rays.add_to_branch(i, plan.triangles.patch[hits.triangle], PASS)


INTERACTION = Interaction(interact, flat_surface, element=lambda lens, _: lens_frame(lens))
