"""Verdicts of mpmath at fifty digits on core: errors of random cases, and the marks they keep.

A case's float64 numbers count as exact, also where a direction is not quite unit. Arrays of
mpmath's numbers are numpy's arrays of objects.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import mpmath
import numpy as np

EPS = np.finfo(float).eps
DIGITS = 50
# k, the square of the cosine behind a face: from here on an
# error may be EXACT, below it 4 eps / sqrt k
STEEP = 1e-6
EXACT = 1e-12
# rad: beyond this from the critical angle it is known whether light is totally reflected
SAME_CLASS = 1e-14

exactly = np.frompyfunc(mpmath.mpf, 1, 1)
sqrt = np.frompyfunc(mpmath.sqrt, 1, 1)
atan2 = np.frompyfunc(mpmath.atan2, 2, 1)
asin = np.frompyfunc(mpmath.asin, 1, 1)


class Verdict(NamedTuple):
    """A verdict on so many cases: worst error where the
    problem is a good one, and worst part of a mark.

    error: relative, where k > STEEP; part: of its mark, of all cases; where: the case with that
    part; n_wrong: cases of the wrong class that rounding does not explain; off: the furthest that a
    case of the wrong class was from where classes part, rad or m
    """

    what: str
    n_cases: int
    error: float
    part: float
    where: str
    n_wrong: int
    off: float

    @property
    def is_kept(self) -> bool:
        return self.part <= 1 and self.n_wrong == 0


def mark(k: np.ndarray) -> np.ndarray:
    """Relative error (n,) that is allowed where k (n,) is the least squared cosine on the way."""
    return np.where(k > STEEP, EXACT, 4 * EPS / np.sqrt(np.maximum(k, EPS**2)))


def verdict(
    what: str,
    error: np.ndarray,
    k: np.ndarray,
    describe: Callable[[int], str],
    is_wrong: np.ndarray | None = None,
    off: np.ndarray | None = None,
    same: float = SAME_CLASS,
) -> Verdict:
    """Of errors (n,), NaN where there is none, with k (n,); `off`
    tells those of the wrong class from the border.
    """
    has_error = np.isfinite(error)
    part = np.where(has_error, error, 0) / mark(k)
    worst = int(np.argmax(part))
    is_wrong = np.zeros(len(error), bool) if is_wrong is None else is_wrong
    off = np.full(len(error), np.inf) if off is None else off
    wrong = np.flatnonzero(is_wrong & (off > same))
    shown = describe(int(wrong[0])) if len(wrong) else describe(worst)
    good = has_error & (k > STEEP)
    furthest = off[is_wrong].max(initial=0.0)
    return Verdict(
        what, len(error), error[good].max(initial=0.0), part[worst], shown, len(wrong), furthest
    )


class Cases(NamedTuple):
    """Errors (n,), k (n,), is_wrong and off (n,) as of `verdict`, and the cases as text."""

    error: np.ndarray
    k: np.ndarray
    is_wrong: np.ndarray
    off: np.ndarray
    text: list[str]


def gathered(
    what: str, n: int, seed: int, judged: Callable[[np.random.Generator], Cases]
) -> Verdict:
    """The verdict on rig after rig, until there are n cases."""
    random = np.random.default_rng(seed)
    parts = []
    with mpmath.workdps(DIGITS):
        while sum(len(part.error) for part in parts) < n:
            parts.append(judged(random))
    error, k, is_wrong, off, text = (np.concatenate(column) for column in zip(*parts, strict=True))
    return verdict(
        what, np.where(is_wrong, np.nan, error), k, lambda i: str(text[i]), is_wrong, off
    )


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Row-wise scalar product (n,)."""
    return (a * b).sum(axis=-1)


def unit(v: np.ndarray) -> np.ndarray:
    """Rows (n, 3) of mpmath's numbers, scaled to length 1."""
    return v / sqrt(dot(v, v))[:, None]


def far_from(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distance (n,) float64 between rows of numbers (n, 3), either of them mpmath's."""
    with np.errstate(
        invalid="ignore"
    ):  # light that is totally reflected has no place behind the face: NaN
        return np.linalg.norm((a - b).astype(float), axis=1)


def named(glass: object, o: np.ndarray, d: np.ndarray) -> list[str]:
    """The cases as text, for whoever wants to see one again."""
    return [f"{glass}, from {a.tolist()} along {b.tolist()}" for a, b in zip(o, d, strict=True)]
