"""A quartic height field around each vertex, by least squares from its neighbours."""

from dataclasses import dataclass
from math import comb

import numpy as np

from ..base.arrays import Bools, Floats, Ints, taken
from ..base.products import solve_symmetric
from ..base.steps import Pauses
from ..base.vectors import dot, length_of, normalise
from ..native import loading
from . import native_fit
from .quartics import N_TERMS, POWERS, monomials, slopes, tangents
from .vertices import Vertices

# squared, of neighbours, in units of their mean distance: nearer ones would weigh all
LEAST_DISTANCE = 1e-12
# cosine to a vertex's normal: slopes of normals that lean further are taken for no steeper
LEAST_UPRIGHT = 0.2
VERTICES_AT_ONCE = 1 << 14  # vertices, by the kernel, between two pauses


def _ridge(*by_degree: float) -> Floats:
    """Of the terms (14,), by degree. The factor makes it the same for all turns of the axes
    (Bombieri).
    """
    return np.array([by_degree[a + b - 1] / comb(a + b, a) for a, b in POWERS])


# Where data are few the high degrees give way first.
RIDGE = _ridge(1e-12, 1e-11, 1e-9, 1e-7)
# Where neighbours are so uneven that slopes do not settle they give way earlier.
STIFFER = _ridge(1e-12, 1e-10, 1e-4, 1e-2)


@dataclass(frozen=True, eq=False)
class Fields:
    """Height fields over the tangent planes of vertices: z =
    size * sum c (x / size)^a (y / size)^b.

    axis_x, axis_y (f, 3) unit; size (f,) mean distance of the neighbours; coefficients (f, 14);
    is_rim (f,): the surface ends along x, and runs on by y to one side only
    """

    axis_x: Floats
    axis_y: Floats
    size: Floats
    coefficients: Floats
    is_rim: Bools

    def fit_of(self, v: Vertices) -> native_fit.Fit:
        """The kernel's fit of their vertices."""
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
    away = taken(v.at, v.end) - taken(v.at, v.start)
    distance = length_of(away)
    size = np.bincount(v.start, distance, len(v.at)) / np.maximum(np.diff(v.first), 1)
    return Fields(axis_x, axis_y, size, np.zeros((len(v.at), N_TERMS)), is_rim)


def _around(
    v: Vertices, fields: Fields, some: Ints, pairs: Ints
) -> tuple[Floats, Floats, Floats, Floats, Bools]:
    """Neighbours (n, m) in the frame of their vertex, in units of its size: x, y, z.

    Are they of use.
    """
    end = v.end[pairs]
    away = (taken(v.at, end) - v.at[some, None]) / fields.size[some, None, None]
    x = dot(away, fields.axis_x[some, None])
    y = dot(away, fields.axis_y[some, None])
    return x, y, dot(away, v.normal[some, None]), dot(away, away), v.is_known[end]


def gradients(
    v: Vertices, fields: Fields, some: Ints, pairs: Ints, normal: Floats
) -> tuple[Floats, Floats]:
    """Slopes (n, m) of the surface at the neighbours, by x and by y in the frame of
    their vertex.
    """
    theirs = taken(normal, v.end[pairs])
    upright = np.maximum(dot(theirs, v.normal[some, None]), LEAST_UPRIGHT)
    return -dot(theirs, fields.axis_x[some, None]) / upright, -dot(
        theirs, fields.axis_y[some, None]
    ) / upright


def system(
    v: Vertices, fields: Fields, some: Ints, pairs: Ints, ridge: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Weighted rows (n, 3m, terms) of heights and slopes, weights, the normal equations' matrix.

    Heights (n, m). Of the last terms, as many as the ridge (terms,) has. Across a rim two rings
    tell no more than a cubic: a quartic through their heights and slopes follows from the next
    ring's own (Simpson's rule), so that all slopes across would do. Nor do those of neighbours at
    the rim tell any, which would do alike.
    """
    x, y, z, distance, is_used = _around(v, fields, some, pairs)
    by_x, by_y = slopes(x, y)
    rows = np.concatenate([monomials(x, y), by_x, by_y], axis=1)[..., -len(ridge) :]
    is_rim = fields.is_rim[some]
    rows[is_rim, :, -1] = 0.0  # y^4

    # a height tells as much of the slope as the slope itself does, over its distance
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


def fitting_fields(v: Vertices, wanted: Bools) -> Pauses[Fields]:
    """Fields with the vertex's own place and slope, through its neighbours, by least squares;
    with pauses.
    """
    fields = tangent_planes(v)
    yield 0
    if loading.library() is not None:
        fit = fields.fit_of(v)
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
