"""The view map, viewer pixels to display pixels, as cells, by which the source image is painted."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Floats, Ints, each_value, mean_at, taken
from ..light.landings import Reason
from . import interpolation
from .interpolation import PARTS, bilinear
from .points import Points, areas, bounds_of, in_triangles, is_in_image

FOR_QUADS = 0.25  # of the tolerance: so far the quads of a smooth cell may be from it
# display px: so near they come to it, unless that takes quads smaller than viewer pixels
CHEAP = 0.01
PLACES = 4  # along a display pixel that is larger than a viewer pixel: its colour is taken there
FEW_PLACES = 2.0  # along a smaller one
# display px: from this tolerance on, one place is enough along a smaller one, on curved glass
ONE_PLACE = 0.1
MOST_QUADS = 128  # along the side of a smooth cell
QUADS_AT_ONCE = 1 << 15
SHARES_OF_QUAD = 2.0  # of a smooth cell, about
COUNTED = 1 << 16  # pieces at the least of which the shares are counted, where there are more
AROUND = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])  # corners of a unit square


class Piece(NamedTuple):
    """Some pieces of a view map: quads or triangles.

    view, display : (n, 4 or 3, 2) corners, viewer px and display px; throughput : (n,)
    branch : (n,) uint64, the same for all that show the display by way of the same surfaces
    """

    view: Floats
    display: Floats
    throughput: Floats
    branch: NDArray[np.uint64]

    def at(self, which: Bools | Ints) -> "Piece":
        """Some of these pieces."""
        return Piece(*(taken(values, which) for values in self))


@dataclass(frozen=True)
class MapError:
    """Errors of the view map at random places, traced for this
    alone, of the part of its image that shows the display.

    rms, percentile : display px, the latter of 99.9 % of the area;
        over the area that map and trace both take there
    facet_limited, unresolved : shares of the area, 0..1, that are off by more than the tolerance or
        that only one of both takes to the display: on pixels whose corners lie on one branch, where
        the map bends within a pixel, most often because of the mesh's facets; and on all others
    facet_error, unresolved_error : rms of those shares, as far as it is known, display px
    cut_off : of `unresolved`, the share that is off because the
        ray there meets more surfaces than are allowed
    sampled : share where light is chaotic, by samples
    noise : of `unresolved`, the standard error of the samples: with
        n samples a pixel 1 / sqrt n of that share
    n_samples, n_checked : rays
    """

    rms: float
    percentile: float
    facet_limited: float
    facet_error: float
    unresolved: float
    unresolved_error: float
    cut_off: float
    sampled: float
    noise: float
    n_samples: int
    n_checked: int


@dataclass(frozen=True, eq=False)
class ViewMap:
    """Cells of the viewer's image and where the display shows them.

    view_size, display_size : width, height in pixels
    points : traced, with viewer px and display px
    corner, size, nodes : (c, 2), (c,), (c, 25) smooth cells: upper
        left corner and side, viewer px, indices of points
    quads, triangles : (q, 4), (t, 3) indices of points, in order, the upper left one of
        quads first: whole pixels and quarters of them, and other pieces of pixels
    samples, sample_area : (s,) indices of points where light is
        chaotic, and the area, viewer px^2, of each
    reason : (h + 1, w + 1) of Reason, at the corners of the viewer's pixels, or of the nearest node
    tolerance : display px
    n_rays : rays traced
    """

    view_size: tuple[int, int]
    display_size: tuple[int, int]
    points: Points
    corner: Ints
    size: Ints
    nodes: Ints
    quads: Ints
    triangles: Ints
    samples: Ints
    sample_area: Floats
    reason: np.ndarray
    tolerance: float
    error: MapError
    n_rays: int

    @cached_property
    def _n_parts(self) -> Ints:
        """Into how many quads (c,) the sides of smooth cells are cut.

        Quads keep the tolerance. A display pixel takes one colour from each quad in it, so quads
        are smaller than display pixels, by the number of places; where a viewer pixel is larger
        than a display pixel, one place is enough: on the ball, at 0.1 px, two gain nothing for 15 %
        more time.
        """
        xy = taken(self.points.xy, self.nodes)

        # for the tolerance
        parts, parts_cheap = (
            interpolation.parts_for(xy, allowed, MOST_QUADS)
            for allowed in (FOR_QUADS * self.tolerance, CHEAP)
        )
        parts = np.maximum(parts, np.minimum(parts_cheap, self.size))

        # for the places; on flat glass, where one quad would keep
        # the tolerance, they alone keep the picture sharp
        low, high = bounds_of(xy)
        span = (high - low).max(axis=1)
        n_places = np.where(
            parts == 1, FEW_PLACES, np.clip(ONE_PLACE / self.tolerance, 1.0, FEW_PLACES)
        )
        pixels = np.clip(PLACES * span, 1.0, self.size) / np.maximum(
            span / (n_places * self.size), 1.0
        )
        parts = np.maximum(parts, 2 ** np.log2(np.maximum(pixels, 1.0)).astype(np.int64))

        # a pixel each where the image folds or lies across the display's edge
        at_fold = interpolation.is_folded(xy)
        return np.where(self._is_inside & ~at_fold, parts, np.maximum(parts, self.size))

    @cached_property
    def _is_inside(self) -> Bools:
        """Are smooth cells (c,) inside of both images, wholly?"""
        low, high = bounds_of(taken(self.points.xy, self.nodes))
        return (
            ((low >= 0) & (high <= self.display_size)).all(axis=1)
            & (self.corner + self.size[:, None] <= self.view_size).all(axis=1)
        )  # fmt: skip

    def is_beside_glass(self, points: Ints) -> Bools:
        """Is light of these landed points beside the glass?"""
        return self.points.reason[points] == Reason.MISSED_GLASS

    @property
    def n_quads(self) -> int:
        """How many quads stand for smooth cells."""
        return int((self._n_parts**2).sum())

    @cached_property
    def n_by_kind(self) -> NDArray[np.float64]:
        """(2, 4): pieces of each kind, in the order of
        `pieces`, and about how many shares they make.

        Kinds are quads of smooth cells, quads and triangles of cut pixels, and samples. A
        quad or triangle makes a share for each display pixel that it touches.
        """
        cut = [(len(kind), self._n_shares_of(kind)) for kind in (self.quads, self.triangles)]
        return np.transpose(
            [(self.n_quads, SHARES_OF_QUAD * self.n_quads), *cut, (len(self.samples),) * 2]
        )

    @property
    def n_cut_shares(self) -> float:
        """About how many shares the pixels make that are not in smooth cells."""
        return float(self.n_by_kind[1, 1:].sum())

    def _n_shares_of(self, pieces: Ints) -> float:
        """About how many shares pieces (n, 4 or 3) make: known
        from some of them, where they are many.
        """
        some = pieces[:: 1 + len(pieces) // COUNTED]
        corners = [taken(self.points.xy, number) for number in some.T]
        low, high = (reduce(bound, corners) for bound in (np.minimum, np.maximum))
        first = np.clip(low, 0, self.display_size)
        last = np.clip(high, 0, self.display_size)
        columns, rows = (np.ceil(last) - np.floor(first)).T
        with np.errstate(over="ignore", invalid="ignore"):
            area = areas(self.points.xy, some[:, :3]) * (some.shape[1] - 2)
            area *= np.fmin.reduce(
                (last - first) / (high - low), axis=1
            )  # of long ones most may lie beside the display
        n_shares = np.fmin(columns * rows, area + columns + rows).sum()
        return float(n_shares) * len(pieces) / max(len(some), 1)

    @cached_property
    def _are_pixels(self) -> Bools:
        """Which quads (q,) are whole pixels, and no quarters?"""
        left, right = (self.points.view[self.quads[:, k], 0] for k in (0, 1))
        return right - left == 1

    @property
    def is_whole(self) -> Bools:
        """Viewer pixels (h, w) that are connected to the display all over, by way of the glass."""
        some = self._is_inside & ~self.is_beside_glass(self.nodes[:, 0])
        return filled(
            self.view_size,
            self.corner[some],
            self.size[some],
            np.ones(int(some.sum()), bool),
            False,
        )

    def pieces(self, at_pixels: bool = False, beside: bool = False) -> Iterator[Piece]:
        """Quads and triangles that make up the map, by way of the glass, or beside it.

        Each lies within one viewer pixel when asked to, but for the squares around samples, whose
        middles do. Their arrays are new each time: whoever asks for them may change them.
        """
        parts = np.maximum(self._n_parts, self.size) if at_pixels else self._n_parts
        asked = np.flatnonzero(self.is_beside_glass(self.nodes[:, 0]) == beside)
        for m, cells in each_value(parts[asked]):
            step = max(1, QUADS_AT_ONCE // m**2)
            for first in range(0, len(cells), step):
                yield self._quads_of(asked[cells[first : first + step]], m)
        for kind in (self.quads, self.triangles):
            asked = kind[self.is_beside_glass(kind[:, 0]) == beside]
            for first in range(0, len(asked), QUADS_AT_ONCE):
                yield self._polygons(asked[first : first + QUADS_AT_ONCE])
        landed = self.points.branch[self.samples] != 0
        asked = np.flatnonzero(landed & (self.is_beside_glass(self.samples) == beside))
        for first in range(0, len(asked), QUADS_AT_ONCE):
            yield self._samples_as_squares(asked[first : first + QUADS_AT_ONCE])

    def _polygons(self, corners: Ints) -> Piece:
        """Pieces with these points (n, 4 or 3) as corners."""
        points = self.points
        of_piece = mean_at(points.throughput, corners), points.branch[corners[:, 0]]
        return Piece(taken(points.view, corners), taken(points.xy, corners), *of_piece)

    def _samples_as_squares(self, some: Ints) -> Piece:
        """Squares around samples, as large as their strata, and as
        many display px, in the pixel that each lands in.
        """
        points = self.points
        samples = self.samples[some]
        side = np.sqrt(self.sample_area[some])[:, None]
        pixel = np.floor(points.xy[samples])
        low = pixel + np.clip(points.xy[samples] - pixel - side / 2, 0, 1 - side)
        # or rounding would give the next pixel a share of nothing
        high = np.minimum(low + side, pixel + 1)
        view = points.view[samples, None] + side[..., None] * (AROUND - 0.5)
        xy = np.where(AROUND, high[:, None], low[:, None])
        return Piece(view, xy, points.throughput[samples], points.branch[samples])

    def _quads_of(self, cells: Ints, m: int) -> Piece:
        points = self.points
        nodes = self.nodes[cells]
        grid = interpolation.on_grid(
            np.concatenate([taken(points.xy, nodes), points.throughput[nodes][..., None]], axis=2),
            m,
        )
        side = np.arange(m + 1) / m
        x, y = np.meshgrid(side, side)
        place = np.stack([x, y], axis=2)
        view = self.corner[cells][:, None, None] + self.size[cells][:, None, None, None] * place
        xy = _quads(grid[..., :2])
        throughput = _quads(grid[..., 2:])[..., 0].mean(axis=1)
        view = _quads(view)
        piece = Piece(view, xy, throughput, np.repeat(points.branch[nodes[:, 0]], m * m))
        if (self.corner[cells] + self.size[cells][:, None] <= self.view_size).all():
            return piece
        return piece.at((view[:, 0] < self.view_size).all(axis=1))

    def display_from_view(self, xy: Floats) -> Floats:
        """Display pixels (n, 2) that viewer pixels (n, 2) show, also
        beyond a flat display; NaN where nothing lands.

        So does light beside the glass where the settings look for it.
        Where light is chaotic this is the landing of the sample that is nearest.
        """
        xy = np.asarray(xy, float)
        found = self.by_cells(xy)
        rays, samples = self.nearest_samples(xy, np.isnan(found[:, 0]))
        found[rays] = self.points.xy[samples]
        return found

    def by_cells(self, xy: Floats) -> Floats:
        """Display pixels (n, 2) that viewer pixels (n, 2) show
        by way of cells; NaN where there is none.
        """
        found = np.full(xy.shape, np.nan)
        in_image = np.flatnonzero(is_in_image(xy, self.view_size))
        pixel = self._pixel(xy[in_image])
        owner = self._owner.ravel()[pixel]
        smooth = np.flatnonzero(owner >= 0)
        rays = in_image[smooth]
        cells = owner[smooth]
        places = (xy[rays] - self.corner[cells]) / self.size[cells, None]
        found[rays] = interpolation.at_places(self.points.xy[self.nodes[cells]], places)
        whole = np.flatnonzero(owner < -1)
        rays = in_image[whole]
        quads = self.quads[-2 - owner[whole]]
        found[rays] = bilinear(self.points.xy[quads], xy[rays] - self.points.view[quads[:, 0]])
        for pieces in (self.quads[~self._are_pixels], self.triangles):
            inside = in_triangles if pieces.shape[1] == 3 else in_quarters
            pieces, of_pixel = self._those_in(pieces, pixel)
            for some, k in _each_in(of_pixel, pixel):
                rays = in_image[some]
                corners = pieces[k]
                is_inside, at = inside(self.points.view[corners], self.points.xy[corners], xy[rays])
                found[rays[is_inside]] = at[is_inside]
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
            is_nearer = off <= np.minimum(best[rays], np.sqrt(self.sample_area[number]))
            best[rays[is_nearer]], nearest[rays[is_nearer]] = (
                off[is_nearer],
                self.samples[number[is_nearer]],
            )
        found = np.flatnonzero(nearest >= 0)
        return found, nearest[found]

    def _pixel(self, xy: Floats) -> Ints:
        """Number (n,) of the viewer's pixel that holds viewer px (n, 2): row * width + column."""
        w, h = self.view_size
        column, row = np.clip(xy, 0, (w - 1, h - 1)).astype(np.int64).T
        return row * w + column

    @property
    def is_one_cell(self) -> Bools:
        """Viewer pixels (h, w) that lie in one cell, wholly."""
        return self._owner != -1

    @cached_property
    def _owner(self) -> Ints:
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
        is_asked = np.zeros(w * h, bool)
        is_asked[pixels] = True
        of_piece = self._pixel(mean_at(self.points.view, pieces))
        some = np.flatnonzero(is_asked[of_piece])
        some = some[np.argsort(of_piece[some], kind="stable")]
        return pieces[some], of_piece[some]

    @cached_property
    def _samples_by_pixel(self) -> tuple[Ints, Ints]:
        """Numbers (s,) of samples in the order of their pixels, and these (s,), sorted."""
        pixel = self._pixel(self.points.view[self.samples])
        order = np.argsort(pixel, kind="stable")
        return order, pixel[order]


NO_ERROR = MapError(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0)


def _each_in(owners: Ints, wanted: Ints) -> Iterator[tuple[Ints, Ints]]:
    """Places of wanted numbers (n,) in sorted owners (m,):
    which of those wanted have one more, and where.
    """
    first, last = (np.searchsorted(owners, wanted, side) for side in ("left", "right"))
    for k in range(int((last - first).max(initial=0))):
        some = np.flatnonzero(first + k < last)
        yield some, first[some] + k


def _quads(grid: Floats) -> Floats:
    """Quads (n m^2, 4, c) between the points of grids (n, m + 1, m + 1, c), corners in order."""
    corners = grid[:, :-1, :-1], grid[:, :-1, 1:], grid[:, 1:, 1:], grid[:, 1:, :-1]
    return np.stack(corners, axis=3).reshape(-1, 4, grid.shape[-1])


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
    return image.repeat(PARTS, axis=0).repeat(PARTS, axis=1)[:h, :w]


def in_quarters(view: Floats, xy: Floats, at: Floats) -> tuple[Bools, Floats]:
    """Are points (n, 2) in quarters of pixels (n, 4, 2),
    and where (n, 2) does the display show them?
    """
    place = (at - view[:, 0]) / (view[:, 1, :1] - view[:, 0, :1])
    return ((place >= 0) & (place <= 1)).all(axis=1), bilinear(xy, place)
