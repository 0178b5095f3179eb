"""Glass: light is refracted, or totally reflected."""

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bools, Floats, Ints, take
from ..base.vectors import dot, normalise
from .hits import Hits
from .meetings import Interaction, reflect_before, shading_normals
from .optics import refract
from .plan import Plan
from .polarisation import Passed, reflection
from .rays import FACE_PASS, FACE_TIR, PASS, TIR, Rays


def interact(plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]) -> None:
    """Refract or totally reflect at an interface; coincident faces of other solids are crossed
    together.
    """
    part = plan.triangles.part[hits.triangle]
    before, after, patch = _cross_faces(plan, rays, i, hits, by_layer)

    # the media before and behind; equal indices do not bend light
    n1 = plan.media.index(part, before)
    n2 = plan.media.index(part, after)
    rays.has_met_glass[i] = True
    bends = n1 != n2
    if not bends.all():
        rays.mask[i[~bends]] = after[~bends]
        _enter(plan, rays, i[~bends], part[~bends], after[~bends])
        i, n1, n2, before, after, patch, part = (
            x[bends] for x in (i, n1, n2, before, after, patch, part)
        )
        hits = hits.at(bends)

    if not len(i):
        return

    directions = take(rays.directions, i)
    geometric, shading, is_own = shading_normals(plan, directions, hits)
    out, is_tir, transmittance = refract(directions, shading, n1, n2)

    # a bent normal can send light to the wrong side of the face: use the face's own normal, at the
    # cost of a discontinuity
    wrong = (dot(out, geometric) > 0) != is_tir
    if wrong.any():
        again = refract(directions[wrong], geometric[wrong], n1[wrong], n2[wrong])
        out[wrong], is_tir[wrong], transmittance[wrong] = again
        is_own[wrong] = True

    transmitted, reflected = Passed(transmittance), Passed(1 - transmittance)
    if plan.is_polarised:
        normals = np.where(wrong[:, None], geometric, shading)
        transmitted, reflected = _polarise(rays, i, normals, (n1, n2), is_tir)

    for glass, some in plan.part_of(hits.triangle) if plan.n_copies else ():
        some = some[~is_tir[some]]
        if not (glass.splits and len(some)):
            continue
        light = reflected.at(some), transmitted.at(some)
        splits, copies = rays.branch_off(i[some], *light, glass.prefers)
        at = some[splits]
        mirrored, wrong = reflect_before(directions[at], geometric[at], shading[at])
        rays.directions[copies] = normalise(mirrored)
        rays.last_part[copies] = part[at]
        rays.mask[copies] = before[at]
        rays.add_to_branch(copies, patch[at], np.where(is_own[at] | wrong, FACE_TIR, TIR))
        transmitted.share[some] = 1.0  # it counts already

    if plan.settings.brightness or plan.is_polarised:
        rays.pass_on(i, transmitted)
    rays.directions[i] = normalise(out)
    # a reflected ray may hit a coincident thin surface again, but not glass faces behind it
    rays.last_part[i[is_tir]] = part[is_tir]
    rays.mask[i] = np.where(is_tir, before, after)
    _enter(plan, rays, i, part, rays.mask[i])

    event = np.where(is_own, np.where(is_tir, FACE_TIR, FACE_PASS), np.where(is_tir, TIR, PASS))
    rays.add_to_branch(i, patch, event)


def _enter(plan: Plan, rays: Rays, i: Ints, part: Ints, mask: NDArray[np.uint64]) -> None:
    """Continue rays (n,) in the media of masks (n,), which absorb light."""
    if plan.media.absorptions is not None:
        rays.absorption[i] = plan.media.absorption(part, mask)


def _polarise(
    rays: Rays, i: Ints, normals: Floats, indices: tuple[Floats, Floats], is_tir: Bools
) -> tuple[Passed, Passed]:
    """Light that goes on, and reflected light, of polarised rays; all is reflected if `is_tir`."""
    reflected = reflection(rays.directions[i], normals, *indices)
    # the rest passes, without a change of phase
    passed = (np.where(is_tir, r, np.sqrt(np.maximum(1 - np.abs(r) ** 2, 0))) for r in reflected)
    return rays.passed(i, normals, *passed), rays.passed(i, normals, *reflected)


def _cross_faces(
    plan: Plan, rays: Rays, i: Ints, hits: Hits, by_layer: list[Hits]
) -> tuple[NDArray[np.uint64], NDArray[np.uint64], Ints]:
    """Cross all coincident faces together: masks (n,) before and after, and the patch (n,) recorded
    in the branch.

    The patch is the smallest number, because a choice by rounding would give neighbouring rays
    different branches.
    """
    # a ray inside one cluster meets no other, unless curved faces extend beyond their facets'
    # boxes, or through gaps
    parts = plan.parts
    part = plan.triangles.part[hits.triangle]
    cluster = parts.cluster[part]
    before = np.where(rays.cluster[i] == cluster, rays.mask[i], np.uint64(0))
    rays.cluster[i] = cluster

    after = before ^ parts.bit[part]
    patch = plan.triangles.patch[hits.triangle]
    for other in by_layer:
        their_part = plan.triangles.part[other.triangle]
        same_place = (other.triangle >= 0) & (other.triangle != hits.triangle)
        # a mask belongs to one cluster
        same_place &= parts.cluster[their_part] == cluster
        same_place &= hits.gap(other) <= plan.merge_distance
        after[same_place] ^= parts.bit[their_part[same_place]]
        theirs = plan.triangles.patch[other.triangle[same_place]]
        patch[same_place] = np.minimum(patch[same_place], theirs)

    return before, after, patch


INTERACTION = Interaction(interact, None, crosses=True)
