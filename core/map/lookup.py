"""Where does a view map show a place of the viewer's image?"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..base.arrays import Bools, Floats, Ints, each_value, in_blocks, mean_at, taken, whole_within
from ..base.steps import Pauses
from . import interpolation
from .interpolation import PARTS, bilinear
from .points import Points, in_triangles, is_in_image


@dataclass(eq=False)
class Lookup:
    """Cells and samples of a map by the viewer's pixels; the fields are those of `ViewMap`."""

    view_size: tuple[int, int]
    points: Points
    corner: Ints
    size: Ints
    nodes: Ints
    quads: Ints
    triangles: Ints
    samples: Ints
    sample_reach: Floats

    def by_cells(self, xy: Floats) -> Pauses[Floats]:
        """Display pixels (n, 2) that viewer pixels (n, 2) show by way of cells; NaN where there is
        none. Pauses on the way.
        """
        found = np.full(xy.shape, np.nan)
        in_image = np.flatnonzero(is_in_image(xy, self.view_size))
        pixel = self._pixel(xy[in_image])
        owner = self.owner.ravel()[pixel]
        yield 0

        # in smooth cells
        smooth = np.flatnonzero(owner >= 0)
        rays = in_image[smooth]
        cells = owner[smooth]
        places = (xy[rays] - self.corner[cells]) / self.size[cells, None]
        found[rays] = interpolation.at_places(self.points.xy[self.nodes[cells]], places)

        # in whole pixels
        whole = np.flatnonzero(owner < -1)
        rays = in_image[whole]
        quads = self.quads[-2 - owner[whole]]
        found[rays] = bilinear(self.points.xy[quads], xy[rays] - self.points.view[quads[:, 0]])
        yield 0

        # in quarters and in other pieces of pixels
        for pieces in (self.quads[~self._are_pixels], self.triangles):
            inside = in_triangles if pieces.shape[1] == 3 else in_quarters
            pieces, of_pixel = self._those_in(pieces, pixel)
            yield 0
            for some, k in _each_in(of_pixel, pixel):
                rays = in_image[some]
                corners = pieces[k]
                is_inside, at = inside(self.points.view[corners], self.points.xy[corners], xy[rays])
                found[rays[is_inside]] = at[is_inside]
            yield 0

        return found

    def nearest_samples(self, xy: Floats, is_asked: Bools) -> tuple[Ints, Ints]:
        """Which of those viewer pixels (n, 2) that are asked for
        (n,) are within a stratum's side of a sample.

        And the point of the nearest one.
        """
        order, of_pixel = self._samples_by_pixel
        asked = np.flatnonzero(is_asked & is_in_image(xy, self.view_size))
        nearest = np.full(len(xy), -1)
        best = np.full(len(xy), np.inf)

        for some, k in _each_in(of_pixel, self._pixel(xy[asked])):
            rays = asked[some]
            number = order[k]
            off = np.abs(self.points.view[self.samples[number]] - xy[rays]).max(axis=1)
            is_nearer = off <= np.minimum(best[rays], self.sample_reach[number])
            best[rays[is_nearer]], nearest[rays[is_nearer]] = (
                off[is_nearer],
                self.samples[number[is_nearer]],
            )

        found = np.flatnonzero(nearest >= 0)
        return found, nearest[found]

    def _pixel(self, xy: Floats) -> Ints:
        """Number (n,) of the viewer's pixel that holds viewer px (n, 2): row * width + column."""
        w, h = self.view_size
        column, row = whole_within(xy, (w - 1, h - 1))
        return row * w + column

    @cached_property
    def owner(self) -> Ints:
        """Cell of each viewer pixel (h, w): a smooth one's
        number, -2 - that of a quad, -1 for neither.
        """
        numbers = np.arange(len(self.size), dtype=np.int32)
        owner = filled(self.view_size, self.corner, self.size, numbers, -1)
        pixels = np.flatnonzero(self._are_pixels)
        column, row = self.points.view[self.quads[pixels, 0]].astype(np.int64).T
        owner[row, column] = -2 - pixels
        return owner

    def _those_in(self, pieces: Ints, pixels: Ints) -> tuple[Ints, Ints]:
        """Pieces (n, k) in pixels (p,), by number, and the pixel (n,) of each, sorted."""
        w, h = self.view_size
        is_asked = np.zeros((h, w), bool)
        is_asked.ravel()[pixels] = True
        # most are told by one corner: it lies in the pixel, or on its right or lower border
        is_near = is_asked.copy()
        is_near[:, 1:] |= is_asked[:, :-1]
        is_near[1:] |= is_near[:-1].copy()
        corner = self._pixel(taken(self.points.view, pieces[:, 0]))
        pieces = pieces[is_near.ravel()[corner]]
        of_piece = self._pixel(mean_at(self.points.view, pieces))
        some = np.flatnonzero(is_asked.ravel()[of_piece])
        some = some[np.argsort(of_piece[some], kind="stable")]
        return pieces[some], of_piece[some]

    @cached_property
    def _samples_by_pixel(self) -> tuple[Ints, Ints]:
        """Numbers (s,) of samples in the order of their pixels, and these (s,), sorted."""
        pixel = self._pixel(self.points.view[self.samples])
        order = np.argsort(pixel, kind="stable")
        return order, pixel[order]

    @cached_property
    def _are_pixels(self) -> Bools:
        """Which quads (q,) are whole pixels, and no quarters?"""
        left, right = (self.points.view[self.quads[:, k], 0] for k in (0, 1))
        return right - left == 1


def _each_in(owners: Ints, wanted: Ints) -> Iterator[tuple[Ints, Ints]]:
    """Places of wanted numbers (n,) in sorted owners (m,):
    which of those wanted have one more, and where.
    """
    first, last = (np.searchsorted(owners, wanted, side) for side in ("left", "right"))
    for k in range(int((last - first).max(initial=0))):
        some = np.flatnonzero(first + k < last)
        yield some, first[some] + k


def filled(
    view_size: tuple[int, int], corner: Ints, size: Ints, values: np.ndarray, blank: int
) -> np.ndarray:
    """An image (h, w) with squares of values (n,) on blank: their
    corners and sizes are multiples of 4 pixels.
    """
    w, h = view_size
    image = np.full((-(-h // PARTS), -(-w // PARTS)), blank, values.dtype)

    for side, some in each_value(size // PARTS):
        column, row = (corner[some].T // PARTS)[..., None] + np.arange(side)
        row = row[:, :, None]
        column = column[:, None, :]

        is_there = (row < image.shape[0]) & (column < image.shape[1])
        row, column, value = (
            a[is_there] for a in np.broadcast_arrays(row, column, values[some][:, None, None])
        )
        image[row, column] = value

    return in_blocks(image, PARTS)[:h, :w]


def in_quarters(view: Floats, xy: Floats, at: Floats) -> tuple[Bools, Floats]:
    """Are points (n, 2) in quarters of pixels (n, 4, 2),
    and where (n, 2) does the display show them?
    """
    place = (at - view[:, 0]) / (view[:, 1, :1] - view[:, 0, :1])
    return ((place >= 0) & (place <= 1)).all(axis=1), bilinear(xy, place)
