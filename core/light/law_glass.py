"""Glass: light is refracted, or mirrored by total reflection."""

import numpy as np

from ..arrays import Ints
from ..vectors import dot, normalise
from .hits import Hits
from .meetings import Law, shading_normals
from .optics import refract
from .plan import Plan
from .rays import PASS, TIR, Rays


def meet(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """Cross or mirror at an interface.

    Faces of other solids at the same place are crossed together with it.
    """
    part = plan.part[hits.triangle]

    # a ray inside one cluster meets no other, but where curved faces
    # stand out of their facets' boxes, or out of gaps
    before = np.where(rays.cluster[i] == plan.cluster[part], rays.mask[i], np.uint64(0))
    rays.cluster[i] = plan.cluster[part]
    after = before ^ plan.bit[part]
    for other in by_layer:
        same_place = (other.triangle >= 0) & (other.triangle != hits.triangle)
        # a mask is of one cluster
        same_place &= plan.cluster[plan.part[other.triangle]] == plan.cluster[part]
        same_place &= np.abs(other.distance - hits.distance) <= plan.merge_distance
        after[same_place] ^= plan.bit[plan.part[other.triangle[same_place]]]

    # the media before and behind; between equal ones nothing bends
    n1 = plan.media.index(part, before)
    n2 = plan.media.index(part, after)
    rays.has_met_glass[i] = True
    bends = n1 != n2
    if not bends.all():
        rays.mask[i[~bends]] = after[~bends]
        i = i[bends]
        n1 = n1[bends]
        n2 = n2[bends]
        before = before[bends]
        after = after[bends]
        hits = hits.at(bends)
    if not len(i):
        return

    directions = rays.directions[i]
    geometric, shading = shading_normals(plan, directions, hits)
    out, is_tir, transmittance = refract(directions, shading, n1, n2)

    # a bent normal can send light to the wrong side of the face
    # it met: there the face's own normal is used
    wrong = (dot(out, geometric) > 0) != is_tir
    if wrong.any():
        again = refract(directions[wrong], geometric[wrong], n1[wrong], n2[wrong])
        out[wrong], is_tir[wrong], transmittance[wrong] = again

    rays.directions[i] = normalise(out)
    # a ray turned back may meet a sheet at this place again, but
    # not other faces of the glass that are behind it
    rays.last_part[i[is_tir]] = plan.part[hits.triangle[is_tir]]
    rays.mask[i] = np.where(is_tir, before, after)
    if plan.settings.brightness:
        rays.throughput[i] *= transmittance
    rays.add_to_branch(i, plan.patch[hits.triangle], np.where(is_tir, TIR, PASS))


LAW = Law(meet, None)
