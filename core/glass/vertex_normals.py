"""Normals of a smooth mesh found from its vertices, where it has only means of its
faces' normals.
"""

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats, taken
from ..base.products import solve_symmetric
from ..base.steps import Pauses
from ..base.vectors import dot, length_of, normalise
from ..native import loading
from .quartics import N_TERMS
from .vertex_fields import RIDGE, STIFFER, Fields, gradients, system, tangent_planes
from .vertices import Vertices, seen_across


@dataclass(frozen=True)
class NormalKnobs:
    """How normals are found from vertices, and which are believed (design.md, decision 3).

    Tuned by `dev.py irregular` on uneven, noisy, decimated and bevelled meshes: where vertices lie
    on the surface chords contradict found normals by 0.001 of the turn and less.

    Parameters
    ----------
    sweeps, settled : so many at most, an even number, and the change of normals at which they end
    restless : of the turn to a neighbour: normals that the last sweep changes by more do not settle
    moved : of the turn to a neighbour: found normals further from the mean have to prove themselves
    most_moved : of it: those further are refused
    straight : of it, by which chords to neighbours may contradict them; noise and rims make it more
    firm : of it, by which they may contradict those of stiffer fields, which settle anywhere: at
        0.1 they are twice as far off as the means on voxels, at 0.03 too few are found on hulls
        of random points
    gentle : rad, to a neighbour: what turns by more is not looked at again by stiffer fields, which
        leave out too much there: coarse balls, tori and ellipsoids get worse
    bulge : rad: edges that turn by less cannot bulge enough to matter
    jump : a curvature that grows this much from one edge to the next, across a vertex, ...
    shorter : ... on an edge this much shorter, means normals that belong to a bevel, not to the
        face beside it
    straight_on : cosine between edges of which one goes on as the other
    """

    sweeps: int = 40
    settled: float = 1e-10
    restless: float = 0.01
    moved: float = 0.2
    most_moved: float = 0.5
    straight: float = 0.1
    firm: float = 0.04
    gentle: float = 0.7
    bulge: float = np.radians(4)
    jump: float = 5.0
    shorter: float = 3.0
    straight_on: float = -0.7


NORMALS = NormalKnobs()


def finding_normals(v: Vertices, wanted: Bools, exact: Floats) -> Pauses[Floats]:
    """Normals (f, 3) of the surface through the vertices, where
    the given ones are only means of the faces around, by those that are exact, NaN elsewhere.

    The slope at a vertex follows from the heights and slopes of its neighbours (a compact scheme:
    fourth order from one ring). Slopes and neighbours' slopes are made to agree by sweeps, which at
    least halve the error. Where neighbours are uneven they may let it grow: slopes there are looked
    for once more, by stiffer fields, and those that were found before are held. At a rim, where the
    mean is that of the last faces alone, slopes follow from two rings of neighbours: third order.
    """
    is_held = ~np.isnan(exact[:, 0])
    is_left = wanted & ~is_held
    normal = np.where(is_held[:, None], exact, v.normal)
    across = seen_across(v)
    fields = tangent_planes(across)
    turn = _turns(v, v.normal)

    for ridge, straight in ((RIDGE, NORMALS.straight), (STIFFER, NORMALS.firm)):
        found = normal.copy()
        change = yield from _settling_normals(across, fields, ridge, is_left, found)
        yield 0
        is_near, is_straight = _are_near(v, fields.is_rim, turn, found, change, straight)
        if ridge is STIFFER:  # which settles near the mean whatever chords say
            is_near &= is_straight
        is_near |= is_held

        # normals are found together: one far from the mean is no
        # better than the worst of its neighbours
        is_refused = ~(is_near | is_straight)
        has_refused = np.bincount(v.start, is_refused[v.end], len(v.at)) > 0
        is_believed = is_near | (is_straight & ~has_refused)

        # where the mesh is too irregular to tell, the mean is the better guess
        normal = np.where(is_believed[:, None], found, v.normal)
        is_held |= wanted & is_believed
        is_left &= ~is_believed & (turn < NORMALS.gentle)
        if not is_left.any():
            break

    return normal


def _turns(v: Vertices, normal: Floats) -> Floats:
    """By how much, rad, normals (f, 3) turn to a neighbour's at most, per vertex (f,)."""
    turn = length_of(taken(normal, v.end) - taken(normal, v.start))
    return np.maximum.reduceat(turn, v.first[:-1])


def _are_near(
    v: Vertices, is_rim: Bools, turn: Floats, normal: Floats, change: Floats, straight: float
) -> tuple[Bools, Bools]:
    """Which normals (f, 3) that the last sweep changed by so much (f, 3) are near the means, and
    which chords do not contradict by more than a part of the turn.

    turn : (f,) rad, from a mean to its neighbours
    is_rim : (f,) those whose means are half a face away
    """
    turn = np.where(is_rim, _turns(v, normal), turn)
    with np.errstate(invalid="ignore"):
        moved = length_of(normal - v.normal)
        is_settled = length_of(change) <= NORMALS.restless * turn
        is_near = is_settled & (moved <= NORMALS.moved * turn)
        is_straight = is_settled & (_bend(v, normal) < straight * turn)
        is_straight &= moved <= (NORMALS.most_moved + is_rim / 2) * turn

    return is_near, is_straight


def _bend(v: Vertices, normal: Floats) -> Floats:
    """By how much chords to neighbours contradict the normals
    (f, 3) at their ends, per vertex (f,), rad rms.

    Of a parabola a chord has the mean of the slopes at its ends.
    """
    chord = normalise(taken(v.at, v.end) - taken(v.at, v.start))
    unlike = dot(taken(normal, v.end) + taken(normal, v.start), chord) / 2
    return np.sqrt(np.bincount(v.start, unlike**2, len(v.at)) / np.maximum(np.diff(v.first), 1))


def _settling_normals(
    v: Vertices, fields: Fields, ridge: Floats, wanted: Bools, normal: Floats
) -> Pauses[Floats]:
    """Let the wanted ones of normals (f, 3) agree with those of their neighbours, with pauses.

    Returns by how much the last sweep changed each (f, 3).
    """
    if loading.library() is not None:
        fit = fields.fit_of(v)
        return (
            yield from fit.settling_normals(wanted, ridge, normal, NORMALS.sweeps, NORMALS.settled)
        )

    before = normal
    solvers = []
    for some, pairs in v.by_valence(wanted):
        rows, weights, matrix, z = system(v, fields, some, pairs, ridge)
        weighted = rows * weights[..., None]

        slope = np.zeros((len(some), N_TERMS, 2))
        slope[:, [0, 1], [0, 1]] = 1.0

        # rows of the pseudo-inverse that give the slope; the matrix is symmetric
        inverse = np.matmul(weighted, solve_symmetric(matrix, slope))

        m = pairs.shape[1]
        solvers.append((some, pairs, np.einsum("nrk,nr->nk", inverse[:, :m], z), inverse[:, m:]))
        yield 0

    for _ in range(NORMALS.sweeps):
        change = 0.0
        before = normal.copy()

        for some, pairs, from_heights, from_slopes in solvers:
            theirs = np.concatenate(gradients(v, fields, some, pairs, before), axis=1)
            slope = from_heights + np.einsum("nrk,nr->nk", from_slopes, theirs)
            found = (
                v.normal[some]
                - slope[:, :1] * fields.axis_x[some]
                - slope[:, 1:] * fields.axis_y[some]
            )
            found = normalise(found)
            change = max(change, float(np.abs(found - before[some]).max(initial=0.0)))
            normal[some] = found
            yield 0

        if change < NORMALS.settled:
            break

    return normal - before


def contradicted(v: Vertices, normal: Floats, wanted: Bools) -> Bools:
    """Pairs (p,) along which the normals turn as those of a bevel do, on the large face beside it.

    Curvature changes little from one edge to the next one straight on. Where it jumps
    up on a much shorter edge, the normal between them belongs to that edge.
    """
    away = taken(v.at, v.end) - taken(v.at, v.start)
    length = length_of(away)
    direction = away / np.maximum(length, 1e-300)[:, None]
    turn = np.abs(dot(taken(normal, v.end) - taken(normal, v.start), direction))

    is_bad = np.zeros(len(v.start), bool)
    suspect = wanted & (np.bincount(v.start, turn > NORMALS.bulge, len(v.at)) > 0)
    for _, pairs in v.by_valence(suspect):
        facing = np.einsum("nic,njc->nij", direction[pairs], direction[pairs])
        on = np.take_along_axis(pairs, facing.argmin(axis=2), axis=1)  # the pair straight on
        is_bad[pairs] = (
            (facing.min(axis=2) < NORMALS.straight_on)
            & (turn[pairs] > NORMALS.bulge)
            & (length[pairs] > NORMALS.shorter * length[on])
            & (turn[on] * length[pairs] > NORMALS.jump * turn[pairs] * length[on])
        )

    return is_bad
