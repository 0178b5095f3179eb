"""Windows of a photograph in which a dot or a crossing may be, and its readings between pixels."""

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Floats, Ints


@dataclass(frozen=True)
class Search:
    """Where something may be: bright maxima of the Hessian's determinant, in an image and in its
    halves, quarters ...; held to rendered photographs by tests/core/test_lattice.py.

    n_levels : the image and its halves, quarters ...
    least_side_px : of an image in which anything is looked for
    rows_at_once : so that a step's arrays stay in the processor's cache
    above_noise : times the noise of the level, the least strength
    median_of_noise : median of normal noise, its sign aside, whose deviation is 1
    trace_of_noise : the Hessian's trace by the root of its determinant, of noise
    least_contrast : of the image's range: of 8 bits the smallest step
    strength_of_contrast : Hessian of the smoothed image at a dot of contrast 1
    most_candidates : of a level, the strongest
    around_px : px of a level on each side of a candidate
    windows_at_once : candidates that are looked at together
    """

    n_levels: int = 5
    least_side_px: int = 24
    rows_at_once: int = 128
    above_noise: float = 5.0
    median_of_noise: float = 0.67
    trace_of_noise: float = 2
    least_contrast: float = 5e-4
    strength_of_contrast: float = 0.12
    most_candidates: int = 4000
    around_px: int = 20
    windows_at_once: int = 500


SEARCH = Search()
HALO = 8  # rows: three passes of two, one for derivatives, one for maxima


class Marks(NamedTuple):
    """Dots or crossings in the middles of windows.

    which (n,) windows; off (n, 2) px from the middle; radius, contrast (n,)
    """

    which: Ints
    off: Floats
    radius: Floats
    contrast: Floats


def levels_of(grey: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    """The image, and means of 2 x 2, 4 x 4 ... of its pixels, which keep centroids."""
    levels = [grey]
    while len(levels) < SEARCH.n_levels and min(levels[-1].shape) >= 2 * SEARCH.least_side_px:
        last = levels[-1]
        h, w = (n // 2 * 2 for n in last.shape)
        rows = last[0:h:2, :w] + last[1:h:2, :w]
        levels.append((rows[:, 0::2] + rows[:, 1::2]) * np.float32(0.25))
    return levels


def candidates(level: NDArray[np.float32]) -> tuple[Ints, Ints, Floats]:
    """Pixels x, y (k,) where the image bends down in all
    directions, as at dots and crossings but not along lines.

    And how much: the root of the Hessian's determinant.
    """
    h = len(level)
    padded = np.pad(level, HALO, mode="reflect")

    found = []
    noise = []

    for first in range(0, h, SEARCH.rows_at_once):
        rows = padded[first : min(first + SEARCH.rows_at_once, h) + 2 * HALO]
        bend, trace = _bend(rows)
        noise.append(trace[::4, ::4].ravel())
        y, x = np.nonzero(_is_top(bend))
        found.append(np.stack([x, y + first, np.sqrt(bend[1:-1, 1:-1][y, x])], axis=1))

    # well above the noise, the strongest first
    x, y, strength = np.concatenate(found).T
    deviation = np.median(np.abs(np.concatenate(noise))) / SEARCH.median_of_noise
    level_noise = deviation / SEARCH.trace_of_noise
    least_step = SEARCH.least_contrast * SEARCH.strength_of_contrast * np.ptp(level)
    strong = np.flatnonzero(strength > max(SEARCH.above_noise * level_noise, least_step))
    strong = strong[np.argsort(-strength[strong], kind="stable")][: SEARCH.most_candidates]

    return x[strong].astype(int), y[strong].astype(int), strength[strong]


def _bend(rows: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Determinant of the Hessian, 0 where the image does not bend down, and its trace."""
    for _ in range(3):  # each with a variance of one pixel squared
        rows = _smooth(rows)
        rows = _smooth(rows.T).T

    rows = np.ascontiguousarray(rows)

    inner = rows[1:-1, 1:-1]
    xx = rows[1:-1, 2:] - 2 * inner + rows[1:-1, :-2]
    yy = rows[2:, 1:-1] - 2 * inner + rows[:-2, 1:-1]
    xy = (rows[2:, 2:] - rows[2:, :-2] - rows[:-2, 2:] + rows[:-2, :-2]) / 4
    trace = xx + yy

    return np.where(trace < 0, xx * yy - xy * xy, 0), trace


def _is_top(bend: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which pixels, but for the outermost, are above 0 and the largest of nine?"""
    middle = bend[1:-1, 1:-1]
    is_top = middle > 0
    n, m = middle.shape
    for dy, dx in product((0, 1, 2), repeat=2):
        if (dy, dx) != (1, 1):
            other = bend[dy : dy + n, dx : dx + m]
            is_top &= middle > other if (dy, dx) < (1, 1) else middle >= other
    return is_top


def _smooth(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Binomial of five along the first axis, which loses two at each end."""
    one = rows[1:] + rows[:-1]
    two = one[1:] + one[:-1]
    one = two[1:] + two[:-1]
    return (one[1:] + one[:-1]) * np.float32(1 / 16)


def windows_at(padded: NDArray[np.float32], x: Ints, y: Ints) -> NDArray[np.float32]:
    """The image around pixels (k,): (k, s, s), s = 2 around_px + 1; padded by around_px."""
    side = np.arange(2 * SEARCH.around_px + 1)
    return padded[y[:, None, None] + side[:, None], x[:, None, None] + side]


def read_between(windows: NDArray[np.float32], at: NDArray[np.complex128]) -> Floats:
    """Windows (k, s, s) at places (k, ..., ) off their middles, x + iy, bilinear."""
    around = SEARCH.around_px
    most = 2 * around - 1e-3
    x = np.clip(at.real + around, 0, most)
    y = np.clip(at.imag + around, 0, most)
    column = x.astype(int)
    row = y.astype(int)
    x, y = x - column, y - row

    side = 2 * around + 1
    first = (
        (np.arange(len(windows)) * side**2).reshape(-1, *(1,) * (at.ndim - 1)) + row * side + column
    )
    flat = windows.reshape(-1)
    return (flat[first] * (1 - x) + flat[first + 1] * x) * (1 - y) + (
        flat[first + side] * (1 - x) + flat[first + side + 1] * x
    ) * y
