"""Rules of Catmull and Clark for quads, and the control points of places on their limit.

Masks of the limit by Halstead, Kass and DeRose, "Efficient, fair interpolation using Catmull-Clark
surfaces" (1993): a vertex of n neighbours goes to (n^2 c + 4 sum of neighbours + sum of the corners
opposite) / (n (n + 5)).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..base.arrays import Bools, Floats, Ints, taken
from ..base.steps import Pauses
from ..base.vectors import normalise

# Chebyshev's iteration for control points: so many steps, and the least eigenvalue of the masks
# (that of a regular grid; around other vertices none was found to be less)
STEPS = 50
LEAST_EIGENVALUE = 1 / 9


@dataclass(frozen=True, eq=False)
class Quads:
    """Faces (q,) of four corners each, by loops, four a face: the vertex (4 q,) that each starts
    at, counter-clockwise from the front, of n vertices.
    """

    start: Ints
    n: int

    @cached_property
    def after(self) -> Ints:
        loops = np.arange(len(self.start))
        return loops - loops % 4 + (loops + 1) % 4

    @cached_property
    def before(self) -> Ints:
        loops = np.arange(len(self.start))
        return loops - loops % 4 + (loops + 3) % 4

    @cached_property
    def twin(self) -> Ints:
        """The loop (4 q,) that runs the other way along the same edge; its own where none does."""
        end = self.start[self.after]
        key = self.start * self.n + end
        order = np.argsort(key)
        found = order[
            np.minimum(np.searchsorted(key[order], end * self.n + self.start), len(key) - 1)
        ]
        has_twin = key[found] == end * self.n + self.start
        return np.where(has_twin, found, np.arange(len(key)))

    @cached_property
    def valence(self) -> Ints:
        return np.bincount(self.start, minlength=self.n)

    def around(self, values: Floats) -> tuple[Floats, Floats]:
        """Sums (n, 3) of the values (n, 3) of the neighbours, and of the corners opposite."""
        next_to = self.start[self.after]
        opposite = next_to[self.after]
        return self._sum(taken(values, next_to)), self._sum(taken(values, opposite))

    def _sum(self, by_loop: Floats) -> Floats:
        return np.stack([np.bincount(self.start, x, self.n) for x in by_loop.T], axis=1)

    def limit(self, points: Floats) -> Floats:
        """Where control points (n, 3) go."""
        edges, corners = self.around(points)
        m = np.maximum(self.valence, 1)[:, None]
        return (m * m * points + 4 * edges + corners) / (m * (m + 5))

    def limit_normals(self, points: Floats, wanted: Bools) -> Floats:
        """Unit normals (n, 3) of the limit where all around is known (n,), NaN elsewhere."""
        normals = np.full_like(points, np.nan)
        around = self.twin[self.before]
        first = np.zeros(self.n, np.int64)
        first[self.start] = np.arange(len(self.start))
        after = self.after
        for m in np.unique(self.valence[wanted]):
            some = np.flatnonzero(wanted & (self.valence == m))
            loops = [first[some]]
            for _ in range(m - 1):
                loops.append(around[loops[-1]])
            loops = np.stack(loops, axis=1)
            next_to = after[loops]
            edges = points[self.start[next_to]]
            corners = points[self.start[after[next_to]]]

            turn = 2 * np.pi / m
            k = turn * np.arange(m)[:, None]
            of_edges = 1 + np.cos(turn) + np.cos(turn / 2) * np.sqrt(2 * (9 + np.cos(turn)))
            along, across = (
                (of_edges * wave(k) * edges + (wave(k) + wave(k + turn)) * corners).sum(axis=1)
                for wave in (np.cos, np.sin)
            )
            normals[some] = normalise(np.cross(along, across))

        return normals

    def divided(self, points: Floats) -> tuple["Quads", Floats]:
        """Each face in four, those of loop l at 4 l; right where all around is known."""
        edge = np.minimum(np.arange(len(self.start)), self.twin)
        first, edge = np.unique(edge, return_inverse=True)
        of_face = points[self.start].reshape(-1, 4, 3).mean(axis=1)
        face = np.arange(len(self.start)) // 4
        ends = points[self.start[first]] + points[self.start[self.after[first]]]
        at_edge = (ends + of_face[face[first]] + of_face[face[self.twin[first]]]) / 4

        m = np.maximum(self.valence, 1)[:, None]
        faces = self._sum(of_face[face]) / m
        edges = self.around(points)[0] / m
        at_vertex = (faces + (points + edges) + (m - 3) * points) / m

        start = [self.start, self.n + edge, self.n + len(first) + face, self.n + edge[self.before]]
        places = np.concatenate([at_vertex, at_edge, of_face])
        return Quads(np.stack(start, axis=1).ravel(), len(places)), places


def finding_points(quads: Quads, places: Floats, is_inner: Bools) -> Pauses[Floats]:
    """Control points (n, 3) whose limit are places (n, 3), at inner vertices; others stay."""
    middle, half = (1 + LEAST_EIGENVALUE) / 2, (1 - LEAST_EIGENVALUE) / 2
    points = places.copy()
    way = np.zeros_like(points)
    part = 1 / middle
    for k in range(STEPS):
        off = np.where(is_inner[:, None], places - quads.limit(points), 0.0)
        again = (half * part) ** 2 / (2 if k == 1 else 4) if k else 0.0
        part = 1 / (middle - again / part) if k else part
        way = off + again * way
        points += part * way
        yield 0

    return points
