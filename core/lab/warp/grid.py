"""Points of the display in rows and columns, at which a warp map is wanted."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...base.arrays import Floats, Ints


@dataclass(frozen=True)
class Grid:
    """Points in rows and columns, row by row from the upper left.

    first, step : (x, y) display px, of the first point, and from one to the next
    columns, rows : how many there are
    """

    first: tuple[float, float]
    step: tuple[float, float]
    columns: int
    rows: int

    def __len__(self) -> int:
        return self.columns * self.rows

    def at(self, number: Ints) -> Floats:
        """Points (n, 2), display px, by their numbers (n,)."""
        place = np.stack([number % self.columns, number // self.columns], axis=1)
        return np.array(self.first) + place * np.array(self.step)

    def bands(self, n_points: int) -> Iterator[range]:
        """The rows in runs of about `n_points` points each."""
        n_rows = max(1, n_points // self.columns)
        for row in range(0, self.rows, n_rows):
            yield range(row, min(row + n_rows, self.rows))

    def steps_to(self, xy: Floats) -> Floats:
        """Columns and rows (..., 2), with their fractions, of display px (..., 2)."""
        return (xy - np.array(self.first)) / np.array(self.step)

    def pixels(self, display_size: tuple[int, int]) -> Ints:
        """The display pixel (n,) of each point, row * width + column; on an edge that after it."""
        width = display_size[0]
        x, y = (
            np.clip(first + step * np.arange(n), 0, size - 1).astype(np.int64)
            for first, step, n, size in zip(
                self.first, self.step, (self.columns, self.rows), display_size, strict=True
            )
        )
        return (y[:, None] * width + x).ravel()


def middles(display_size: tuple[int, int], times: int = 1) -> Grid:
    """The middles of a display's pixels, each cut into `times` a side."""
    width, height = display_size
    return Grid((0.5 / times,) * 2, (1 / times,) * 2, width * times, height * times)


def nodes(display_size: tuple[int, int], step: float) -> Grid:
    """The corners of a mesh over a whole display, about `step` px apart."""
    columns, rows = (max(1, round(n / step)) for n in display_size)
    width, height = display_size
    return Grid((0.0, 0.0), (width / columns, height / rows), columns + 1, rows + 1)
