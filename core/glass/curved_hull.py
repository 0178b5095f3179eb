"""The mesh that a ray engine is asked about in the place of curved faces: it lies just in front.

A ray that meets a face, however close to a silhouette, meets this hull, too. It is the faces'
own points, lifted along the normals of the vertices by more than the faces stand out of the
chords between those points. Each face is cut into k^2 parts, as many as its turn needs.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import Bools, Floats
from ..products import combine
from ..steps import Pauses
from ..vectors import length_of
from .curved import HIGHER, CurvedFaces
from .quartics import N_TERMS, grid, monomials


@dataclass(frozen=True)
class HullKnobs:
    """How fine a hull is, tuned by `dev.py curved`: finer ones cost the engine more than they save.

    angle : rad, by less than this the hull turns from one part to the next
    most_parts : of an edge
    parts_at_edges : of an edge where some are straight: there hull and face are one, and the hull
        is no further in front than the faces are
    usual : share of the faces whose turn counts; those that turn further are few
    """

    angle: float = np.radians(3)
    most_parts: int = 8
    parts_at_edges: int = 4
    usual: float = 0.999


HULL = HullKnobs()
POINTS_AT_ONCE = 1 << 17  # on faces, that are worked on together: between two pauses


def count_parts(faces: CurvedFaces, angle: float, most: int) -> int:
    """Into how many parts edges have to be cut to turn by
    less than an angle (radians) each, but at most.
    """
    # offsets of the middles of edges from their chords
    corners = faces.corners[faces.triangle]
    at_middles = monomials(np.array([0.5, 0.5, 0.0]), np.array([0.0, 0.5, 0.5]))
    middles = combine(at_middles, faces.coefficient_table.reshape(N_TERMS, -1)).reshape(3, 3, -1)

    edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).T
    turn = 8 * np.linalg.norm(middles, axis=1) / edges  # of a parabola as high over its chord
    return int(np.clip(np.ceil(np.quantile(turn.max(axis=0), HULL.usual) / angle), 1, most))


def count_hull_parts(faces: CurvedFaces) -> int:
    """Into how many parts edges are cut in the hull."""
    least = HULL.parts_at_edges if faces.has_straight_edges else 1
    return max(count_parts(faces, HULL.angle, HULL.most_parts), least)


class Hull(NamedTuple):
    """Triangles (p k^2, 3, 3), m, that lie just in front of p faces: k^2 for each.

    Next to straight edges, which faces share with flat ones, they lie on the faces instead.
    """

    k: int
    corners: Floats


def making_hull(faces: CurvedFaces) -> Pauses[Hull]:
    """Make the hull of curved faces, with pauses."""
    k = count_hull_parts(faces)
    weights, parts = grid(k)
    points, sag = yield from _find_points(faces, k)

    # around each vertex all faces are lifted alike, or the hull would have gaps
    lift = np.zeros(len(faces.vertex_normal))
    np.maximum.at(lift, faces.vertex.ravel(), np.repeat(HIGHER * sag, 3))
    lifted = lift[:, None] * faces.vertex_normal

    # vertices and edges that are shared with flat faces stay
    on_edge = faces.neighbour < 0
    is_held = np.zeros(len(lift), bool)
    is_held[faces.vertex[on_edge]] = True
    is_held[np.roll(faces.vertex, -1, axis=1)[on_edge]] = True

    corners = np.empty((len(points), *parts.shape, 3))
    for some in _portions(len(points), len(weights)):
        raised = np.matmul(weights, lifted[faces.vertex[some]])
        _hold_edges(raised, weights, is_held[faces.vertex[some]], on_edge[some])
        corners[some] = (points[some] + raised)[:, parts]
        yield 0

    return Hull(k, corners.reshape(-1, 3, 3))


def _portions(n_faces: int, n_points: int) -> list[slice]:
    """Faces that are worked on together, of so many points each."""
    at_once = max(1, POINTS_AT_ONCE // n_points)
    return [slice(first, first + at_once) for first in range(0, n_faces, at_once)]


def _find_points(faces: CurvedFaces, k: int) -> Pauses[tuple[Floats, Floats]]:
    """Points (p, n, 3), m, of the faces at those of grid(k), and by how
    much (p,), m, faces stand out of the chords between these at most.
    """
    weights, parts = grid(k)
    fine = grid(2 * k)[0]
    terms = monomials(fine[:, 1], fine[:, 2])
    number = {tuple(steps): i for i, steps in enumerate(np.round(2 * k * fine).astype(int))}

    def among_fine(points: Floats) -> list[int]:
        return [number[tuple(steps)] for steps in np.round(2 * k * points).astype(int)]

    # both ends and the middle of each chord, among the points of the finer grid
    coarse = among_fine(weights)
    ends = [(weights[parts[:, e]], weights[parts[:, (e + 1) % 3]]) for e in range(3)]
    chords = [(among_fine(a), among_fine((a + b) / 2), among_fine(b)) for a, b in ends]

    triangle = faces.triangle
    points = np.empty((len(triangle), len(weights), 3))
    sag = np.zeros(len(triangle))

    for some in _portions(len(triangle), len(fine)):
        at = np.matmul(terms, faces.coefficients[some])
        for i, m, j in chords:
            missed = length_of(at[:, m] - (at[:, i] + at[:, j]) / 2).max(axis=1)
            sag[some] = np.maximum(sag[some], missed)
        points[some] = np.matmul(weights, faces.corners[triangle[some]]) + at[:, coarse]
        yield 0

    return points, sag


def _hold_edges(raised: Floats, weights: Floats, is_held: Bools, on_edge: Bools) -> None:
    """Take back how far points (n, m, 3) are raised at held corners and edges (n, 3)."""
    for corner in range(3):
        raised[is_held[:, corner], weights[:, corner].argmax()] = 0.0
        # the edge that begins at this corner, where the weight of the one after the next is 0
        along = weights[:, (corner + 2) % 3] == 0
        raised[np.ix_(on_edge[:, corner], along)] = 0.0
