"""Ghosts: which display pixels are seen by several paths, and which of these is the strongest.

A path is a way through the same surfaces that shows the display the same way round. Beyond a
caustic light takes the same surfaces, and shows it turned over: that is another path.
"""

import numpy as np
from numpy.typing import NDArray

from ..arrays import Floats
from ..map.pieces import Piece
from ..map.share_batches import ShareBatches
from ..map.shares import Shares
from ..steps import Pauses
from ..vectors import cross_2d

# an odd number: pixels and paths are mixed to one number, the golden ratio
MIX = np.uint64(0x9E3779B97F4A7C15)
NO_PATH = np.uint64(0)


def paths_of(piece: Piece) -> NDArray[np.uint64]:
    """Paths (n,) of pieces of a view map."""
    turns = []
    for corners in (piece.view, piece.display):
        across = corners[:, 1] - corners[:, 0]
        along = corners[:, -1] - corners[:, 0]
        turns.append(cross_2d(across, along) < 0)
    return piece.branch ^ (turns[0] != turns[1])


class Paths:
    """How strongly each display pixel (H, W) is seen by each
    path: sums over shares of area * throughput^2.
    """

    def __init__(self, display_size: tuple[int, int]) -> None:
        self._size = display_size
        self._key, self._path = (np.empty(0, np.uint64) for _ in range(2))
        self._pixel = np.empty(0, np.int64)
        self._weight = np.empty(0)

    def add(self, shares: Shares) -> None:
        """Add some shares, which know their paths."""
        pixel = shares.display_index.astype(np.int64)
        with np.errstate(over="ignore"):
            key = (shares.path ^ pixel.astype(np.uint64) * MIX) * MIX
        keys, first, of = np.unique(
            np.concatenate([self._key, key]), return_index=True, return_inverse=True
        )
        self._pixel = np.concatenate([self._pixel, pixel])[first]
        self._path = np.concatenate([self._path, shares.path])[first]
        self._weight = np.bincount(
            of.ravel(), np.concatenate([self._weight, shares.weight]), len(keys)
        )
        self._key = keys

    def strongest(self) -> NDArray[np.uint64]:
        """The strongest path (H * W,) of each pixel, row by row; NO_PATH where it is not seen."""
        width, height = self._size
        found = np.full(width * height, NO_PATH)
        # of two that are as strong it is always the same one
        order = np.lexsort((self._path, self._weight))
        found[self._pixel[order]] = self._path[order]
        return found

    def weights(self) -> tuple[Floats, Floats]:
        """The sum over all paths of each pixel (H, W), and the part
        of it, 0..1, that other paths than the strongest have.
        """
        width, height = self._size
        whole = np.bincount(self._pixel, self._weight, width * height)
        most = np.zeros(width * height)
        np.maximum.at(most, self._pixel, self._weight)
        contested = 1 - np.divide(most, whole, out=np.ones_like(most), where=whole > 0)
        return whole.reshape(height, width), contested.reshape(height, width)


def strongest_paths(batches: ShareBatches) -> Pauses[NDArray[np.uint64]]:
    """The path (H * W,) that most of each display pixel is seen by."""
    paths = Paths(batches.display_size)
    for shares in batches.pausing():
        if shares is not None:
            paths.add(shares)
        yield 0
    return paths.strongest()
