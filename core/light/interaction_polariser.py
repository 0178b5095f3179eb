"""A polariser: absorbs the light that is polarised along its absorbing axis, as a sheet does.

The axis projected across the ray absorbs, which is the law of tilted sheet polarisers (Korger et
al. 2013, doi 10.1364/OE.21.027032).
"""

from typing import NamedTuple

import numpy as np

from ..base.arrays import Floats, Ints
from ..glass.surfaces import Surface
from ..rig.parts import Film
from .hits import Hits
from .interaction_plate import flat_surface
from .meetings import Interaction
from .plan import Plan
from .polarisation import axes_of
from .rays import PASS, Rays


class PlacedFilm(NamedTuple):
    """A thin polarising part in place.

    axis : (3,) unit, in its plane: a polariser's absorbing, a wave plate's fast axis
    over, along : complex amplitudes of light polarised perpendicular to the axis, and along it
    """

    axis: Floats
    over: complex
    along: complex


def placed_film(film: Film, surface: Surface) -> PlacedFilm:
    """The extraordinary axis and the amplitudes of a part."""
    axes = axes_of(film.mesh, surface.normals, film.angle + film.crossed)
    return PlacedFilm(axes[0], *film.amplitudes)


def interact(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """Let the rays through, each polarisation with its amplitude."""
    for one, some in plan.part_of(hits.triangle):
        axis = np.broadcast_to(one.axis, (len(some), 3))
        rays.pass_on(i[some], rays.passed(i[some], axis, one.over, one.along))
    rays.add_to_branch(i, plan.triangles.patch[hits.triangle], PASS)


INTERACTION = Interaction(interact, flat_surface, element=placed_film)
