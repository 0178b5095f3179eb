"""The view map, viewer pixels to display pixels, as cells, by which the source image is painted."""

from collections.abc import Generator, Iterator
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bools, Floats, Ints, each_value, taken
from ..base.steps import Pauses, at, finish, within
from ..light.landings import Reason
from .cells import count_shares
from .decimation import THINNING, Thinning
from .kernel_width import widths
from .lookup import Lookup, filled
from .pieces import Piece, polygons, quads_of, squares_around
from .points import Points
from .squares import CORNERS, Squares
from .subdivision import n_parts

QUADS_AT_ONCE = 1 << 14


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
    most_samples : of n_samples, those of a viewer pixel, at the most
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
    """Cells of the viewer's image and where the display shows them.

    view_size, display_size : width, height in pixels
    points : traced, with viewer px and display px
    corner, size, nodes : (c, 2), (c,), (c, 25) smooth cells: upper
        left corner and side, viewer px, indices of points
    quads, triangles : (q, 4), (t, 3) indices of points, in order, the upper left one of
        quads first: whole pixels and quarters of them, and other pieces of pixels
    samples, sample_area, sample_reach : (s,) indices of points where light is chaotic; the area,
        viewer px^2, that each stands for; and the side of its stratum, viewer px
    reason : (h + 1, w + 1) of Reason, at the corners of the viewer's pixels, or of the nearest node
    tolerance : display px
    unchecked : (p, 4) corners of the finest pixels, in order, until `error` is measured; None then
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
    reason: np.ndarray
    tolerance: float
    samples: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    sample_area: Floats = field(default_factory=lambda: np.empty(0))
    sample_reach: Floats = field(default_factory=lambda: np.empty(0))
    error: MapError = NO_ERROR
    unchecked: Ints | None = None
    n_rays: int = 0

    def with_samples(self, samples: Points, area: Floats, reach: Floats) -> "ViewMap":
        """The same map, which had no samples yet, with some."""
        number = len(self.points) + np.arange(len(samples))
        points = self.points.and_more(samples)
        return replace(self, points=points, samples=number, sample_area=area, sample_reach=reach)

    def with_error(self, error: MapError) -> "ViewMap":
        """The same map, with all that is known of it, and its errors."""
        found = copy(self)  # `replace` would find its quads anew
        n_rays = self.n_rays + error.n_checked
        vars(found).update(error=error, unchecked=None, n_rays=n_rays)
        return found

    @cached_property
    def _n_parts(self) -> Ints:
        """Into how many quads (c,) the sides of smooth cells are cut."""
        xy = taken(self.points.xy, self.nodes)
        return n_parts(xy, self.size, self._is_inside, self.tolerance)

    @cached_property
    def _is_inside(self) -> Bools:
        """Are smooth cells (c,) inside of both images, wholly?"""
        xy = taken(self.points.xy, self.nodes)
        squares = Squares(self.corner, self.size)
        return squares.are_within(xy, self.view_size, self.display_size)

    def is_beside_glass(self, points: Ints) -> Bools:
        """Is light of these landed points beside the glass?"""
        return self.points.reason[points] == Reason.MISSED_GLASS

    @cached_property
    def sample_width(self) -> Floats:
        """Sides (s,), display px, of the squares that samples light; 0 of those that light none."""
        return finish(self._spreading())

    def _spreading(self) -> Pauses[Floats]:
        is_landed = self.points.branch[self.samples] != 0
        is_beside = self.is_beside_glass(self.samples)
        found = np.zeros(len(self.samples))
        # light through the glass and light beside it are never mixed
        for some in (np.flatnonzero(is_landed & ~is_beside), np.flatnonzero(is_landed & is_beside)):
            number = self.samples[some]
            view, xy = (taken(of, number) for of in (self.points.view, self.points.xy))
            found[some] = yield from widths(view, xy, self.display_size)
        return found

    @property
    def n_pieces(self) -> int:
        """Number of quads, triangles and lit samples."""
        n_smooth = int((self._n_parts**2).sum())
        n_samples = np.count_nonzero(self.sample_width)
        return n_smooth + len(self.quads) + len(self.triangles) + n_samples

    @cached_property
    def shares_by_kind(self) -> NDArray[np.float64]:
        """(4,) approximate numbers of shares that smooth cells, quads, triangles and samples make,
        one for each display pixel that a piece touches.
        """
        shares, step = self._count_shares(self.nodes[:, CORNERS], self._n_parts)
        smooth = step * shares.sum()
        shares, step = self._count_shares(self.quads)
        quads = step * shares.sum()
        shares, step = self._shares_of_triangles
        if self.thinning is not None:
            some = self.triangles[::step]
            some = [taken(places, some) for places in (self.points.view, self.points.xy)]
            shares = shares / self.thinning.strides(*some) ** 2
        triangles = step * shares.sum()
        # a square narrower than a pixel lies in one
        width = self.sample_width
        shares = np.where(width < 1, width > 0, (width + 1) ** 2)
        return np.array([smooth, quads, triangles, shares.sum()])

    @cached_property
    def thinning(self) -> Thinning | None:
        """Of triangles that spread far over the display; None where these are not many."""
        return finish(self._looking_far())

    def look_far(self) -> Generator[float, None, None]:
        """Make `sample_width` and `thinning`, each of which may take a second and more; yields
        progress 0..1.
        """
        if "sample_width" not in vars(self):
            vars(self)["sample_width"] = yield from at(0.0, self._spreading())
        if "thinning" not in vars(self):
            vars(self)["thinning"] = yield from within(self._looking_far(), 0.5, 1.0)

    def _looking_far(self) -> Generator[float, None, Thinning | None]:
        shares, step = self._shares_of_triangles
        if step * shares.sum() <= THINNING.per_pixel * np.prod(self.display_size):
            return None
        thinning = Thinning(self.display_size)
        for first in range(0, len(self.triangles), QUADS_AT_ONCE):
            thinning.add(*polygons(self.points, self.triangles[first : first + QUADS_AT_ONCE])[:2])
            yield first / len(self.triangles)
        return thinning

    @cached_property
    def _shares_of_triangles(self) -> tuple[Floats, int]:
        return self._count_shares(self.triangles)

    def _count_shares(self, pieces: Ints, n_parts: Ints | None = None) -> tuple[Floats, int]:
        return count_shares(self.points.xy, pieces, self.display_size, n_parts)

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

    def pieces(
        self, at_pixels: bool = False, beside: bool = False, sampled: bool = True
    ) -> Iterator[Piece]:
        """Quads and triangles that make up the map, by way of the glass, or beside it.

        Each lies within one viewer pixel when asked to, but for the squares around samples, whose
        middles do. Those come last, unless only the rest is asked for. Arrays are new each time:
        whoever asks for them may change them.
        """
        # smooth cells, by the number of their quads
        parts = np.maximum(self._n_parts, self.size) if at_pixels else self._n_parts
        asked = np.flatnonzero(self.is_beside_glass(self.nodes[:, 0]) == beside)
        for m, cells in each_value(parts[asked]):
            step = max(1, QUADS_AT_ONCE // m**2)
            for first in range(0, len(cells), step):
                yield self._quads_of(asked[cells[first : first + step]], m)

        # cut pixels
        for kind in (self.quads, self.triangles):
            asked = kind[self.is_beside_glass(kind[:, 0]) == beside]
            for first in range(0, len(asked), QUADS_AT_ONCE):
                yield polygons(self.points, asked[first : first + QUADS_AT_ONCE])

        if not sampled:
            return

        # samples
        is_lit = self.sample_width > 0
        asked = np.flatnonzero(is_lit & (self.is_beside_glass(self.samples) == beside))
        for first in range(0, len(asked), QUADS_AT_ONCE):
            some = asked[first : first + QUADS_AT_ONCE]
            samples = self.points.at(self.samples[some])
            area, width = self.sample_area[some], self.sample_width[some]
            yield squares_around(samples, area, width, self.display_size)

    def _quads_of(self, cells: Ints, m: int) -> Piece:
        """Quads of smooth cells (n,), m a side, that begin in the viewer's image."""
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
        """Display pixels (n, 2) that viewer pixels (n, 2) show, also
        beyond a flat display; NaN where nothing lands.

        So does light beside the glass where the settings look for it.
        Where light is chaotic this is the landing of the sample that is nearest.
        """
        xy = np.asarray(xy, float)
        found = finish(self.lookup.by_cells(xy))
        rays, samples = self.lookup.nearest_samples(xy, np.isnan(found[:, 0]))
        found[rays] = self.points.xy[samples]
        return found

    @property
    def is_one_cell(self) -> Bools:
        """Viewer pixels (h, w) that lie in one cell, wholly."""
        return self.lookup.owner != -1
