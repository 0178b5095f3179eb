"""The part of a view map's painting that is done: cells are gathered, shares made of them, and
painted.
"""

from dataclasses import dataclass

import numpy as np

from ..arrays import Floats
from ..map.share_batches import ShareBatches
from ..map.view_map import ViewMap
from .pace import pace

SPREAD = 1.5  # times as many shares as others of their kind may the last cells make


@dataclass(frozen=True, eq=False)
class PaintedPart:
    """Tells how far the painting of some batches of shares is.

    cells, n_made : (n,) after how many cells how many shares are made, about
    to_gather, to_make, to_paint : parts of the time for all cells, to
        make all shares of them, and to paint these; 1 together
    """

    batches: ShareBatches
    cells: Floats
    n_made: Floats
    to_gather: float
    to_make: float
    to_paint: float

    @classmethod
    def of(cls, view_map: ViewMap, batches: ShareBatches) -> "PaintedPart":
        """For the shares of a view map."""
        cells, n_made = np.cumsum(np.pad(view_map.n_by_kind, ((0, 0), (1, 0))), axis=1)
        of_cells = pace().painted_cell.by_clock * cells[-1]
        of_shares = pace().painted_share.by_clock * n_made[-1]
        to_gather = of_cells / (of_cells + of_shares) if of_cells > 0 else 0.0
        to_make = (1 - to_gather) * pace().made_share
        return cls(batches, cells, n_made, to_gather, to_make, 1 - to_gather - to_make)

    def done(self, n: int) -> float:
        """Which part of the work is done when n shares are painted, 0..1: of those that are there,
        or about, while they are made.
        """
        if self.batches.are_kept:
            return n / max(len(self.batches), 1)
        gathered = min(1.0, self.batches.n_gathered / max(self.cells[-1], 1.0))
        expected = self._n_expected
        of_shares = self.to_make * self.batches.n_made + self.to_paint * min(n, expected)
        return self.to_gather * gathered + of_shares / expected

    @property
    def made(self) -> float:
        """Which part of all shares is made, about, 0..1."""
        return self.batches.n_made / self._n_expected

    @property
    def _n_expected(self) -> float:
        """Shares in all, about, while they are made."""
        batches = self.batches
        # cells may make fewer than they seem to: the last are done all the same
        n_cells, n_before = batches.before_lot
        before, with_lot = np.interp((n_cells, batches.n_divided), self.cells, self.n_made)
        of_lot = max(with_lot - before - (batches.n_made - n_before), 0.0)
        by_cells = SPREAD * (of_lot + self.n_made[-1] - with_lot)
        left = min(max(self.n_made[-1] - batches.n_made, 0.0), by_cells)
        return max(batches.n_made + left, 1.0)
