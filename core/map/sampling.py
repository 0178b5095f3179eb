"""Which rays are traced for a view map: as few as keep the tolerance.

Squares of the viewer's image are traced at 5 x 5 nodes. Where these lie on one branch and a
biquartic through them keeps the tolerance, at six more rays too, the square is one cell; elsewhere
it is quartered, down to 4 pixels. There the nodes are the pixels' corners: pixels whose corners lie
on one branch are cells, the others are cut in pieces.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Bools, Floats, Ints, taken
from ..light.landings import Reason
from ..light.plan import Plan
from ..steps import Pauses
from . import interpolation
from .borders import QUARTERINGS, cut
from .interpolation import CHECKS, COLUMN, PARTS, ROW
from .points import Paths, Points, bounds_of, is_in_image, is_seen, trace_points
from .samples import sample_cells
from .view_map import FOR_QUADS, NO_ERROR, MapError, ViewMap

ACROSS = 16  # squares along the longer side of the viewer's image to begin with
# of the lesser step from a node to its neighbours: so
# far points between them may be beyond the node
MARGIN = 0.25
# times the display's size: light that lands so far beside
# it does not come back to it within a square
FAR = 1.0
RAYS_OF_SQUARE = 16  # about as many as a square of each size takes
# and a pixel of the finest; where all glass is flat
RAYS_OF_PIXEL = 12
RAYS_OF_FLAT = 5
# of squares, of the smallest ones: so many are expected at the least
QUARTERED = 0.6
REFUSED = 0.5
MORE = 1.02  # times the rays so far: there are always some to come
SAMPLED = 1024  # places, of smooth squares and of pixels, at which the error is measured
ALIKE = 8  # px: up to here squares may be dark whose rays are lost in different ways
LAST = 0.999  # quantile of the error that keeps to the tolerance


def sample(plan: Plan) -> Generator[float, None, ViewMap]:
    """Trace the display as the viewer sees it, and cut it into cells; yields progress 0..1."""
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
        return _Squares(
            np.concatenate([self.corner, others.corner]), np.concatenate([self.size, others.size])
        )

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
    """The work of making a view map: the points traced so far
    and the number of that at each node, -1 for none.

    n_done : rays traced so far; expected : a guess of the rays in all, mended at each level
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        viewer = plan.rig.viewer
        display = plan.rig.display
        self.view_size = (viewer.width, viewer.height)
        self.display_size = (display.width, display.height)
        self.tolerance = plan.settings.tolerance
        self.first_size = max(PARTS, 2 ** int(np.log2(max(self.view_size) / ACROSS)))
        n_columns, n_rows = (-(-n // self.first_size) for n in self.view_size)
        self.number = np.full(
            (n_rows * self.first_size + 1, n_columns * self.first_size + 1), -1, np.int32
        )
        x, y = np.meshgrid(np.arange(n_columns), np.arange(n_rows))
        corner = self.first_size * np.stack([x.ravel(), y.ravel()], axis=1)
        self.first = _Squares(corner, np.full(len(corner), self.first_size))
        self.points = Points.none()
        self.allowed = (1 - FOR_QUADS) * self.tolerance
        low, high = plan.thin_parts().box
        far = np.linalg.norm(
            np.maximum(np.abs(low - viewer.position), np.abs(high - viewer.position))
        )
        self.paths = Paths(far + float(np.linalg.norm(high - low)))
        self.n_done, self.expected = 0, 0.0
        self._expect(self.first, self.first.at(slice(0)), 0.0, 0)

    def sample(self) -> Generator[float, None, ViewMap]:
        """Make the view map; yields progress 0..1."""
        work = self._run()
        told = 0.0
        while True:
            try:
                self.n_done += next(work)
            except StopIteration as end:
                return replace(end.value, n_rays=self.n_done)
            # more may be expected than before
            told = max(told, self.n_done / max(self.expected, MORE * self.n_done))
            yield told

    def _run(self) -> Generator[int, None, ViewMap]:
        none = self.first.at(slice(0))
        todo = self.first
        checking = none
        smooth = none
        finest = none
        while len(todo) or len(checking):
            column, row = todo.nodes()
            missing = np.unique((row * self.number.shape[1] + column)[self.number[row, column] < 0])
            nodes = np.stack(
                [missing % self.number.shape[1], missing // self.number.shape[1]], axis=1
            ).astype(float)
            checks = checking.checks()
            found = yield from trace_points(
                self.plan, np.concatenate([nodes, checks.reshape(-1, 2)]), paths=self.paths
            )
            first = len(self.points)
            self.points = self.points.and_more(found)
            self.number.ravel()[missing] = first + np.arange(len(missing))
            missed = self._missed(checking, first + len(missing))
            # of the smallest, the rest of their error is compared with
            # that of the quads between their nodes
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
        """Guess the number of rays.

        Of squares to be traced, or checked, such a share is refused. finest : px.
        """
        n_rays = float(len(self.points) + len(CHECKS) * len(checking))
        share = max(refused, QUARTERED)
        size = self.first_size
        area = 0.0
        while size > PARTS:
            area += float((todo.size == size).sum()) * size**2
            n_rays += RAYS_OF_SQUARE * area / size**2
            area = share * (area + float((checking.size == size).sum()) * size**2)
            size //= 2
        area += float((todo.size == PARTS).sum() + (checking.size == PARTS).sum()) * PARTS**2
        of_pixel = RAYS_OF_FLAT if self.plan.is_flat else RAYS_OF_PIXEL
        self.expected = n_rays + of_pixel * (max(refused, REFUSED) * area + finest)

    def _expect_of_cut(self, n_rays: float) -> None:
        """Guess the number of rays, if so many are still to
        come until all pixels are cut and sampled.
        """
        self.expected = self.n_done + n_rays + 2 * SAMPLED

    def _at_nodes(self, squares: _Squares) -> Ints:
        """Numbers (n, 25) of the points at the nodes of squares."""
        column, row = squares.nodes()
        return self.number[row, column]

    def _sorted(self, squares: _Squares) -> Pauses[tuple[Bools, Bools]]:
        """Which squares (n,) are smooth cells if checks confirm
        it, and which show nothing of the display?
        """
        nodes = self._at_nodes(squares)
        branch = self.points.branch[nodes]
        xy = taken(self.points.xy, nodes)
        is_one = (branch == branch[:, :1]).all(axis=1)
        is_dark = is_one & (branch[:, 0] == 0)
        is_one &= ~is_dark
        is_aside = _is_aside(xy, branch, np.array(self.display_size))
        is_smooth = is_one & ~is_aside
        expected = interpolation.expected_error(xy[is_smooth])
        is_smooth[is_smooth] = (expected <= self.allowed) | (squares.size[is_smooth] == PARTS)
        met = self.paths.met[nodes]
        # lost in different ways: something between may be seen
        is_dark &= (met == met[:, :1]).all(axis=(1, 2)) | (squares.size <= ALIKE)
        settled = np.flatnonzero(is_smooth | is_dark | is_aside)
        touched = settled[(yield from self._is_touched(squares.at(settled)))]
        is_smooth[touched] = is_dark[touched] = is_aside[touched] = False
        return is_smooth, is_dark | is_aside

    def _is_touched(self, squares: _Squares) -> Pauses[Bools]:
        """Did the rays of squares (n,) pass by something that none of them met?"""
        nodes = self._at_nodes(squares)
        return (
            yield from self.plan.thin_parts().touch(
                taken(self.paths.places, nodes), taken(self.paths.met, nodes)
            )
        )

    def _bent(self, squares: _Squares) -> Floats:
        """About how far off (n,), display px, the pixels of the
        smallest squares are, quartered as in `cut`.
        """
        by_quads = interpolation.sag(taken(self.points.xy, self._at_nodes(squares)))
        return np.where(by_quads > self.tolerance, by_quads / 4**QUARTERINGS, by_quads)

    def _missed(self, squares: _Squares, first: int) -> Floats:
        """By how much (n,), display px, smooth squares miss the points traced to check them.

        Inf on another branch.
        """
        n = len(squares)
        nodes = self._at_nodes(squares)
        checks = first + np.arange(len(CHECKS) * n).reshape(n, len(CHECKS))
        missed = np.zeros(n)
        for k, place in enumerate(CHECKS):
            expected = interpolation.at_places(taken(self.points.xy, nodes), np.tile(place, (n, 1)))
            xy = self.points.xy[checks[:, k]]
            is_one = self.points.branch[checks[:, k]] == self.points.branch[nodes[:, 0]]
            off = np.where(is_one, np.linalg.norm(expected - xy, axis=1), np.inf)
            missed = np.maximum(
                missed, np.where(is_seen(expected, xy, self.display_size), off, 0.0)
            )
        return missed

    def _finished(self, smooth: _Squares, finest: _Squares) -> Generator[int, None, ViewMap]:
        """Cells of the pixels of the squares that were refused to the last, and the whole map."""
        column, row = finest.nodes()
        at = np.flatnonzero((COLUMN < PARTS) & (ROW < PARTS))
        corners = np.stack([at, at + 1, at + PARTS + 2, at + PARTS + 1], axis=1)
        is_there = (column[:, at] < self.view_size[0]) & (row[:, at] < self.view_size[1])
        cells = self._at_nodes(finest)[:, corners][is_there]
        by_row = cells[:, [0, 1, 3, 2]]
        is_aside = _is_aside(
            taken(self.points.xy, by_row), self.points.branch[by_row], np.array(self.display_size)
        )
        # beside the glass there is nothing to find, but where
        # something thin is near, or light is followed there, too
        is_lost = (self.points.reason == Reason.MISSED_GLASS) & (self.points.branch == 0)
        is_beside_glass = is_lost[cells].all(axis=1)
        is_touched = yield from self._is_touched(finest)
        is_beside_glass &= ~np.broadcast_to(is_touched[:, None], is_there.shape)[is_there]
        is_seen = ~is_aside & ~is_beside_glass
        square = np.broadcast_to(np.arange(len(finest))[:, None], is_there.shape)[is_there]
        cells = cells[is_seen]
        pieces = yield from cut(self.plan, self.points, cells, square[is_seen], self._expect_of_cut)
        samples, sample_area = yield from sample_cells(
            self.plan, pieces.points.view[pieces.chaotic]
        )
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

    def _measure(
        self, view_map: ViewMap, smooth: _Squares, pixels: Ints
    ) -> Generator[int, None, MapError]:
        """Errors of the map at random places of smooth squares,
        and of the finest pixels, corners (n, 4).
        """
        random = np.random.default_rng(0)
        # light beside the glass carries no picture
        smooth = smooth.at(~view_map.is_beside_glass(self._at_nodes(smooth)[:, 0]))
        n_smooth, n_pixels = (min(SAMPLED, 16 * len(kind)) for kind in (smooth, pixels))
        squares = smooth.at(
            random.choice(len(smooth), n_smooth, p=smooth.size**2 / (smooth.size**2).sum())
            if n_smooth
            else []
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
            [(smooth.size**2.0).sum() / max(n_smooth, 1), len(pixels) / max(n_pixels, 1)],
            [n_smooth, n_pixels],
        )
        expected = view_map.by_cells(at)
        is_sampled = np.zeros(len(at), bool)
        is_sampled[view_map.nearest_samples(at, np.isnan(expected[:, 0]))[0]] = True
        seen = is_seen(expected, found.xy, self.display_size) & is_in_image(at, self.view_size)
        is_beside_glass = view_map.is_beside_glass(some).all(axis=1)
        seen[n_smooth:] &= ~is_beside_glass | (found.reason[n_smooth:] != Reason.MISSED_GLASS)
        whole = max(float(area[seen].sum()), 1e-300)
        sampled = float(area[seen & is_sampled].sum() / whole)
        seen &= ~is_sampled
        off = np.nan_to_num(np.linalg.norm(expected - found.xy, axis=1)[seen], nan=np.inf)
        both = is_in_image(expected, self.display_size) & is_in_image(found.xy, self.display_size)
        # seen by one account only, however far away by the other
        off[~both[seen] & (off > self.tolerance)] = np.inf
        area = area[seen]
        is_one = is_one[seen]
        is_cut_off = found.reason[seen] == Reason.CUT_OFF
        by_kind = []
        for kind in (is_one, ~is_one):
            above = kind & (off > self.tolerance)
            by_kind += [float(area[above].sum() / whole), _rms(off[above], area[above])]
        cut_off = float(area[~is_one & is_cut_off].sum() / whole)
        noise = sampled / self.plan.settings.samples_along
        by_kind[2] += noise
        chaos = sampled, noise, len(view_map.samples)
        return MapError(
            _rms(off, area),
            _quantile(off, area, LAST),
            *by_kind,
            cut_off,
            *chaos,
            n_checked=len(at),
        )

    def _reasons(self) -> np.ndarray:
        """Reason at the corners (h + 1, w + 1) of the viewer's
        pixels: those not traced have that of a node nearby.
        """
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


def _is_aside(xy: Floats, branch: np.ndarray, display_size: Ints) -> Bools:
    """Do squares (n,) with nodes, k rows of k, that land
    at (n, k^2, 2) show nothing of the display?

    Those on one branch do so when all their nodes land beside it, on one side, and their limits do
    as well: along each row and column, a step beyond the last that lands, and a part of a step
    around the one nearest to the display.
    """
    is_lost = branch == 0
    is_single = (is_lost | (branch == branch.max(axis=1, keepdims=True))).all(
        axis=1
    ) & ~is_lost.all(axis=1)
    low, high = bounds_of(np.where(is_lost[..., None], np.nan, xy))
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
        before = np.concatenate([outside, -step], axis=2)
        after = np.concatenate([step, outside], axis=2)
        with np.errstate(invalid="ignore"):
            needed = np.where(np.isnan(before) | np.isnan(after), 1.0, MARGIN) * np.fmin(
                before, after
            )
            needed = np.where(np.isfinite(needed), needed, FAR * display_size)
            holds &= ~np.moveaxis(along < needed, 2, axis)
    is_aside = np.zeros(len(xy), bool)
    is_aside[chosen] = holds.all(axis=(2, 3)).any(axis=(0, 2))
    return is_aside


def _rms(off: Floats, area: Floats) -> float:
    """Root mean square of errors (n,) over areas (n,), as far as they are known."""
    known = np.isfinite(off)
    return float(np.sqrt((area[known] * off[known] ** 2).sum() / max(area[known].sum(), 1e-300)))


def _quantile(off: Floats, area: Floats, share: float) -> float:
    """The error that this share of the area stays below, as far as errors are known; 0
    without any.
    """
    known = np.isfinite(off)
    off = off[known]
    area = area[known]
    order = np.argsort(off)
    below = np.cumsum(area[order])
    return (
        float(off[order[np.searchsorted(below, share * below[-1])]])
        if len(off) and below[-1] > 0
        else 0.0
    )
