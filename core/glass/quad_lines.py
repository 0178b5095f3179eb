"""Lines of edges that go on from quad to quad, as the polygons of a mesh tell them."""

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Ints
from .meshes import Edges
from .vertices import Vertices


@dataclass(frozen=True, eq=False)
class QuadLines:
    """Lines (n,), one for each pair of neighbours whose first lies where four quads meet.

    pair : of the vertices, the first two of the line; beside : the line that begins at the same
    vertex a quarter on, counter-clockwise; back : that which begins there the other way; on : that
    which begins a vertex further, and turned : from there the way back; -1 where there are none
    face (t,) : the line along which each triangle that is half of a quad begins, at the corner off
    the diagonal, -1 where there is none; corner (t,) : that corner; is_half (t,) : triangles that
    are half of a quad
    """

    pair: Ints
    beside: Ints
    back: Ints
    on: Ints
    turned: Ints
    face: Ints
    corner: Ints
    is_half: Bools


def find_quad_lines(v: Vertices, edges: Edges, polygon: Ints) -> QuadLines:
    """The lines of a mesh whose triangles are parts of polygons (t,)."""
    n = len(v.at)
    keys = v.start * n + v.end
    order = np.argsort(keys)
    keys = keys[order]

    def find(start: Ints, end: Ints) -> Ints:
        return order[np.searchsorted(keys, start * n + end)]

    is_diagonal, is_half = _halves(edges, polygon)
    corner = (is_diagonal.argmax(axis=1) + 2) % 3

    # the pair that follows each around its vertex, past the diagonal of a quad; the last is none
    at, to, last = (np.roll(v.of_corner[is_half], -k, axis=1).ravel() for k in range(3))
    pairs = find(at, to)
    follows = np.full(len(keys) + 1, -1)
    follows[pairs] = find(at, last)
    is_inner = np.zeros(len(follows), bool)
    is_inner[pairs] = is_diagonal[is_half].ravel()
    follows = np.where(is_inner[follows], follows[follows], follows)
    follows[is_inner] = -1

    # opposite, where the fourth is the first again
    across = follows[follows]
    pair = np.flatnonzero(across[across] == np.arange(len(across)))
    line = np.full(len(across), -1)
    line[pair] = np.arange(len(pair))
    back = find(v.end[pair], v.start[pair])
    apex, ahead = (v.of_corner[np.arange(len(corner)), (corner + k) % 3] for k in (0, 1))
    return QuadLines(
        pair=pair,
        beside=line[follows[pair]],
        back=line[across[pair]],
        on=line[np.where(line[back] < 0, -1, across[back])],
        turned=line[back],
        face=np.where(is_half, line[find(apex, ahead)], -1),
        corner=corner,
        is_half=is_half,
    )


def _halves(edges: Edges, polygon: Ints) -> tuple[Bools, Bools]:
    """Edges (t, 3) that are diagonals of polygons (t,), and triangles (t,) that are half a quad."""
    is_diagonal = np.zeros((len(polygon), 3), bool)
    # a triangle that has a vertex twice is beside itself
    same = (polygon[edges.first] == polygon[edges.second]) & (edges.first != edges.second)
    for t, e in ((edges.first, edges.corner_first), (edges.second, edges.corner_second)):
        is_diagonal[t[same], e[same]] = True

    n_parts = np.bincount(polygon)[polygon]
    return is_diagonal, (n_parts == 2) & (is_diagonal.sum(axis=1) == 1)
