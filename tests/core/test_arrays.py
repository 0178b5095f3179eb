"""Work on arrays that goes round numpy where it is slow."""

import numpy as np
import pytest

from kiriko.core.base.arrays import greatest, stable_argsort

N = 1000


@pytest.mark.parametrize(
    ("most", "dtype"),
    [(3, np.int64), (10**6, np.int64), (2**62, np.int64), (2**31 - 1, np.int32)],
    ids=["few", "many", "too large to be packed", "of 32 bits"],
)
def test_numbers_are_ordered_as_by_a_stable_argsort(most, dtype):
    """Equal ones stay in their order; numbers that leave no bits free are ordered, too."""
    numbers = np.random.default_rng(0).integers(0, most, N, dtype)
    numbers[N // 2 :] = numbers[: N // 2]
    assert np.array_equal(stable_argsort(numbers), np.argsort(numbers, kind="stable"))
    assert len(stable_argsort(numbers[:0])) == 0


@pytest.mark.parametrize("shape", [(N, 5), (N, 3, 3), (0, 3, 3)])
def test_the_greatest_of_each_row_is_found(shape):
    """Of rows of one axis or two, none too; NaN where one of them is."""
    rows = np.random.default_rng(0).normal(size=shape)
    rows[3:7, 1] = np.nan
    expected = rows.max(axis=tuple(range(1, rows.ndim)))
    assert np.array_equal(greatest(rows), expected, equal_nan=True)
