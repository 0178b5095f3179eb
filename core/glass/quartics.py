"""Quartic polynomials over a triangle: their terms, and the nodes that determine them."""

from math import perm

import numpy as np

from ..base.arrays import Floats, Ints

# exponents of u and v, or x and y: 14 terms
POWERS = [(a, d - a) for d in range(1, 5) for a in range(d, -1, -1)]
N_TERMS = len(POWERS)


def _powers(x: Floats) -> list[Floats]:
    """x^0 to x^4, by products: a general power is many times slower."""
    return [np.ones_like(x), x, x * x, x * x * x, (x * x) * (x * x)]


def monomials(x: Floats, y: Floats) -> Floats:
    """All 14 terms x^a y^b, along a new last axis."""
    px = _powers(x)
    py = _powers(y)
    return np.stack([px[a] * py[b] for a, b in POWERS], axis=-1)


def slopes(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Derivatives of all 14 terms by x and by y."""
    px = _powers(x)
    py = _powers(y)
    by_x = [a * px[max(a - 1, 0)] * py[b] for a, b in POWERS]
    by_y = [b * px[a] * py[max(b - 1, 0)] for a, b in POWERS]
    return np.stack(by_x, axis=-1), np.stack(by_y, axis=-1)


def grid(k: int) -> tuple[Floats, Ints]:
    """Barycentric points (n, 3) of a triangle with edges cut into k parts, and its k^2 parts (k^2,
    3).
    """
    index = {}
    for j in range(k + 1):
        for i in range(k + 1 - j):
            index[i, j] = len(index)

    points = np.array([(k - i - j, i, j) for i, j in index]) / k
    up = [(index[i, j], index[i + 1, j], index[i, j + 1]) for j in range(k) for i in range(k - j)]
    down = [
        (index[i + 1, j], index[i + 1, j + 1], index[i, j + 1])
        for j in range(k - 1)
        for i in range(k - 1 - j)
    ]
    return points, np.array(up + down)


def _nodes() -> Floats:
    """Barycentric coordinates (12, 3) of the free nodes: three on each edge (from corner e to e +
    1), three inside.
    """
    on_edges = [np.roll([1 - s, s, 0], e) for e in range(3) for s in (0.25, 0.5, 0.75)]
    inside = [np.roll([0.5, 0.25, 0.25], e) for e in range(3)]
    return np.array(on_edges + inside)


NODES = _nodes()
N_NODES = len(NODES)
AT_NODES = monomials(NODES[:, 1], NODES[:, 2])
# corners 1 and 2, where the offset is 0; at corner 0 all terms are 0
_AT_CORNERS = monomials(np.array([1.0, 0.0]), np.array([0.0, 1.0]))
# (14, 12): coefficients from offsets
FROM_NODES = np.linalg.inv(np.vstack([AT_NODES, _AT_CORNERS]))[:, :N_NODES]


def _lower(degree: int) -> Floats:
    """Matrix (14, 14) from the coefficients of a quartic to a face of a lower degree through its
    points.
    """
    points = grid(degree)[0][1:]  # all but corner 0, where there is no offset
    few = [k for k, power in enumerate(POWERS) if sum(power) <= degree]
    values = monomials(points[:, 1], points[:, 2])
    matrix = np.zeros((N_TERMS, N_TERMS))
    matrix[few] = np.linalg.solve(values[:, few], values)
    return matrix


def _to_bezier() -> Floats:
    """Matrix (15, 14): Bezier points of a quartic triangle from the coefficients of its terms."""
    # u^a v^b is the sum over i, j of i! / (i - a)!  j! / (j - b)!
    # (4 - a - b)! / 4!  times Bernstein's polynomials
    numbers = [(i, j) for i in range(5) for j in range(5 - i)]
    return np.array(
        [[perm(i, a) * perm(j, b) / perm(4, a + b) for a, b in POWERS] for i, j in numbers]
    )


TO_BEZIER = _to_bezier()
LOWER = {degree: _lower(degree) for degree in (2, 3)}


def tangents(normal: Floats) -> tuple[Floats, Floats]:
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


def value(c: Floats, u: Floats, v: Floats) -> Floats:
    """Value of the polynomial with coefficients (14, ...) at u, v."""
    shape = c.shape[1:]
    c, u, v = _in_one_row(c, u, v)
    u1, v1, u2, uv, v2, u3, u2v, uv2, v3, u4, u3v, u2v2, uv3, v4 = c
    in_v = (
        v1
        + u * (uv + u * (u2v + u * u3v))
        + v * (v2 + u * (uv2 + u * u2v2) + v * (v3 + u * uv3 + v * v4))
    )
    return (u * (u1 + u * (u2 + u * (u3 + u * u4))) + v * in_v).reshape(shape)


def value_and_slopes(c: Floats, u: Floats, v: Floats) -> tuple[Floats, Floats, Floats]:
    """Value of the polynomial with coefficients (14, ...) at u, v, and its slopes by u and v."""
    shape = c.shape[1:]
    c, u, v = _in_one_row(c, u, v)
    u1, v1, u2, uv, v2, u3, u2v, uv2, v3, u4, u3v, u2v2, uv3, v4 = c
    # Horner's scheme, which also gives the slopes
    p3 = u3 + u * u4
    p2 = u2 + u * p3
    p1 = u1 + u * p2
    by_u = p1 + u * (p2 + u * (p3 + u * u4))

    # coefficients a of v, v^2, v^3, polynomials of u, and slopes b of the first two
    r, s = u * u3v, u * u2v2
    r2 = u2v + r
    r1 = uv + u * r2
    s1 = uv2 + s
    a1 = v1 + u * r1
    a2 = v2 + u * s1
    a3 = v3 + u * uv3
    b1 = r1 + u * (r2 + r)
    b2 = s1 + s
    q3 = a3 + v * v4
    q2 = a2 + v * q3
    q1 = a1 + v * q2
    by_v = q1 + v * (q2 + v * (q3 + v * v4))
    by_u += v * (b1 + v * (b2 + v * uv3))
    return tuple(values.reshape(shape) for values in (u * p1 + v * q1, by_u, by_v))


def _in_one_row(c: Floats, u: Floats, v: Floats) -> tuple[Floats, Floats, Floats]:
    """Coefficients (14, 3 n) of vectors (14, 3, n), with u, v repeated: twice as fast as
    broadcasting.
    """
    if c.ndim < 3:
        return c, u, v
    n = c.shape[1]
    return c.reshape(N_TERMS, -1), np.concatenate([u] * n), np.concatenate([v] * n)


def product(a: Floats, b: Floats) -> Floats:
    """Scalar product (n,) of vectors (3, n): faster than a reduction over rows of three."""
    x, y, z = a * b
    return x + y + z


def by_term(coefficients: Floats) -> Floats:
    """Coefficients (p, 14, 3) term by term in memory: many times faster to read than blocks of 14 x
    3.
    """
    return np.ascontiguousarray(coefficients.transpose(1, 2, 0)).transpose(2, 0, 1)


def table(coefficients: Floats) -> Floats:
    """Coefficients (p, 14, 3) as (42, p); not copied if stored term by term."""
    return np.ascontiguousarray(coefficients.transpose(1, 2, 0)).reshape(N_TERMS * 3, -1)


def cross(a: Floats, b: Floats) -> Floats:
    """Vector product (3, n) of vectors (3, n)."""
    found = np.empty_like(a)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.subtract(a[j] * b[k], a[k] * b[j], out=found[i])
    return found


N_ON_EDGES = N_NODES - 3  # nodes; three lie inside
AT = np.vstack([NODES, np.eye(3)])  # (15, 3): nodes and corners


def _quadratic(points: Floats) -> Floats:
    """All six products of two of the barycentric coordinates of points (n, 3)."""
    return np.stack([points[:, i] * points[:, j] for i in range(3) for j in range(i, 3)], axis=1)


# (3, 15): values at the nodes inside, from the other nodes and the corners; exact for quadratics
INWARD = np.zeros((N_NODES - N_ON_EDGES, len(AT)))
_AROUND = np.r_[:N_ON_EDGES, N_NODES : len(AT)]
INWARD[:, _AROUND] = _quadratic(AT[N_ON_EDGES:N_NODES]) @ np.linalg.pinv(_quadratic(AT[_AROUND]))
