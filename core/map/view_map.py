"""The view map: cells from viewer to display pixels, from which the source image is painted.

`Lookup` finds the cell at a place of the viewer's image.
"""

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bools, Floats, Ints, each_value, in_blocks, mean_at, take, whole_within
from ..base.steps import Steps, run_steps
from ..light.rays import Reason
from ..rig.views import Views
from . import smooth_cells
from .cells import count_shares
from .pieces import Piece, kernel_widths, polygons, quads_of, squares_around
from .points import Points, in_triangles, is_in_image
from .smooth_cells import CORNERS, OF_TOLERANCE, PARTS, Squares, bilinear, n_parts


@dataclass(eq=False)
class Lookup:
    """Cells and samples of a map by the viewer's pixels; fields as in `ViewMap`."""

    view_size: tuple[int, int]
    points: Points
    corner: Ints
    size: Ints
    nodes: Ints
    quads: Ints
    triangles: Ints
    samples: Ints
    sample_reach: Floats

    def by_cells(self, xy: Floats) -> Steps[Floats]:
        """Display pixels (n, 2) shown by viewer pixels (n, 2) through cells; NaN without a cell.
        With pauses.
        """
        found = np.full(xy.shape, np.nan)
        in_image = np.flatnonzero(is_in_image(xy, self.view_size))
        pixel = self._pixel(xy[in_image])
        owner = self.owner.ravel()[pixel]
        yield 0

        smooth = np.flatnonzero(owner >= 0)
        rays = in_image[smooth]
        cells = owner[smooth]
        places = (xy[rays] - self.corner[cells]) / self.size[cells, None]
        found[rays] = smooth_cells.at_places(self.points.xy[self.nodes[cells]], places)

        whole = np.flatnonzero(owner < -1)
        rays = in_image[whole]
        quads = self.quads[-2 - owner[whole]]
        found[rays] = bilinear(self.points.xy[quads], xy[rays] - self.points.view[quads[:, 0]])
        yield 0

        for pieces in (self.quads[~self._are_pixels], self.triangles):
            inside = in_triangles if pieces.shape[1] == 3 else in_quarters
            pieces, of_pixel = self._pieces_in(pieces, pixel)
            yield 0
            for some, k in _each_in(of_pixel, pixel):
                rays = in_image[some]
                corners = pieces[k]
                is_inside, at = inside(self.points.view[corners], self.points.xy[corners], xy[rays])
                found[rays[is_inside]] = at[is_inside]
            yield 0

        return found

    def nearest_samples(self, xy: Floats, is_requested: Bools) -> tuple[Ints, Ints]:
        """Requested viewer pixels (n,) within a stratum's side of a sample, and the point of the
        nearest one.

        xy : (n, 2) viewer px
        """
        order, of_pixel = self._samples_by_pixel
        requested = np.flatnonzero(is_requested & is_in_image(xy, self.view_size))
        nearest = np.full(len(xy), -1)
        best = np.full(len(xy), np.inf)

        for some, k in _each_in(of_pixel, self._pixel(xy[requested])):
            rays = requested[some]
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
        """Number (n,) of the viewer's pixel at viewer px (n, 2): row * width + column."""
        w, h = self.view_size
        column, row = whole_within(xy, (w - 1, h - 1))
        return row * w + column

    @cached_property
    def owner(self) -> Ints:
        """Cell of each viewer pixel (h, w): number of a smooth one, -2 - number of a quad, -1 for
        neither.
        """
        numbers = np.arange(len(self.size), dtype=np.int32)
        owner = filled(self.view_size, self.corner, self.size, numbers, -1)
        pixels = np.flatnonzero(self._are_pixels)
        column, row = self.points.view[self.quads[pixels, 0]].astype(np.int64).T
        owner[row, column] = -2 - pixels
        return owner

    def _pieces_in(self, pieces: Ints, pixels: Ints) -> tuple[Ints, Ints]:
        """Pieces (n, k) in pixels (p,), by number, and the pixel (n,) of each, sorted."""
        w, h = self.view_size
        is_requested = np.zeros((h, w), bool)
        is_requested.ravel()[pixels] = True
        # preselect by one corner: it lies in the pixel, or on its right or lower border
        is_near = is_requested.copy()
        is_near[:, 1:] |= is_requested[:, :-1]
        is_near[1:] |= is_near[:-1].copy()
        corner = self._pixel(take(self.points.view, pieces[:, 0]))
        pieces = pieces[is_near.ravel()[corner]]
        of_piece = self._pixel(mean_at(self.points.view, pieces))
        some = np.flatnonzero(is_requested.ravel()[of_piece])
        some = some[np.argsort(of_piece[some], kind="stable")]
        return pieces[some], of_piece[some]

    @cached_property
    def _samples_by_pixel(self) -> tuple[Ints, Ints]:
        """Numbers (s,) of samples in the order of their pixels, and these pixels (s,), sorted."""
        pixel = self._pixel(self.points.view[self.samples])
        order = np.argsort(pixel, kind="stable")
        return order, pixel[order]

    @cached_property
    def _are_pixels(self) -> Bools:
        """Mask of quads (q,) that are whole pixels, not quarters."""
        left, right = (self.points.view[self.quads[:, k], 0] for k in (0, 1))
        return right - left == 1


def _each_in(owners: Ints, wanted: Ints) -> Iterator[tuple[Ints, Ints]]:
    """Matches of wanted numbers (n,) in sorted owners (m,), one for each at a time: indices of the
    wanted, and of the owners.
    """
    first, last = (np.searchsorted(owners, wanted, side) for side in ("left", "right"))
    for k in range(int((last - first).max(initial=0))):
        some = np.flatnonzero(first + k < last)
        yield some, first[some] + k


def filled(
    view_size: tuple[int, int], corner: Ints, size: Ints, values: np.ndarray, blank: int
) -> np.ndarray:
    """Image (h, w) with squares of values (n,) on blank; corners and sizes are multiples of 4
    pixels.
    """
    w, h = view_size
    image = np.full((-(-h // PARTS), -(-w // PARTS)), blank, values.dtype)

    for side, some in each_value(size // PARTS):
        column, row = (corner[some].T // PARTS)[..., None] + np.arange(side)
        row = row[:, :, None]
        column = column[:, None, :]

        is_inside = (row < image.shape[0]) & (column < image.shape[1])
        row, column, value = (
            a[is_inside] for a in np.broadcast_arrays(row, column, values[some][:, None, None])
        )
        image[row, column] = value

    return in_blocks(image, PARTS)[:h, :w]


def in_quarters(view: Floats, xy: Floats, at: Floats) -> tuple[Bools, Floats]:
    """Whether points (n, 2) are in quarters of pixels (n, 4, 2), and their display px (n, 2)."""
    place = (at - view[:, 0]) / (view[:, 1, :1] - view[:, 0, :1])
    return ((place >= 0) & (place <= 1)).all(axis=1), bilinear(xy, place)


QUADS_AT_ONCE = 1 << 14


@dataclass(frozen=True)
class MapError:
    """Errors of the view map on the part of its image with the display, by rays at random places.

    rms, percentile : display px, the latter of 99.9 % of the area; over the area on the display by
        both map and rays
    facet_limited, unresolved : fractions of the area, 0..1, with an error above the tolerance, or
        on the display by only one of both. The first: in pixels with corners on one branch, where
        the map bends within a pixel, mostly at the mesh's facets. The second: in all others
    facet_error, unresolved_error : rms of the finite errors there, display px
    cut_off : part of `unresolved` whose rays meet more surfaces than allowed
    sampled : fraction with chaotic light, shown by samples
    noise : part of `unresolved`, the standard error of the samples: 1 / sqrt n of `sampled`, with n
        samples a pixel
    n_samples, n_checked : rays
    most_samples : largest number of n_samples in a viewer pixel
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
    most_samples: int


NO_ERROR = MapError(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0, 0)


@dataclass(frozen=True, eq=False)
class ViewMap:
    """Cells of the viewer's image, and their landings on the display.

    view_size, display_size : width, height in pixels
    points : traced, with viewer px and display px
    corner, size, nodes : (c, 2), (c,), (c, 25) smooth cells: upper left corner and side, viewer px,
        indices of points
    quads, triangles : (q, 4), (t, 3) indices of points, in order, quads from the upper left one:
        whole pixels and quarters, and other pieces of pixels
    samples, sample_area, sample_reach : (s,) in chaotic light: indices of points; the area, viewer
        px^2, each represents; side of its stratum, viewer px
    reason : (h + 1, w + 1) of Reason, at the corners of the viewer's pixels, or of the nearest node
    tolerance : display px
    unchecked : (p, 4) corners of the finest pixels, in order; None once `error` is measured
    n_rays : rays traced
    views : of the display, each of display_size; None for none
    """

    view_size: tuple[int, int]
    display_size: tuple[int, int]
    points: Points
    corner: Ints
    size: Ints
    nodes: Ints
    quads: Ints
    triangles: Ints
    reason: np.ndarray
    tolerance: float
    samples: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    sample_area: Floats = field(default_factory=lambda: np.empty(0))
    sample_reach: Floats = field(default_factory=lambda: np.empty(0))
    error: MapError = NO_ERROR
    unchecked: Ints | None = None
    n_rays: int = 0
    views: Views | None = None

    def with_samples(self, samples: Points, area: Floats, reach: Floats) -> "ViewMap":
        """The same map with samples; it must have none yet."""
        number = len(self.points) + np.arange(len(samples))
        points = self.points.and_more(samples)
        return replace(self, points=points, samples=number, sample_area=area, sample_reach=reach)

    def with_error(self, error: MapError) -> "ViewMap":
        """The same map with its errors; cached values stay."""
        found = copy(self)  # `replace` would drop the cached values
        n_rays = self.n_rays + error.n_checked
        vars(found).update(error=error, unchecked=None, n_rays=n_rays)
        return found

    @cached_property
    def _n_parts(self) -> Ints:
        """Number of quads (c,) along the sides of smooth cells."""
        xy = take(self.points.xy, self.nodes)
        return n_parts(xy, self.size, self._is_inside, self.tolerance)

    @cached_property
    def _is_inside(self) -> Bools:
        """Mask of smooth cells (c,) entirely inside both images."""
        xy = take(self.points.xy, self.nodes)
        squares = Squares(self.corner, self.size)
        return squares.are_within(xy, self.view_size, self.display_size)

    def is_past_glass(self, points: Ints) -> Bools:
        """Whether light of these landed points passes the glass outside."""
        return self.points.reason[points] == Reason.MISSED_GLASS

    @cached_property
    def sample_width(self) -> Floats:
        """Sides (s,), display px, of the squares lit by samples; 0 for samples that light none."""
        return run_steps(self._spreading())

    def _spreading(self) -> Steps[Floats]:
        is_landed = self.points.branch[self.samples] != 0
        is_past_glass = self.is_past_glass(self.samples)
        found = np.zeros(len(self.samples))
        # light through the glass and light past it are never mixed
        for some in (
            np.flatnonzero(is_landed & ~is_past_glass),
            np.flatnonzero(is_landed & is_past_glass),
        ):
            number = self.samples[some]
            view, xy = (take(of, number) for of in (self.points.view, self.points.xy))
            found[some] = yield from kernel_widths(view, xy, self.display_size)
        return found

    @cached_property
    def parts_within_tolerance(self) -> Ints:
        """Number of quads (c,) along the sides of smooth cells, for the landings alone."""
        xy = take(self.points.xy, self.nodes)
        (parts,) = smooth_cells.parts_within(xy, OF_TOLERANCE * self.tolerance)
        return np.where(smooth_cells.is_folded(xy), np.maximum(parts, self.size), parts)

    @property
    def n_pieces(self) -> int:
        """Number of quads, triangles and lit samples."""
        n_smooth = int((self._n_parts**2).sum())
        n_samples = np.count_nonzero(self.sample_width)
        return n_smooth + len(self.quads) + len(self.triangles) + n_samples

    @cached_property
    def shares_by_kind(self) -> NDArray[np.float64]:
        """Approximate numbers (4,) of shares from smooth cells, quads, triangles and samples: one
        for each display pixel a piece touches.
        """
        of_cells = [
            self._count_shares(self.nodes[:, CORNERS], self._n_parts),
            self._count_shares(self.quads),
            self._count_shares(self.triangles),
        ]
        # a square narrower than a pixel lies in one
        width = self.sample_width
        shares = np.where(width < 1, width > 0, (width + 1) ** 2)
        return np.array([*of_cells, shares.sum()])

    def _count_shares(self, pieces: Ints, parts: Ints | None = None) -> float:
        shares, step = count_shares(self.points.xy, pieces, self.display_size, parts)
        return step * shares.sum()

    def spread_samples(self) -> Steps[None]:
        """Compute `sample_width`, with pauses: it may take a second and more."""
        if "sample_width" not in vars(self):
            vars(self)["sample_width"] = yield from self._spreading()

    @property
    def is_whole(self) -> Bools:
        """Viewer pixels (h, w) fully connected to the display through the glass."""
        some = self._is_inside & ~self.is_past_glass(self.nodes[:, 0])
        if self.views is not None:
            beam = take(self.points.beam, self.nodes[:, CORNERS].ravel())
            some &= self.views.are_within(beam).reshape(len(some), -1).all(axis=1)
        return filled(
            self.view_size,
            self.corner[some],
            self.size[some],
            np.ones(int(some.sum()), bool),
            False,
        )

    def pieces(
        self,
        at_pixels: bool = False,
        past_glass: bool = False,
        sampled: bool = True,
        parts: Ints | None = None,
    ) -> Iterator[Piece]:
        """Quads and triangles of the map, through the glass or past it.

        at_pixels : each lies within one viewer pixel; squares around samples have their middle in
            it
        past_glass : light past the glass instead
        sampled : include samples, which come last
        parts : (c,) number of quads along the sides of smooth cells; None for those of shares

        Arrays are new each time and may be changed.
        """
        # smooth cells, by the number of their quads
        if parts is None:
            parts = np.maximum(self._n_parts, self.size) if at_pixels else self._n_parts
        requested = np.flatnonzero(self.is_past_glass(self.nodes[:, 0]) == past_glass)
        for m, cells in each_value(parts[requested]):
            step = max(1, QUADS_AT_ONCE // m**2)
            for first in range(0, len(cells), step):
                yield self._quads_of(requested[cells[first : first + step]], m)

        # cut pixels
        for kind in (self.quads, self.triangles):
            requested = kind[self.is_past_glass(kind[:, 0]) == past_glass]
            for first in range(0, len(requested), QUADS_AT_ONCE):
                yield polygons(self.points, requested[first : first + QUADS_AT_ONCE])

        if not sampled:
            return

        # samples
        is_lit = self.sample_width > 0
        requested = np.flatnonzero(is_lit & (self.is_past_glass(self.samples) == past_glass))
        for first in range(0, len(requested), QUADS_AT_ONCE):
            some = requested[first : first + QUADS_AT_ONCE]
            samples = self.points.at(self.samples[some])
            area, width = self.sample_area[some], self.sample_width[some]
            yield squares_around(samples, area, width, self.display_size)

    def _quads_of(self, cells: Ints, m: int) -> Piece:
        """Quads of smooth cells (n,), m a side, that start in the viewer's image."""
        corner = self.corner[cells]
        size = self.size[cells]
        piece = quads_of(self.points, corner, size, self.nodes[cells], m)
        if (corner + size[:, None] <= self.view_size).all():
            return piece
        return piece.at((piece.view[:, 0] < self.view_size).all(axis=1))

    @cached_property
    def lookup(self) -> Lookup:
        """The cells by the viewer's pixels."""
        return Lookup(
            view_size=self.view_size,
            points=self.points,
            corner=self.corner,
            size=self.size,
            nodes=self.nodes,
            quads=self.quads,
            triangles=self.triangles,
            samples=self.samples,
            sample_reach=self.sample_reach,
        )

    def display_from_view(self, xy: Floats) -> Floats:
        """Display pixels (n, 2) shown by viewer pixels (n, 2), also beyond a flat display; NaN
        without a landing.

        Light past the glass lands, too, if the settings follow it. In chaotic light the result is
        the landing of the nearest sample.
        """
        xy = np.asarray(xy, float)
        found = run_steps(self.lookup.by_cells(xy))
        rays, samples = self.lookup.nearest_samples(xy, np.isnan(found[:, 0]))
        found[rays] = self.points.xy[samples]
        return found

    @property
    def is_one_cell(self) -> Bools:
        """Viewer pixels (h, w) entirely in one cell."""
        return self.lookup.owner != -1
