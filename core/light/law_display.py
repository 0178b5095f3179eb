"""The display: light that came by glass and plate has landed."""

from dataclasses import replace

import numpy as np

from ..arrays import Ints
from ..glass.meshes import interpolate
from ..glass.surfaces import Surface, make_surface
from ..rig import Display
from ..vectors import dot
from .display import uv_islands
from .hits import Hits
from .kept import Kept
from .landings import Reason
from .meetings import Law, is_beside_glass, is_on_image, key_of_facets
from .plan import Plan
from .rays import LAND, Rays


def surface(part: Display, kept: Kept) -> tuple[Surface, str]:
    """Its triangles, each flat; a patch for each piece of its UV map."""
    flat = replace(make_surface(part.mesh.flat()), patch=uv_islands(part.mesh))
    return flat, key_of_facets(part.mesh)


def meet(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """End here: with a landing when the light came by glass and plate to the display's front.

    Light that carries no picture, but is followed to see all there is, may come past the plate.
    """
    is_front = dot(rays.directions[i], plan.normals[hits.triangle]) < 0
    counts = rays.has_met_glass[i] | (not plan.settings.only_through_glass)
    reason = np.select(
        [~counts, ~rays.has_met_plate[i] & (rays.light == "imaged"), ~is_front],
        [Reason.MISSED_GLASS, Reason.MISSED_PLATE, Reason.BLOCKED],
        Reason.ARRIVED,
    )
    rays.reason[i] = reason
    rays.add_to_branch(i, plan.patch[hits.triangle], LAND)

    u, v = interpolate(
        plan.rig.display.mesh.uv[hits.triangle - plan.display_start], hits.u, hits.v
    ).T
    xy = np.stack([u * plan.rig.display.width, (1 - v) * plan.rig.display.height], axis=1)

    lands = (reason == Reason.ARRIVED) | is_beside_glass(plan, rays, i) & is_front
    rays.xy[i] = np.where(lands[:, None], xy, np.nan)

    is_off = (reason == Reason.ARRIVED) & ~is_on_image(plan, xy)  # the UV map leaves the image
    rays.reason[i[is_off]] = Reason.MISSED_DISPLAY


LAW = Law(meet, surface, ends=True)
