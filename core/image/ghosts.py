"""Ghosts: display pixels seen by several light paths, and the strongest of these paths.

A path is a sequence of surfaces with one orientation of the display. Light beyond a caustic meets
the same surfaces but shows the display flipped, so it is another path.
"""

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from ..base.steps import Steps
from ..base.vectors import cross_2d
from ..map.pieces import Piece
from ..map.shares import ShareBatches, Shares

# odd hash multiplier for pixels and paths, the golden ratio
MIX = np.uint64(0x9E3779B97F4A7C15)
NO_PATH = np.uint64(0)
# interleaved parts of the display; one is sorted per step
N_PARTS = 64


def paths_of(piece: Piece) -> NDArray[np.uint64]:
    """Paths (n,) of pieces of a view map."""
    turns = []
    for corners in (piece.view, piece.display):
        across = corners[:, 1] - corners[:, 0]
        along = corners[:, -1] - corners[:, 0]
        turns.append(cross_2d(across, along) < 0)
    return piece.branch ^ (turns[0] != turns[1])


class SeenPaths:
    """Weight of each path seen at each display pixel (H, W): sums over shares of area *
    throughput^2.

    Complex glass has as many paths at a pixel as shares. Shares are therefore queued until they are
    as many as the sums, and then added together; sorting all sums for each few shares would take
    quadratic time. Each sum adds its shares in order, whenever they are processed.
    """

    def __init__(self, display_size: tuple[int, int]) -> None:
        self._size = display_size
        self._key, self._path = (np.empty(0, np.uint64) for _ in range(2))
        self._pixel = np.empty(0, np.int64)
        self._weight = np.empty(0)
        self._waiting: list[tuple[NDArray, ...]] = []  # keys, paths, pixels, weights
        self._n_waiting = 0

    def add(self, shares: Shares) -> None:
        """Add some shares with paths."""
        self.add_rows(shares.display_index.astype(np.int64), shares.path, shares.weight)

    def add_rows(self, pixel: NDArray[np.int64], path: NDArray[np.uint64], weight: Floats) -> bool:
        """Add some shares by pixel, path and weight (n,); returns whether it took long."""
        with np.errstate(over="ignore"):
            key = (path ^ pixel.astype(np.uint64) * MIX) * MIX
        self._waiting.append((key, path, pixel, weight))
        self._n_waiting += len(key)
        is_due = self._n_waiting >= len(self._key)
        if is_due:
            self._sum_up()
        return is_due

    def _sum_up(self) -> None:
        """Add the queued shares to the sums."""
        if not self._waiting:
            return

        sums = self._key, self._path, self._pixel, self._weight
        key, path, pixel, weight = map(np.concatenate, zip(sums, *self._waiting, strict=True))
        self._key, first, of = np.unique(key, return_index=True, return_inverse=True)
        self._path, self._pixel = path[first], pixel[first]
        self._weight = np.bincount(of.ravel(), weight, len(first))
        self._waiting, self._n_waiting = [], 0

    def strongest(self) -> NDArray[np.uint64]:
        """The strongest path (H * W,) of each pixel, row by row; NO_PATH if it is not seen."""
        self._sum_up()
        width, height = self._size
        found = np.full(width * height, NO_PATH)
        # ties are resolved by path
        order = np.lexsort((self._path, self._weight))
        found[self._pixel[order]] = self._path[order]
        return found

    def weights(self) -> tuple[Floats, Floats]:
        """The sum over all paths of each pixel (H, W), and the fraction, 0..1, of all paths but the
        strongest.
        """
        self._sum_up()
        width, height = self._size
        whole = np.bincount(self._pixel, self._weight, width * height)
        most = np.zeros(width * height)
        np.maximum.at(most, self._pixel, self._weight)
        contested = 1 - np.divide(most, whole, out=np.ones_like(most), where=whole > 0)
        return whole.reshape(height, width), contested.reshape(height, width)


def strongest_paths(batches: ShareBatches) -> Steps[NDArray[np.uint64]]:
    """The strongest path (H * W,) of each display pixel."""
    width, height = batches.display_size
    found = np.full(width * height, NO_PATH)
    parts = [SeenPaths((len(found[k::N_PARTS]), 1)) for k in range(N_PARTS)]

    for shares in batches.pausing():
        yield 0
        if shares is None:
            continue
        pixel, part = np.divmod(shares.display_index.astype(np.int64), N_PARTS)
        order = np.argsort(part.astype(np.uint8), kind="stable")
        rows = pixel[order], shares.path[order], shares.weight[order]
        ends = np.cumsum(np.bincount(part, minlength=N_PARTS))
        for paths, *of_part in zip(parts, *(np.split(row, ends[:-1]) for row in rows), strict=True):
            if paths.add_rows(*of_part):
                yield 0

    for k, paths in enumerate(parts):
        found[k::N_PARTS] = paths.strongest()
        yield 0
    return found
