"""Which rays to trace: the view map, viewer pixels to display pixels, as cells.

Squares of the viewer's image are traced at 5 x 5 nodes. Where these lie on one branch and a biquartic through them
keeps the tolerance, at six more rays too, the square is one cell; elsewhere it is quartered, down to 4 pixels. There
the nodes are the pixels' corners: pixels whose corners lie on one branch are cells, the others are cut in pieces.
"""

from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import interpolation
from .arrays import Bools, Floats, Ints, mean_at, taken
from .borders import QUARTERINGS, Paths, Points, areas, cut, in_triangles, is_in_image, is_seen, trace_points
from .interpolation import CHECKS, COLUMN, PARTS, ROW
from .plan import Plan
from .samples import sample_cells
from .steps import Pauses
from .trace import Reason

ACROSS = 16  # squares along the longer side of the viewer's image to begin with
MARGIN = 0.25  # of the lesser step from a node to its neighbours: so far what is between may be beyond the node
FAR = 1.0  # times the display's size: light that lands so far beside it does not come back to it within a square
FOR_QUADS = 0.25  # of the tolerance: so far the quads of a smooth cell may be from it
CHEAP = 0.01  # display px: so near they come to it, unless that takes quads smaller than viewer pixels
PLACES = 4  # along a display pixel that is larger than a viewer pixel: its colour is taken there
FEW_PLACES = 2.0  # along a smaller one
ONE_PLACE = 0.1  # display px: from this tolerance on, one place is enough along a smaller one, on curved glass
MOST_QUADS = 128  # along the side of a smooth cell
QUADS_AT_ONCE = 1 << 15
SHARES_OF_QUAD = 2.0  # of a smooth cell, about
RAYS_OF_SQUARE = 16  # about as many as a square of each size takes
RAYS_OF_PIXEL, RAYS_OF_FLAT = 12, 5  # and a pixel of the finest; where all glass is flat
QUARTERED, REFUSED = 0.6, 0.5  # of squares, of the smallest ones: so many are expected at the least
MORE = 1.02  # times the rays so far: there are always some to come
COUNTED = 1 << 16  # pieces at the least of which the shares are counted, where there are more
SAMPLED = 1024  # places, of smooth squares and of pixels, at which the error is measured
AROUND = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])  # corners of a unit square
ALIKE = 8  # px: up to here squares may be dark whose rays are lost in different ways
LAST = 0.999  # quantile of the error that keeps to the tolerance


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
    """Errors of the view map at random places, traced for this alone, of the part of its image that shows the display.

    rms, percentile : display px, the latter of 99.9 % of the area; over what the map and the trace both take there
    facet_limited, unresolved : shares of the area, 0..1, that are off by more than the tolerance or that only one of
        both takes to the display: on pixels whose corners lie on one branch, where the map bends within a pixel, most
        often because of the mesh's facets; and on all others
    facet_error, unresolved_error : rms of those shares, as far as it is known, display px
    cut_off : of `unresolved`, what is off because the ray there meets more surfaces than are allowed
    sampled : share where light is chaotic, by samples
    noise : of `unresolved`, the standard error of what they tell: with n samples a pixel 1 / sqrt n of that share
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
    corner, size, nodes : (c, 2), (c,), (c, 25) smooth cells: upper left corner and side, viewer px, indices of points
    quads, triangles : (q, 4), (t, 3) indices of points, in order, the upper left one of quads first: whole pixels and
        quarters of them, and other pieces of pixels
    samples, sample_area : (s,) indices of points where light is chaotic, and the area, viewer px^2, of each
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

        Quads keep the tolerance. A display pixel takes one colour from each quad in it, so quads are smaller than
        display pixels, by the number of places; where a viewer pixel is larger than a display pixel, one place is
        enough: on the ball, at 0.1 px, two gain nothing for 15 % more time.
        """
        xy = taken(self.points.xy, self.nodes)

        # for the tolerance
        parts, parts_cheap = (
            interpolation.parts_for(xy, allowed, MOST_QUADS) for allowed in (FOR_QUADS * self.tolerance, CHEAP)
        )
        parts = np.maximum(parts, np.minimum(parts_cheap, self.size))

        # for the places; on flat glass, where one quad would keep the tolerance, they alone keep the picture sharp
        low, high = _box(xy)
        span = (high - low).max(axis=1)
        n_places = np.where(parts == 1, FEW_PLACES, np.clip(ONE_PLACE / self.tolerance, 1.0, FEW_PLACES))
        pixels = np.clip(PLACES * span, 1.0, self.size) / np.maximum(span / (n_places * self.size), 1.0)
        parts = np.maximum(parts, 2 ** np.log2(np.maximum(pixels, 1.0)).astype(np.int64))

        # a pixel each where the image folds or lies across the display's edge
        at_fold = interpolation.is_folded(xy)
        return np.where(self._is_inside & ~at_fold, parts, np.maximum(parts, self.size))

    @cached_property
    def _is_inside(self) -> Bools:
        """Are smooth cells (c,) inside of both images, wholly?"""
        low, high = _box(taken(self.points.xy, self.nodes))
        return (
            ((low >= 0) & (high <= self.display_size)).all(axis=1)
            & (self.corner + self.size[:, None] <= self.view_size).all(axis=1)
        )  # fmt: skip

    def _is_beside_glass(self, points: Ints) -> Bools:
        """Is light of these landed points beside the glass?"""
        return self.points.reason[points] == Reason.MISSED_GLASS

    @property
    def n_quads(self) -> int:
        """How many quads stand for smooth cells."""
        return int((self._n_parts**2).sum())

    @cached_property
    def n_by_kind(self) -> NDArray[np.float64]:
        """(2, 4): pieces of each kind, in the order of `pieces`, and about how many shares they make.

        Kinds are quads of smooth cells, quads and triangles of cut pixels, and samples. A quad or triangle makes a
        share for each display pixel that it touches.
        """
        cut = [(len(kind), self._n_shares_of(kind)) for kind in (self.quads, self.triangles)]
        return np.transpose([(self.n_quads, SHARES_OF_QUAD * self.n_quads), *cut, (len(self.samples),) * 2])

    @property
    def n_cut_shares(self) -> float:
        """About how many shares the pixels make that are not in smooth cells."""
        return float(self.n_by_kind[1, 1:].sum())

    def _n_shares_of(self, pieces: Ints) -> float:
        """About how many shares pieces (n, 4 or 3) make: known from some of them, where they are many."""
        some = pieces[:: 1 + len(pieces) // COUNTED]
        corners = [taken(self.points.xy, number) for number in some.T]
        low, high = (reduce(bound, corners) for bound in (np.minimum, np.maximum))
        first, last = np.clip(low, 0, self.display_size), np.clip(high, 0, self.display_size)
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
        some = self._is_inside & ~self._is_beside_glass(self.nodes[:, 0])
        return _filled(self.view_size, self.corner[some], self.size[some], np.ones(int(some.sum()), bool), False)

    def pieces(self, at_pixels: bool = False, beside: bool = False) -> Iterator[Piece]:
        """Quads and triangles that make up the map, by way of the glass, or beside it.

        Each lies within one viewer pixel when asked to, but for the squares around samples, whose middles do. Their
        arrays are new each time: whoever asks for them may change them.
        """
        parts = np.maximum(self._n_parts, self.size) if at_pixels else self._n_parts
        asked = np.flatnonzero(self._is_beside_glass(self.nodes[:, 0]) == beside)
        for m, cells in _by(parts[asked]):
            step = max(1, QUADS_AT_ONCE // m**2)
            for first in range(0, len(cells), step):
                yield self._quads_of(asked[cells[first : first + step]], m)
        for kind in (self.quads, self.triangles):
            asked = kind[self._is_beside_glass(kind[:, 0]) == beside]
            for first in range(0, len(asked), QUADS_AT_ONCE):
                yield self._polygons(asked[first : first + QUADS_AT_ONCE])
        landed = self.points.branch[self.samples] != 0
        asked = np.flatnonzero(landed & (self._is_beside_glass(self.samples) == beside))
        for first in range(0, len(asked), QUADS_AT_ONCE):
            yield self._samples_as_squares(asked[first : first + QUADS_AT_ONCE])

    def _polygons(self, corners: Ints) -> Piece:
        """Pieces with these points (n, 4 or 3) as corners."""
        points = self.points
        of_piece = mean_at(points.throughput, corners), points.branch[corners[:, 0]]
        return Piece(taken(points.view, corners), taken(points.xy, corners), *of_piece)

    def _samples_as_squares(self, some: Ints) -> Piece:
        """Squares around samples, as large as their strata, and as many display px, in the pixel that each lands in."""
        points, samples = self.points, self.samples[some]
        side = np.sqrt(self.sample_area[some])[:, None]
        pixel = np.floor(points.xy[samples])
        low = pixel + np.clip(points.xy[samples] - pixel - side / 2, 0, 1 - side)
        high = np.minimum(low + side, pixel + 1)  # or rounding would give the next pixel a share of nothing
        view = points.view[samples, None] + side[..., None] * (AROUND - 0.5)
        xy = np.where(AROUND, high[:, None], low[:, None])
        return Piece(view, xy, points.throughput[samples], points.branch[samples])

    def _quads_of(self, cells: Ints, m: int) -> Piece:
        points, nodes = self.points, self.nodes[cells]
        grid = interpolation.on_grid(
            np.concatenate([taken(points.xy, nodes), points.throughput[nodes][..., None]], axis=2), m
        )
        side = np.arange(m + 1) / m
        x, y = np.meshgrid(side, side)
        place = np.stack([x, y], axis=2)
        view = self.corner[cells][:, None, None] + self.size[cells][:, None, None, None] * place
        xy, throughput = _quads(grid[..., :2]), _quads(grid[..., 2:])[..., 0].mean(axis=1)
        view = _quads(view)
        piece = Piece(view, xy, throughput, np.repeat(points.branch[nodes[:, 0]], m * m))
        if (self.corner[cells] + self.size[cells][:, None] <= self.view_size).all():
            return piece
        return piece.at((view[:, 0] < self.view_size).all(axis=1))

    def display_from_view(self, xy: Floats) -> Floats:
        """Display pixels (n, 2) that viewer pixels (n, 2) show, also beyond a flat display; NaN where nothing lands.

        So does light beside the glass where the settings look for it.
        Where light is chaotic this is the landing of the sample that is nearest.
        """
        xy = np.asarray(xy, float)
        found = self._by_cells(xy)
        rays, samples = self._nearest_samples(xy, np.isnan(found[:, 0]))
        found[rays] = self.points.xy[samples]
        return found

    def _by_cells(self, xy: Floats) -> Floats:
        """Display pixels (n, 2) that viewer pixels (n, 2) show by way of cells; NaN where there is none."""
        found = np.full(xy.shape, np.nan)
        in_image = np.flatnonzero(is_in_image(xy, self.view_size))
        pixel = self._pixel(xy[in_image])
        owner = self._owner.ravel()[pixel]
        smooth = np.flatnonzero(owner >= 0)
        rays, cells = in_image[smooth], owner[smooth]
        places = (xy[rays] - self.corner[cells]) / self.size[cells, None]
        found[rays] = interpolation.at_places(self.points.xy[self.nodes[cells]], places)
        whole = np.flatnonzero(owner < -1)
        rays, quads = in_image[whole], self.quads[-2 - owner[whole]]
        found[rays] = _bilinear(self.points.xy[quads], xy[rays] - self.points.view[quads[:, 0]])
        for pieces in (self.quads[~self._are_pixels], self.triangles):
            inside = in_triangles if pieces.shape[1] == 3 else _in_quarters
            pieces, of_pixel = self._those_in(pieces, pixel)
            for some, k in _each_in(of_pixel, pixel):
                rays, corners = in_image[some], pieces[k]
                is_inside, at = inside(self.points.view[corners], self.points.xy[corners], xy[rays])
                found[rays[is_inside]] = at[is_inside]
        return found

    def _nearest_samples(self, xy: Floats, is_asked: Bools) -> tuple[Ints, Ints]:
        """Which of those viewer pixels (n, 2) that are asked for (n,) are within a stratum's side of a sample.

        And the point of the nearest one.
        """
        order, of_pixel = self._samples_by_pixel
        asked = np.flatnonzero(is_asked & is_in_image(xy, self.view_size))
        nearest, best = np.full(len(xy), -1), np.full(len(xy), np.inf)
        for some, k in _each_in(of_pixel, self._pixel(xy[asked])):
            rays, number = asked[some], order[k]
            off = np.abs(self.points.view[self.samples[number]] - xy[rays]).max(axis=1)
            is_nearer = off <= np.minimum(best[rays], np.sqrt(self.sample_area[number]))
            best[rays[is_nearer]], nearest[rays[is_nearer]] = off[is_nearer], self.samples[number[is_nearer]]
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
        """Cell of each viewer pixel (h, w): a smooth one's number, -2 - that of a quad, -1 for neither."""
        numbers = np.arange(len(self.size), dtype=np.int32)
        owner = _filled(self.view_size, self.corner, self.size, numbers, -1)
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


def sample(plan: Plan) -> Generator[float, None, ViewMap]:
    """Trace what the viewer sees of the display and cut it into cells; yields progress 0..1."""
    return (yield from Sampling(plan).sample())


@dataclass(frozen=True, eq=False)
class _Squares:
    """Squares of the viewer's image: upper left corner (n, 2), side (n,), px."""

    corner: Ints
    size: Ints

    def __len__(self) -> int:
        return len(self.size)

    def at(self, which: Bools | Ints) -> "_Squares":
        return _Squares(self.corner[which], self.size[which])

    def and_more(self, others: "_Squares") -> "_Squares":
        return _Squares(np.concatenate([self.corner, others.corner]), np.concatenate([self.size, others.size]))

    @property
    def area(self) -> int:
        """Of all of them, px."""
        return int((self.size**2).sum())

    def quarters(self) -> "_Squares":
        half = np.repeat(self.size // 2, 4)
        step = np.tile([[0, 0], [1, 0], [0, 1], [1, 1]], (len(self), 1))
        return _Squares(np.repeat(self.corner, 4, axis=0) + half[:, None] * step, half)

    def nodes(self) -> tuple[Ints, Ints]:
        """Columns and rows (n, 25) of the nodes."""
        step = self.size[:, None] // PARTS
        return self.corner[:, :1] + step * COLUMN, self.corner[:, 1:] + step * ROW

    def checks(self) -> Floats:
        """Viewer px (n, 6, 2) of the places at which the interpolation is checked."""
        return self.corner[:, None] + self.size[:, None, None] * CHECKS


class Sampling:
    """The work of making a view map: the points traced so far and the number of that at each node, -1 for none.

    n_done : rays traced so far; expected : a guess of the rays in all, mended at each level
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        viewer, display = plan.rig.viewer, plan.rig.display
        self.view_size, self.display_size = (viewer.width, viewer.height), (display.width, display.height)
        self.tolerance = plan.settings.tolerance
        self.first_size = max(PARTS, 2 ** int(np.log2(max(self.view_size) / ACROSS)))
        n_columns, n_rows = (-(-n // self.first_size) for n in self.view_size)
        self.number = np.full((n_rows * self.first_size + 1, n_columns * self.first_size + 1), -1, np.int32)
        x, y = np.meshgrid(np.arange(n_columns), np.arange(n_rows))
        corner = self.first_size * np.stack([x.ravel(), y.ravel()], axis=1)
        self.first = _Squares(corner, np.full(len(corner), self.first_size))
        self.points = Points.none()
        self.allowed = (1 - FOR_QUADS) * self.tolerance
        low, high = plan.thin_parts().box
        far = np.linalg.norm(np.maximum(np.abs(low - viewer.position), np.abs(high - viewer.position)))
        self.paths = Paths(far + float(np.linalg.norm(high - low)))
        self.n_done, self.expected = 0, 0.0
        self._expect(self.first, self.first.at(slice(0)), 0.0, 0)

    def sample(self) -> Generator[float, None, ViewMap]:
        """Make the view map; yields progress 0..1."""
        work, told = self._run(), 0.0
        while True:
            try:
                self.n_done += next(work)
            except StopIteration as end:
                return replace(end.value, n_rays=self.n_done)
            told = max(told, self.n_done / max(self.expected, MORE * self.n_done))  # more may be expected than before
            yield told

    def _run(self) -> Generator[int, None, ViewMap]:
        none = self.first.at(slice(0))
        todo, checking, smooth, finest = self.first, none, none, none
        while len(todo) or len(checking):
            column, row = todo.nodes()
            missing = np.unique((row * self.number.shape[1] + column)[self.number[row, column] < 0])
            nodes = np.stack([missing % self.number.shape[1], missing // self.number.shape[1]], axis=1).astype(float)
            checks = checking.checks()
            found = yield from trace_points(self.plan, np.concatenate([nodes, checks.reshape(-1, 2)]), paths=self.paths)
            first = len(self.points)
            self.points = self.points.and_more(found)
            self.number.ravel()[missing] = first + np.arange(len(missing))
            missed = self._missed(checking, first + len(missing))
            # of the smallest, what is left of their error is compared with that of the quads between their nodes
            good = missed <= np.where(
                checking.size == PARTS, np.maximum(self._bent(checking), self.allowed), self.allowed
            )
            smooth = smooth.and_more(checking.at(good))
            is_smooth, is_done = yield from self._sorted(todo)
            refused = todo.at(~is_smooth & ~is_done).and_more(checking.at(~good))
            checking = todo.at(is_smooth)
            finest = finest.and_more(refused.at(refused.size == PARTS))
            todo = refused.at(refused.size > PARTS).quarters()
            known = refused.area + checking.area + smooth.area
            self._expect(todo, checking, refused.area / max(known, 1), finest.area)
        return (yield from self._finished(smooth, finest))

    def _expect(self, todo: _Squares, checking: _Squares, refused: float, finest: int) -> None:
        """Guess the number of rays; of squares to be traced, or checked, such a share is refused. finest : px."""
        n_rays = float(len(self.points) + len(CHECKS) * len(checking))
        share, size, area = max(refused, QUARTERED), self.first_size, 0.0
        while size > PARTS:
            area += float((todo.size == size).sum()) * size**2
            n_rays += RAYS_OF_SQUARE * area / size**2
            area = share * (area + float((checking.size == size).sum()) * size**2)
            size //= 2
        area += float((todo.size == PARTS).sum() + (checking.size == PARTS).sum()) * PARTS**2
        of_pixel = RAYS_OF_FLAT if self.plan.is_flat else RAYS_OF_PIXEL
        self.expected = n_rays + of_pixel * (max(refused, REFUSED) * area + finest)

    def _expect_of_cut(self, n_rays: float) -> None:
        """Guess the number of rays, if so many are still to come until all pixels are cut and sampled."""
        self.expected = self.n_done + n_rays + 2 * SAMPLED

    def _at_nodes(self, squares: _Squares) -> Ints:
        """Numbers (n, 25) of the points at the nodes of squares."""
        column, row = squares.nodes()
        return self.number[row, column]

    def _sorted(self, squares: _Squares) -> Pauses[tuple[Bools, Bools]]:
        """Which squares (n,) are smooth cells if checks confirm it, and which show nothing of the display?"""
        nodes = self._at_nodes(squares)
        branch, xy = self.points.branch[nodes], taken(self.points.xy, nodes)
        is_one = (branch == branch[:, :1]).all(axis=1)
        is_dark = is_one & (branch[:, 0] == 0)
        is_one &= ~is_dark
        is_aside = _is_aside(xy, branch, np.array(self.display_size))
        is_smooth = is_one & ~is_aside
        expected = interpolation.expected_error(xy[is_smooth])
        is_smooth[is_smooth] = (expected <= self.allowed) | (squares.size[is_smooth] == PARTS)
        met = self.paths.met[nodes]
        # lost in different ways: what is between may be seen
        is_dark &= (met == met[:, :1]).all(axis=(1, 2)) | (squares.size <= ALIKE)
        settled = np.flatnonzero(is_smooth | is_dark | is_aside)
        touched = settled[(yield from self._is_touched(squares.at(settled)))]
        is_smooth[touched] = is_dark[touched] = is_aside[touched] = False
        return is_smooth, is_dark | is_aside

    def _is_touched(self, squares: _Squares) -> Pauses[Bools]:
        """Did the rays of squares (n,) pass by something that none of them met?"""
        nodes = self._at_nodes(squares)
        return (yield from self.plan.thin_parts().touch(taken(self.paths.places, nodes), taken(self.paths.met, nodes)))

    def _bent(self, squares: _Squares) -> Floats:
        """About how far off (n,), display px, the pixels of the smallest squares are, quartered as in `cut`."""
        by_quads = interpolation.sag(taken(self.points.xy, self._at_nodes(squares)))
        return np.where(by_quads > self.tolerance, by_quads / 4**QUARTERINGS, by_quads)

    def _missed(self, squares: _Squares, first: int) -> Floats:
        """By how much (n,), display px, smooth squares miss the points traced to check them; inf on another branch."""
        n = len(squares)
        nodes, checks = self._at_nodes(squares), first + np.arange(len(CHECKS) * n).reshape(n, len(CHECKS))
        missed = np.zeros(n)
        for k, place in enumerate(CHECKS):
            expected = interpolation.at_places(taken(self.points.xy, nodes), np.tile(place, (n, 1)))
            xy = self.points.xy[checks[:, k]]
            is_one = self.points.branch[checks[:, k]] == self.points.branch[nodes[:, 0]]
            off = np.where(is_one, np.linalg.norm(expected - xy, axis=1), np.inf)
            missed = np.maximum(missed, np.where(is_seen(expected, xy, self.display_size), off, 0.0))
        return missed

    def _finished(self, smooth: _Squares, finest: _Squares) -> Generator[int, None, ViewMap]:
        """Cells of the pixels of the squares that were refused to the last, and the whole map."""
        column, row = finest.nodes()
        at = np.flatnonzero((COLUMN < PARTS) & (ROW < PARTS))
        corners = np.stack([at, at + 1, at + PARTS + 2, at + PARTS + 1], axis=1)
        is_there = (column[:, at] < self.view_size[0]) & (row[:, at] < self.view_size[1])
        cells = self._at_nodes(finest)[:, corners][is_there]
        by_row = cells[:, [0, 1, 3, 2]]
        is_aside = _is_aside(taken(self.points.xy, by_row), self.points.branch[by_row], np.array(self.display_size))
        # beside the glass there is nothing to find, but where something thin is near, or light is followed there, too
        is_lost = (self.points.reason == Reason.MISSED_GLASS) & (self.points.branch == 0)
        is_beside_glass = is_lost[cells].all(axis=1)
        is_touched = yield from self._is_touched(finest)
        is_beside_glass &= ~np.broadcast_to(is_touched[:, None], is_there.shape)[is_there]
        is_seen = ~is_aside & ~is_beside_glass
        square = np.broadcast_to(np.arange(len(finest))[:, None], is_there.shape)[is_there]
        cells = cells[is_seen]
        pieces = yield from cut(self.plan, self.points, cells, square[is_seen], self._expect_of_cut)
        samples, sample_area = yield from sample_cells(self.plan, pieces.points.view[pieces.chaotic])
        view_map = ViewMap(
            self.view_size,
            self.display_size,
            pieces.points.and_more(samples),
            smooth.corner,
            smooth.size,
            self._at_nodes(smooth),
            pieces.quads,
            pieces.triangles,
            len(pieces.points) + np.arange(len(samples)),
            sample_area,
            self._reasons(),
            self.tolerance,
            NO_ERROR,
            n_rays=0,
        )
        return replace(view_map, error=(yield from self._measure(view_map, smooth, cells)))

    def _measure(self, view_map: ViewMap, smooth: _Squares, pixels: Ints) -> Generator[int, None, MapError]:
        """Errors of the map at random places of smooth squares, and of the finest pixels, corners (n, 4)."""
        random = np.random.default_rng(0)
        # light beside the glass carries no picture
        smooth = smooth.at(~view_map._is_beside_glass(self._at_nodes(smooth)[:, 0]))
        n_smooth, n_pixels = (min(SAMPLED, 16 * len(kind)) for kind in (smooth, pixels))
        squares = smooth.at(
            random.choice(len(smooth), n_smooth, p=smooth.size**2 / (smooth.size**2).sum()) if n_smooth else []
        )
        some = pixels[random.integers(0, max(len(pixels), 1), n_pixels)]
        at = np.concatenate([
            squares.corner + squares.size[:, None] * random.random((n_smooth, 2)),
            self.points.view[some[:, 0]] + random.random((n_pixels, 2)),
        ])  # fmt: skip
        found = yield from trace_points(self.plan, at)
        branch = self.points.branch[some]
        is_one = np.append(np.zeros(n_smooth, bool), (branch == branch[:, :1]).all(axis=1))
        area = np.repeat(
            [(smooth.size**2.0).sum() / max(n_smooth, 1), len(pixels) / max(n_pixels, 1)], [n_smooth, n_pixels]
        )
        expected = view_map._by_cells(at)
        is_sampled = np.zeros(len(at), bool)
        is_sampled[view_map._nearest_samples(at, np.isnan(expected[:, 0]))[0]] = True
        seen = is_seen(expected, found.xy, self.display_size) & is_in_image(at, self.view_size)
        is_beside_glass = view_map._is_beside_glass(some).all(axis=1)
        seen[n_smooth:] &= ~is_beside_glass | (found.reason[n_smooth:] != Reason.MISSED_GLASS)
        whole = max(float(area[seen].sum()), 1e-300)
        sampled = float(area[seen & is_sampled].sum() / whole)
        seen &= ~is_sampled
        off = np.nan_to_num(np.linalg.norm(expected - found.xy, axis=1)[seen], nan=np.inf)
        both = is_in_image(expected, self.display_size) & is_in_image(found.xy, self.display_size)
        off[~both[seen] & (off > self.tolerance)] = np.inf  # seen by one account only, however far away by the other
        area, is_one, is_cut_off = area[seen], is_one[seen], found.reason[seen] == Reason.CUT_OFF
        by_kind = []
        for kind in (is_one, ~is_one):
            above = kind & (off > self.tolerance)
            by_kind += [float(area[above].sum() / whole), _rms(off[above], area[above])]
        cut_off = float(area[~is_one & is_cut_off].sum() / whole)
        noise = sampled / self.plan.settings.samples_along
        by_kind[2] += noise
        chaos = sampled, noise, len(view_map.samples)
        return MapError(_rms(off, area), _quantile(off, area, LAST), *by_kind, cut_off, *chaos, n_checked=len(at))

    def _reasons(self) -> np.ndarray:
        """Reason at the corners (h + 1, w + 1) of the viewer's pixels: those not traced have that of a node nearby."""
        step = self.first_size // PARTS
        at = self.number[::step, ::step]
        reasons = self.points.reason[at]
        while step > 1:
            step //= 2
            at = self.number[::step, ::step]
            rows, columns = ((np.arange(n) + 1) // 2 for n in at.shape)
            reasons = np.where(at >= 0, self.points.reason[at], reasons[rows[:, None], columns])
        w, h = self.view_size
        return reasons[: h + 1, : w + 1].copy()


def _by(values: Ints) -> Iterator[tuple[int, Ints]]:
    """Each different value, and where it stands."""
    for value in np.unique(values):
        yield int(value), np.flatnonzero(values == value)


def _each_in(owners: Ints, wanted: Ints) -> Iterator[tuple[Ints, Ints]]:
    """Places of wanted numbers (n,) in sorted owners (m,): which of those wanted have one more, and where."""
    first, last = (np.searchsorted(owners, wanted, side) for side in ("left", "right"))
    for k in range(int((last - first).max(initial=0))):
        some = np.flatnonzero(first + k < last)
        yield some, first[some] + k


def _box(xy: Floats) -> tuple[Floats, Floats]:
    """Least and greatest x and y (n, 2) of display pixels (n, k, 2), NaN without a landing."""
    return np.fmin.reduce(xy, axis=1), np.fmax.reduce(xy, axis=1)


def _is_aside(xy: Floats, branch: np.ndarray, display_size: Ints) -> Bools:
    """Do squares (n,) with nodes, k rows of k, that land at (n, k^2, 2) show nothing of the display?

    Those on one branch do so when all their nodes land beside it, on one side, and what they tend to does as well:
    along each row and column, a step beyond the last that lands, and a part of a step around the one nearest to the
    display.
    """
    is_lost = branch == 0
    is_single = (is_lost | (branch == branch.max(axis=1, keepdims=True))).all(axis=1) & ~is_lost.all(axis=1)
    low, high = _box(np.where(is_lost[..., None], np.nan, xy))
    chosen = np.flatnonzero(is_single & ((low > display_size) | (high < 0)).any(axis=1))
    k = round(xy.shape[1] ** 0.5)
    of_chosen = taken(xy, chosen)
    beyond = np.stack([of_chosen - display_size, -of_chosen])  # the image, by so much
    beyond[:, is_lost[chosen]] = np.nan
    holds = ~(beyond <= 0)
    beyond, holds = (x.reshape(2, -1, k, k, 2) for x in (beyond, holds))
    for axis in (2, 3):
        along = np.moveaxis(beyond, axis, 2)
        step = np.diff(along, axis=2)
        outside = np.full_like(step[:, :, :1], np.inf)  # nothing is lost there
        before, after = np.concatenate([outside, -step], axis=2), np.concatenate([step, outside], axis=2)
        with np.errstate(invalid="ignore"):
            needed = np.where(np.isnan(before) | np.isnan(after), 1.0, MARGIN) * np.fmin(before, after)
            needed = np.where(np.isfinite(needed), needed, FAR * display_size)
            holds &= ~np.moveaxis(along < needed, 2, axis)
    is_aside = np.zeros(len(xy), bool)
    is_aside[chosen] = holds.all(axis=(2, 3)).any(axis=(0, 2))
    return is_aside


def _filled(view_size: tuple[int, int], corner: Ints, size: Ints, values: np.ndarray, blank: int) -> np.ndarray:
    """An image (h, w) with squares of values (n,) on blank: their corners and sizes are multiples of 4 pixels."""
    w, h = view_size
    image = np.full((-(-h // PARTS), -(-w // PARTS)), blank, values.dtype)
    for side, some in _by(size // PARTS):
        column, row = (corner[some].T // PARTS)[..., None] + np.arange(side)
        row, column = row[:, :, None], column[:, None, :]
        is_there = (row < image.shape[0]) & (column < image.shape[1])
        row, column, value = (a[is_there] for a in np.broadcast_arrays(row, column, values[some][:, None, None]))
        image[row, column] = value
    return image.repeat(PARTS, axis=0).repeat(PARTS, axis=1)[:h, :w]


def _quads(grid: Floats) -> Floats:
    """Quads (n m^2, 4, c) between the points of grids (n, m + 1, m + 1, c), corners in order."""
    corners = grid[:, :-1, :-1], grid[:, :-1, 1:], grid[:, 1:, 1:], grid[:, 1:, :-1]
    return np.stack(corners, axis=3).reshape(-1, 4, grid.shape[-1])


def _bilinear(corners: Floats, place: Floats) -> Floats:
    """Points (n, 2) at places (n, 2), in 0..1, of quads (n, 4, 2)."""
    x, y = place[:, :1], place[:, 1:]
    a, b, c, d = np.moveaxis(corners, 1, 0)
    return (1 - y) * ((1 - x) * a + x * b) + y * ((1 - x) * d + x * c)


def _in_quarters(view: Floats, xy: Floats, at: Floats) -> tuple[Bools, Floats]:
    """Are points (n, 2) in quarters of pixels (n, 4, 2), and where (n, 2) does the display show them?"""
    place = (at - view[:, 0]) / (view[:, 1, :1] - view[:, 0, :1])
    return ((place >= 0) & (place <= 1)).all(axis=1), _bilinear(xy, place)


def _rms(off: Floats, area: Floats) -> float:
    """Root mean square of errors (n,) over areas (n,), as far as they are known."""
    known = np.isfinite(off)
    return float(np.sqrt((area[known] * off[known] ** 2).sum() / max(area[known].sum(), 1e-300)))


def _quantile(off: Floats, area: Floats, share: float) -> float:
    """The error that this share of the area stays below, as far as errors are known; 0 without any."""
    known = np.isfinite(off)
    off, area = off[known], area[known]
    order = np.argsort(off)
    below = np.cumsum(area[order])
    return float(off[order[np.searchsorted(below, share * below[-1])]]) if len(off) and below[-1] > 0 else 0.0
