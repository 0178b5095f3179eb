"""Products of many small vectors and matrices, and many small linear systems, in one thread.

BLAS, used by numpy's `@` and `linalg.solve`, distributes these among threads by row count,
regardless of the work per row. Waking threads for three multiplications a row costs more than it
saves, especially on a busy machine. Thousands of 12 x 12 systems in numpy 1.26 take 7 ms in one
thread and 400 to 1200 ms in two. The last bits then also depend on the machine. Products with a
small inner dimension therefore use `einsum`, which avoids BLAS. Rejected: explicit sums of outer
products, which write every intermediate sum (5 times as slow), and pieces small enough for
single-threaded BLAS (the limits differ between versions).
"""

from collections.abc import Sequence

import numpy as np

from .arrays import Floats

SYSTEMS_AT_ONCE = 1 << 10  # eliminated together, so their arrays stay in the cache


def turn(linear: Floats, vectors: Floats) -> Floats:
    """Multiply vectors (..., j) by a matrix (k, j): `vectors @ linear.T`, (..., k)."""
    return np.einsum("kj,...j->...k", linear, vectors)


def combine(weights: Floats, rows: Floats) -> Floats:
    """Weighted sums (m, n) of long rows (k, n) with weights (m, k): `weights @ rows`.

    Faster if the rows are contiguous.
    """
    return np.einsum("mk,kn->mn", weights, rows)


def turn_covariance(
    covariance: Sequence[Floats], a: Floats, b: Floats, c: Floats, d: Floats
) -> Floats:
    """Covariances (3, n), xx, xy and yy, of points mapped by matrices [[a, b], [c, d]]."""
    xx, xy, yy = covariance
    found = np.empty((3, len(xx)))
    found[0] = a * a * xx + 2 * a * b * xy + b * b * yy
    found[1] = a * c * xx + (a * d + b * c) * xy + b * d * yy
    found[2] = c * c * xx + 2 * c * d * xy + d * d * yy
    return found


def solve_symmetric(matrices: Floats, right: Floats) -> Floats:
    """Solutions (n, k, m) of n systems with symmetric positive definite matrices (n, k, k) and
    right sides (n, k, m).

    Elimination without pivots, which such matrices do not need, in all systems at once.
    """
    n_systems, k, _ = right.shape
    solved = np.empty(right.shape)

    for first in range(0, n_systems, SYSTEMS_AT_ONCE):
        some = slice(first, first + SYSTEMS_AT_ONCE)
        # systems last: each step works on long contiguous rows
        a = np.concatenate([matrices[some], right[some]], axis=2).transpose(1, 2, 0).copy()

        for i in range(k):
            row = a[i, i + 1 :] / a[i, i]
            # by symmetry the column below the diagonal equals the row
            a[i + 1 :, i + 1 :] -= a[i, i + 1 : k, None] * row
            a[i, i + 1 :] = row

        for i in range(k - 2, -1, -1):
            a[i, k:] -= (a[i, i + 1 : k, None] * a[i + 1 :, k:]).sum(axis=0)

        solved[some] = a[:, k:].transpose(2, 0, 1)

    return solved
