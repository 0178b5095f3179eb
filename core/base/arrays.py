"""Array types, and faster versions of numpy operations on short rows."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

# spacing of float32 numbers just above 1
FLOAT32 = 2.0**-23


def convert(record: Any, kind: Callable[[Any], Any], *names: str) -> None:
    """Convert fields of a frozen dataclass that are not None."""
    for name in names:
        value = getattr(record, name)
        if value is not None:
            object.__setattr__(record, name, kind(value))


def frozen(values: NDArray) -> NDArray:
    """Make an array and its bases read-only; returns the same array."""
    values.flags.writeable = False
    if isinstance(values.base, np.ndarray):
        frozen(values.base)
    return values


def is_frozen(values: NDArray) -> bool:
    """Whether an array and all its bases are read-only."""
    if values.flags.writeable:
        return False
    return values.base is None or (isinstance(values.base, np.ndarray) and is_frozen(values.base))


def take(values: NDArray, which: Bools | Ints) -> NDArray:
    """`values[which]`, faster for short rows: 0.4 ms instead of 4 ms for 200 000 rows of two
    numbers.
    """
    return values.compress(which, axis=0) if which.dtype == np.bool_ else values.take(which, axis=0)


def transpose_rows(rows: NDArray) -> NDArray:
    """Short rows (n, ...) as contiguous columns (..., n), along which numpy is several times as
    fast.
    """
    return np.ascontiguousarray(np.moveaxis(rows, 0, -1))


def greatest(rows: Floats) -> Floats:
    """Maximum (n,) of each row (n, ...); NaN if the row contains one."""
    return np.maximum.reduce(transpose_rows(rows), axis=tuple(range(rows.ndim - 1)))


def stable_argsort(numbers: Ints) -> Ints:
    """Stable `argsort` of non-negative integers (n,).

    numpy sorts integers up to ten times as fast as it finds their order, so keys and positions are
    packed together.
    """
    bits = len(numbers).bit_length()
    if int(numbers.max(initial=0)) >> (63 - bits):
        return np.argsort(numbers, kind="stable")
    # numpy's default integer may have 32 bits on Windows
    packed = numbers.astype(np.int64) << bits | np.arange(len(numbers), dtype=np.int64)
    return np.sort(packed) & ((1 << bits) - 1)


def mean_at(values: Floats, corners: Ints) -> Floats:
    """`values[corners].mean(axis=1)`, (n, ...), of values (m, ...) at corners (n, k)."""
    return sum(take(values, corner) for corner in corners.T) / corners.shape[1]


def whole_within(places: Floats, most: tuple[int, int]) -> tuple[Ints, Ints]:
    """Integer columns and rows (n,) of places (n, 2), clipped to 0..most on each axis.

    Each axis is clipped separately because numpy is slow on rows of two.
    """
    column, row = (
        np.clip(along, 0, last).astype(np.int64) for along, last in zip(places.T, most, strict=True)
    )
    return column, row


def in_blocks(image: NDArray, side: int) -> NDArray:
    """Enlarge an image (h, w) `side` times along both axes; faster than `repeat`."""
    h, w = image.shape
    blocks = np.empty((h, side, w, side), image.dtype)
    blocks[:] = image[:, None, :, None]
    return blocks.reshape(h * side, w * side)


def unique_inverse(numbers: Ints) -> tuple[Ints, Ints]:
    """Sorted distinct values (u,) and the index (n,) of each number among them, without sorting.

    As `np.unique` with `return_inverse`. The numbers must be non-negative and not much larger than
    their count.
    """
    is_there = np.zeros(int(numbers.max(initial=-1)) + 1, bool)
    is_there[numbers] = True
    return np.flatnonzero(is_there), (np.cumsum(is_there) - 1)[numbers]


def each_value(values: Ints) -> Iterator[tuple[int, Ints]]:
    """Each distinct value with the indices where it occurs."""
    for value in np.unique(values):
        yield int(value), np.flatnonzero(values == value)
