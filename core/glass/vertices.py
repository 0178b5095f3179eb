"""Vertices of a smooth mesh, with their neighbours and rims."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import Bools, Floats, Ints, stable_argsort, take, unique_inverse
from ..base.vectors import dot
from .curved import FACES_AT_ONCE
from .meshes import Edges, components


@dataclass(frozen=True, eq=False)
class Vertices:
    """Vertices with one normal each: a mesh vertex with different normals around it is repeated.

    at, normal : (f, 3) m, unit
    is_known : (f,) the normal is valid
    of_corner : (t, 3) vertex of each triangle's corner
    start, end : (p,) all directed pairs of neighbours, sorted by start
    first : (f + 1,) first pair of each vertex
    rim : (f, 3) m, along the rim at vertices with neighbours on one side only, 0 elsewhere; None
        before `with_second_ring`
    """

    at: Floats
    normal: Floats
    is_known: Bools
    of_corner: Ints
    start: Ints
    end: Ints
    first: Ints
    rim: Floats | None = None

    def by_valence(self, wanted: Bools) -> Iterator[tuple[Ints, Ints]]:
        """Wanted vertices (n,) with equal numbers of neighbours, in batches, and their pairs (n,
        m).
        """
        counts = np.diff(self.first)
        for m in np.unique(counts[wanted]):
            chosen = np.flatnonzero(wanted & (counts == m))
            for k in range(0, len(chosen), 2 * FACES_AT_ONCE):
                some = chosen[k : k + 2 * FACES_AT_ONCE]
                yield some, self.first[some, None] + np.arange(m)


def find_vertices(
    vertices: Floats,
    triangles: Ints,
    corner_normals: Floats,
    is_usable: Bools,
    edges: Edges,
    is_joined: Bools,
) -> Vertices:
    """Vertices by joining corners across joined edges (e,), with their neighbours."""
    n = len(triangles)
    corner = 3 * np.arange(n)[:, None] + np.arange(3)
    of_corner = triangles.copy()

    # most vertices have joined edges only and stay whole; around the others corners are joined one
    # by one
    is_joined_edge = np.zeros((n, 3), bool)
    for t, e in ((edges.first, edges.corner_first), (edges.second, edges.corner_second)):
        is_joined_edge[t[is_joined], e[is_joined]] = True

    whole = np.ones(len(vertices), bool)
    open_t, open_e = np.nonzero(~is_joined_edge)
    whole[triangles[open_t, open_e]] = whole[triangles[open_t, (open_e + 1) % 3]] = False

    chosen = np.flatnonzero(~whole[triangles].ravel())
    if len(chosen):
        local = np.full(3 * n, -1)
        local[chosen] = np.arange(len(chosen))
        f, s, i, j = (
            x[is_joined]
            for x in (edges.first, edges.second, edges.corner_first, edges.corner_second)
        )
        a = np.concatenate([corner[f, i], corner[f, (i + 1) % 3]])
        b = np.concatenate([corner[s, (j + 1) % 3], corner[s, j]])
        inside = (local[a] >= 0) & (local[b] >= 0)
        label = components(len(chosen), local[a[inside]], local[b[inside]])
        of_corner.reshape(-1)[chosen] = len(vertices) + label

    used, of_corner = unique_inverse(of_corner)
    normal = np.zeros((len(used), 3))
    at = np.empty((len(used), 3))
    at[of_corner] = take(vertices, triangles)
    normal[of_corner[is_usable]] = corner_normals[is_usable]

    # a joined edge occurs once in each direction; the reverse of the others has to be added
    a = of_corner.ravel()
    b = np.roll(of_corner, -1, axis=1).ravel()
    lone = ~is_joined_edge.ravel()
    start = np.concatenate([a, b[lone]])
    end = np.concatenate([b, a[lone]])

    order = stable_argsort(start)
    start = start[order]
    end = end[order]
    first = np.searchsorted(start, np.arange(len(used) + 1))

    return Vertices(at, normal, dot(normal, normal) > 0.5, of_corner, start, end, first)


def with_second_ring(v: Vertices) -> Vertices:
    """The same vertices, with second neighbours added for vertices at rims.

    One ring cannot distinguish a dome from a cone, so a vertex counts as a rim vertex only if two
    of its rings are away from all rims. The end of a sharp edge within a surface is not at a rim:
    the edge there and back sums to 0.
    """
    n = len(v.at)
    n_around = np.diff(v.first)
    is_open = np.bincount(v.of_corner.ravel(), minlength=n) < n_around
    if not is_open.any():
        return v

    a, b = v.of_corner.ravel(), np.roll(v.of_corner, -1, axis=1).ravel()
    between = is_open[a] & is_open[b]
    a, b = a[between], b[between]
    is_lone = ~np.isin(a * n + b, b * n + a)
    a, b = a[is_lone], b[is_lone]
    rim = np.zeros((n, 3))
    along = v.at[b] - v.at[a]
    for ends in (a, b):
        np.add.at(rim, ends, along)
    is_open = rim.any(axis=1)

    # second neighbours of each rim vertex
    pairs = np.flatnonzero(is_open[v.start])
    middle = v.end[pairs]
    counts = n_around[middle]
    start = np.repeat(v.start[pairs], counts)
    skipped = np.cumsum(counts) - counts
    end = v.end[np.repeat(v.first[middle] - skipped, counts) + np.arange(counts.sum())]

    is_inner = np.zeros(n, bool)
    is_inner[v.start[~is_open[v.start] & ~is_open[v.end]]] = True
    is_rim = np.zeros(n, bool)
    is_rim[start[is_inner[end]]] = True
    further = is_rim[start] & ~is_open[end]
    start, end = np.divmod(np.setdiff1d((start * n + end)[further], v.start[pairs] * n + middle), n)

    start = np.concatenate([v.start, start])
    order = stable_argsort(start)
    start = start[order]
    return replace(
        v,
        start=start,
        end=np.concatenate([v.end, end])[order],
        first=np.searchsorted(start, np.arange(n + 1)),
        rim=np.where(is_rim[:, None], rim, 0.0),
    )
