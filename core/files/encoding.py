"""Converts linear light to the numbers of an image file, and back."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import log, log2, log10
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arrays import Floats

VALUES_AT_ONCE = 1 << 17  # stay in the processor's cache between steps
ONE = 0x3F800000  # bits of the float32 number 1
SHIFT = 14  # low bits shared by one entry of a table


# x and y of red, green, blue and white (D65)
REC709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)  # ITU-R BT.709
DISPLAY_P3 = (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329)  # SMPTE EG 432-1
REC2020 = (0.708, 0.292, 0.17, 0.797, 0.131, 0.046, 0.3127, 0.329)  # ITU-R BT.2020
PQ_PEAK = 10000.0  # cd/m^2 of the number 1 (SMPTE ST 2084)


@dataclass(frozen=True)
class Encoding:
    """An encoding of all colours together: other primaries than Rec.709, and a curve.

    name : a key of ENCODINGS
    white : cd/m^2 of a linear value of 1
    """

    name: str
    white: float

    @property
    def codes(self) -> tuple[int, int]:
        """Numbers of primaries and curve in ITU-T H.273, for PNG's cICP chunk."""
        return ENCODINGS[self.name].codes


class EncodingKind(NamedTuple):
    """Primaries, x and y (8,), a curve of linear values (n, 3) by the display's white, codes."""

    primaries: tuple[float, ...]
    curve: Callable[[Floats, float], Floats]
    codes: tuple[int, int]


Curve = float | Encoding | None  # a display's gamma, an encoding, or sRGB


def xyz_from(chromaticities: ArrayLike) -> Floats:
    """Matrix (3, 3) to XYZ, with white at Y = 1, from x and y (8,) of red, green, blue and white.

    Source: SMPTE RP 177.
    """
    xy = np.reshape(chromaticities, (4, 2)).astype(float)
    xyz = np.column_stack([xy, 1 - xy.sum(axis=1)]) / xy[:, 1:]
    return xyz[:3].T * np.linalg.solve(xyz[:3].T, xyz[3])


def _srgb(linear: Floats, white: float = 0.0) -> Floats:
    """IEC 61966-2-1."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def _perceptual(linear: Floats, white: float) -> Floats:
    """PQ, the inverse EOTF of SMPTE ST 2084."""
    m1, m2 = 2610 / 16384, 2523 / 4096 * 128
    c1, c2, c3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
    power = np.minimum(linear * white / PQ_PEAK, 1.0) ** m1
    return ((c1 + c2 * power) / (1 + c3 * power)) ** m2


def _hybrid(linear: Floats, white: float) -> Floats:
    """HLG: inverse OOTF with the display's white as its peak, then the OETF; ITU-R BT.2100, tables
    5 and 5f.
    """
    is_near = 400 <= white <= 2000
    gamma = 1.2 + 0.42 * log10(white / 1000) if is_near else 1.2 * 1.111 ** log2(white / 1000)
    luminance = linear @ xyz_from(REC2020)[1]
    scale = np.where(luminance > 0, luminance, 1.0) ** ((1 - gamma) / gamma)
    scene = np.minimum(linear * scale[..., None], 1.0)
    a = 0.17883277
    b, c = 1 - 4 * a, 0.5 - a * log(4 * a)
    upper = a * np.log(np.maximum(12 * scene - b, 1e-9)) + c
    return np.where(scene <= 1 / 12, np.sqrt(3 * scene), upper)


ENCODINGS = {
    "P3": EncodingKind(DISPLAY_P3, _srgb, (12, 13)),
    "PQ": EncodingKind(REC2020, _perceptual, (9, 16)),
    "HLG": EncodingKind(REC2020, _hybrid, (9, 18)),
}


def encode(linear: ArrayLike, gamma: Curve = None) -> Floats:
    """Encode linear values, clipped to 0..1, as float64 values 0..1.

    gamma : the display emits value ** gamma; None: sRGB; an Encoding takes Rec.709 (..., 3 or 4)
    """
    linear = np.clip(np.nan_to_num(np.asarray(linear, float)), 0.0, 1.0)
    if isinstance(gamma, Encoding):
        kind = ENCODINGS[gamma.name]
        matrix = np.linalg.solve(xyz_from(kind.primaries), xyz_from(REC709))
        colours = np.clip(linear[..., :3] @ matrix.T, 0.0, 1.0)
        encoded = np.clip(kind.curve(colours, gamma.white), 0.0, 1.0)
        return np.concatenate([encoded, linear[..., 3:]], axis=-1)
    if gamma is not None:
        return linear ** (1 / gamma)
    return _srgb(linear)


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


def quantised(linear: NDArray[np.floating], kind: str, gamma: Curve = None) -> NDArray[np.integer]:
    """Encoded values as rounded integers up to the greatest number of the type.

    A table replaces the powers if there is one; results are identical.

    kind : "uint8" or "uint16"
    """
    has_table = kind == "uint8" and linear.dtype == np.float32 and not isinstance(gamma, Encoding)
    table = _table(gamma) if has_table else None
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
