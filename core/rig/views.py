"""Views of a display: light of one place shows another image in each direction.

Light-field displays have a lens sheet over their pixels. A view is the image that one position of
the eye sees: cameras on a line, evenly spaced, look at the display as at a window. View 0 is the
leftmost of the lowest row. Its tile is in the lower left corner of the *quilt*, the image of all
views, and the others follow to the right, then upward: the order of Looking Glass's players
(https://docs.lookingglassfactory.com/keyconcepts/quilts).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf

import numpy as np

from ..base.arrays import Bools, Floats, Ints
from ..base.errors import RigError, out_of_range

Size = tuple[int, int]  # columns and rows, or width and height
HALF_TURN = 180.0  # degrees
LEAST_WIDTH = 1e-12  # of a beam, in views


def tile_corner(view: Ints | int, tiling: Size, size: Size) -> tuple[Ints, Ints]:
    """Left and upper corner, px, of the tiles of views (n,) in a quilt of a tiling.

    size : of a tile, px
    """
    columns, rows = tiling
    return view % columns * size[0], (rows - 1 - view // columns) * size[1]


@dataclass(frozen=True)
class Views:
    """The views of a display.

    Parameters
    ----------
    columns, rows : number of views; a single one on an axis is seen from all its directions
    cone : rad, horizontal and vertical angle between the outermost views, as seen from the
        display's middle
    overlap : 0..1 of the distance between neighbours, over which one view fades into the next; each
        view extends by half of it on both sides
    distance : m, from the display, where each view is seen over the whole display; inf for views
        that are the same angle everywhere
    """

    columns: int
    rows: int = 1
    cone: tuple[float, float] = (0.0, 0.0)
    overlap: float = 0.0
    distance: float = inf

    @property
    def n(self) -> int:
        """Number of views."""
        return self.columns * self.rows

    @property
    def spacing(self) -> Floats:
        """Distance (2,) of neighbouring views in the tangent of the angle; inf for one view."""
        n = np.array([self.columns, self.rows], float)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(n > 1, 2 * np.tan(np.divide(self.cone, 2)) / (n - 1), inf)

    @property
    def _middle(self) -> Floats:
        return (np.array([self.columns, self.rows]) - 1) / 2

    def check(self, owner: str) -> None:
        """Raise RigError for numbers that no display has."""
        if min(self.columns, self.rows) < 1:
            raise RigError("{owner} has no views: set Columns and Rows to 1 or more.", owner=owner)
        for n, angle in zip((self.columns, self.rows), self.cone, strict=True):
            degrees = float(np.degrees(angle))
            if n > 1 and not 0 < degrees < HALF_TURN:
                raise RigError(
                    "{owner} has views over a cone of {angle:g} degrees: set Cone above 0 and"
                    " below 180.",
                    owner=owner,
                    angle=degrees,
                )
        if not 0 <= self.overlap <= 1:
            raise out_of_range(owner, "Overlap", self.overlap, 0, 1)
        if not self.distance > 0:
            raise out_of_range(owner, "Distance", self.distance, 0)

    def tiling(self, size: Size) -> Size:
        """Columns and rows of the quilt of views of a size (width, height), px.

        A single row of views wraps into the rectangle nearest to a square.
        """
        if self.rows > 1:
            return self.columns, self.rows
        columns = [n for n in range(1, self.n + 1) if self.n % n == 0]
        shape = [abs(np.log(n * size[0] / (self.n // n * size[1]))) for n in columns]
        best = columns[int(np.argmin(shape))]
        return best, self.n // best

    def quilt_size(self, size: Size) -> Size:
        """Width and height, px, of the quilt of views of a size."""
        columns, rows = self.tiling(size)
        return columns * size[0], rows * size[1]

    def in_quilt(self, pixel: Ints, view: Ints, size: Size) -> Ints:
        """Pixels (n,) of the quilt, row by row, for pixels (n,) of views (n,)."""
        left, top = tile_corner(view, self.tiling(size), size)
        width = self.quilt_size(size)[0]
        return (pixel // size[0] + top) * width + pixel % size[0] + left

    def beam(self, slope: Floats, place: Floats) -> Floats:
        """Column and row (n, 2), in units of views, whole at a view's middle, of light that leaves
        the display with tangents (n, 2) to the right and upward.

        place : (n, 2) m, right and up from the display's middle. At a finite distance m, light to
            the place c on the line of cameras has the tangent (c - place) / m.
        """
        return (slope + place / self.distance) / self.spacing + self._middle

    def are_within(self, beam: Floats) -> Bools:
        """Whether beams (n, 2) are entirely in views."""
        reach = (1 - self.overlap) / 2
        with np.errstate(invalid="ignore"):
            return ((beam >= -reach) & (beam <= [self.columns - 1 + reach, self.rows - 1 + reach])
                    ).all(axis=1)  # fmt: skip

    def shown(
        self, beam: Floats, spread: Floats | float = 0.0
    ) -> Iterator[tuple[Ints, Ints, Floats]]:
        """The light of beams (n, 2) by view: indices (m,) of some, the view (m,) of each, and its
        part (m,) of their light, above 0 up to 1. A beam is in up to two views of an axis, or none.

        spread : (n, 2) widths of the beams, in views, up to 1
        """
        widths = np.broadcast_to(np.hypot(self.overlap, spread), beam.shape).T
        column, row = map(_on_axis, beam.T, widths)
        for x, first in column:
            for y, second in row:
                weight = first * second
                is_in = (weight > 0) & (x >= 0) & (x < self.columns) & (y >= 0) & (y < self.rows)
                some = np.flatnonzero(is_in)
                yield some, (y[some] * self.columns + x[some]).astype(np.int64), weight[some]


def _on_axis(along: Floats, width: Floats) -> list[tuple[Floats, Floats]]:
    """Two views (n,) of beams (n,) on an axis, with weights (n,) that add up to 1.

    A view's weight is the part of the interval of a width around the beam that is nearest to it:
    with `overlap` it fades linearly.
    """
    width = np.minimum(width, 1.0)
    first, last = (np.floor(along + 0.5 + k * width / 2) for k in (-1, 1))
    into = (first + 0.5 - along) / np.maximum(width, LEAST_WIDTH)
    weight = np.where(last > first, np.clip(into + 0.5, 0.0, 1.0), 1.0)
    return [(first, weight), (last, 1 - weight)]
