"""Products of many small vectors and matrices, and many small systems of equations, in one thread.

BLAS, which numpy asks for `@` and `linalg.solve`, shares these out among threads: it counts rows,
not the work in each. Threads that are woken for three multiplications a row cost more than they
save, by far when others want the processor: thousands of 12 x 12 systems in numpy 1.26, 7 ms in one
thread, take 400 to 1200 ms in two. The last bits, too, then depend on the machine. So products
whose inner dimension is a handful and whose other may be large are taken by `einsum`, which asks no
BLAS. Tried and left: explicit sums of outer products, which write every intermediate sum (5 times
as slow), and pieces small enough for BLAS to keep to one thread (the limits differ from version to
version).
"""

from collections.abc import Sequence

import numpy as np

from .arrays import Floats

SYSTEMS_AT_ONCE = 1 << 10  # systems eliminated together: their arrays stay in the cache


def turn(linear: Floats, vectors: Floats) -> Floats:
    """Vectors (..., j) times a matrix (k, j): `vectors @ linear.T`, (..., k)."""
    return np.einsum("kj,...j->...k", linear, vectors)


def combine(weights: Floats, rows: Floats) -> Floats:
    """Sums (m, n) of long rows (k, n), with weights (m, k):
    `weights @ rows`. Faster where the rows are contiguous.
    """
    return np.einsum("mk,kn->mn", weights, rows)


def turn_covariance(
    covariance: Sequence[Floats], a: Floats, b: Floats, c: Floats, d: Floats
) -> Floats:
    """Covariances (3, n), xx, xy and yy, of points that were mapped by matrices [[a, b],
    [c, d]].
    """
    xx, xy, yy = covariance
    found = np.empty((3, len(xx)))
    found[0] = a * a * xx + 2 * a * b * xy + b * b * yy
    found[1] = a * c * xx + (a * d + b * c) * xy + b * d * yy
    found[2] = c * c * xx + 2 * c * d * xy + d * d * yy
    return found


def solve_symmetric(matrices: Floats, right: Floats) -> Floats:
    """Solutions (n, k, m) of n systems with symmetric positive
    definite matrices (n, k, k) and right sides (n, k, m).

    By elimination without pivots, which such matrices do not need, in all of them at once.
    """
    n_systems, k, _ = right.shape
    solved = np.empty(right.shape)

    for first in range(0, n_systems, SYSTEMS_AT_ONCE):
        some = slice(first, first + SYSTEMS_AT_ONCE)
        # entries first, systems last: each step is of long contiguous rows
        a = np.concatenate([matrices[some], right[some]], axis=2).transpose(1, 2, 0).copy()

        for i in range(k):
            row = a[i, i + 1 :] / a[i, i]
            # by symmetry the column below the diagonal is the row beside it
            a[i + 1 :, i + 1 :] -= a[i, i + 1 : k, None] * row
            a[i, i + 1 :] = row

        for i in range(k - 2, -1, -1):
            a[i, k:] -= (a[i, i + 1 : k, None] * a[i + 1 :, k:]).sum(axis=0)

        solved[some] = a[:, k:].transpose(2, 0, 1)

    return solved
