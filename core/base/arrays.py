"""Types of arrays, and work that numpy does several times slower where rows are a few
numbers long.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

# spacing of float32 numbers just above 1
FLOAT32 = 2.0**-23


def frozen(values: NDArray) -> NDArray:
    """The same array, which nobody can write to any more."""
    values.flags.writeable = False
    if isinstance(values.base, np.ndarray):
        frozen(values.base)
    return values


def is_frozen(values: NDArray) -> bool:
    """Can nobody write to it, nor to an array that it is a view of?"""
    if values.flags.writeable:
        return False
    return values.base is None or (isinstance(values.base, np.ndarray) and is_frozen(values.base))


def take(values: NDArray, which: Bools | Ints) -> NDArray:
    """`values[which]`, which is slow to begin each row: of 200
    000 rows of two numbers it takes 4 ms, this 0.4.
    """
    return values.compress(which, axis=0) if which.dtype == np.bool_ else values.take(which, axis=0)


def transpose_rows(rows: NDArray) -> NDArray:
    """Rows (n, ...) of a few numbers as columns (..., n): numpy goes along them several times as
    fast.
    """
    return np.ascontiguousarray(np.moveaxis(rows, 0, -1))


def greatest(rows: Floats) -> Floats:
    """The greatest number (n,) of each row (n, ...), NaN where one is."""
    return np.maximum.reduce(transpose_rows(rows), axis=tuple(range(rows.ndim - 1)))


def stable_argsort(numbers: Ints) -> Ints:
    """The same as a stable `argsort` of numbers (n,), none of which is below 0: numpy sorts whole
    numbers up to ten times as fast as it finds their order.
    """
    bits = len(numbers).bit_length()
    if int(numbers.max(initial=0)) >> (63 - bits):
        return np.argsort(numbers, kind="stable")
    # on Windows numpy's whole numbers may be of 32 bits
    packed = numbers.astype(np.int64) << bits | np.arange(len(numbers), dtype=np.int64)
    return np.sort(packed) & ((1 << bits) - 1)


def mean_at(values: Floats, corners: Ints) -> Floats:
    """`values[corners].mean(axis=1)`, (n, ...), of values (m, ...) at corners (n, k)."""
    return sum(take(values, corner) for corner in corners.T) / corners.shape[1]


def whole_within(places: Floats, most: tuple[int, int]) -> tuple[Ints, Ints]:
    """Columns and rows (n,) of places (n, 2): whole numbers, from 0 to the most of each.

    Axis by axis: numpy is slow where rows are two numbers long.
    """
    column, row = (
        np.clip(along, 0, last).astype(np.int64) for along, last in zip(places.T, most, strict=True)
    )
    return column, row


def in_blocks(image: NDArray, side: int) -> NDArray:
    """An image (h, w) with each pixel so many times along both axes; `repeat` goes one by one."""
    h, w = image.shape
    blocks = np.empty((h, side, w, side), image.dtype)
    blocks[:] = image[:, None, :, None]
    return blocks.reshape(h * side, w * side)


def unique_inverse(numbers: Ints) -> tuple[Ints, Ints]:
    """Different numbers (u,), none below 0 or much above how many there are, sorted, and the place
    among them of each, as `np.unique` finds them by sorting.
    """
    is_there = np.zeros(int(numbers.max(initial=-1)) + 1, bool)
    is_there[numbers] = True
    return np.flatnonzero(is_there), (np.cumsum(is_there) - 1)[numbers]


def each_value(values: Ints) -> Iterator[tuple[int, Ints]]:
    """Each different value, and where it stands."""
    for value in np.unique(values):
        yield int(value), np.flatnonzero(values == value)
