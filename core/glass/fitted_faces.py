"""Curved faces, fitted to height fields around the vertices, and checked against the mesh."""

from dataclasses import dataclass
from math import comb

import numpy as np

from ..base.arrays import Bools, Floats, Ints, take
from ..base.products import combine, solve_symmetric
from ..base.steps import Steps
from ..base.vectors import dot, length_of, normalise
from ..native import loading
from . import native_fit
from .curved import FACES_AT_ONCE, MOST_OFFSET
from .meshes import Edges
from .quartics import (
    AT,
    AT_NODES,
    FROM_NODES,
    N_NODES,
    N_TERMS,
    NODES,
    POWERS,
    cross,
    monomials,
    product,
    slopes,
    tangents,
    value,
)
from .subdivided import ExactLimit
from .vertices import Vertices

# squared, of neighbours, in units of their mean distance: nearer ones would dominate
LEAST_DISTANCE = 1e-12
# cosine to a vertex's normal: limits the slopes of normals with a larger lean
LEAST_UPRIGHT = 0.2
VERTICES_AT_ONCE = 1 << 14  # in the kernel, between two pauses


def _ridge(*by_degree: float) -> Floats:
    """Weights of the terms (14,), by degree.

    The factor makes them invariant under rotation of the axes (Bombieri).
    """
    return np.array([by_degree[a + b - 1] / comb(a + b, a) for a, b in POWERS])


# High degrees give way first if data are few.
RIDGE = _ridge(1e-12, 1e-11, 1e-9, 1e-7)
# They give way earlier if neighbours are so uneven that slopes do not settle.
STIFFER = _ridge(1e-12, 1e-10, 1e-4, 1e-2)


@dataclass(frozen=True, eq=False)
class Fields:
    """Height fields over the tangent planes of vertices: z = size * sum c (x / size)^a (y /
    size)^b.

    axis_x, axis_y (f, 3) unit; size (f,) m, mean distance of the neighbours; coefficients (f, 14);
    is_rim (f,): the surface ends along x and continues to one side of it
    """

    axis_x: Floats
    axis_y: Floats
    size: Floats
    coefficients: Floats
    is_rim: Bools

    def kernel_fit(self, v: Vertices) -> native_fit.Fit:
        """Kernel object for the fit."""
        return native_fit.Fit(v, (self.axis_x, self.axis_y), self.size, self.is_rim)


def tangent_planes(v: Vertices) -> Fields:
    """Fields of height 0 over all vertices."""
    axis_x, axis_y = tangents(np.where(v.is_known[:, None], v.normal, [0.0, 0.0, 1.0]))
    is_rim = np.zeros(len(v.at), bool)
    if v.rim is not None:
        is_rim = v.is_known & v.rim.any(axis=1)
        normal = v.normal[is_rim]
        along = v.rim[is_rim]
        axis_x[is_rim] = along = normalise(along - dot(along, normal)[:, None] * normal)
        axis_y[is_rim] = np.cross(normal, along)
    away = take(v.at, v.end) - take(v.at, v.start)
    distance = length_of(away)
    size = np.bincount(v.start, distance, len(v.at)) / np.maximum(np.diff(v.first), 1)
    return Fields(axis_x, axis_y, size, np.zeros((len(v.at), N_TERMS)), is_rim)


def _around(
    v: Vertices, fields: Fields, some: Ints, pairs: Ints
) -> tuple[Floats, Floats, Floats, Floats, Bools]:
    """Neighbours (n, m) in the frame of their vertex, in units of its size: x, y, z, squared
    distance, and whether each is usable.
    """
    end = v.end[pairs]
    away = (take(v.at, end) - v.at[some, None]) / fields.size[some, None, None]
    x = dot(away, fields.axis_x[some, None])
    y = dot(away, fields.axis_y[some, None])
    return x, y, dot(away, v.normal[some, None]), dot(away, away), v.is_known[end]


def gradients(
    v: Vertices, fields: Fields, some: Ints, pairs: Ints, normal: Floats
) -> tuple[Floats, Floats]:
    """Slopes (n, m) of the surface at the neighbours, by x and by y in their vertex's frame."""
    theirs = take(normal, v.end[pairs])
    upright = np.maximum(dot(theirs, v.normal[some, None]), LEAST_UPRIGHT)
    return -dot(theirs, fields.axis_x[some, None]) / upright, -dot(
        theirs, fields.axis_y[some, None]
    ) / upright


def system(
    v: Vertices, fields: Fields, some: Ints, pairs: Ints, ridge: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Weighted rows (n, 3m, terms) of heights and slopes, their weights, the normal equations'
    matrix, and heights (n, m).

    Only the last len(ridge) terms are used. Across a rim two rings determine a cubic at most: a
    quartic through their heights and slopes follows from the next ring's own (Simpson's rule), so
    any slope across would fit. Slopes of neighbours on the rim are dropped for the same reason.
    """
    x, y, z, distance, is_used = _around(v, fields, some, pairs)
    by_x, by_y = slopes(x, y)
    rows = np.concatenate([monomials(x, y), by_x, by_y], axis=1)[..., -len(ridge) :]
    is_rim = fields.is_rim[some]
    rows[is_rim, :, -1] = 0.0  # y^4

    # a height over its distance determines the slope as well as a slope does
    weights = np.concatenate(
        [2.0 / np.sqrt(np.maximum(distance, LEAST_DISTANCE)), np.ones_like(x), np.ones_like(x)],
        axis=1,
    )
    weights *= np.tile(is_used, 3)
    weights[:, -x.shape[1] :] *= ~(is_rim[:, None] & fields.is_rim[v.end[pairs]])
    rows = rows * weights[..., None]
    matrix = np.matmul(rows.transpose(0, 2, 1), rows)
    scale = np.einsum("nr,nr->n", weights, weights)[:, None] + 1.0
    diagonal = np.arange(matrix.shape[1])
    matrix[:, diagonal, diagonal] += ridge * scale

    return rows, weights, matrix, z


def field_steps(v: Vertices, wanted: Bools) -> Steps[Fields]:
    """Fields exact in place and slope at the vertex, fitted to its neighbours by least squares;
    with pauses.
    """
    fields = tangent_planes(v)
    yield 0
    if loading.library() is not None:
        fit = fields.kernel_fit(v)
        for first in range(0, len(wanted), VERTICES_AT_ONCE):
            some = np.zeros(len(wanted), bool)
            some[first : first + VERTICES_AT_ONCE] = wanted[first : first + VERTICES_AT_ONCE]
            fit.fit_fields(some, RIDGE, fields.coefficients)
            yield 0
        return fields

    for some, pairs in v.by_valence(wanted):
        rows, weights, matrix, z = system(v, fields, some, pairs, RIDGE[2:])
        right = np.concatenate([z, *gradients(v, fields, some, pairs, v.normal)], axis=1) * weights
        solved = solve_symmetric(matrix, np.einsum("nrk,nr->nk", rows, right)[..., None])
        fields.coefficients[some, 2:] = solved[..., 0]
        yield 0

    return fields


@dataclass(frozen=True)
class FaceOptions:
    """Limits of fitted faces against their mesh (docs/decisions/02-curved-faces.md).

    Tuned by `dev.py bench`, and `dev.py irregular` on decimated and bevelled meshes, whose long
    sides next to a bevel would dip by a millimetre.

    Parameters
    ----------
    steps : of a fixed point, each gains two orders: the same for all, or neighbours would not meet;
        also in the kernel's fit.c
    least_cosine : between the normals of a curved face and its facet's: 60 degrees
    swollen : multiple of the sag of an arc with the turn of the normals: a face beyond it follows a
        bevel next to it
    extra_bulge : fraction of an edge: bulge allowed besides, for edges that turn both ways
    """

    steps: int = 2
    least_cosine: float = np.cos(np.radians(60))
    swollen: float = 3.0
    extra_bulge: float = 0.01


FACE = FaceOptions()


def _node_offsets(v: Vertices, fields: Fields, corner: Ints) -> Floats:
    """Offsets (12, 3, n) of the nodes of triangles with corners (n, 3), from the facet to the
    blended fields.

    All fields are intersected along one direction, blended from the corners' normals: with several
    they would differ sideways by the third power of the edge, which costs an order.
    """
    weight = NODES**2 / (NODES**2).sum(axis=1, keepdims=True)
    if loading.library() is not None:
        return fields.kernel_fit(v).find_offsets(fields.coefficients, NODES, weight, corner)

    # corner by corner: the field around each, in its own frame
    offsets = np.zeros((N_NODES, 3, len(corner)))
    at = take(v.at, corner)
    normal = take(v.normal, corner)

    for i in range(3):
        own = corner[:, i]
        size = fields.size[own]
        frame = fields.axis_x[own], fields.axis_y[own], v.normal[own]
        sides = [
            [dot(at[:, (i + s) % 3] - at[:, i], axis) / size for axis in frame] for s in (1, 2)
        ]
        leans = [[dot(normal[:, (i + s) % 3], axis) for axis in frame] for s in (1, 2)]

        # fixed point: the line from the facet meets the field
        c = np.ascontiguousarray(fields.coefficients[own].T)
        for node in np.flatnonzero(weight[:, i]):
            li, lj, lk = (NODES[node, (i + s) % 3] for s in range(3))
            x, y, z = (lj * a + lk * b for a, b in zip(*sides, strict=True))
            dx, dy, dz = (lj * a + lk * b for a, b in zip(*leans, strict=True))
            dz += li
            height = (value(c, x, y) - z) / dz
            for _ in range(FACE.steps):
                height = (value(c, x + height * dx, y + height * dy) - z) / dz

            direction = sum(NODES[node, m] * normal[:, m].T for m in range(3))
            offsets[node] += weight[node, i] * (size * height) * direction

    return offsets


_BY_U, _BY_V = slopes(*AT[:, 1:].T)  # (15, 14) of the terms
# (15, 12) from offsets
_DU_AT = _BY_U @ FROM_NODES
_DV_AT = _BY_V @ FROM_NODES
_OF_OFFSETS = np.concatenate([_DU_AT, _DV_AT, FROM_NODES])


def _normals_at_nodes(offsets: Floats, corners: Floats) -> Floats:
    """Unit normals (n, 15, 3) at nodes and corners of curved faces with node offsets (12, 3, n)
    over facets (n, 3, 3).
    """
    by_u, by_v = (
        combine(matrix, offsets.reshape(N_NODES, -1)).reshape(len(AT), 3, -1)
        + (corners[:, c] - corners[:, 0]).T
        for matrix, c in ((_DU_AT, 1), (_DV_AT, 2))
    )
    normal = cross(by_u.swapaxes(0, 1), by_v.swapaxes(0, 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        normal /= np.sqrt(product(normal, normal))

    return normal.transpose(2, 1, 0)


def _is_whole(offsets: Floats, corners: Floats, normals: Floats, facets: Floats) -> Bools:
    """Whether curved faces, with node offsets (12, 3, n) and normals (n, 15, 3), stay near their
    facets and face the same way.
    """
    longest = length_of(corners[:, 1:] - corners[:, :1]).max(axis=1)
    with np.errstate(invalid="ignore"):
        is_near = np.sqrt((offsets**2).sum(axis=1).max(axis=0)) < MOST_OFFSET * longest
        cosine = np.einsum("nkc,nc->nk", normals, facets).min(axis=1)
        return is_near & (cosine > FACE.least_cosine)


def _is_swollen(offsets: Floats, corners: Floats, at_corners: Floats) -> Bools:
    """Whether curved faces bulge out or in further than the normals (n, 3, 3) at their corners (n,
    3, 3) explain.
    """
    turned, along = (np.roll(x, -1, axis=1) - x for x in (at_corners, corners))
    sag = dot(turned, along) / 8  # of arcs over the edges
    height = np.einsum("kcn,nc->kn", offsets, normalise(at_corners.sum(axis=1)))
    more = FACE.extra_bulge * length_of(along).max(axis=1)
    with np.errstate(invalid="ignore"):
        bulges_out = height.max(axis=0) > FACE.swollen * np.maximum(sag.max(axis=1), 0) + more
        bulges_in = height.min(axis=0) < FACE.swollen * np.minimum(sag.min(axis=1), 0) - more
    return bulges_out | bulges_in


def _make_faces(
    offsets: Floats,
    corners: Floats,
    at_corners: Floats,
    facets: Floats,
    into: tuple[Floats, Floats, Bools, Bools],
) -> None:
    """Write the coefficients of faces, their normals, and masks of whole and of swollen ones, from
    node offsets (12, 3, n).
    """
    if loading.library() is not None:
        limits = np.array([MOST_OFFSET, FACE.least_cosine, FACE.swollen, FACE.extra_bulge])
        native_fit.make_faces(offsets, (corners, at_corners, facets), _OF_OFFSETS, limits, into)
        return

    coefficients, own, is_whole, is_swollen = into
    fitted = combine(FROM_NODES, offsets.reshape(N_NODES, -1)).reshape(N_TERMS, 3, -1)
    coefficients[:] = fitted.transpose(2, 0, 1)
    own[:] = _normals_at_nodes(offsets, corners)
    is_whole[:] = _is_whole(offsets, corners, own, facets)
    is_swollen[:] = _is_swollen(offsets, corners, at_corners)


@dataclass(frozen=True, eq=False)
class Faces:
    """Curved faces during the fit.

    chosen (n,): their triangles; coefficients (n, 14, 3) m; own (n, 15, 3): unit normals at nodes
    and corners; intended: the same, except on exact faces; is_swollen (n,)
    """

    chosen: Ints
    coefficients: Floats
    own: Floats
    intended: Floats
    is_swollen: Bools

    def at(self, which: Bools) -> "Faces":
        own = self.own[which]
        return Faces(
            self.chosen[which],
            self.coefficients[which],
            own,
            own if self.intended is self.own else self.intended[which],
            self.is_swollen[which],
        )


def fit_faces(
    v: Vertices,
    fields: Fields,
    corners: Floats,
    facets: Floats,
    chosen: Ints,
    limit: ExactLimit | None,
) -> Steps[tuple[Faces, Bools]]:
    """Faces over chosen triangles (n,), and a mask of faces near their facets."""
    coefficients = np.empty((len(chosen), N_TERMS, 3))
    own = np.empty((len(chosen), len(AT), 3))
    intended = own if limit is None else np.empty_like(own)
    is_whole, is_swollen = np.empty((2, len(chosen)), bool)

    for k in range(0, len(chosen), FACES_AT_ONCE):
        some = slice(k, k + FACES_AT_ONCE)
        at = take(corners, chosen[some])
        of_corner = v.of_corner[chosen[some]]

        if limit is None:
            offsets = _node_offsets(v, fields, of_corner)
        else:
            is_exact = limit.is_face[chosen[some]]
            which = np.flatnonzero(is_exact)
            places, normals = limit.faces(chosen[some][which])
            offsets = np.empty((N_NODES, 3, len(at)))
            away = places[:, :N_NODES] - np.matmul(NODES, at[which])
            offsets[..., which] = away.transpose(1, 2, 0)
            if len(which) < len(at):
                offsets[..., ~is_exact] = _node_offsets(v, fields, of_corner[~is_exact])

        over = at, take(v.normal, of_corner), take(facets, chosen[some])
        into = coefficients[some], own[some], is_whole[some], is_swollen[some]
        _make_faces(offsets, *over, into)

        if limit is not None:
            intended[some] = own[some]
            intended[k + which] = normals
            is_swollen[k + which] = False

        yield 0

    return Faces(chosen, coefficients, own, intended, is_swollen), is_whole


def match_edges(
    faces: Faces, limit: ExactLimit, edges: Edges, corners: Floats, facets: Floats
) -> Bools:
    """Copy places on edges to faces (n,) from neighbours of higher rank.

    Returns a mask (n,) of faces near their facets. edges : of triangles with corners (t, 3, 3) and
    normals facets (t, 3), across which the surface continues
    """
    row = np.full(len(corners), -1)
    row[faces.chosen] = np.arange(len(faces.chosen))
    rank = limit.rank[faces.chosen]
    f, s = row[edges.first], row[edges.second]
    is_between = (f >= 0) & (s >= 0)
    is_between[is_between] = rank[f[is_between]] != rank[s[is_between]]
    f, s = f[is_between], s[is_between]
    sides = edges.corner_first[is_between], edges.corner_second[is_between]

    # nodes of the faces to change, and of their better neighbours
    is_lower = rank[f] < rank[s]
    changed, better = np.where(is_lower, (f, s), (s, f))
    mine, theirs = np.where(is_lower, sides, sides[::-1])
    which, place = np.unique(changed, return_inverse=True)
    offsets = np.matmul(AT_NODES, faces.coefficients[which])
    along = np.arange(3)
    there = np.matmul(AT_NODES, faces.coefficients[better])
    there = there[np.arange(len(better))[:, None], 3 * theirs[:, None] + 2 - along]
    offsets[place[:, None], 3 * mine[:, None] + along] = there

    at = take(corners, faces.chosen[which])
    faces.coefficients[which] = np.matmul(FROM_NODES, offsets)
    own = _normals_at_nodes(np.ascontiguousarray(offsets.transpose(1, 2, 0)), at)
    is_own = rank[which] == 0
    faces.own[which] = own
    faces.intended[which[is_own]] = own[is_own]
    is_whole = np.ones(len(faces.chosen), bool)
    is_whole[which] = _is_whole(
        offsets.transpose(1, 2, 0), at, own, take(facets, faces.chosen[which])
    )
    return is_whole
