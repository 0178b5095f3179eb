"""The surface that was meant by a smooth-shaded mesh: a curved face over each smooth triangle.

Around each vertex a quartic height field over its tangent plane is fitted to the positions and normals of its
neighbours, with place and slope exact at the vertex. The fields of a triangle's three corners, blended, are sampled at
the nodes of a quartic triangle: 12 offsets from the facet. On an edge only the fields of its two ends count, so that
neighbours meet without a crack. Edges to what is not curved, and sharp ones, stay straight.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import comb

import numpy as np

from .. import kernel
from ..arrays import Bools, Floats, Ints, taken
from ..products import combine, solve_symmetric
from ..steps import Pauses
from ..vectors import dot, length_of, normalise
from .curved import (
    AT_NODES,
    CHUNK,
    FROM_NODES,
    MOST_OFFSET,
    N_NODES,
    N_TERMS,
    NODES,
    POWERS,
    CurvedFaces,
    by_term,
    cross,
    monomials,
    product,
    slopes,
    tangents,
    value,
)
from .meshes import Edges, areas_of, components

STEEPEST = np.cos(np.radians(40))  # corner normals further than this from the facet's contradict it
STEEPEST_INSIDE = np.cos(np.radians(60))  # so do normals of the curved face
BULGE = np.radians(4)  # edges that turn by less cannot bulge enough to matter
JUMP = 5.0  # a curvature that grows this much from one edge to the next, across a vertex, ...
SHORTER = 3.0  # ... on an edge this much shorter, means normals that belong to a bevel, not to the face beside it
SWEEPS, SETTLED = 40, 1e-10  # sweeps in which normals are found from vertices, and the change at which they end
LEAST_DISTANCE = 1e-12  # squared, of neighbours, in units of their mean distance: nearer ones would weigh all
LEAST_UPRIGHT = 0.2  # cosine to a vertex's normal: slopes of normals that lean further are taken for no steeper
STEPS = 2  # of a fixed point, each of which gains two orders: as many for all, or neighbours would not meet
MOVED, MOST_MOVED = 0.2, 0.5  # of the turn to a neighbour: found normals further from the mean have to prove themselves
STRAIGHT = 0.1  # ... by chords to neighbours, which contradict them by no more of it; noise and rims make it more
SWOLLEN = 3.0  # times the sag of an arc that turns as the normals do: a face beyond it follows a bevel beside it
UNTOLD = 0.01  # of an edge: so far faces may stand out besides, whose edges turn one way and back
AGREE = 1e-6  # radians: normals that differ by less move landings by 1e-3 px; those of fine meshes do, 1e-7 and less
TRUSTED = 0.2  # of what a face gains over its facet: where normals of noisy balls jump by 0.25 of it, it gains nothing
COPLANAR = 1e-4  # radians: facets that turn by less are one flat face in parts
# Where data are few the high degrees give way first. The factor makes it the same for all turns of the axes (Bombieri).
RIDGE = np.array([(1e-12, 1e-11, 1e-9, 1e-7)[a + b - 1] / comb(a + b, a) for a, b in POWERS])


@dataclass(frozen=True, eq=False)
class Vertices:
    """Vertices with one normal each: where normals differ around a vertex of the mesh, it counts more than once.

    at (f, 3), normal (f, 3), is_known (f,): the normal is one; of_corner (t, 3): which one a triangle's corner is;
    start (p,), end (p,): all directed pairs of neighbours, sorted by start; first (f + 1,): where each begins
    """

    at: Floats
    normal: Floats
    is_known: Bools
    of_corner: Ints
    start: Ints
    end: Ints
    first: Ints

    def by_valence(self, wanted: Bools) -> Iterator[tuple[Ints, Ints]]:
        """Wanted vertices (n,) of equal numbers of neighbours, some at a time, and their pairs (n, m)."""
        counts = np.diff(self.first)
        for m in np.unique(counts[wanted]):
            chosen = np.flatnonzero(wanted & (counts == m))
            for k in range(0, len(chosen), 2 * CHUNK):
                some = chosen[k : k + 2 * CHUNK]
                yield some, self.first[some, None] + np.arange(m)


def _find_vertices(
    vertices: Floats, triangles: Ints, corner_normals: Floats, is_usable: Bools, edges: Edges, is_joined: Bools
) -> Vertices:
    """Corners joined around each vertex across joined edges (e,), and their neighbours."""
    n = len(triangles)
    corner = 3 * np.arange(n)[:, None] + np.arange(3)
    of_corner = triangles.copy()
    # most vertices have joined edges only and are themselves; around the others corners are put together one by one
    beside = np.zeros((n, 3), bool)  # edges (t, 3) that are joined
    for t, e in ((edges.first, edges.corner_first), (edges.second, edges.corner_second)):
        beside[t[is_joined], e[is_joined]] = True
    whole = np.ones(len(vertices), bool)
    open_t, open_e = np.nonzero(~beside)
    whole[triangles[open_t, open_e]] = whole[triangles[open_t, (open_e + 1) % 3]] = False
    chosen = np.flatnonzero(~whole[triangles].ravel())
    if len(chosen):
        local = np.full(3 * n, -1)
        local[chosen] = np.arange(len(chosen))
        f, s, i, j = (x[is_joined] for x in (edges.first, edges.second, edges.corner_first, edges.corner_second))
        a = np.concatenate([corner[f, i], corner[f, (i + 1) % 3]])
        b = np.concatenate([corner[s, (j + 1) % 3], corner[s, j]])
        inside = (local[a] >= 0) & (local[b] >= 0)
        label = components(len(chosen), local[a[inside]], local[b[inside]])
        of_corner.reshape(-1)[chosen] = len(vertices) + label
    used, of_corner = np.unique(of_corner, return_inverse=True)
    of_corner = of_corner.reshape(n, 3)
    normal, at = np.zeros((len(used), 3)), np.empty((len(used), 3))
    at[of_corner] = taken(vertices, triangles)
    normal[of_corner[is_usable]] = corner_normals[is_usable]
    # each joined edge is met from both sides, once in each direction; the others have to be turned round as well
    a, b = of_corner.ravel(), np.roll(of_corner, -1, axis=1).ravel()
    lone = ~beside.ravel()
    start, end = np.concatenate([a, b[lone]]), np.concatenate([b, a[lone]])
    order = np.argsort(start, kind="stable")
    start, end = start[order], end[order]
    first = np.searchsorted(start, np.arange(len(used) + 1))
    return Vertices(at, normal, dot(normal, normal) > 0.5, of_corner, start, end, first)


@dataclass(frozen=True, eq=False)
class Fields:
    """Height fields over the tangent planes of vertices: z = size * sum c (x / size)^a (y / size)^b.

    axis_x, axis_y (f, 3) unit; size (f,) mean distance of the neighbours; coefficients (f, 14)
    """

    axis_x: Floats
    axis_y: Floats
    size: Floats
    coefficients: Floats


def _tangent_planes(v: Vertices) -> Fields:
    """Fields of height 0 over all vertices."""
    axis_x, axis_y = tangents(np.where(v.is_known[:, None], v.normal, [0.0, 0.0, 1.0]))
    away = taken(v.at, v.end) - taken(v.at, v.start)
    distance = length_of(away)
    size = np.bincount(v.start, distance, len(v.at)) / np.maximum(np.diff(v.first), 1)
    return Fields(axis_x, axis_y, size, np.zeros((len(v.at), N_TERMS)))


def _around(v: Vertices, fields: Fields, some: Ints, pairs: Ints) -> tuple[Floats, Floats, Floats, Floats, Bools]:
    """Neighbours (n, m) in the frame of their vertex, in units of its size: x, y, z; are they of use."""
    end = v.end[pairs]
    away = (taken(v.at, end) - v.at[some, None]) / fields.size[some, None, None]
    x, y = dot(away, fields.axis_x[some, None]), dot(away, fields.axis_y[some, None])
    return x, y, dot(away, v.normal[some, None]), dot(away, away), v.is_known[end]


def _gradients(v: Vertices, fields: Fields, some: Ints, pairs: Ints, normal: Floats) -> tuple[Floats, Floats]:
    """Slopes (n, m) of the surface at the neighbours, by x and by y in the frame of their vertex."""
    theirs = taken(normal, v.end[pairs])
    upright = np.maximum(dot(theirs, v.normal[some, None]), LEAST_UPRIGHT)
    return -dot(theirs, fields.axis_x[some, None]) / upright, -dot(theirs, fields.axis_y[some, None]) / upright


def _system(
    v: Vertices, fields: Fields, some: Ints, pairs: Ints, terms: slice
) -> tuple[Floats, Floats, Floats, Floats]:
    """Weighted rows (n, 3m, terms) of heights and slopes, weights, the normal equations' matrix; heights (n, m)."""
    x, y, z, distance, is_used = _around(v, fields, some, pairs)
    by_x, by_y = slopes(x, y)
    rows = np.concatenate([monomials(x, y), by_x, by_y], axis=1)[..., terms]
    # a height tells as much of the slope as the slope itself does, over its distance
    weights = np.concatenate(
        [2.0 / np.sqrt(np.maximum(distance, LEAST_DISTANCE)), np.ones_like(x), np.ones_like(x)], axis=1
    )
    weights *= np.tile(is_used, 3)
    rows = rows * weights[..., None]
    matrix = np.matmul(rows.transpose(0, 2, 1), rows)
    scale = np.einsum("nr,nr->n", weights, weights)[:, None] + 1.0
    diagonal = np.arange(matrix.shape[1])
    matrix[:, diagonal, diagonal] += RIDGE[terms] * scale
    return rows, weights, matrix, z


def _fit_fields(v: Vertices, wanted: Bools) -> Fields:
    """Fields with the vertex's own place and slope, through its neighbours, by least squares."""
    fields = _tangent_planes(v)
    if kernel.library() is not None:
        kernel.Fit(v, fields).fit_fields(wanted, RIDGE, fields.coefficients)
        return fields

    for some, pairs in v.by_valence(wanted):
        rows, weights, matrix, z = _system(v, fields, some, pairs, slice(2, None))
        right = np.concatenate([z, *_gradients(v, fields, some, pairs, v.normal)], axis=1) * weights
        solved = solve_symmetric(matrix, np.einsum("nrk,nr->nk", rows, right)[..., None])
        fields.coefficients[some, 2:] = solved[..., 0]
    return fields


def _find_normals(v: Vertices, wanted: Bools) -> Floats:
    """Normals (f, 3) of the surface through the vertices, where the given ones are only means of the faces around.

    The slope at a vertex follows from the heights and slopes of its neighbours (a compact scheme: fourth order from
    one ring). Slopes and neighbours' slopes are made to agree by sweeps, which at least halve the error.
    """
    normal = v.normal.copy()
    if kernel.library() is not None:
        kernel.Fit(v, _tangent_planes(v)).settle_normals(wanted, RIDGE, normal, SWEEPS, SETTLED)
    else:
        _settle_normals(v, _tangent_planes(v), wanted, normal)

    # where the mesh is too irregular to tell, the mean is the better guess
    turn = length_of(taken(v.normal, v.end) - taken(v.normal, v.start))
    with np.errstate(invalid="ignore"):
        turn = np.maximum.reduceat(turn, v.first[:-1])
        moved = length_of(normal - v.normal)
        is_near = moved <= MOVED * turn
        is_straight = (moved <= MOST_MOVED * turn) & (_bend(v, normal) < STRAIGHT * turn)

    # normals are found together: one far from the mean is no better than the worst of its neighbours
    is_refused = ~(is_near | is_straight)
    has_refused = np.bincount(v.start, is_refused[v.end], len(v.at)) > 0
    is_believed = is_near | (is_straight & ~has_refused)
    return np.where(is_believed[:, None], normal, v.normal)


def _bend(v: Vertices, normal: Floats) -> Floats:
    """By how much chords to neighbours contradict the normals (f, 3) at their ends, per vertex (f,), rad rms.

    Of a parabola a chord has the mean of the slopes at its ends.
    """
    chord = normalise(taken(v.at, v.end) - taken(v.at, v.start))
    unlike = dot(taken(normal, v.end) + taken(normal, v.start), chord) / 2
    return np.sqrt(np.bincount(v.start, unlike**2, len(v.at)) / np.maximum(np.diff(v.first), 1))


def _settle_normals(v: Vertices, fields: Fields, wanted: Bools, normal: Floats) -> None:
    """Let the wanted ones of normals (f, 3) agree with those of their neighbours."""
    solvers = []
    for some, pairs in v.by_valence(wanted):
        rows, weights, matrix, z = _system(v, fields, some, pairs, slice(None))
        weighted = rows * weights[..., None]
        slope = np.zeros((len(some), N_TERMS, 2))
        slope[:, [0, 1], [0, 1]] = 1.0
        # rows of the pseudo-inverse that give the slope; the matrix is symmetric
        inverse = np.matmul(weighted, solve_symmetric(matrix, slope))
        m = pairs.shape[1]
        solvers.append((some, pairs, np.einsum("nrk,nr->nk", inverse[:, :m], z), inverse[:, m:]))

    for _ in range(SWEEPS):
        change, before = 0.0, normal.copy()
        for some, pairs, from_heights, from_slopes in solvers:
            theirs = np.concatenate(_gradients(v, fields, some, pairs, before), axis=1)
            slope = from_heights + np.einsum("nrk,nr->nk", from_slopes, theirs)
            found = v.normal[some] - slope[:, :1] * fields.axis_x[some] - slope[:, 1:] * fields.axis_y[some]
            found = normalise(found)
            change = max(change, float(np.abs(found - before[some]).max(initial=0.0)))
            normal[some] = found
        if change < SETTLED:
            break


def _contradicted(v: Vertices, normal: Floats, wanted: Bools) -> Bools:
    """Pairs (p,) along which the normals turn as those of a bevel do, on the large face beside it.

    Curvature changes little from one edge to the next one straight on. Where it jumps up on a much shorter edge, the
    normal between them belongs to that edge.
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


def _node_offsets(v: Vertices, fields: Fields, corner: Ints) -> Floats:
    """Offsets (12, 3, n) of the nodes of triangles with corners (n, 3), from the facet to the blended fields.

    All fields are met along one direction, blended from the corners' normals: met along different ones they would
    differ sideways by the third power of the edge, which costs an order.
    """
    weight = NODES**2 / (NODES**2).sum(axis=1, keepdims=True)
    if kernel.library() is not None:
        return kernel.Fit(v, fields).find_offsets(fields.coefficients, NODES, weight, corner)

    offsets = np.zeros((N_NODES, 3, len(corner)))
    at, normal = taken(v.at, corner), taken(v.normal, corner)
    for i in range(3):
        own = corner[:, i]
        size = fields.size[own]
        frame = fields.axis_x[own], fields.axis_y[own], v.normal[own]
        sides = [[dot(at[:, (i + s) % 3] - at[:, i], axis) / size for axis in frame] for s in (1, 2)]
        leans = [[dot(normal[:, (i + s) % 3], axis) for axis in frame] for s in (1, 2)]
        c = np.ascontiguousarray(fields.coefficients[own].T)
        for node in np.flatnonzero(weight[:, i]):
            li, lj, lk = (NODES[node, (i + s) % 3] for s in range(3))
            x, y, z = (lj * a + lk * b for a, b in zip(*sides, strict=True))
            dx, dy, dz = (lj * a + lk * b for a, b in zip(*leans, strict=True))
            dz += li
            height = (value(c, x, y) - z) / dz
            for _ in range(STEPS):
                height = (value(c, x + height * dx, y + height * dy) - z) / dz
            direction = sum(NODES[node, m] * normal[:, m].T for m in range(3))
            offsets[node] += weight[node, i] * (size * height) * direction
    return offsets


_AT = np.vstack([NODES, np.eye(3)])
_BY_U, _BY_V = slopes(*_AT[:, 1:].T)  # (15, 14) of the terms
_DU_AT, _DV_AT = _BY_U @ FROM_NODES, _BY_V @ FROM_NODES  # (15, 12) from offsets
N_ON_EDGES = N_NODES - 3


def _normals_at_nodes(offsets: Floats, corners: Floats) -> Floats:
    """Unit normals (n, 15, 3) at nodes and corners of curved faces of node offsets (12, 3, n) over facets (n, 3, 3)."""
    by_u, by_v = (
        combine(matrix, offsets.reshape(N_NODES, -1)).reshape(len(_AT), 3, -1) + (corners[:, c] - corners[:, 0]).T
        for matrix, c in ((_DU_AT, 1), (_DV_AT, 2))
    )
    normal = cross(by_u.swapaxes(0, 1), by_v.swapaxes(0, 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        normal /= np.sqrt(product(normal, normal))
    return normal.transpose(2, 1, 0)


def _is_whole(offsets: Floats, corners: Floats, normals: Floats, facets: Floats) -> Bools:
    """Do curved faces, of node offsets (12, 3, n) and normals (n, 15, 3), stay near facets and look the same way?"""
    longest = length_of(corners[:, 1:] - corners[:, :1]).max(axis=1)
    with np.errstate(invalid="ignore"):
        is_near = np.sqrt((offsets**2).sum(axis=1).max(axis=0)) < MOST_OFFSET * longest
        return is_near & (np.einsum("nkc,nc->nk", normals, facets).min(axis=1) > STEEPEST_INSIDE)


def _is_swollen(offsets: Floats, corners: Floats, at_corners: Floats) -> Bools:
    """Do curved faces stand out, or in, further than the normals (n, 3, 3) at their corners (n, 3, 3) account for?"""
    turned, along = (np.roll(x, -1, axis=1) - x for x in (at_corners, corners))
    sag = dot(turned, along) / 8  # of arcs over the edges
    height = np.einsum("kcn,nc->kn", offsets, normalise(at_corners.sum(axis=1)))
    more = UNTOLD * length_of(along).max(axis=1)
    with np.errstate(invalid="ignore"):
        stands_out = height.max(axis=0) > SWOLLEN * np.maximum(sag.max(axis=1), 0) + more
        stands_in = height.min(axis=0) < SWOLLEN * np.minimum(sag.min(axis=1), 0) - more
    return stands_out | stands_in


def _quadratic(points: Floats) -> Floats:
    """All six products of two of the barycentric coordinates of points (n, 3)."""
    return np.stack([points[:, i] * points[:, j] for i in range(3) for j in range(i, 3)], axis=1)


# (3, 15): values at the nodes inside, from those at the other nodes and the corners; exact for quadratics
_INWARD = np.zeros((N_NODES - N_ON_EDGES, len(_AT)))
_AROUND = np.r_[:N_ON_EDGES, N_NODES : len(_AT)]
_INWARD[:, _AROUND] = _quadratic(_AT[N_ON_EDGES:N_NODES]) @ np.linalg.pinv(_quadratic(_AT[_AROUND]))


@dataclass(frozen=True, eq=False)
class _Beside:
    """What lies across the edges of p curved faces.

    row (t,) of each triangle's curved face, -1 where it has none; triangle (p, 3) where the surface runs on curved, -1
    elsewhere, and its edge (p, 3); is_drawn (p, 3): where it runs on as drawn
    """

    row: Ints
    triangle: Ints
    edge: Ints
    is_drawn: Bools

    @classmethod
    def of(cls, chosen: Ints, n_triangles: int, edges: Edges, is_joined: Bools) -> "_Beside":
        """Of the chosen triangles (p,), of n."""
        row = np.full(n_triangles, -1, np.int32)
        row[chosen] = np.arange(len(chosen))
        triangle = np.full((len(chosen), 3), -1, np.int32)
        edge = np.zeros((len(chosen), 3), np.int8)
        is_drawn = np.zeros((len(chosen), 3), bool)
        f, s, i, j = (x[is_joined] for x in (edges.first, edges.second, edges.corner_first, edges.corner_second))
        both = (row[f] >= 0) & (row[s] >= 0)
        triangle[row[f[both]], i[both]], edge[row[f[both]], i[both]] = s[both], j[both]
        triangle[row[s[both]], j[both]], edge[row[s[both]], j[both]] = f[both], i[both]
        for here, e in ((f, i), (s, j)):
            ends = ~both & (row[here] >= 0)
            is_drawn[row[here[ends]], e[ends]] = True
        return cls(row, triangle, edge, is_drawn)


def _agree(own: Floats, at_corners: Floats, area: Floats, beside: _Beside) -> tuple[Floats, Floats]:
    """Normals (p, 12, 3) at the nodes that neighbours agree on, and about how far they are off, rad, at the first 9.

    On an edge it is the mean of both sides, and what a facet has where it runs on as drawn; inside it is the face's
    own, changed as the edges are. Both sides interpolate the same numbers along an edge, so that they agree all along.
    A wrong height turns the normal by itself over the distance to the edge: each side weighs by its area squared. Sides
    that weigh the same are off by as much as they differ; the less one of them weighs the less it matters.

    Parameters
    ----------
    own : (p, 15, 3) of the faces; at_corners : (p, 3, 3) of the vertices; area (p,)
    """
    squared, agreed = area**2, own[:, :N_NODES].copy()
    jump = np.zeros((len(own), N_ON_EDGES))
    for k in range(0, len(own), CHUNK):
        some = slice(k, k + CHUNK)
        corners = at_corners[some]
        facets = np.matmul(NODES[:N_ON_EDGES], corners)
        change = np.zeros_like(own[some])
        change[:, N_NODES:] = corners - own[some, N_NODES:]
        for edge in range(3):
            nodes = slice(3 * edge, 3 * edge + 3)
            mine, found = own[some, nodes], agreed[some, nodes]
            triangle, is_drawn = beside.triangle[some, edge], beside.is_drawn[some, edge]
            other = beside.row[triangle]
            # it runs the other way there
            first = other * len(_AT) + 3 * beside.edge[some, edge]
            theirs = taken(own.reshape(-1, 3), first[:, None] + [2, 1, 0])
            both = squared[some] + squared[other]
            my_part, their_part = squared[some] / both, squared[other] / both
            found[:] = normalise(my_part[:, None, None] * mine + their_part[:, None, None] * theirs)
            jump[some, nodes] = length_of(mine - theirs) * 2 * np.sqrt(my_part * their_part)[:, None]

            alone = np.flatnonzero(triangle < 0)
            found[alone], jump[k + alone, nodes] = mine[alone], 0.0
            found[is_drawn] = facets[is_drawn, nodes]
            change[:, nodes] = found - mine
        differ = np.flatnonzero(np.abs(change).max(axis=(1, 2)) > AGREE / 10)  # others keep their own normals
        agreed[k + differ, N_ON_EDGES:] += np.matmul(_INWARD, change[differ])
    return agreed, jump


def _is_trusted(
    corners: Floats, coefficients: Floats, at_corners: Floats, vertex: Ints, agreed: Floats, jump: Floats
) -> Bools:
    """Which curved faces (p,) are nearer to what was meant than their facets, as far as the fit can tell by itself.

    The jump of normals between neighbours is about their error. The gain of a face is the angle by which its normals
    differ from the facet's, and by which its height turns them. Jumps have to be small beside gains: around each vertex
    of the face, on the whole, or around one vertex and in the face itself, so that a spoilt face takes few with it.

    Parameters
    ----------
    corners : (p, 3, 3) m; coefficients : (p, 14, 3) m; at_corners : (p, 3, 3) unit normals of the vertices (p, 3)
    agreed, jump : of `_agree`
    """
    away = agreed - normalise(np.matmul(NODES, at_corners))
    turned = np.einsum("nkc,nkc->n", away, away) / N_NODES
    # a ray that meets the face later, by its height, finds it turned by so much more
    height = length_of(np.matmul(AT_NODES, coefficients)).max(axis=1)
    along, turn = (length_of(np.roll(x, -1, axis=1) - x).max(axis=1) for x in (corners, at_corners))
    unsure, gained = (jump**2).mean(axis=1), (np.sqrt(turned) + height * turn / along) ** 2

    def is_believed(unsure: Floats, gained: Floats) -> Bools:
        return unsure <= TRUSTED**2 * gained + AGREE**2

    is_fine = is_believed(*(np.bincount(vertex.ravel(), np.repeat(x, 3)) for x in (unsure, gained)))[vertex]
    return is_fine.all(axis=1) | (is_fine.any(axis=1) & is_believed(unsure, gained))


def make_curved(
    vertices: Floats,
    triangles: Ints,
    corner_normals: Floats,
    wanted: Bools,
    edges: Edges,
    is_joined: Bools,
    facets: Floats,
    has_mean_normals: bool,
    is_automatic: bool = False,
) -> Pauses[tuple[CurvedFaces | None, Bools]]:
    """Curved faces over those of the wanted triangles whose normals agree with their shape; which (t,) are doubted.

    Parameters
    ----------
    vertices, triangles : (v, 3) m, (t, 3)
    corner_normals : (t, 3, 3) unit; a flat triangle has its own three times
    wanted : (t,) smooth triangles
    edges : of the triangles; is_joined : (e,) those at whose ends the corner normals agree
    facets : (t, 3) normals of the triangles, unit
    has_mean_normals : normals are means of the faces around: the surface's own are found from the vertices
    is_automatic : faces that are no nearer to what was meant than the facets are doubted, and left flat
    """
    corners = taken(vertices, triangles)
    area, asked = areas_of(corners), wanted
    least = np.einsum("tij,tj->ti", corner_normals, facets).min(axis=1)
    wanted = wanted & (least > STEEPEST)
    is_joined = is_joined & ~edges.is_same_way
    v = _find_vertices(vertices, triangles, corner_normals, least > 0, edges, is_joined)
    is_used = np.zeros(len(v.at), bool)
    is_used[v.of_corner[wanted]] = True
    given = v.normal
    yield 0
    if has_mean_normals:
        v = replace(v, normal=_find_normals(v, is_used))
        wanted &= (np.einsum("tij,tj->ti", taken(v.normal, v.of_corner), facets) > STEEPEST).all(axis=1)
    yield 0
    is_bad = _contradicted(v, v.normal, is_used)
    if is_bad.any():
        n = len(v.at)
        bad = np.concatenate([v.start[is_bad] * n + v.end[is_bad], v.end[is_bad] * n + v.start[is_bad]])
        wanted &= ~np.isin(v.of_corner * n + np.roll(v.of_corner, -1, axis=1), bad).any(axis=1)
    # a flat face in parts is curved as a whole or not at all
    is_flat = is_joined & (np.abs(taken(facets, edges.first) - taken(facets, edges.second)).max(axis=1) < COPLANAR)
    face = components(len(triangles), edges.first[is_flat], edges.second[is_flat])
    wanted &= ~np.isin(face, face[asked & ~wanted])
    # nor is it when nothing around it is
    among = is_joined & ~is_flat & wanted[edges.first] & wanted[edges.second]
    wanted &= np.isin(face, face[np.concatenate([edges.first[among], edges.second[among]])])
    is_used[:] = False
    is_used[v.of_corner[wanted]] = True
    yield 0
    fields = _fit_fields(v, is_used)

    chosen = np.flatnonzero(wanted)
    coefficients, own = np.empty((len(chosen), N_TERMS, 3)), np.empty((len(chosen), len(_AT), 3))
    is_whole, is_swollen = np.empty((2, len(chosen)), bool)
    for k in range(0, len(chosen), CHUNK):
        some = slice(k, k + CHUNK)
        at, of_corner = taken(corners, chosen[some]), v.of_corner[chosen[some]]
        offsets = _node_offsets(v, fields, of_corner)
        own[some] = _normals_at_nodes(offsets, at)
        is_whole[some] = _is_whole(offsets, at, own[some], taken(facets, chosen[some]))
        is_swollen[some] = _is_swollen(offsets, at, taken(v.normal, of_corner))
        fitted = combine(FROM_NODES, offsets.reshape(N_NODES, -1)).reshape(N_TERMS, 3, -1)
        coefficients[some] = fitted.transpose(2, 0, 1)
        yield 0
    if not is_automatic:  # Automatic looks at swollen faces and their neighbours together
        is_whole &= ~np.isin(face[chosen], face[chosen[is_swollen]])
    if not is_whole.all():
        chosen, coefficients, own, is_swollen = (x[is_whole] for x in (chosen, coefficients, own, is_swollen))
    vertex, beside = v.of_corner[chosen], _Beside.of(chosen, len(triangles), edges, is_joined)
    yield 0
    agreed, jump = _agree(own, taken(v.normal, vertex), area[chosen], beside)
    yield 0
    is_doubted = np.zeros(len(triangles), bool)
    if is_automatic:
        is_trusted = ~is_swollen & _is_trusted(
            taken(corners, chosen), coefficients, taken(v.normal, vertex), vertex, agreed, jump
        )
        if not is_trusted.all():
            is_trusted &= ~np.isin(face[chosen], face[chosen[~is_trusted]])
            is_doubted[chosen] = ~is_trusted
            chosen, coefficients, own = chosen[is_trusted], coefficients[is_trusted], own[is_trusted]
            vertex, beside = vertex[is_trusted], _Beside.of(chosen, len(triangles), edges, is_joined)
    if not len(chosen):
        return None, is_doubted

    # what is drawn has the normals that were given: so have the faces around its vertices
    is_drawn = np.zeros(len(v.at), bool)
    is_drawn[v.of_corner[beside.row < 0]] = True
    normal = np.where(is_drawn[:, None], given, v.normal)
    if len(chosen) < len(triangles):
        yield 0
        agreed, jump = _agree(own, taken(normal, vertex), area[chosen], beside)

    yield 0
    is_straight = beside.triangle < 0
    held = np.flatnonzero(is_straight.any(axis=1))
    bent_row = np.full(len(chosen), -1, np.int32)
    bent_row[held] = np.arange(len(held))
    bent = coefficients[held]
    offsets = np.matmul(AT_NODES, bent)
    offsets[:, :N_ON_EDGES] *= ~np.repeat(is_straight[held], 3, axis=1)[..., None]
    coefficients[held] = np.matmul(FROM_NODES, offsets)

    off = length_of(np.concatenate([agreed, taken(normal, vertex)], axis=1) - own).max(axis=1)
    with_terms = np.flatnonzero(is_straight.any(axis=1) | (off > AGREE))
    normal_row = np.full(len(chosen), -1, np.int32)
    normal_row[with_terms] = np.arange(len(with_terms))
    normal_terms = np.matmul(FROM_NODES, agreed[with_terms] - np.matmul(NODES, taken(normal, vertex[with_terms])))
    curved = CurvedFaces(
        corners=corners,
        row=beside.row,
        coefficients=by_term(coefficients),
        neighbour=beside.triangle,
        neighbour_edge=beside.edge,
        vertex=vertex,
        vertex_normal=normal,
        normal_row=normal_row,
        normal_terms=by_term(normal_terms),
        jump=jump[:, 1::3].max(axis=1),  # in the middles of edges
        bent_row=bent_row,
        bent=bent,
    )
    return curved, is_doubted
