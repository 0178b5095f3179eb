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

from .meshes import SAME_NORMAL, Edges, components, edge_corners
from .optics import dot, normalise
from .rig import Bools, Floats, Ints

CHUNK = 1 << 12  # rays or faces worked on together: their arrays stay in the cache
STEEPEST = np.cos(np.radians(40))  # corner normals further than this from the facet's contradict it
STEEPEST_INSIDE = np.cos(np.radians(60))  # so do normals of the curved face
MOST_OFFSET = 0.3  # of the longest edge: a curved face further from its facet than this is none
BULGE = np.radians(4)  # edges that turn by less cannot bulge enough to matter
JUMP = 5.0  # a curvature that grows this much from one edge to the next, across a vertex, ...
SHORTER = 3.0  # ... on an edge this much shorter, means normals that belong to a bevel, not to the face beside it
SWEEPS, SETTLED = 40, 1e-10  # sweeps in which normals are found from vertices, and the change at which they end
SLIGHT = 0.1  # radians: normals that turn by less meet their fields in one fixed-point step, which gains two orders
ITERATIONS = 12  # of Newton's method
PATIENCE, HOPELESS = 6, 0.05  # after so many it is given up for rays whose steps in u, v are still larger
CONVERGED = 3e-6  # of a step in u, v: what is left after it is less than its square
BEYOND = 1e-10  # barycentric slack, so that a ray through an edge meets a face
WALKS = 8  # faces a root may wander over
FARTHEST = 0.2  # of the turn to a neighbour: a found normal further from the mean than this is not believed
COPLANAR = 1e-4  # radians: facets that turn by less are one flat face in parts
FINE = np.radians(3)  # the mesh that is asked for hits turns by less than this between neighbours
MOST_PARTS = 8  # parts of an edge in that mesh
HIGHER = 1.5  # times the largest sag found at the middles of its edges: how far it stands in front

POWERS = [(a, d - a) for d in range(1, 5) for a in range(d, -1, -1)]  # of u and v, or x and y: 14 terms
N_TERMS = len(POWERS)
# Where data are few the high degrees give way first. The factor makes it the same for all turns of the axes (Bombieri).
RIDGE = np.array([(1e-12, 1e-11, 1e-9, 1e-7)[a + b - 1] / comb(a + b, a) for a, b in POWERS])


def _powers(x: Floats) -> list[Floats]:
    """x^0 to x^4, by products: a general power is many times slower."""
    return [np.ones_like(x), x, x * x, x * x * x, (x * x) * (x * x)]


def _terms(x: Floats, y: Floats) -> Floats:
    """All 14 terms x^a y^b, along a new last axis."""
    px, py = _powers(x), _powers(y)
    return np.stack([px[a] * py[b] for a, b in POWERS], axis=-1)


def _slopes(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Derivatives of all 14 terms by x and by y."""
    px, py = _powers(x), _powers(y)
    by_x = [a * px[max(a - 1, 0)] * py[b] for a, b in POWERS]
    by_y = [b * px[a] * py[max(b - 1, 0)] for a, b in POWERS]
    return np.stack(by_x, axis=-1), np.stack(by_y, axis=-1)


def grid(k: int) -> tuple[Floats, Ints]:
    """Points of a triangle whose edges are cut into k parts: barycentric (n, 3); and its k^2 parts (k^2, 3)."""
    index = {}
    for j in range(k + 1):
        for i in range(k + 1 - j):
            index[i, j] = len(index)
    points = np.array([(k - i - j, i, j) for i, j in index]) / k
    up = [(index[i, j], index[i + 1, j], index[i, j + 1]) for j in range(k) for i in range(k - j)]
    down = [(index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]) for j in range(k - 1) for i in range(k - 1 - j)]
    return points, np.array(up + down)


def _nodes() -> Floats:
    """Barycentric coordinates (12, 3) of the free nodes: three on each edge (from corner e to e + 1), three inside."""
    on_edges = [np.roll([1 - s, s, 0], e) for e in range(3) for s in (0.25, 0.5, 0.75)]
    inside = [np.roll([0.5, 0.25, 0.25], e) for e in range(3)]
    return np.array(on_edges + inside)


NODES = _nodes()
N_NODES = len(NODES)
_AT_NODES = _terms(NODES[:, 1], NODES[:, 2])
_AT_CORNERS = _terms(np.array([1.0, 0.0]), np.array([0.0, 1.0]))  # where the offset is 0; at corner 0 all terms are
FROM_NODES = np.linalg.inv(np.vstack([_AT_NODES, _AT_CORNERS]))[:, :N_NODES]  # (14, 12): coefficients from offsets


def _lower(degree: int) -> Floats:
    """Matrix (14, 14): coefficients of the face of a lower degree through the same surface, from those of a quartic."""
    points = grid(degree)[0][1:]  # all but corner 0, where there is no offset
    few = [k for k, power in enumerate(POWERS) if sum(power) <= degree]
    values = _terms(points[:, 1], points[:, 2])
    matrix = np.zeros((N_TERMS, N_TERMS))
    matrix[few] = np.linalg.solve(values[:, few], values)
    return matrix


LOWER = {degree: _lower(degree) for degree in (2, 3)}


@dataclass(frozen=True, eq=False)
class _Vertices:
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
) -> _Vertices:
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
    at[of_corner] = vertices[triangles]
    normal[of_corner[is_usable]] = corner_normals[is_usable]
    # each joined edge is met from both sides, once in each direction; the others have to be turned round as well
    a, b = of_corner.ravel(), np.roll(of_corner, -1, axis=1).ravel()
    lone = ~beside.ravel()
    start, end = np.concatenate([a, b[lone]]), np.concatenate([b, a[lone]])
    order = np.argsort(start, kind="stable")
    start, end = start[order], end[order]
    first = np.searchsorted(start, np.arange(len(used) + 1))
    return _Vertices(at, normal, dot(normal, normal) > 0.5, of_corner, start, end, first)


@dataclass(frozen=True, eq=False)
class _Fields:
    """Height fields over the tangent planes of vertices: z = size * sum c (x / size)^a (y / size)^b.

    axis_x, axis_y (f, 3) unit; size (f,) mean distance of the neighbours; coefficients (f, 14)
    """

    axis_x: Floats
    axis_y: Floats
    size: Floats
    coefficients: Floats


def _tangents(normal: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors (f, 3) perpendicular to normals and to each other."""
    # Duff et al., Building an Orthonormal Basis, Revisited (JCGT 2017)
    x, y, z = normal.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return (
        np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1),
        np.stack([b, sign + y * y * a, -y], axis=1),
    )


def _around(v: _Vertices, fields: _Fields, some: Ints, pairs: Ints) -> tuple[Floats, Floats, Floats, Floats, Bools]:
    """Neighbours (n, m) in the frame of their vertex, in units of its size: x, y, z; are they of use."""
    end = v.end[pairs]
    away = (v.at[end] - v.at[some, None]) / fields.size[some, None, None]
    x, y = dot(away, fields.axis_x[some, None]), dot(away, fields.axis_y[some, None])
    return x, y, dot(away, v.normal[some, None]), dot(away, away), v.is_known[end]


def _gradients(v: _Vertices, fields: _Fields, some: Ints, pairs: Ints, normal: Floats) -> tuple[Floats, Floats]:
    """Slopes (n, m) of the surface at the neighbours, by x and by y in the frame of their vertex."""
    theirs = normal[v.end[pairs]]
    upright = np.maximum(dot(theirs, v.normal[some, None]), 0.2)
    return -dot(theirs, fields.axis_x[some, None]) / upright, -dot(theirs, fields.axis_y[some, None]) / upright


def _system(v: _Vertices, fields: _Fields, some: Ints, pairs: Ints, terms: slice) -> tuple[Floats, Floats, Floats]:
    """Weighted rows (n, 3m, terms) of heights and slopes, weights (n, 3m), and the normal equations' matrix."""
    x, y, _, distance, is_used = _around(v, fields, some, pairs)
    by_x, by_y = _slopes(x, y)
    rows = np.concatenate([_terms(x, y), by_x, by_y], axis=1)[..., terms]
    # a height tells as much of the slope as the slope itself does, over its distance
    weights = np.concatenate([2.0 / np.sqrt(np.maximum(distance, 1e-12)), np.ones_like(x), np.ones_like(x)], axis=1)
    weights *= np.tile(is_used, 3)
    rows = rows * weights[..., None]
    matrix = np.matmul(rows.transpose(0, 2, 1), rows)
    scale = np.einsum("nr,nr->n", weights, weights)[:, None] + 1.0
    diagonal = np.arange(matrix.shape[1])
    matrix[:, diagonal, diagonal] += RIDGE[terms] * scale
    return rows, weights, matrix


def _fit_fields(v: _Vertices, wanted: Bools) -> _Fields:
    """Fields with the vertex's own place and slope, through its neighbours, by least squares."""
    n = len(v.at)
    axis_x, axis_y = _tangents(np.where(v.is_known[:, None], v.normal, [0.0, 0.0, 1.0]))
    fields = _Fields(axis_x, axis_y, _sizes(v), np.zeros((n, N_TERMS)))
    for some, pairs in v.by_valence(wanted):
        rows, weights, matrix = _system(v, fields, some, pairs, slice(2, None))
        z = _around(v, fields, some, pairs)[2]
        right = np.concatenate([z, *_gradients(v, fields, some, pairs, v.normal)], axis=1) * weights
        solved = np.linalg.solve(matrix, np.einsum("nrk,nr->nk", rows, right)[..., None])
        fields.coefficients[some, 2:] = solved[..., 0]
    return fields


def _sizes(v: _Vertices) -> Floats:
    """Mean distance (f,) of each vertex's neighbours."""
    distance = np.linalg.norm(v.at[v.end] - v.at[v.start], axis=1)
    return np.bincount(v.start, distance, len(v.at)) / np.maximum(np.diff(v.first), 1)


def _find_normals(v: _Vertices, wanted: Bools) -> Floats:
    """Normals (f, 3) of the surface through the vertices, where the given ones are only means of the faces around.

    The slope at a vertex follows from the heights and slopes of its neighbours (a compact scheme: fourth order from
    one ring). Slopes and neighbours' slopes are made to agree by sweeps, which at least halve the error.
    """
    axis_x, axis_y = _tangents(np.where(v.is_known[:, None], v.normal, [0.0, 0.0, 1.0]))
    fields = _Fields(axis_x, axis_y, _sizes(v), np.empty((0, N_TERMS)))
    solvers = []
    for some, pairs in v.by_valence(wanted):
        rows, weights, matrix = _system(v, fields, some, pairs, slice(None))
        weighted = rows * weights[..., None]
        slope = np.zeros((len(some), N_TERMS, 2))
        slope[:, [0, 1], [0, 1]] = 1.0
        # rows of the pseudo-inverse that give the slope; the matrix is symmetric
        inverse = np.matmul(weighted, np.linalg.solve(matrix, slope))
        m = pairs.shape[1]
        z = _around(v, fields, some, pairs)[2]
        solvers.append((some, pairs, np.einsum("nrk,nr->nk", inverse[:, :m], z), inverse[:, m:]))
    normal = v.normal.copy()
    for _ in range(SWEEPS):
        change = 0.0
        for some, pairs, from_heights, from_slopes in solvers:
            theirs = np.concatenate(_gradients(v, fields, some, pairs, normal), axis=1)
            slope = from_heights + np.einsum("nrk,nr->nk", from_slopes, theirs)
            found = v.normal[some] - slope[:, :1] * axis_x[some] - slope[:, 1:] * axis_y[some]
            found = normalise(found)
            change = max(change, float(np.abs(found - normal[some]).max(initial=0.0)))
            normal[some] = found
        if change < SETTLED:
            break
    # where the mesh is too irregular to tell, the mean is the better guess
    turn = np.linalg.norm(v.normal[v.end] - v.normal[v.start], axis=1)
    with np.errstate(invalid="ignore"):
        moved = np.linalg.norm(normal - v.normal, axis=1)
        is_sane = moved <= FARTHEST * np.maximum.reduceat(turn, v.first[:-1])
    return np.where(is_sane[:, None], normal, v.normal)


def _contradicted(v: _Vertices, normal: Floats, wanted: Bools) -> Bools:
    """Pairs (p,) along which the normals turn as those of a bevel do, on the large face beside it.

    Curvature changes little from one edge to the next one straight on. Where it jumps up on a much shorter edge, the
    normal between them belongs to that edge.
    """
    away = v.at[v.end] - v.at[v.start]
    length = np.linalg.norm(away, axis=1)
    direction = away / np.maximum(length, 1e-300)[:, None]
    turn = np.abs(dot(normal[v.end] - normal[v.start], direction))
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


def _node_offsets(v: _Vertices, fields: _Fields, corner: Ints) -> Floats:
    """Offsets (12, 3, n) of the nodes of triangles with corners (n, 3), from the facet to the blended fields.

    All fields are met along one direction, blended from the corners' normals: met along different ones they would
    differ sideways by the third power of the edge, which costs an order.
    """
    n = len(corner)
    offsets = np.zeros((N_NODES, 3, n))
    weight = NODES**2 / (NODES**2).sum(axis=1, keepdims=True)
    at, normal = v.at[corner], v.normal[corner]
    for i in range(3):
        own = corner[:, i]
        size = fields.size[own]
        frame = fields.axis_x[own], fields.axis_y[own], v.normal[own]
        sides = [[dot(at[:, (i + s) % 3] - at[:, i], axis) / size for axis in frame] for s in (1, 2)]
        leans = [[dot(normal[:, (i + s) % 3], axis) for axis in frame] for s in (1, 2)]
        n_steps = 1 if max(np.abs(lean).max() for lean in leans[0][:2] + leans[1][:2]) < SLIGHT else 2
        c = np.ascontiguousarray(fields.coefficients[own].T)
        for node in np.flatnonzero(weight[:, i]):
            li, lj, lk = (NODES[node, (i + s) % 3] for s in range(3))
            x, y, z = (lj * a + lk * b for a, b in zip(*sides, strict=True))
            dx, dy, dz = (lj * a + lk * b for a, b in zip(*leans, strict=True))
            dz += li
            height = (_value(c, x, y) - z) / dz
            for _ in range(n_steps):
                height = (_value(c, x + height * dx, y + height * dy) - z) / dz
            direction = sum(NODES[node, m] * normal[:, m].T for m in range(3))
            offsets[node] += weight[node, i] * (size * height) * direction
    return offsets


def _value(c: Floats, u: Floats, v: Floats) -> Floats:
    """Value of the polynomial with coefficients (14, ...) at u, v."""
    u1, v1, u2, uv, v2, u3, u2v, uv2, v3, u4, u3v, u2v2, uv3, v4 = c
    in_v = v1 + u * (uv + u * (u2v + u * u3v)) + v * (v2 + u * (uv2 + u * u2v2) + v * (v3 + u * uv3 + v * v4))
    return u * (u1 + u * (u2 + u * (u3 + u * u4))) + v * in_v


def _value_and_slopes(c: Floats, u: Floats, v: Floats) -> tuple[Floats, Floats, Floats]:
    """Value of the polynomial with coefficients (14, ...) at u, v, and its derivatives by u and v."""
    u1, v1, u2, uv, v2, u3, u2v, uv2, v3, u4, u3v, u2v2, uv3, v4 = c
    a1 = v1 + u * (uv + u * (u2v + u * u3v))  # of v
    a2 = v2 + u * (uv2 + u * u2v2)  # of v^2
    a3 = v3 + u * uv3
    value = u * (u1 + u * (u2 + u * (u3 + u * u4))) + v * (a1 + v * (a2 + v * (a3 + v * v4)))
    by_v = a1 + v * (2 * a2 + v * (3 * a3 + v * (4 * v4)))
    by_u = u1 + u * (2 * u2 + u * (3 * u3 + u * (4 * u4)))
    by_u += v * (uv + u * (2 * u2v + 3 * (u * u3v)) + v * (uv2 + 2 * (u * u2v2) + v * uv3))
    return value, by_u, by_v


_DU_AT, _DV_AT = (d @ FROM_NODES for d in _slopes(*np.vstack([NODES, np.eye(3)])[:, 1:].T))  # (15, 12) from offsets


_STEEPNESS = max(np.abs(_DU_AT).sum(axis=1).max(), np.abs(_DV_AT).sum(axis=1).max())


def _is_whole(offsets: Floats, corners: Floats) -> Bools:
    """Do curved faces, of node offsets (12, 3, n) from facets (n, 3, 3), stay near them and look the same way?"""
    e1, e2 = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    facet = _cross(e1, e2)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        longest = np.sqrt(np.maximum((e1**2).sum(axis=0), (e2**2).sum(axis=0)))
        furthest = np.sqrt((offsets**2).sum(axis=1).max(axis=0))
        is_whole = furthest < MOST_OFFSET * longest
        # most faces are so shallow that no slope can turn them far
        shallow = 2 * _STEEPNESS * furthest * longest < 0.5 * np.sqrt((facet**2).sum(axis=0))
        doubtful = np.flatnonzero(is_whole & ~shallow)
        few = offsets[..., doubtful].reshape(N_NODES, -1)
        by_u = (_DU_AT @ few).reshape(len(_DU_AT), 3, len(doubtful)) + e1[:, doubtful]
        by_v = (_DV_AT @ few).reshape(len(_DV_AT), 3, len(doubtful)) + e2[:, doubtful]
        normal, facet = _cross(by_u.swapaxes(0, 1), by_v.swapaxes(0, 1)), facet[:, None, doubtful]
        cosine = (normal * facet).sum(axis=0) / np.sqrt((normal**2).sum(axis=0) * (facet**2).sum(axis=0))
        is_whole[doubtful] = cosine.min(axis=0) > STEEPEST_INSIDE
    return is_whole


def _cross(a: Floats, b: Floats) -> Floats:
    """Vector product of vectors with components along the first axis."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@dataclass(frozen=True, eq=False)
class CurvedFaces:
    """Curved faces over some of t triangles: point(u, v) = facet + sum of 14 terms u^a v^b times coefficients.

    corners (t, 3, 3) m; row (t,) of each triangle's curved face, -1 where it has none; coefficients (p, 14, 3) m;
    neighbour (p, 3) the triangle across each edge (from corner e to
    e + 1) where the surface runs on, -1 elsewhere, and neighbour_edge (p, 3), its edge; bent_row (p,) and bent
    (q, 14, 3): faces with a straight edge take their normals from the face that is not held straight;
    vertex (p, 3) of the corners and vertex_normal (f, 3), the same for all faces around a vertex;
    degree: 4, or less to follow faces of a lower degree and see what difference it makes;
    slack: barycentric, by which a hit may be outside its face
    """

    corners: Floats
    row: Ints
    coefficients: Floats
    neighbour: Ints
    neighbour_edge: Ints
    bent_row: Ints
    bent: Floats
    vertex: Ints
    vertex_normal: Floats
    degree: int = 4
    slack: float = BEYOND

    @classmethod
    def join(cls, parts: "list[CurvedFaces | None]", corners: list[Floats]) -> "CurvedFaces | None":
        """The curved faces of several surfaces, of facets (t, 3, 3) each, in one numbering."""
        if all(part is None for part in parts):
            return None
        starts = np.cumsum([0, *(len(facets) for facets in corners)])
        row, neighbour, bent_row, vertex = [], [], [], []
        n_faces = n_bent = n_vertices = 0
        for part, facets, start in zip(parts, corners, starts, strict=False):
            if part is None:
                row.append(np.full(len(facets), -1, np.int32))
                continue
            row.append(np.where(part.row >= 0, part.row + n_faces, -1))
            neighbour.append(np.where(part.neighbour >= 0, part.neighbour + start, -1))
            bent_row.append(np.where(part.bent_row >= 0, part.bent_row + n_bent, -1))
            vertex.append(part.vertex + n_vertices)
            n_faces, n_bent = n_faces + len(part.coefficients), n_bent + len(part.bent)
            n_vertices += len(part.vertex_normal)
        full = [part for part in parts if part is not None]
        others = ("coefficients", "neighbour_edge", "bent", "vertex_normal")
        return cls(
            corners=np.concatenate(corners),
            row=np.concatenate(row),
            neighbour=np.concatenate(neighbour),
            bent_row=np.concatenate(bent_row),
            vertex=np.concatenate(vertex),
            **{name: np.concatenate([getattr(part, name) for part in full]) for name in others},
        )

    @property
    def triangle(self) -> Ints:
        """Triangle (p,) of each curved face."""
        return np.flatnonzero(self.row >= 0)

    @property
    def has_straight_edges(self) -> bool:
        """Is an edge of some face held straight?"""
        return len(self.bent) > 0

    def parts(self, angle: float, most: int) -> int:
        """Into how many parts edges have to be cut to turn by less than an angle (radians) each, but at most."""
        corners = self.corners[self.triangle]
        middles = np.tensordot(_terms(np.array([0.5, 0.5, 0.0]), np.array([0.0, 0.5, 0.5])), self.coefficients, (1, 1))
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).T
        turn = 8 * np.linalg.norm(middles, axis=2) / edges  # of a parabola as high over its chord
        return int(np.clip(np.ceil(np.quantile(turn.max(axis=0), 0.999) / angle), 1, most))

    def points_on(self, k: int) -> Floats:
        """Points (p, n, 3), m, of all faces at those of grid(k)."""
        weights = grid(k)[0]
        terms = _terms(weights[:, 1], weights[:, 2])
        return np.matmul(weights, self.corners[self.triangle]) + np.matmul(terms, self.coefficients)

    def hull(self, k: int) -> Floats:
        """Triangles (p k^2, 3, 3), m, that lie just in front of all faces: k^2 for each.

        A ray that meets a face, however close to a silhouette, meets them, too. Next to straight edges, which they
        share with what is flat, they lie on the faces instead.
        """
        weights, parts = grid(k)
        n_faces = len(self.coefficients)
        points = np.empty((n_faces, len(weights), 3))
        sag = np.zeros(n_faces)
        fine = grid(2 * k)[0]
        where = {tuple(np.round(2 * k * w).astype(int)): i for i, w in enumerate(fine)}
        ends = [tuple(np.round(2 * k * weights[parts[:, i]]).astype(int) for i in (e, (e + 1) % 3)) for e in range(3)]
        terms = _terms(fine[:, 1], fine[:, 2])
        triangle = self.triangle
        for first in range(0, n_faces, CHUNK):
            some = slice(first, first + CHUNK)
            at = np.matmul(terms, self.coefficients[some])
            coarse = [where[tuple(np.round(2 * k * w).astype(int))] for w in weights]
            for a, b in ends:
                i, j = ([where[tuple(p)] for p in end] for end in (a, b))
                m = [where[tuple(p)] for p in (a + b) // 2]
                missed = np.linalg.norm(at[:, m] - (at[:, i] + at[:, j]) / 2, axis=2).max(axis=1)
                sag[some] = np.maximum(sag[some], missed)
            points[some] = np.matmul(weights, self.corners[triangle[some]]) + at[:, coarse]
        lift = np.zeros(len(self.vertex_normal))
        np.maximum.at(lift, self.vertex.ravel(), np.repeat(HIGHER * sag, 3))
        lifted = lift[:, None] * self.vertex_normal
        is_held = np.zeros(len(lift), bool)
        on_edge = self.neighbour < 0
        is_held[self.vertex[on_edge]] = is_held[np.roll(self.vertex, -1, axis=1)[on_edge]] = True
        for first in range(0, n_faces, CHUNK):
            some = slice(first, first + CHUNK)
            raised = np.matmul(weights, lifted[self.vertex[some]])
            for corner in range(3):
                raised[is_held[self.vertex[some, corner]], weights[:, corner].argmax()] = 0.0
                # the edge that begins at this corner, where the weight of the one after the next is 0
                along = weights[:, (corner + 2) % 3] == 0
                raised[np.ix_(on_edge[some, corner], along)] = 0.0
            points[some] += raised
        return points[:, parts].reshape(-1, 3, 3)

    def _load(self, table: Floats, rows: Ints, k: Ints) -> Floats:
        """Coefficients (14, 3, n) of points relative to the first corner of triangles k."""
        c = table[rows].transpose(1, 2, 0)
        c = np.ascontiguousarray(c) if self.degree == 4 else np.tensordot(LOWER[self.degree], c, 1)
        corners = self.corners[k]
        c[:2] += (corners[:, 1:] - corners[:, :1]).transpose(1, 2, 0)
        return c

    def points(self, k: Ints, u: Floats, v: Floats) -> Floats:
        """Points (n, 3), m, of the curved faces of triangles k at u, v (n,)."""
        return self.corners[k, 0] + _value(self._load(self.coefficients, self.row[k], k), u, v).T

    def may_meet(self, origins: Floats, directions: Floats) -> Bools:
        """Do the lines of rays (n, 1, 3) come near the triangles (t,), so near that they could meet a curved face?"""
        centre = self.corners.mean(axis=1)
        radius = np.linalg.norm(self.corners - centre[:, None], axis=2).max(axis=1)
        away = centre - origins
        nearest = away - dot(away, directions)[..., None] * directions
        return dot(nearest, nearest) <= ((1 + 2 * MOST_OFFSET) * radius) ** 2

    def normals(self, k: Ints, u: Floats, v: Floats) -> Floats:
        """Unit normals (n, 3) by which the curved faces of triangles k refract at u, v (n,)."""
        c = self._load(self.coefficients, self.row[k], k)
        return normalise(self._bend(_cross(*_value_and_slopes(c, u, v)[1:]).T, k, u, v))

    def _bend(self, normal: Floats, k: Ints, u: Floats, v: Floats) -> Floats:
        """Normals (n, 3), changed where the face has a straight edge; the very array where none has."""
        if not self.has_straight_edges:
            return normal
        held = np.flatnonzero(self.bent_row[self.row[k]] >= 0)
        if len(held):
            c = self._load(self.bent, self.bent_row[self.row[k[held]]], k[held])
            normal = normal.copy()
            normal[held] = _cross(*_value_and_slopes(c, u[held], v[held])[1:]).T
        return normal

    def meet(
        self, k: Ints, u: Floats, v: Floats, origins: Floats, directions: Floats, leaves: Bools | None, least: float
    ) -> tuple[Ints, Floats, Floats, Floats, Bools, Floats, Floats, Bools]:
        """Where rays meet the curved surface, beginning at u, v (n,) of triangles k.

        Parameters
        ----------
        leaves : (n,) do rays come from within, so that only hits from behind can be; None: from either side. Where a
            root is of the other side, the one before or after it is looked for; but not for rays that have just left
            the surface, whose root is nearer than `least`, m

        Returns
        -------
        triangle (n,), u (n,), v (n,), distance (n,) m; enters (n,) the ray comes from the front; normal (n, 3) of the
        face and the one (n, 3) by which it refracts, neither unit; is_met (n,)
        """
        *found, is_met = self._roots(k, u, v, origins, directions)
        if leaves is None:
            return *found, is_met
        odd = np.flatnonzero(is_met & (found[4] == leaves) & (leaves | (found[3] > least)))
        if len(odd):
            k, u, v = (x[odd] for x in found[:3])
            o, d = origins[odd], directions[odd]
            *other, is_other = self._roots(k, *self._across(k, u, v, d), o, d)
            better = is_other & (other[4] != leaves[odd])
            for mine, theirs in zip(found, other, strict=True):
                mine[odd[better]] = theirs[better]
        return *found, is_met

    def _across(self, k: Ints, u: Floats, v: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Places about as far beyond where rays touch the surface as u, v are before it, or the reverse."""
        c = self._load(self.coefficients, self.row[k], k)
        d = directions.T

        def facing(u: Floats, v: Floats) -> tuple[Floats, Floats, Floats]:
            _, by_u, by_v = _value_and_slopes(c, u, v)
            return (d * _cross(by_u, by_v)).sum(axis=0), by_u, by_v

        here, by_u, by_v = facing(u, v)
        # the ray along the face: d = a by_u + b by_v, without what is perpendicular to both
        uu, uv, vv = (by_u**2).sum(axis=0), (by_u * by_v).sum(axis=0), (by_v**2).sum(axis=0)
        du, dv = (d * by_u).sum(axis=0), (d * by_v).sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            a, b = (vv * du - uv * dv) / (uu * vv - uv * uv), (uu * dv - uv * du) / (uu * vv - uv * uv)
            size = np.maximum(np.abs(a), np.abs(b))
            a, b = a / size, b / size
            step = 1e-3
            way = -2 * here * step / (facing(u + step * a, v + step * b)[0] - here)
        way = np.clip(np.nan_to_num(way), -1.0, 1.0)
        return u + way * np.nan_to_num(a), v + way * np.nan_to_num(b)

    def _roots(
        self, k: Ints, u: Floats, v: Floats, origins: Floats, directions: Floats
    ) -> tuple[Ints, Floats, Floats, Floats, Bools, Floats, Floats, Bools]:
        """As `meet`, for whichever side."""
        k, u, v = k.copy(), np.array(u), np.array(v)
        distance, enters = np.full(len(k), np.inf), np.zeros(len(k), bool)
        facing = np.zeros((len(k), 3))
        normal = np.zeros((len(k), 3)) if self.has_straight_edges else facing
        is_met = np.zeros(len(k), bool)
        todo = np.arange(len(k))
        for _ in range(WALKS):
            parts = [
                self._newton(k[some], u[some], v[some], origins[some], directions[some])
                for some in np.split(todo, range(CHUNK, len(todo), CHUNK))
            ]
            u[todo], v[todo], distance[todo], enters[todo], facing[todo], normal[todo], done = (
                np.concatenate(column) for column in zip(*parts, strict=True)
            )
            outside = np.stack([v[todo], 1 - u[todo] - v[todo], u[todo]], axis=1)  # distances from the edges
            edge = outside.argmin(axis=1)
            is_within = outside.min(axis=1) >= -self.slack
            is_met[todo] = done & is_within
            # a root beyond an edge may lie on the next face
            row = self.row[k[todo]]
            following = np.where(done & ~is_within, self.neighbour[row, edge], -1)
            goes_on = following >= 0
            if not goes_on.any():
                break
            todo, edge, row = todo[goes_on], edge[goes_on], row[goes_on]
            k[todo], u[todo], v[todo] = self._step_over(row, following[goes_on], edge, u[todo], v[todo])
        return k, u, v, distance, enters, facing, normal, is_met

    def _step_over(self, row: Ints, following: Ints, edge: Ints, u: Floats, v: Floats) -> tuple[Ints, Floats, Floats]:
        """Neighbours across edges, and the place on them next to where u, v left their faces."""
        along = np.choose(edge, [u, v, 1 - u - v])  # weight of the corner in which the edge ends
        along = np.clip(along, 0.0, 1.0)
        weights = np.zeros((len(row), 3))
        n, theirs = np.arange(len(row)), self.neighbour_edge[row, edge].astype(int)
        weights[n, theirs], weights[n, (theirs + 1) % 3] = along, 1 - along  # it runs the other way there
        return following, weights[:, 1], weights[:, 2]

    def _newton(
        self, k: Ints, u: Floats, v: Floats, origins: Floats, directions: Floats
    ) -> tuple[Floats, Floats, Floats, Bools, Floats, Floats, Bools]:
        """Newton's method on the two components of point(u, v) - origin across the ray; steps and range are limited."""
        c = self._load(self.coefficients, self.row[k], k)
        away = (self.corners[k, 0] - origins).T
        across = np.stack([axis.T for axis in _tangents(directions)])  # (2, 3, n)
        seen = np.stack([c[:, 0] * a[0] + c[:, 1] * a[1] + c[:, 2] * a[2] for a in across], axis=1)  # (14, 2, n)
        start = (across * away).sum(axis=1)
        u, v = u.copy(), v.copy()
        live, terms, rest = np.arange(len(k)), seen, start
        done = np.zeros(len(k), bool)
        # near a turning point the matrix is singular: such rays do not converge, and count as no hit
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            for turn in range(ITERATIONS):
                x, y = (u, v) if turn == 0 else (u[live], v[live])
                f, by_u, by_v = _value_and_slopes(terms, x, y)
                f += rest
                det = 1.0 / (by_u[0] * by_v[1] - by_u[1] * by_v[0])
                du = (f[1] * by_v[0] - f[0] * by_v[1]) * det
                dv = (f[0] * by_u[1] - f[1] * by_u[0]) * det
                size = np.maximum(np.abs(du), np.abs(dv))
                limit = np.fmin(0.5 / size, 1.0)
                # fmax and fmin put a number in the place of NaN
                u[live] = np.fmin(np.fmax(x + limit * du, -1.0), 2.0)
                v[live] = np.fmin(np.fmax(y + limit * dv, -1.0), 2.0)
                small = size < CONVERGED
                done[live] = small
                if turn == 0:
                    continue  # hardly any is done so soon
                goes_on = np.flatnonzero(~small & (size < HOPELESS) if turn >= PATIENCE else ~small)
                if not len(goes_on):
                    break
                if len(goes_on) < len(live):
                    live, terms, rest = live[goes_on], terms[..., goes_on], rest[:, goes_on]
        at, by_u, by_v = _value_and_slopes(c, u, v)
        at += away
        d = directions.T
        facing = _cross(by_u, by_v)
        distance = d[0] * at[0] + d[1] * at[1] + d[2] * at[2]
        enters = d[0] * facing[0] + d[1] * facing[1] + d[2] * facing[2] < 0
        return u, v, distance, enters, facing.T, self._bend(facing.T, k, u, v), done


def make_curved(
    vertices: Floats,
    triangles: Ints,
    corner_normals: Floats,
    wanted: Bools,
    edges: Edges,
    facets: Floats,
    has_mean_normals: bool,
) -> CurvedFaces | None:
    """Curved faces over those of the wanted triangles whose normals agree with their shape.

    Parameters
    ----------
    vertices, triangles : (v, 3) m, (t, 3)
    corner_normals : (t, 3, 3) unit; a flat triangle has its own three times
    wanted : (t,) smooth triangles
    edges : of the triangles
    facets : (t, 3) normals of the triangles, unit
    has_mean_normals : normals are means of the faces around: the surface's own are found from the vertices
    """
    corners = vertices[triangles]
    asked = wanted
    wanted = wanted & (np.einsum("tij,tj->ti", corner_normals, facets) > STEEPEST).all(axis=1)
    first, second = edge_corners(corner_normals, edges)
    is_joined = (np.abs(first - second).max(axis=(1, 2)) < SAME_NORMAL) & ~edges.is_same_way
    usable = np.einsum("tij,tj->ti", corner_normals, facets).min(axis=1) > 0
    v = _find_vertices(vertices, triangles, corner_normals, usable, edges, is_joined)
    is_used = np.zeros(len(v.at), bool)
    is_used[v.of_corner[wanted]] = True
    if has_mean_normals:
        v = replace(v, normal=_find_normals(v, is_used))
        wanted &= (np.einsum("tij,tj->ti", v.normal[v.of_corner], facets) > STEEPEST).all(axis=1)
    is_bad = _contradicted(v, v.normal, is_used)
    if is_bad.any():
        n = len(v.at)
        bad = np.concatenate([v.start[is_bad] * n + v.end[is_bad], v.end[is_bad] * n + v.start[is_bad]])
        wanted &= ~np.isin(v.of_corner * n + np.roll(v.of_corner, -1, axis=1), bad).any(axis=1)
    # a flat face in parts is curved as a whole or not at all
    is_flat = is_joined & (np.abs(facets[edges.first] - facets[edges.second]).max(axis=1) < COPLANAR)
    face = components(len(triangles), edges.first[is_flat], edges.second[is_flat])
    wanted &= ~np.isin(face, face[asked & ~wanted])
    # nor is it when nothing around it is
    among = is_joined & ~is_flat & wanted[edges.first] & wanted[edges.second]
    wanted &= np.isin(face, face[np.concatenate([edges.first[among], edges.second[among]])])
    is_used[:] = False
    is_used[v.of_corner[wanted]] = True
    fields = _fit_fields(v, is_used)

    chosen = np.flatnonzero(wanted)
    coefficients = np.empty((len(chosen), N_TERMS, 3))
    is_whole = np.empty(len(chosen), bool)
    for k in range(0, len(chosen), CHUNK):
        some = slice(k, k + CHUNK)
        offsets = _node_offsets(v, fields, v.of_corner[chosen[some]])
        is_whole[some] = _is_whole(offsets, corners[chosen[some]])
        coefficients[some] = np.tensordot(FROM_NODES, offsets, 1).transpose(2, 0, 1)
    if not is_whole.all():
        chosen, coefficients = chosen[is_whole], coefficients[is_whole]
    if not len(chosen):
        return None
    row = np.full(len(triangles), -1, np.int32)
    row[chosen] = np.arange(len(chosen))

    neighbour = np.full((len(chosen), 3), -1, np.int32)
    neighbour_edge = np.zeros((len(chosen), 3), np.int8)
    runs_on = is_joined & (row[edges.first] >= 0) & (row[edges.second] >= 0)
    f, s, i, j = (x[runs_on] for x in (edges.first, edges.second, edges.corner_first, edges.corner_second))
    neighbour[row[f], i], neighbour_edge[row[f], i] = s, j
    neighbour[row[s], j], neighbour_edge[row[s], j] = f, i

    is_straight = neighbour < 0
    held = np.flatnonzero(is_straight.any(axis=1))
    bent_row = np.full(len(chosen), -1, np.int32)
    bent_row[held] = np.arange(len(held))
    bent = coefficients[held]
    offsets = np.matmul(_AT_NODES, bent)
    offsets[:, : N_NODES - 3] *= ~np.repeat(is_straight[held], 3, axis=1)[..., None]
    coefficients[held] = np.matmul(FROM_NODES, offsets)
    vertex = v.of_corner[chosen]
    return CurvedFaces(corners, row, coefficients, neighbour, neighbour_edge, bent_row, bent, vertex, v.normal)
