"""The display: light that came by the glass, and by a plate where one is needed, has landed."""

from dataclasses import replace

import numpy as np

from ..base.arrays import Ints
from ..base.vectors import dot
from ..glass.meshes import interpolate
from ..glass.surfaces import Surface, make_surface
from ..rig.rig import Display
from .display import uv_islands
from .endings import give_reasons, is_on_image, land
from .hits import Hits
from .meetings import Law, key_of_facets
from .mesh_cache import Kept
from .plan import Plan
from .rays import LAND, Rays


def surface(part: Display, kept: Kept) -> tuple[Surface, str]:
    """Its triangles, each flat; a patch for each piece of its UV map."""

    def make() -> Surface:
        return replace(make_surface(part.mesh.flat()), patch=uv_islands(part.mesh))

    key = key_of_facets(part.mesh)
    return kept.get(f"display {key}", make), key


def meet(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """End here: with a landing when the light came the way that it has to, to the display's front.

    Light that carries no picture, but is followed to see all there is, may come past the plate.
    """
    display = plan.rig.display
    uv = display.mesh.uv[hits.triangle - plan.display.start]
    place = display.place(interpolate(uv, hits.u, hits.v))

    is_front = dot(rays.directions[i], plan.triangles.normals[hits.triangle]) < 0
    is_met = np.ones(len(i), bool)
    lands = give_reasons(plan, rays, i, is_met, is_front, is_on=is_on_image(plan, place)) & is_front
    rays.add_to_branch(i, plan.triangles.patch[hits.triangle], LAND)
    land(plan, rays, i[lands], place[lands])


LAW = Law(meet, surface, ends=True)
