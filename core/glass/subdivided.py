"""Exact limit surface of a subdivided mesh around poles, and wherever its quads form no grid.

Blender puts vertices on the limit surface of Subdivision. Control points follow from them; divided
twice, they give places and normals at the nodes of curved faces. Control points also show whether a
mesh was subdivided at all. If so, each point on an edge is a quarter of the sum of four: two on the
faces next to it, and the coarser ones at its ends, which follow from the points around them. Other
meshes never satisfy this for any choice of edge points, except fine, smooth ones: there all choices
come close, and none is accepted.

Masks of the limit by Halstead, Kass and DeRose, "Efficient, fair interpolation using Catmull-Clark
surfaces" (1993): a vertex of n neighbours goes to (n^2 c + 4 sum of neighbours + sum of the corners
opposite) / (n (n + 5)).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..base.arrays import Bools, Floats, Ints, take
from ..base.steps import Steps
from ..base.vectors import length_of, normalise
from .meshes import Edges, components
from .quartics import AT
from .splines import QuadLines, Splines, find_quad_lines, spline_steps
from .vertices import Vertices

# Chebyshev iteration for control points: number of steps, and the least eigenvalue of the masks (of
# a regular grid; no smaller one was found at other vertices)
STEPS = 50
LEAST_EIGENVALUE = 1 / 9


@dataclass(frozen=True, eq=False)
class Quads:
    """Faces (q,) of four corners each, with n vertices. Stored as loops, four a face.

    start (4 q,): vertex where each loop starts, counter-clockwise from the front
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
        """Loop (4 q,) that runs the other way along the same edge; itself without one."""
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
        """Sums (n, 3) of the values (n, 3) of the neighbours, and of the opposite corners."""
        next_to = self.start[self.after]
        opposite = next_to[self.after]
        return self._sum(take(values, next_to)), self._sum(take(values, opposite))

    def _sum(self, by_loop: Floats) -> Floats:
        return np.stack([np.bincount(self.start, x, self.n) for x in by_loop.T], axis=1)

    def limit(self, points: Floats) -> Floats:
        """Limit positions of control points (n, 3)."""
        edges, corners = self.around(points)
        m = np.maximum(self.valence, 1)[:, None]
        return (m * m * points + 4 * edges + corners) / (m * (m + 5))

    def limit_normals(self, points: Floats, wanted: Bools) -> Floats:
        """Unit normals (n, 3) of the limit at wanted vertices (n,) with all faces around them; NaN
        elsewhere.
        """
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
        """Each face split in four, those of loop l at 4 l; correct if all faces around exist."""
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


def control_point_steps(quads: Quads, places: Floats, is_inner: Bools) -> Steps[Floats]:
    """Control points (n, 3) with limit positions `places` (n, 3) at inner vertices; others stay."""
    middle, half = (1 + LEAST_EIGENVALUE) / 2, (1 - LEAST_EIGENVALUE) / 2
    points = places.copy()
    direction = np.zeros_like(points)
    part = 1 / middle
    for k in range(STEPS):
        off = np.where(is_inner[:, None], places - quads.limit(points), 0.0)
        again = (half * part) ** 2 / (2 if k == 1 else 4) if k else 0.0
        part = 1 / (middle - again / part) if k else part
        direction = off + again * direction
        points += part * direction
        yield 0

    return points


# rings of faces around the requested ones, to find control points, and to test them
AROUND = 14
TESTED = 3
# rings of faces around a pole (more or fewer than four quads) without splines of two edges
NEAR = 8
# fraction of an edge: largest error of control points, and how many times less it is than otherwise
ROUNDING = 1e-3
CLEAR_RATIO = 10.0


def _places_divided() -> Ints:
    """The loop (5, 5), of the 64 in a quad divided twice, that starts at each place of a grid over
    it: from its first corner along its first edge, and along its last.
    """
    found = np.full((5, 5), -1)
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    axes = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
    for k in range(4):
        for j in range(4):
            for m in range(4):
                # from the innermost face outward, by its origin and its first two directions
                at = 2 * corners[j] + corners[m] @ np.stack([axes[j], axes[(j + 1) % 4]])
                at = 4 * corners[k] + at @ np.stack([axes[k], axes[(k + 1) % 4]])
                found[tuple(at)] = 16 * k + 4 * j + m

    return found


def _nodes_divided() -> Ints:
    """The same loops (2, 3, 15) at nodes and corners of the halves of a quad, the one at its first
    corner and the other, by the corner off the diagonal.
    """
    grid = _places_divided()
    at = np.stack([np.roll(np.rint(4 * AT).astype(int), -k, axis=1)[:, 1:] for k in range(3)])
    return np.stack([grid[at[..., 0], at[..., 1]], grid[4 - at[..., 0], 4 - at[..., 1]]])


NODES_DIVIDED = _nodes_divided()


@dataclass(frozen=True, eq=False)
class Subdivided:
    """Parts of a mesh on a subdivision surface.

    is_face : (t,) triangles on it
    normal : (f, 3) unit, of the vertices at their corners, NaN elsewhere
    row : (t,) of each of them, -1 for others
    vertex : (r, 15) of the divided mesh at their nodes and corners
    places, normals : (n, 3) of these vertices, m and unit
    """

    is_face: Bools
    normal: Floats
    row: Ints
    vertex: Ints
    places: Floats
    normals: Floats

    def faces(self, triangles: Ints) -> tuple[Floats, Floats]:
        """Places and unit normals (n, 15, 3) of triangles (n,) at nodes and corners."""
        vertex = self.vertex[self.row[triangles]]
        return self.places[vertex], self.normals[vertex]


def subdivided_steps(
    v: Vertices, lines: QuadLines, polygon: Ints, requested: Bools
) -> Steps[Subdivided | None]:
    """Subdivision surface under the requested triangles (t,); None if there is none."""
    faces, halves = _faces(v, lines, polygon)
    n = len(v.at)
    n_triangles, in_halves, n_quads = (
        np.bincount(x.ravel(), minlength=n) for x in (v.of_corner, v.of_corner[halves], faces)
    )
    # closed, with quads only
    is_whole = (n_triangles == in_halves) & (n_triangles == np.diff(v.first))
    is_pole = is_whole & (n_quads != 4)
    if not is_pole.any():
        return None

    rings = _rings(faces, is_pole, requested[halves].any(axis=1))
    yield 0
    if not rings[0].any():
        return None

    used, start = np.unique(faces[rings[-1]], return_inverse=True)
    quads = Quads(start.reshape(-1), len(used))
    is_whole = is_whole[used]
    is_inner = is_whole & (quads.valence == n_quads[used])
    points = yield from control_point_steps(quads, v.at[used], is_inner)

    # they show where it was divided
    is_tested = np.zeros(n, bool)
    is_tested[faces[rings[TESTED]]] = True
    group = components(quads.n, quads.start, quads.start[quads.after])
    is_divided = _are_divided(quads, points, is_tested[used] & is_inner, group)
    is_divided &= ~np.isin(group, group[~is_whole])
    yield 0
    corners = quads.start.reshape(-1, 4)
    chosen = is_divided[corners[:, 0]] & rings[0][rings[-1]]
    if not chosen.any():
        return None

    normal = np.full_like(v.normal, np.nan)
    is_corner = np.zeros(quads.n, bool)
    is_corner[corners[chosen]] = True
    normal[used] = quads.limit_normals(points, is_corner)
    yield 0
    loops, places, normals = yield from _divided_twice(quads, points, chosen)
    row, vertex = _at_nodes(lines, halves[rings[-1]][chosen], loops)
    return Subdivided(row >= 0, normal, row, vertex, places, normals)


def _rings(faces: Ints, is_pole: Bools, requested: Bools) -> list[Bools]:
    """Requested faces (q,) near poles (f,), then, ring by ring, with the faces around them."""
    is_near = is_pole
    for _ in range(NEAR):
        is_near = _grown(faces, is_near)
    rings = [requested & is_near[faces].all(axis=1)]
    for _ in range(AROUND):
        is_near = np.zeros(len(is_pole), bool)
        is_near[faces[rings[-1]]] = True
        rings.append(is_near[faces].any(axis=1))

    return rings


def _at_nodes(lines: QuadLines, halves: Ints, loops: Ints) -> tuple[Ints, Ints]:
    """Row (t,) of each half (q, 2) of quads, -1 for other triangles, and the vertices (r, 15) at
    its nodes and corners, from the loops (64 q,) of the quads divided twice.
    """
    row = np.full(len(lines.corner), -1)
    row[halves] = np.arange(halves.size).reshape(halves.shape)
    nodes = NODES_DIVIDED[[0, 1], lines.corner[halves]]
    nodes = nodes + 64 * np.arange(len(halves))[:, None, None]
    return row, loops[nodes].reshape(-1, len(AT))


def _faces(v: Vertices, lines: QuadLines, polygon: Ints) -> tuple[Ints, Ints]:
    """Vertices (q, 4) around each quad, and its halves (q, 2), the first at the first vertex."""
    halves = np.flatnonzero(lines.is_half)
    halves = halves[np.argsort(polygon[halves], kind="stable")].reshape(-1, 2)
    corner = lines.corner[halves]
    apex, ahead, last = (
        np.take_along_axis(v.of_corner[halves], (corner[..., None] + k) % 3, axis=2)[..., 0]
        for k in range(3)
    )
    return np.stack([apex[:, 0], ahead[:, 0], apex[:, 1], last[:, 0]], axis=1), halves


def _grown(faces: Ints, is_near: Bools) -> Bools:
    """Mask of vertices (n,), extended by all faces (q, 4) that touch it."""
    grown = is_near.copy()
    grown[faces[is_near[faces].any(axis=1)]] = True
    return grown


def _are_divided(quads: Quads, points: Floats, is_tested: Bools, group: Ints) -> Bools:
    """Mask of control points (n,) in a group (n,) that was divided from coarser ones."""
    edges, corners = quads.around(points)
    m = quads.valence
    n = quads.n
    start, end = quads.start, quads.start[quads.after]
    opposite = end[quads.after]
    edge = np.median(length_of(points[end] - points[start]))

    # two kinds of points, alternating along edges, and along diagonals
    by_edge = components(2 * n, np.r_[start, start + n], np.r_[end + n, end])
    by_corner = components(2 * n, np.r_[start, start + n], np.r_[opposite + n, opposite])
    has_two = by_corner[:n] != by_corner[n:]
    is_first = by_edge[:n] < by_edge[n:]
    is_one = by_corner[:n] < by_corner[n:]

    with np.errstate(invalid="ignore", divide="ignore"):
        mean, across = edges / m[:, None], corners / m[:, None]
        coarser = (m[:, None] * points - 4 * mean + across) / (m[:, None] - 3)
    coarser[m == 3] = np.nan
    at_three = length_of(3 * points - 4 * mean + across)

    offs = []
    for on_edge in (is_first, ~is_first):
        for at_vertex in (is_one & ~on_edge, ~is_one & ~on_edge):
            ends = np.where(at_vertex[:, None], coarser, points)
            off = length_of(quads.around(ends)[0] - 4 * points)
            off = np.where(on_edge, np.nan_to_num(off), 0.0)
            off[np.where(on_edge, m != 4, ~has_two)] = np.inf
            off = np.where(at_vertex & (m == 3), at_three, off)
            worst = np.zeros(n)
            np.maximum.at(worst, group[is_tested], off[is_tested])
            offs.append(worst[group])

    best, second = np.partition(offs, 1, axis=0)[:2]
    is_clear = (second > CLEAR_RATIO * best) & (second > ROUNDING * edge)
    return (by_edge[:n] != by_edge[n:]) & (best <= ROUNDING * edge) & is_clear


def _divided_twice(
    quads: Quads, points: Floats, chosen: Bools
) -> Steps[tuple[Ints, Floats, Floats]]:
    """Vertices (64 q,) at the loops of the chosen quads, divided twice, with places and unit
    normals (n, 3) of all on the limit surface.
    """
    faces = quads.start.reshape(-1, 4)
    is_near = np.zeros(quads.n, bool)
    is_near[faces[chosen]] = True
    is_near = _grown(faces, is_near)
    near = is_near[faces].any(axis=1)

    some, start = np.unique(faces[near], return_inverse=True)
    fine, places = Quads(start.reshape(-1), len(some)), points[some]
    for _ in range(2):
        fine, places = fine.divided(places)
        yield 0

    loops = fine.start.reshape(-1, 64)[chosen[near]].ravel()
    is_used = np.zeros(fine.n, bool)
    is_used[loops] = True
    normals = fine.limit_normals(places, is_used)
    yield 0
    return loops, fine.limit(places), normals


# larger meshes are judged face by face, as any other: curved throughout they would take twice the
# time
MOST_TRIANGLES = 10_000


@dataclass(frozen=True, eq=False)
class ExactLimit:
    """Triangles with an exact limit surface, in parts.

    is_face : (t,) triangles on any part
    normal : (f, 3) unit, of the vertices at their corners, NaN elsewhere
    rank : (t,) at an edge between two parts the higher one determines the edge; 0 without a part
    """

    parts: tuple[Splines | Subdivided, ...]
    is_face: Bools
    normal: Floats
    rank: Ints

    def faces(self, triangles: Ints) -> tuple[Floats, Floats]:
        """Places and unit normals (n, 15, 3) of such triangles (n,) at nodes and corners."""
        places, normals = np.empty((2, len(triangles), len(AT), 3))
        for part in self.parts:
            some = np.flatnonzero(part.is_face[triangles])
            places[some], normals[some] = part.faces(triangles[some])

        return places, normals


def exact_limit_steps(
    v: Vertices, edges: Edges, polygon: Ints, requested: Bools
) -> Steps[ExactLimit | None]:
    """Exact limit surface of the requested triangles (t,) of a mesh with triangles in polygons
    (t,).

    None if there is none, and for a mesh of more than MOST_TRIANGLES.
    """
    if len(polygon) > MOST_TRIANGLES:
        return None

    lines = find_quad_lines(v, edges, polygon)
    yield 0
    splines = yield from spline_steps(v, lines)
    rest = requested if splines is None else requested & ~splines.is_face
    subdivided = yield from subdivided_steps(v, lines, polygon, rest)
    parts = [part for part in (splines, subdivided) if part is not None]
    if not parts:
        return None

    normal = parts[0].normal
    for part in parts[1:]:
        normal = np.where(np.isnan(normal), part.normal, normal)

    # only splines pass through rounded vertices unchanged
    rank = np.zeros(len(polygon), np.int64)
    for part in reversed(parts):
        rank[part.is_face] = 2 if part is splines else 1

    return ExactLimit(tuple(parts), rank > 0, normal, rank)
