"""Passes over all pixels of an image, bit-identical to numpy's."""

import ctypes
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bools, Floats
from .loading import loaded, n_threads
from .structures import LevelStructure


def decode(
    pixels: NDArray[np.float32],
    table: NDArray[np.float32] | None,
    has_coverage: bool,
    is_straight: bool,
) -> bool:
    """Decode a picture (h, w, 4) with contiguous rows in place; returns whether all numbers are
    finite.

    table : 256 linear values of encoded colours 0..1; None for linear ones
    has_coverage : the fourth channel is coverage; otherwise it is set to 1
    is_straight : multiply colours by coverage
    """
    level = of_levels([pixels])
    decoding = 0 if table is None else table.ctypes.data
    flags = has_coverage, is_straight
    return bool(loaded().kiriko_decode(ctypes.addressof(level), decoding, *flags, n_threads()))


def halved(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Half the size of a picture (h, w, 4) of even sides, by area means."""
    h, w, n = pixels.shape
    half = np.empty((h // 2, w // 2, n), np.float32)
    level = of_levels([pixels])
    loaded().kiriko_halve(ctypes.addressof(level), half.ctypes.data)
    return half


def finish(total: Floats, weight: Floats, is_covered: Bools) -> NDArray[np.float32]:
    """The image (H, W, 3) of sums (3, H, W) over shares: divided by their weight (H, W) where
    covered (H, W), else black.
    """
    image = np.empty((*weight.shape, 3), np.float32)
    given = [np.ascontiguousarray(values) for values in (total, weight, is_covered)]
    addresses = (array.ctypes.data for array in (*given, image))
    loaded().kiriko_finish(*addresses, weight.size, n_threads())
    return image


def of_levels(levels: Sequence[NDArray[np.float32]]) -> ctypes.Array:
    """The structures of a picture's sizes (h, w, 4) float32, with contiguous rows."""
    made = (LevelStructure * len(levels))()
    for of_level, pixels in zip(made, levels, strict=True):
        of_level.pixels = pixels.ctypes.data
        of_level.height, of_level.width = pixels.shape[:2]
        of_level.stride = pixels.strides[0] // pixels.itemsize
    return made
