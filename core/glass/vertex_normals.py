"""Normals of a smooth mesh found from its vertices, where it has only means of its
faces' normals.
"""

import numpy as np

from .. import kernel
from ..arrays import Bools, Floats, taken
from ..products import solve_symmetric
from ..vectors import dot, length_of, normalise
from .quartics import N_TERMS
from .vertex_fields import RIDGE, Fields, gradients, system, tangent_planes
from .vertices import Vertices

# sweeps in which normals are found from vertices, and the change at which they end
SWEEPS = 40
SETTLED = 1e-10
# of the turn to a neighbour: found normals further from the mean have to prove themselves
MOVED = 0.2
MOST_MOVED = 0.5
# ... by chords to neighbours, which contradict them by no more of it; noise and rims make it more
STRAIGHT = 0.1

BULGE = np.radians(4)  # edges that turn by less cannot bulge enough to matter
JUMP = 5.0  # a curvature that grows this much from one edge to the next, across a vertex, ...
# ... on an edge this much shorter, means normals that belong to a bevel, not to the face beside it
SHORTER = 3.0


def find_normals(v: Vertices, wanted: Bools) -> Floats:
    """Normals (f, 3) of the surface through the vertices, where
    the given ones are only means of the faces around.

    The slope at a vertex follows from the heights and slopes of its neighbours (a compact scheme:
    fourth order from one ring). Slopes and neighbours' slopes are made to agree by sweeps, which at
    least halve the error.
    """
    normal = v.normal.copy()
    if kernel.library() is not None:
        kernel.Fit(v, tangent_planes(v)).settle_normals(wanted, RIDGE, normal, SWEEPS, SETTLED)
    else:
        _settle_normals(v, tangent_planes(v), wanted, normal)

    # where the mesh is too irregular to tell, the mean is the better guess
    turn = length_of(taken(v.normal, v.end) - taken(v.normal, v.start))
    with np.errstate(invalid="ignore"):
        turn = np.maximum.reduceat(turn, v.first[:-1])
        moved = length_of(normal - v.normal)
        is_near = moved <= MOVED * turn
        is_straight = (moved <= MOST_MOVED * turn) & (_bend(v, normal) < STRAIGHT * turn)

    # normals are found together: one far from the mean is no
    # better than the worst of its neighbours
    is_refused = ~(is_near | is_straight)
    has_refused = np.bincount(v.start, is_refused[v.end], len(v.at)) > 0
    is_believed = is_near | (is_straight & ~has_refused)
    return np.where(is_believed[:, None], normal, v.normal)


def _bend(v: Vertices, normal: Floats) -> Floats:
    """By how much chords to neighbours contradict the normals
    (f, 3) at their ends, per vertex (f,), rad rms.

    Of a parabola a chord has the mean of the slopes at its ends.
    """
    chord = normalise(taken(v.at, v.end) - taken(v.at, v.start))
    unlike = dot(taken(normal, v.end) + taken(normal, v.start), chord) / 2
    return np.sqrt(np.bincount(v.start, unlike**2, len(v.at)) / np.maximum(np.diff(v.first), 1))


def _settle_normals(v: Vertices, fields: Fields, wanted: Bools, normal: Floats) -> None:
    """Let the wanted ones of normals (f, 3) agree with those of their neighbours."""
    solvers = []
    for some, pairs in v.by_valence(wanted):
        rows, weights, matrix, z = system(v, fields, some, pairs, slice(None))
        weighted = rows * weights[..., None]
        slope = np.zeros((len(some), N_TERMS, 2))
        slope[:, [0, 1], [0, 1]] = 1.0
        # rows of the pseudo-inverse that give the slope; the matrix is symmetric
        inverse = np.matmul(weighted, solve_symmetric(matrix, slope))
        m = pairs.shape[1]
        solvers.append((some, pairs, np.einsum("nrk,nr->nk", inverse[:, :m], z), inverse[:, m:]))

    for _ in range(SWEEPS):
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
        if change < SETTLED:
            break


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
    suspect = wanted & (np.bincount(v.start, turn > BULGE, len(v.at)) > 0)
    for _, pairs in v.by_valence(suspect):
        facing = np.einsum("nic,njc->nij", direction[pairs], direction[pairs])
        on = np.take_along_axis(pairs, facing.argmin(axis=2), axis=1)  # the pair straight on
        is_bad[pairs] = (
            (facing.min(axis=2) < -0.7)
            & (turn[pairs] > BULGE)
            & (length[pairs] > SHORTER * length[on])
            & (turn[on] * length[pairs] > JUMP * turn[pairs] * length[on])
        )
    return is_bad
