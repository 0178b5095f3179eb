"""Light through glass whose shells overlap or cut themselves, by brute force: each ray meets every
triangle, in float64. Glass is where shells wind around a place once or more, as the faces tell that
the ray has entered and left.
"""

from typing import NamedTuple

import numpy as np

from kiriko.core.base.arrays import Bools, Floats, Ints
from kiriko.core.rig.rig import Mesh

from .closed_forms import snell, unit

MOST_FACES = 200  # that a ray may pass


class Walk(NamedTuple):
    """Rays (k,) after the glass.

    places, directions : (k, 3)
    n_events : (k,) surfaces of the glass met
    is_deep, is_inside_out : (k,) it was where shells wind around it twice or more, and less than
        never
    """

    places: Floats
    directions: Floats
    n_events: Ints
    is_deep: Bools
    is_inside_out: Bools


def through_union(o: Floats, d: Floats, mesh: Mesh, n: float, most_events: int) -> Walk:
    """Follow rays (k, 3) that start in air through facets, which refract by their own normals."""
    corner = mesh.corners[:, 0]
    along, up = (mesh.corners[:, i] - corner for i in (1, 2))
    normal = unit(np.cross(along, up))
    o, d = o.copy(), d.copy()
    depth, n_events = np.zeros((2, len(o)), np.int64)
    is_deep, is_inside_out = np.zeros((2, len(o)), bool)
    last = np.full(len(o), -1)
    live = np.arange(len(o))

    for _ in range(MOST_FACES):
        # the nearest face but the last one (Moller & Trumbore 1997)
        across = np.cross(d[live, None], up)
        inverse = 1 / (along * across).sum(axis=2)
        away = o[live, None] - corner
        turned = np.cross(away, along)
        u, v = (away * across).sum(axis=2) * inverse, (d[live, None] * turned).sum(axis=2) * inverse
        t = (up * turned).sum(axis=2) * inverse
        is_met = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > -1e-14)
        is_met &= np.arange(len(corner)) != last[live, None]
        t[~is_met] = np.inf
        face = t.argmin(axis=1)
        t = t[np.arange(len(live)), face]
        goes_on = np.isfinite(t)
        live, face, t = live[goes_on], face[goes_on], t[goes_on]
        if not len(live):
            break

        o[live] += t[:, None] * d[live]
        last[live] = face
        enters = (d[live] * normal[face]).sum(axis=1) < 0
        bends = depth[live] == np.where(enters, 0, 1)
        before, after = (np.where(side, 1.0, n)[:, None] for side in (enters, ~enters))
        bent = snell(d[live], normal[face], before, after)
        is_tir = bends & np.isnan(bent[:, 0])
        mirrored = d[live] - 2 * (d[live] * normal[face]).sum(axis=1)[:, None] * normal[face]
        d[live] = np.where(is_tir[:, None], mirrored, np.where(bends[:, None], bent, d[live]))
        depth[live] += np.where(is_tir, 0, np.where(enters, 1, -1))
        is_deep[live] |= depth[live] > 1
        is_inside_out[live] |= depth[live] < 0
        n_events[live] += bends
        live = live[n_events[live] < most_events]
    return Walk(o, d, n_events, is_deep, is_inside_out)
