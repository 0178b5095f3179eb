"""Bounding shell of curved faces: a mesh just in front of them, for the ray engine to trace.

Any ray through a face, however close to a silhouette, also hits this shell. It is made of points on
the faces, lifted along the vertex normals by more than the faces bulge out of the chords between
the points. Faces are split as finely as their turn requires.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bools, Floats, Ints, take
from ..base.products import combine
from ..base.steps import Steps
from ..base.vectors import dot, length_of
from .curved import HIGHER, CurvedFaces
from .quartics import N_TERMS, monomials


@dataclass(frozen=True)
class ShellOptions:
    """Fineness of the shell, tuned for time: a finer one costs the engine more than it saves.

    angle : rad: largest turn of the shell from one part to the next
    uneven : weight of an edge's offset along itself, against one to the side, in its turn: Newton's
        method needs a near start there, too
    halvings : of an edge, at most
    halvings_at_edges : at least, for edges of faces with a straight edge or a corner on one: shell
        and face coincide there
    """

    angle: float = np.radians(3)
    uneven: float = 0.5
    halvings: int = 3
    halvings_at_edges: int = 2


SHELL = ShellOptions()
PARTS_AT_ONCE = 1 << 14  # between two pauses
UNITS = 2**SHELL.halvings  # length of an edge, in units of places

CORNERS = UNITS * np.array([[0, 0], [1, 0], [0, 1]])  # places of a face's corners

# terms at all places, and half-way between them
_AT = np.stack(np.meshgrid(*2 * [np.arange(2 * UNITS + 1)], indexing="ij"), axis=-1)
_TERMS = monomials(*np.moveaxis(_AT / (2 * UNITS), -1, 0))


class BoundingShell(NamedTuple):
    """Triangles (p, 3, 3), m, just in front of curved faces.

    triangle (p,): triangle of the face behind each; places (p, 3, 2): u, v of the corners on it.
    Next to straight edges, shared with flat faces, they lie on the faces themselves.
    """

    corners: Floats
    triangle: Ints
    places: NDArray[np.float32]


def edge_turns(faces: CurvedFaces) -> Floats:
    """Turn (p, 3), rad, of the edges."""
    return _edges_of(faces)[0]


def _edges_of(faces: CurvedFaces) -> tuple[Floats, Floats]:
    """Turn (p, 3), rad, and sideways bulge (p, 3), m, of the edges."""
    at_middles = monomials(np.array([0.5, 0.5, 0.0]), np.array([0.0, 0.5, 0.5]))
    middles = combine(at_middles, faces.coefficient_table.reshape(N_TERMS, -1))
    middles = np.ascontiguousarray(middles.reshape(3, 3, -1).transpose(2, 0, 1))
    corners = take(faces.corners, faces.triangle)
    chords = np.roll(corners, -1, axis=1) - corners
    heights = _heights(middles, chords)
    return _turn(middles, chords, heights), heights


def _turn(middles: Floats, chords: Floats, heights: Floats) -> Floats:
    """Turn (...), rad, of parabolas over chords (..., 3).

    middles (..., 3): offset of the parabola's middle from the chord's; heights (...): its part
    across the chord
    """
    off = np.maximum(heights, SHELL.uneven * length_of(middles))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.nan_to_num(8 * off / length_of(chords))


def _heights(middles: Floats, chords: Floats) -> Floats:
    """Distance (...) from chords (..., 3) of points at offsets (..., 3) from their middles."""
    with np.errstate(invalid="ignore", divide="ignore"):
        along = np.nan_to_num(dot(middles, chords) / dot(chords, chords))

    return length_of(middles - along[..., None] * chords)


def bounding_shell_steps(faces: CurvedFaces) -> Steps[BoundingShell]:
    """Bounding shell of curved faces, with pauses."""
    # vertices and edges shared with flat faces are not lifted
    on_edge = faces.neighbour < 0
    is_held = np.zeros(len(faces.vertex_normal), bool)
    is_held[faces.vertex[on_edge]] = True
    is_held[np.roll(faces.vertex, -1, axis=1)[on_edge]] = True

    at_edge = is_held[faces.vertex].any(axis=1)
    turns, heights = _edges_of(faces)
    halvings = _count_halvings(faces, turns, at_edge)
    yield 0

    sag = np.zeros(len(turns))
    portions = []
    for some in _portions(halvings):
        # uncut faces are their facets
        is_cut = halvings[some].any(axis=1)
        face = some.start + np.flatnonzero(~is_cut)
        places = np.broadcast_to(CORNERS, (len(face), 3, 2))
        points = take(faces.corners, faces.triangle[face])
        sag[face] = heights[face].max(axis=1)

        if is_cut.any():
            cut = some.start + np.flatnonzero(is_cut)
            of_cut, places_of_cut = _cut(faces, cut, halvings[cut], at_edge[cut])
            points_of_cut, out = _find_points(faces, of_cut, places_of_cut)
            sag[cut] = np.maximum.reduceat(out, np.searchsorted(of_cut, cut))

            both = np.concatenate([face, of_cut])
            in_order = np.argsort(both, kind="stable")
            face = both[in_order]
            places = np.concatenate([places, places_of_cut])[in_order]
            points = np.concatenate([points, points_of_cut])[in_order]

        portions.append((face, places, points))
        yield 0

    # all faces around a vertex are lifted equally, or the shell would have gaps
    lift = np.zeros(len(faces.vertex_normal))
    np.maximum.at(lift, faces.vertex.ravel(), np.repeat(HIGHER * sag, 3))
    lifted = lift[:, None] * faces.vertex_normal

    # filled in portions: all at once would take most of a second for many faces
    n = sum(len(face) for face, _, _ in portions)
    made = np.empty((n, 3, 3)), np.empty(n, np.int64), np.empty((n, 3, 2), np.float32)
    shell = BoundingShell(*made)
    last = 0
    for face, places, points in portions:
        vertex = faces.vertex[face]
        raised = take(lifted, vertex)
        if halvings[face[0] : face[-1] + 1].any():
            weights = _weights(places)
            raised = np.matmul(weights, raised)
            _hold_edges(raised, weights, is_held[vertex], on_edge[face])
        else:
            raised[is_held[vertex]] = 0.0
        some = slice(last, last := last + len(face))
        shell.corners[some] = points + raised
        shell.triangle[some], shell.places[some] = faces.triangle[face], places / UNITS
        yield 0
    return shell


def _count_halvings(faces: CurvedFaces, turns: Floats, at_edge: Bools) -> Ints:
    """Halvings (p, 3) of each edge for its turn (p, 3), the same on both sides.

    at_edge (p,): the face touches a straight edge
    """
    n = np.ceil(np.log2(np.maximum(turns / SHELL.angle, 1))).astype(int)
    n[at_edge] = np.maximum(n[at_edge], SHELL.halvings_at_edges)
    row, edge = np.nonzero(faces.neighbour >= 0)
    across = faces.row[faces.neighbour[row, edge]], faces.neighbour_edge[row, edge]
    n[row, edge] = np.maximum(n[row, edge], n[across])
    return np.minimum(n, SHELL.halvings)


def _portions(halvings: Ints) -> list[slice]:
    """Slices of faces to process together, for halvings (p, 3) of their edges."""
    n_before = np.cumsum(4 ** halvings.max(axis=1, initial=0))
    ends = np.flatnonzero(np.diff(n_before // PARTS_AT_ONCE, append=-1)) + 1
    return [slice(a, b) for a, b in zip([0, *ends[:-1]], ends, strict=True)]


def _cut(faces: CurvedFaces, some: Ints, halvings: Ints, at_edge: Bools) -> tuple[Ints, Ints]:
    """Parts of some faces (f,): the face (m,) of each, by number, and places (m, 3, 2) of its
    corners, in units.

    Edges are halved as given (f, 3). Edges inside a face are halved by their own turn, so the parts
    on both sides agree. at_edge (f,) as in `_count_halvings`.
    """
    n_faces = len(halvings)
    corners = take(faces.corners, faces.triangle[some])
    sides = (corners[:, 1:] - corners[:, :1]) / UNITS
    face = np.arange(n_faces)
    places = np.broadcast_to(CORNERS, (n_faces, 3, 2))
    edges = np.broadcast_to(np.arange(3), (n_faces, 3))  # of the face, -1 for an edge inside it
    done = []
    for halved in range(SHELL.halvings):
        vectors = np.roll(places, -1, axis=1) - places
        is_cut = halvings[face[:, None], edges] > halved
        inside, e = np.nonzero(edges < 0)
        if len(inside):
            across = face[inside]
            du, dv = vectors[inside, e].T[..., None]
            side_u, side_v = sides[across].swapaxes(0, 1)
            a, b = places[inside, e], places[inside, (e + 1) % 3]
            u, v = np.stack([2 * a, a + b, 2 * b], axis=1).transpose(2, 0, 1)
            at = np.matmul(_TERMS[u, v], faces.coefficients[some[across]])
            middles = at[:, 1] - (at[:, 0] + at[:, 2]) / 2
            chords = side_u * du + side_v * dv
            turns = _turn(middles, chords, _heights(middles, chords))
            is_cut[inside, e] = turns > SHELL.angle
            is_cut[inside, e] |= at_edge[across] & (halved < SHELL.halvings_at_edges)

        n_cut = is_cut.sum(axis=1)
        done.append((face[n_cut == 0], places[n_cut == 0]))
        if not n_cut.any():
            break
        pieces = [
            _cut_alike(face[which], places[which], edges[which], is_cut[which], n)
            for n in (1, 2, 3)
            for which in [n_cut == n]
        ]
        face, places, edges = map(np.concatenate, zip(*pieces, strict=True))
    else:
        done.append((face, places))

    face, places = map(np.concatenate, zip(*done, strict=True))
    in_order = np.argsort(face, kind="stable")
    return some[face[in_order]], places[in_order]


# pieces of a triangle with its first n edges cut: corners (3, 4 and 5 are the middles of the
# edges), and edges (3 runs across)
_PIECES = {
    1: ([[0, 3, 2], [3, 1, 2]], [[0, 3, 2], [0, 1, 3]]),
    2: ([[3, 1, 4], [0, 3, 4], [0, 4, 2]], [[0, 1, 3], [0, 3, 3], [3, 1, 2]]),
    3: (
        [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]],
        [[0, 3, 2], [0, 1, 3], [3, 1, 2], [3, 3, 3]],
    ),
}


def _cut_alike(
    face: Ints, places: Ints, edges: Ints, is_cut: Bools, n: int
) -> tuple[Ints, Ints, Ints]:
    """Pieces of parts with n cut edges each; is_cut (m, 3)."""
    # rotate the cut edges to the front
    start = np.zeros(len(face), int)
    if n < 3:
        start = (is_cut if n == 1 else ~is_cut).argmax(axis=1) + (n == 2)
    turned = (start[:, None] + np.arange(3)) % 3
    places = np.take_along_axis(places, turned[..., None], axis=1)
    edges = np.take_along_axis(edges, turned, axis=1)

    middles = (places + np.roll(places, -1, axis=1)) // 2
    corners, sides = _PIECES[n]
    pieces = np.concatenate([places, middles], axis=1)[:, corners]
    across = np.concatenate([edges, np.full((len(edges), 1), -1)], axis=1)[:, sides]
    return np.repeat(face, len(corners)), pieces.reshape(-1, 3, 2), across.reshape(-1, 3)


def _weights(places: Ints) -> Floats:
    """Barycentric weights (..., 3) of places (..., 2), in units."""
    u, v = places[..., 0], places[..., 1]
    return np.stack([UNITS - u - v, u, v], axis=-1) / UNITS


def _find_points(faces: CurvedFaces, face: Ints, places: Ints) -> tuple[Floats, Floats]:
    """Points (m, 3, 3), m, of faces at the corners of parts, and the largest bulge (m,), m, out of
    the edges of each part.
    """
    twice = np.concatenate([2 * places, places + np.roll(places, -1, axis=1)], axis=1)
    at = np.matmul(_TERMS[twice[..., 0], twice[..., 1]], faces.coefficients[face])
    offsets, middles = at[:, :3], at[:, 3:]
    points = np.matmul(_weights(places), faces.corners[faces.triangle[face]]) + offsets
    chords = np.roll(points, -1, axis=1) - points
    missed = middles - (offsets + np.roll(offsets, -1, axis=1)) / 2
    return points, _heights(missed, chords).max(axis=1)


def _hold_edges(raised: Floats, weights: Floats, is_held: Bools, on_edge: Bools) -> None:
    """Undo the lift of points (m, 3, 3) at held corners and edges (m, 3)."""
    at_corner = weights == 1
    raised[(at_corner & is_held[:, None]).any(axis=2)] = 0.0
    # on the edge from corner c the weight of corner c + 2 is 0
    along = np.roll(weights == 0, -2, axis=2)
    raised[(along & on_edge[:, None]).any(axis=2)] = 0.0
