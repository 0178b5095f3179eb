"""The mesh that a ray engine is asked about in the place of curved faces: it lies just in front.

A ray that meets a face, however close to a silhouette, meets this hull, too. It is the faces'
own points, lifted along the normals of the vertices by more than the faces stand out of the
chords between those points. Each face is cut into as many parts as its turn needs, along the
edges that turn.
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
class HullKnobs:
    """How fine a hull is, tuned for time: finer ones cost the engine more than they save.

    angle : rad, by less than this the hull turns from one part to the next
    uneven : a face that runs faster at one end than at the other counts as turning so much of what
        it would if it were as far off to the side: Newton's method needs a near start there, too
    halvings : of an edge, at most
    halvings_at_edges : at least, of edges and ways across of faces that have a straight edge, or
        meet one in a corner: there hull and face are one
    """

    angle: float = np.radians(3)
    uneven: float = 0.5
    halvings: int = 3
    halvings_at_edges: int = 2


HULL = HullKnobs()
PARTS_AT_ONCE = 1 << 14  # that are worked on together: between two pauses
UNITS = 2**HULL.halvings  # that an edge is long where places are counted

CORNERS = UNITS * np.array([[0, 0], [1, 0], [0, 1]])  # places of a face's corners

# terms at all places, and at those half way between
_AT = np.stack(np.meshgrid(*2 * [np.arange(2 * UNITS + 1)], indexing="ij"), axis=-1)
_TERMS = monomials(*np.moveaxis(_AT / (2 * UNITS), -1, 0))


class BoundingShell(NamedTuple):
    """Triangles (p, 3, 3), m, that lie just in front of curved faces.

    triangle (p,) whose face each is in front of; places (p, 3, 2): u, v of its corners there. Next
    to straight edges, which faces share with flat ones, they lie on the faces instead.
    """

    corners: Floats
    triangle: Ints
    places: NDArray[np.float32]


def edge_turns(faces: CurvedFaces) -> Floats:
    """By how much (p, 3), rad, edges turn."""
    return _edges_of(faces)[0]


def _edges_of(faces: CurvedFaces) -> tuple[Floats, Floats]:
    """By how much (p, 3), rad, edges turn, and how far (p, 3), m, they stand out to the side."""
    at_middles = monomials(np.array([0.5, 0.5, 0.0]), np.array([0.0, 0.5, 0.5]))
    middles = combine(at_middles, faces.coefficient_table.reshape(N_TERMS, -1))
    middles = np.ascontiguousarray(middles.reshape(3, 3, -1).transpose(2, 0, 1))
    corners = take(faces.corners, faces.triangle)
    chords = np.roll(corners, -1, axis=1) - corners
    heights = _heights(middles, chords)
    return _turn(middles, chords, heights), heights


def _turn(middles: Floats, chords: Floats, heights: Floats) -> Floats:
    """By how much (...) parabolas turn whose middles are so far off those of chords (..., 3), and
    of that by their heights (...) to the side.
    """
    off = np.maximum(heights, HULL.uneven * length_of(middles))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.nan_to_num(8 * off / length_of(chords))


def _heights(middles: Floats, chords: Floats) -> Floats:
    """How far points that are off the middles of chords (..., 3) are from these, to the side."""
    with np.errstate(invalid="ignore", divide="ignore"):
        along = np.nan_to_num(dot(middles, chords) / dot(chords, chords))

    return length_of(middles - along[..., None] * chords)


def bounding_shell_steps(faces: CurvedFaces) -> Steps[BoundingShell]:
    """Make the hull of curved faces, with pauses."""
    # vertices and edges that are shared with flat faces stay
    on_edge = faces.neighbour < 0
    is_held = np.zeros(len(faces.vertex_normal), bool)
    is_held[faces.vertex[on_edge]] = True
    is_held[np.roll(faces.vertex, -1, axis=1)[on_edge]] = True

    at_edge = is_held[faces.vertex].any(axis=1)
    turns, heights = _edges_of(faces)
    halvings = _count_halvings(faces, turns, at_edge)
    yield 0

    # parts, and how far the faces stand out of them
    sag = np.zeros(len(turns))
    portions = []
    for some in _portions(halvings):
        # those that are not cut are their facets
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

    # around each vertex all faces are lifted alike, or the hull would have gaps
    lift = np.zeros(len(faces.vertex_normal))
    np.maximum.at(lift, faces.vertex.ravel(), np.repeat(HIGHER * sag, 3))
    lifted = lift[:, None] * faces.vertex_normal

    # put together bit by bit: of many faces that takes most of a second
    n = sum(len(face) for face, _, _ in portions)
    made = np.empty((n, 3, 3)), np.empty(n, np.int64), np.empty((n, 3, 2), np.float32)
    hull = BoundingShell(*made)
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
        hull.corners[some] = points + raised
        hull.triangle[some], hull.places[some] = faces.triangle[face], places / UNITS
        yield 0
    return hull


def _count_halvings(faces: CurvedFaces, turns: Floats, at_edge: Bools) -> Ints:
    """How often each edge (p, 3) is halved that turns by so much: the same
    on both sides. at_edge (p,): does the face meet a straight edge?
    """
    n = np.ceil(np.log2(np.maximum(turns / HULL.angle, 1))).astype(int)
    n[at_edge] = np.maximum(n[at_edge], HULL.halvings_at_edges)
    row, edge = np.nonzero(faces.neighbour >= 0)
    beside = faces.row[faces.neighbour[row, edge]], faces.neighbour_edge[row, edge]
    n[row, edge] = np.maximum(n[row, edge], n[beside])
    return np.minimum(n, HULL.halvings)


def _portions(halvings: Ints) -> list[slice]:
    """Faces that are worked on together, whose edges are halved so often (p, 3)."""
    n_before = np.cumsum(4 ** halvings.max(axis=1, initial=0))
    ends = np.flatnonzero(np.diff(n_before // PARTS_AT_ONCE, append=-1)) + 1
    return [slice(a, b) for a, b in zip([0, *ends[:-1]], ends, strict=True)]


def _cut(faces: CurvedFaces, some: Ints, halvings: Ints, at_edge: Bools) -> tuple[Ints, Ints]:
    """Parts of some faces (f,), by number: of which face (m,)
    each is, and places (m, 3, 2) of its corners, in units.

    Edges are halved so often (f, 3), and ways across as they turn themselves, so
    that parts of both sides do the same; at_edge (f,) as for `_count_halvings`.
    """
    n_faces = len(halvings)
    corners = take(faces.corners, faces.triangle[some])
    sides = (corners[:, 1:] - corners[:, :1]) / UNITS
    face = np.arange(n_faces)
    places = np.broadcast_to(CORNERS, (n_faces, 3, 2))
    edges = np.broadcast_to(np.arange(3), (n_faces, 3))  # of the face, -1 where a way crosses it
    done = []
    for halved in range(HULL.halvings):
        ways = np.roll(places, -1, axis=1) - places
        is_cut = halvings[face[:, None], edges] > halved
        inside, e = np.nonzero(edges < 0)
        if len(inside):
            across = face[inside]
            du, dv = ways[inside, e].T[..., None]
            side_u, side_v = sides[across].swapaxes(0, 1)
            a, b = places[inside, e], places[inside, (e + 1) % 3]
            u, v = np.stack([2 * a, a + b, 2 * b], axis=1).transpose(2, 0, 1)
            at = np.matmul(_TERMS[u, v], faces.coefficients[some[across]])
            middles = at[:, 1] - (at[:, 0] + at[:, 2]) / 2
            chords = side_u * du + side_v * dv
            turns = _turn(middles, chords, _heights(middles, chords))
            is_cut[inside, e] = turns > HULL.angle
            is_cut[inside, e] |= at_edge[across] & (halved < HULL.halvings_at_edges)

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


# triangles that come of one whose first n edges are cut: corners, of which 3, 4 and 5 are the
# middles of the edges; and edges, of which 3 runs across
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
    """The pieces of parts of which n edges each are cut (m, 3)."""
    # turned so that those that are cut come first
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
    """Points (m, 3, 3), m, of faces at the corners of parts, and by
    how much (m,), m, they stand out of the parts' edges at most.
    """
    twice = np.concatenate([2 * places, places + np.roll(places, -1, axis=1)], axis=1)
    at = np.matmul(_TERMS[twice[..., 0], twice[..., 1]], faces.coefficients[face])
    offsets, middles = at[:, :3], at[:, 3:]
    points = np.matmul(_weights(places), faces.corners[faces.triangle[face]]) + offsets
    chords = np.roll(points, -1, axis=1) - points
    missed = middles - (offsets + np.roll(offsets, -1, axis=1)) / 2
    return points, _heights(missed, chords).max(axis=1)


def _hold_edges(raised: Floats, weights: Floats, is_held: Bools, on_edge: Bools) -> None:
    """Take back how far points (m, 3, 3) are raised at held corners and edges (m, 3)."""
    at_corner = weights == 1
    raised[(at_corner & is_held[:, None]).any(axis=2)] = 0.0
    # along the edge that begins at a corner the weight of the one after the next is 0
    along = np.roll(weights == 0, -2, axis=2)
    raised[(along & on_edge[:, None]).any(axis=2)] = 0.0
