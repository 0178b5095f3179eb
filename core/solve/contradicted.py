"""Which light meets normals that contradict their face, so that renderers bend it another way?"""

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.vectors import dot, length_of, normalise
from ..glass.meshes import interpolate
from ..light.optics import reflect
from ..light.plan import Plan
from ..light.ray_engine import Layer
from ..light.trace import Step

# Cycles turns a normal until light mirrored at it leaves the face at this cosine, or at so much of
# that at which it came (`ensure_valid_specular_reflection` in its bsdf_util.h)
FLATTEST = 0.01
FLATTEST_OF_COMING = 0.9
BENT = 1e-6  # light that turns by less has met a face between two equal media


def find_contradicted(plan: Plan, origins: Floats, steps: list[Step]) -> Ints:
    """For each ray (n,) the first object, among the rig's glasses, then mirrors,
    that bends it by a normal which contradicts its flat face; -1 for none.

    A normal contradicts its face, for this light, where it looks away from the light, or light
    mirrored at it would go into the face, or nearly so: there Cycles and others take another one.
    Curved faces are left out.

    Parameters
    ----------
    origins : (n, 3) m, world
    steps : as `tracing` gives them
    """
    found = np.full(len(origins), -1)
    if not plan.triangles.is_bent.any():
        return found

    held_places = [(held, held.places(len(plan.triangles))) for held in plan.layers]
    last = origins.copy()
    came = np.zeros_like(origins)
    asked = found.copy()

    def go_on(rays: Ints, directions: Floats) -> None:
        """Was light bent where it was asked?"""
        has_turned = length_of(directions - came[rays]) > BENT
        some = rays[has_turned & (asked[rays] >= 0) & (found[rays] < 0)]
        found[some] = asked[some]

    for step in steps:
        way = step.place - last[step.rays]
        moves = length_of(way) > 0
        rays, triangle, place = step.rays[moves], step.triangle[moves], step.place[moves]
        directions = normalise(way[moves])
        go_on(rays, directions)
        go_on(step.left, step.direction)

        owner = plan.parts.owner[plan.triangles.part[triangle]]
        is_bent = plan.triangles.is_bent[triangle]
        is_odd = np.zeros(len(triangle), bool)
        for held, places in held_places:
            some = np.flatnonzero(is_bent & (places[triangle] >= 0))
            number = triangle[some]
            is_odd[some] = _contradicts(
                plan, held.layer, number, places[number], place[some], directions[some]
            )
        asked[rays] = np.where(is_odd, owner, -1)
        last[rays], came[rays] = place, directions

    return found


def _contradicts(
    plan: Plan, layer: Layer, triangle: Ints, number: Ints, place: Floats, directions: Floats
) -> Bools:
    """Are normals at places (n, 3) of bent triangles (n,) such for light with directions (n, 3)?

    number : (n,) the layer's own, of the triangles
    """
    at = place if layer.motion is None else layer.motion.back(place, directions)[0]
    u, v = layer.frames.barycentric(number, at)
    shading = normalise(interpolate(plan.triangles.corner_normals[triangle], u, v))
    geometric = plan.triangles.normals[triangle]

    came = dot(directions, geometric)
    back = np.where(came < 0, 1.0, -1.0)  # times a normal: the side the light came from
    leaves = back * dot(reflect(directions, shading), geometric)
    looks_away = back * dot(directions, shading) >= 0
    is_flat = leaves < np.minimum(FLATTEST_OF_COMING * np.abs(came), FLATTEST)
    return looks_away | is_flat
