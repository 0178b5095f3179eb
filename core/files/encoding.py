"""Converts linear light to the numbers of an image file, and back."""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arrays import Floats

VALUES_AT_ONCE = 1 << 17  # stay in the processor's cache between steps
ONE = 0x3F800000  # bits of the float32 number 1
SHIFT = 14  # low bits shared by one entry of a table


def encode(linear: ArrayLike, gamma: float | None = None) -> Floats:
    """Encode linear values, clipped to 0..1, as float64 values 0..1.

    gamma : the display emits value ** gamma; None: sRGB (IEC 61966-2-1)
    """
    linear = np.clip(np.nan_to_num(np.asarray(linear, float)), 0.0, 1.0)
    if gamma is not None:
        return linear ** (1 / gamma)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def linear_from_srgb(encoded: Floats) -> Floats:
    """Linear light of sRGB-encoded numbers, both 0..1. Source: IEC 61966-2-1."""
    return np.where(
        encoded <= 0.04045, encoded / 12.92, ((np.maximum(encoded, 0.0) + 0.055) / 1.055) ** 2.4
    )


class _Table(NamedTuple):
    """8-bit numbers by the bits of a float32 value in 0..1: entry `bits >> SHIFT` gives the number,
    plus one if `bits` >= `more`; (65025,) each.
    """

    number: NDArray[np.uint8]
    more: NDArray[np.uint32]


def quantised(
    linear: NDArray[np.floating], kind: str, gamma: float | None = None
) -> NDArray[np.integer]:
    """Encoded values as rounded integers up to the greatest number of the type.

    A table replaces the powers if there is one; results are identical.

    kind : "uint8" or "uint16"
    """
    table = _table(gamma) if kind == "uint8" and linear.dtype == np.float32 else None
    if table is None:
        top = np.iinfo(kind).max
        return np.ascontiguousarray(np.rint(encode(linear, gamma) * top).astype(kind))

    numbers = np.empty(linear.shape, np.uint8)
    out = numbers.reshape(-1)
    values = np.ascontiguousarray(linear).reshape(-1)
    for first in range(0, len(values), VALUES_AT_ONCE):
        some = np.fmax(values[first : first + VALUES_AT_ONCE], np.float32(0))  # 0 for NaN
        np.fmin(some, np.float32(1), out=some)
        bits = np.abs(some, out=some).view(np.uint32)  # also removes the sign of -0
        entry = (bits >> np.uint32(SHIFT)).astype(np.intp)
        is_more = bits >= table.more.take(entry)
        np.add(table.number.take(entry), is_more, out=out[first : first + VALUES_AT_ONCE])
    return numbers


@cache
def _table(gamma: float | None) -> _Table | None:
    """The table of an encoding; None if one entry would span more than two numbers."""
    first = np.arange((ONE >> SHIFT) + 1, dtype=np.uint32) << np.uint32(SHIFT)
    number, next_number = (_numbers(bits, gamma) for bits in (first, first + np.uint32(1 << SHIFT)))
    if (next_number > number + 1).any():
        return None

    # bisect for the last bits of the lower number in entries with two
    changing = np.flatnonzero(next_number > number)
    last = first[changing]
    for step in reversed(range(SHIFT)):
        further = last + np.uint32(1 << step)
        last = np.where(_numbers(further, gamma) == number[changing], further, last)
    more = np.full(len(first), ONE + 1, np.uint32)
    more[changing] = last + 1
    return _Table(number.astype(np.uint8), more)


def _numbers(bits: NDArray[np.uint32], gamma: float | None) -> Floats:
    """The 8-bit numbers of float32 numbers."""
    return np.rint(encode(bits.view(np.float32), gamma) * 255)
