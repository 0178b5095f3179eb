"""Welding of open edges in the same place, so surfaces drawn as one become one.

Curves, texts and many imported files have faces that touch without common vertices. Only edges with
one face are joined, and only with each other: closed bodies in contact stay separate. If more than
two edges meet, the two on both sides of the same piece of glass are joined.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.vectors import dot
from .meshes import components, volume_of

SAME_ANGLE = 1e-4  # rad: faces around an edge closer than this are in the same place


class _OpenEdges(NamedTuple):
    """Edges with one triangle, all (e,): vertices at start, end and opposite, along the triangle's
    winding.
    """

    start: Ints
    end: Ints
    opposite: Ints

    def at(self, which: Ints | Bools) -> "_OpenEdges":
        return _OpenEdges(*(column[which] for column in self))


def welded(vertices: Floats, triangles: Ints, distance: float) -> Ints:
    """Triangles (t, 3) with the same corners as before, but common vertices at joined open edges.

    An open edge no longer than `distance` is a point: its triangle then has one vertex twice.

    Parameters
    ----------
    vertices : (v, 3) float64
    triangles : (t, 3) int, indices into vertices, consistently wound wherever more than two open
        edges meet
    distance : in the vertices' unit: vertices closer than this are in the same place
    """
    if not len(triangles):
        return triangles

    is_inside_out = volume_of(vertices[triangles]) < 0
    edges = _open_edges(triangles[:, ::-1] if is_inside_out else triangles)
    if not len(edges.start):
        return triangles

    used, index = np.unique(np.concatenate([edges.start, edges.end]), return_inverse=True)
    label = coincident(vertices[used], distance)
    start, end = label[index].reshape(2, -1)
    has_length = start != end
    short = edges.at(~has_length)  # points, such as the pole of a sphere of splines
    edges = edges.at(has_length)
    start = start[has_length]
    end = end[has_length]

    first, second = _pairs(
        vertices, edges, np.minimum(start, end) * len(used) + np.maximum(start, end)
    )
    is_same_face = (
        np.linalg.norm(vertices[edges.opposite[first]] - vertices[edges.opposite[second]], axis=1)
        <= distance
    )

    # a face drawn twice would be joined with itself
    first = first[~is_same_face]
    second = second[~is_same_face]

    runs_back = start[first] != start[second]
    a = np.concatenate([short.start, edges.start[first], edges.end[first]])
    b = np.concatenate([
        short.end,
        np.where(runs_back, edges.end[second], edges.start[second]),
        np.where(runs_back, edges.start[second], edges.end[second]),
    ])  # fmt: skip
    return components(len(vertices), a, b)[triangles]


def _open_edges(triangles: Ints) -> _OpenEdges:
    """Edges of triangles (t, 3) that belong to one triangle only."""
    start, end, opposite = (
        np.roll(triangles, -k, axis=1).astype(np.int64).ravel() for k in range(3)
    )
    key = np.minimum(start, end) * (int(triangles.max(initial=0)) + 1) + np.maximum(start, end)
    _, first, counts = np.unique(key, return_index=True, return_counts=True)
    return _OpenEdges(start, end, opposite).at(first[counts == 1])


def coincident(points: Floats, distance: float) -> Ints:
    """Label (n,), equal for points (n, 3) at most `distance` apart, and for chains of such points.

    Two such points share a cell of a grid twice as wide, or of one shifted by half a cell along
    some axes.
    """
    first, same = _equal_rows(points)
    points = points[first]
    pairs = [np.empty((0, 2), np.int64)]

    if distance > 0:
        place = (points - points.min(axis=0)) / (2 * distance)
        for shift in np.ndindex(2, 2, 2):
            cell = np.floor(place + 0.5 * np.array(shift)).astype(np.int64)
            pairs.extend(_near_in_cells(points, cell, distance))

    return components(len(points), *np.concatenate(pairs).T)[same]


def _equal_rows(rows: Floats) -> tuple[Ints, Ints]:
    """Indices (m,) of unique rows among (n, 3), and the unique row (n,) of each."""
    order = np.lexsort(rows.T)
    is_new = np.r_[True, (rows[order[1:]] != rows[order[:-1]]).any(axis=1)]
    same = np.empty(len(rows), np.int64)
    same[order] = np.cumsum(is_new) - 1
    return order[is_new], same


def _near_in_cells(points: Floats, cell: Ints, distance: float) -> Iterator[Ints]:
    """Pairs (p, 2) of points (n, 3) in one cell (n, 3), at most `distance` apart."""
    low = cell.min(axis=0)
    high = cell.max(axis=0)
    x, y, z = (cell - low).T
    _, rows, layers = high - low + 1

    # on overflow a cell shares its key with others, which are far away
    key = (x * rows + y) * layers + z
    order = np.argsort(key)
    key = key[order]

    for step in range(1, len(order)):
        same = np.flatnonzero(key[:-step] == key[step:])
        if not len(same):
            return
        one = order[same]
        other = order[same + step]
        is_near = np.linalg.norm(points[one] - points[other], axis=1) <= distance
        yield np.stack([one[is_near], other[is_near]], axis=1)


def _pairs(vertices: Floats, edges: _OpenEdges, place: Ints) -> tuple[Ints, Ints]:
    """Pairs (p,), (p,) of edges, out of (e,), to join; place (e,): equal for edges in the same
    place.
    """
    order = np.argsort(place, kind="stable")
    begins = np.flatnonzero(np.r_[True, place[order][1:] != place[order][:-1]])
    counts = np.diff(np.r_[begins, len(order)])
    alone = begins[counts == 2]
    first = [order[alone]]
    second = [order[alone + 1]]

    for begin, count in zip(begins[counts > 2], counts[counts > 2], strict=True):
        some = order[begin : begin + count]
        one, other = _around(vertices, edges.at(some))
        first.append(some[one])
        second.append(some[other])

    return np.concatenate(first), np.concatenate(second)


def _around(vertices: Floats, edges: _OpenEdges) -> tuple[Ints, Ints]:
    """Pairs among edges in one place whose triangles have glass between them; none if the winding
    gives no inside.

    Around the edge, about its direction, glass ends at a triangle wound along it. It has begun at
    the triangle before, wound the other way.
    """
    middle = vertices[edges.start[0]]
    along = vertices[edges.end] - vertices[edges.start]
    is_along = along @ along[0] > 0
    axis = along[0] / np.linalg.norm(along[0])
    outward = vertices[edges.opposite] - middle
    outward = outward - (outward @ axis)[:, None] * axis
    # the farthest: a triangle without area has no direction
    from_here = outward[dot(outward, outward).argmax()]
    angle = np.arctan2(outward @ np.cross(axis, from_here), outward @ from_here)
    angle = np.mod(angle, 2 * np.pi)

    # start behind the widest gap, so the step from 2 pi to 0 does not separate faces in the same
    # place
    rising = np.sort(angle)
    gaps = np.diff(np.r_[rising, rising[0] + 2 * np.pi])
    angle = np.mod(angle - rising[(np.argmax(gaps) + 1) % len(gaps)] + SAME_ANGLE, 2 * np.pi)
    order = np.argsort(angle)
    step = np.cumsum(np.r_[0, np.diff(angle[order]) > SAME_ANGLE])

    # of faces in contact, glass ends before it begins again
    order = order[np.lexsort([~is_along[order], step])]
    ends = np.flatnonzero(is_along[order])
    before = order[ends - 1]
    is_inside = not is_along[before].any() and len(ends) * 2 == len(order)

    return (before, order[ends]) if is_inside else (order[:0], order[:0])
