"""The view map the other way: at which places of the viewer's image is a point of the display seen?

A point may be seen at several places, on as many sheets of the map. One of them counts: that on
the path that most of the display pixel is seen by, and of several on this path the one that shows
it largest. A source image that settles ghosts by the strongest path shows the same.

Where the middle of a pixel is seen on no such path, but a part of the pixel is, the place is the
middle of that part's largest share. So no pixel at a border is lost.

Candidates are the triangles of the map's pieces that hold a point, a quad counting as two. A point
on an edge may be found in both triangles next to it.
"""

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Floats, Ints, take
from ...base.steps import Steps, hold_progress
from ...base.vectors import cross_2d
from ...image.ghosts import NO_PATH, paths_of, strongest_paths
from ...light.plan import Plan
from ...map.pieces import Piece
from ...map.points import Tracer, is_in_image, trace_points, tracer
from ...map.rasterise import ragged
from ...map.shares import ShareBatches
from ...map.view_map import ViewMap
from ...solve.channel import shares_of


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


@dataclass(frozen=True)
class Settling:
    """When a place is good enough; seen on the ball, where the median takes two rays.

    settled : share of the tolerance between the landing and the point; the step that is left then
        makes it a square of that
    most_rays : for one place
    nearby : viewer px, over which the derivative is taken where no piece tells it
    """

    settled: float = 0.01
    most_rays: int = 10
    nearby: float = 1e-3


SETTLING = Settling()


@dataclass(eq=False)
class Places:
    """Places of the viewer's image, each with the point of the display that it is to show.

    view : (n, 2) viewer px, the best so far
    off : (n,) display px between its landing and the point; inf where it is on no branch
    """

    view: Floats
    off: Floats


def settle(
    plan: Plan,
    points: Floats,
    view: Floats,
    view_by_display: Floats,
    branch: NDArray[np.uint64],
) -> Steps[Places]:
    """Bring places to the points that they are to show; yields the number of rays now and then.

    Parameters
    ----------
    points : (n, 2) display px
    view : (n, 2) viewer px to begin with
    view_by_display : (n, 2, 2) about the inverse of the map's derivative there
    branch : (n,) that light has to take
    """
    n = len(points)
    settled_px = SETTLING.settled * plan.settings.tolerance
    found = Places(view.copy(), np.full(n, np.inf))
    inverse = view_by_display.copy()
    step = np.zeros((n, 2))
    miss = np.zeros((n, 2))
    left = np.arange(n)

    for _ in range(SETTLING.most_rays):
        if not len(left):
            break

        tried = found.view[left] + step[left]
        traced = yield from trace_points(plan, tried)
        new_miss = traced.xy - points[left]
        off = np.where(traced.branch == branch[left], np.hypot(*new_miss.T), np.inf)
        is_nearer = off < found.off[left]

        # how the step turned out corrects the derivative
        some = left[is_nearer]
        is_second = np.isfinite(found.off[some])
        known = some[is_second]
        inverse[known] = _corrected(
            inverse[known], step[known], new_miss[is_nearer][is_second] - miss[known]
        )
        found.view[some] = tried[is_nearer]
        found.off[some] = off[is_nearer]
        miss[some] = new_miss[is_nearer]
        step[some] = -_times(inverse[some], miss[some])

        # a first ray beside its branch has nowhere to go
        others = left[~is_nearer]
        step[others] *= 0.5
        left = left[np.isfinite(found.off[left]) & (found.off[left] > settled_px)]

    last = np.flatnonzero(found.off <= settled_px)
    found.view[last] += step[last]
    return found


def derivative(
    trace: Tracer, view: Floats, display: Floats, branch: NDArray[np.uint64]
) -> Steps[Floats]:
    """Display px per viewer px (n, 2, 2), columns x and y of the viewer, by rays beside places.

    0 where the rays beside them take other branches.

    trace : traces places, by their rows in the tables
    view, display, branch : (n, 2) viewer px, (n, 2) display px and (n,) of the places
    """
    found = np.zeros((len(view), 2, 2))
    for side in (1, -1):
        # both axes together
        lacks, axis = np.nonzero(~found.any(axis=1))
        if not len(lacks):
            break
        beside = view[lacks]
        beside[np.arange(len(lacks)), axis] += side * SETTLING.nearby
        traced = yield from trace(lacks, beside)
        known = traced.branch == branch[lacks]
        some = lacks[known]
        by_side = (traced.xy[known] - display[some]) / SETTLING.nearby
        found[some, :, axis[known]] = side * by_side
    return found


def inverse_of(matrices: Floats) -> Floats:
    """Inverses of matrices (n, 2, 2); 0 where there is none."""
    (a, b), (c, d) = np.moveaxis(matrices, 0, 2)
    det = a * d - b * c
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found = np.array([[d, -b], [-c, a]]) / det
    return np.where(np.isfinite(found), found, 0.0).transpose(2, 0, 1)


def _corrected(inverse: Floats, step: Floats, change: Floats) -> Floats:
    """Inverses (n, 2, 2) of derivatives, by which a change (n, 2) would have told the step (n, 2)
    that it came of.
    """
    told = _times(inverse, change)
    back = np.einsum("ni,nij->nj", step, inverse)
    along = np.einsum("ni,ni->n", step, told)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        more = (step - told)[:, :, None] * back[:, None, :] / along[:, None, None]
    return inverse + np.where(np.isfinite(more), more, 0.0)


def _times(matrices: Floats, vectors: Floats) -> Floats:
    """Products (n, 2) of matrices (n, 2, 2) and vectors (n, 2)."""
    return np.einsum("nij,nj->ni", matrices, vectors)


SLACK = 1e-9  # of a triangle, so that no point on an edge falls between two
ROWS_AT_ONCE = 1 << 18  # of triangles that are looked at together


class Candidates(NamedTuple):
    """Places of the viewer's image that show points of the display, as a view map has it.

    point : (n,) number in the grid
    view : (n, 2) viewer px
    view_by_display : (n, 2, 2) viewer px per display px, rows x and y of the viewer
    branch, path : (n,) uint64
    throughput : (n,)
    """

    point: Ints
    view: Floats
    view_by_display: Floats
    branch: NDArray[np.uint64]
    path: NDArray[np.uint64]
    throughput: Floats

    @classmethod
    def none(cls) -> "Candidates":
        """Not a single one."""
        paths, two = np.empty(0, np.uint64), np.empty((0, 2))
        return cls(np.empty(0, np.int64), two, np.empty((0, 2, 2)), paths, paths, two[:, 0])

    def at(self, which: NDArray) -> "Candidates":
        """Some of them, by their numbers."""
        return Candidates(*(take(values, which) for values in self))


def candidates(view_map: ViewMap, grid: Grid, rows: range) -> Iterator[Candidates]:
    """Where the pieces of a map show the points in some rows of a grid, some at a time.

    Samples of chaotic light are left out: between them there is no map.
    """
    for piece in view_map.pieces(sampled=False):
        n = piece.view.shape[1]
        for corners in ((0, 1, 2), (0, 2, 3))[: n - 2]:
            triangles = Piece(
                piece.view[:, corners],
                piece.display[:, corners],
                piece.throughput,
                piece.branch,
            )
            yield from _in_triangles(triangles, grid, rows)


def _in_triangles(triangles: Piece, grid: Grid, rows: range) -> Iterator[Candidates]:
    """The points in some rows of a grid that lie in triangles, row by row: boxes around slivers
    hold a hundred times as many.
    """
    steps = grid.steps_to(triangles.display)
    first = np.array([0, rows.start])
    last = np.array([grid.columns, rows.stop]) - 1
    low = np.clip(np.ceil(steps.min(axis=1) - SLACK), first, last + 1)
    high = np.clip(np.floor(steps.max(axis=1) + SLACK), first - 1, last)
    n_rows = np.where(low[:, 0] <= high[:, 0], np.maximum(high[:, 1] - low[:, 1] + 1, 0), 0)

    some = np.flatnonzero(n_rows)
    n_rows = n_rows[some].astype(np.int64)
    runs = np.cumsum(n_rows) // ROWS_AT_ONCE
    for number in np.unique(runs):
        which = runs == number
        batch = some[which]
        owner, k = ragged(n_rows[which])
        row = low[batch, 1].astype(np.int64)[owner] + k
        begin, end = _spans(steps[batch], owner, row)
        begin = np.maximum(np.ceil(begin - SLACK), low[batch, 0][owner]).astype(np.int64)
        end = np.minimum(np.floor(end + SLACK), high[batch, 0][owner]).astype(np.int64)
        span, k = ragged(np.maximum(end - begin + 1, 0))
        point = row[span] * grid.columns + begin[span] + k
        yield _within(triangles.at(batch), grid, owner[span], point)


def _spans(corners: Floats, owner: Ints, row: Ints) -> tuple[Floats, Floats]:
    """Where triangles (t, 3, 2) by their numbers (n,) begin and end in rows (n,), SLACK about them;
    infinite where an edge runs along its row.
    """
    begin = np.full(len(row), -np.inf)
    end = np.full(len(row), np.inf)
    (ax, ay), (bx, by), (cx, cy) = np.moveaxis(corners, 0, 2)
    twice = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    for (px, py), (qx, qy) in (((ax, ay), (bx, by)), ((bx, by), (cx, cy)), ((cx, cy), (ax, ay))):
        # inside of an edge is x * slope + rest + row * fall >= -SLACK
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            slope, fall = (py - qy) / twice, (qx - px) / twice
            rest = -(slope * px + fall * py)
            border = (-SLACK - rest[owner] - fall[owner] * row) / slope[owner]
        rises, falls = (slope > 0)[owner], (slope < 0)[owner]
        begin = np.where(rises, np.fmax(begin, border), begin)
        end = np.where(falls, np.fmin(end, border), end)
    return begin, end


def _within(triangles: Piece, grid: Grid, owner: Ints, number: Ints) -> Candidates:
    """The points of a grid, by their numbers (n,), that lie in their triangles, by theirs (n,)."""
    # the map of each triangle, and its inverse
    a = triangles.display[:, 1] - triangles.display[:, 0]
    b = triangles.display[:, 2] - triangles.display[:, 0]
    det = cross_2d(a, b)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        to_triangle = (
            np.stack(
                [np.stack([b[:, 1], -b[:, 0]], axis=1), np.stack([-a[:, 1], a[:, 0]], axis=1)],
                axis=1,
            )
            / det[:, None, None]
        )
        p = grid.at(number) - triangles.display[owner, 0]
        u, v = np.einsum("nij,nj->in", to_triangle[owner], p)
        inside = (u >= -SLACK) & (v >= -SLACK) & (u + v <= 1 + SLACK)

    u, v, owner, number = (values[inside] for values in (u, v, owner, number))
    sides = np.stack([triangles.view[:, k] - triangles.view[:, 0] for k in (1, 2)], axis=2)
    with np.errstate(invalid="ignore", over="ignore"):
        view_by_display = np.einsum("nij,njk->nik", sides, to_triangle)

    return Candidates(
        point=number,
        view=triangles.view[owner, 0]
        + u[:, None] * sides[owner, :, 0]
        + v[:, None] * sides[owner, :, 1],
        view_by_display=view_by_display[owner],
        branch=triangles.branch[owner],
        path=paths_of(triangles)[owner],
        throughput=triangles.throughput[owner],
    )


POINTS_AT_ONCE = 1 << 18  # of the grid: where light is chaotic a point has tens of candidates
HALF_PIXEL = 0.5**0.5  # display px, from its middle to its corner


@dataclass(frozen=True, eq=False)
class ViewPlaces:
    """For each point of a grid the place of the viewer's image that shows it.

    view : (n, 2) viewer px, NaN where the point's pixel is not seen
    view_by_display : (n, 2, 2) viewer px per display px
    path : (n,) uint64, the way that its light takes, NO_PATH where it is not known
    multiplicity : (n,) at how many places the very point is seen; 0 where only another part of its
        pixel is
    off : (n,) display px between the point and the place's landing, at most; inf where its pixel is
        not seen
    """

    view: Floats
    view_by_display: Floats
    path: NDArray[np.uint64]
    multiplicity: Ints
    off: Floats


def paths_shown(plan: Plan, view_map: ViewMap) -> Steps[NDArray[np.uint64]]:
    """The path (H * W,) that counts for each display pixel."""
    return strongest_paths(_shares(plan, view_map))


def _shares(plan: Plan, view_map: ViewMap) -> ShareBatches:
    return shares_of(view_map, plan.settings.brightness, view_map.pieces, has_path=True)


def view_from_display(
    plan: Plan, view_map: ViewMap, grid: Grid, strongest: NDArray[np.uint64] | None = None
) -> Generator[float, None, ViewPlaces]:
    """The places that show the points of a grid; yields progress 0..1.

    Only those on the path that counts are traced; of others the map says that they are there.

    strongest : as by `paths_shown`, if it is known
    """
    if strongest is None:
        strongest = yield from hold_progress(0.0, paths_shown(plan, view_map))
    wanted = strongest[grid.pixels(view_map.display_size)]

    found = ViewPlaces(
        view=np.full((len(grid), 2), np.nan),
        view_by_display=np.zeros((len(grid), 2, 2)),
        path=np.full(len(grid), NO_PATH),
        multiplicity=np.zeros(len(grid), np.int64),
        off=np.full(len(grid), np.inf),
    )
    # the very points, by the pieces of the map that show them; a fold may show one a hundred times
    for rows in grid.bands(POINTS_AT_ONCE):
        done = 0.8 * rows.start / grid.rows
        lots = [Candidates.none()]
        for some in candidates(view_map, grid, rows):
            lots.append(some)
            yield done
        lot = _each_once(Candidates(*map(np.concatenate, zip(*lots, strict=True))), view_map)
        found.multiplicity[:] += np.bincount(lot.point, minlength=len(grid))
        lot = lot.at(np.flatnonzero(lot.path == wanted[lot.point]))
        yield from hold_progress(done, _place(found, plan, view_map, grid, lot))

    # other parts of their pixels
    lacks = np.flatnonzero(np.isnan(found.view[:, 0]) & (wanted != NO_PATH))
    if len(lacks):
        shares = _shares(plan, view_map)
        largest = yield from hold_progress(0.85, _largest(shares, strongest, view_map.display_size))
        pixels = grid.pixels(view_map.display_size)[lacks]
        yield from hold_progress(
            0.9, _fill(found, plan, view_map, grid.at(lacks), lacks, largest[pixels])
        )
    return found


def _largest(
    shares: ShareBatches, strongest: NDArray[np.uint64], display_size: tuple[int, int]
) -> Steps[Floats]:
    """The middle (H * W, 2), viewer px, of the largest share of each pixel's strongest path."""
    width, height = display_size
    place = np.full((width * height, 2), np.nan)
    weight = np.zeros(width * height)

    for some in shares.pausing():
        yield 0
        if some is None:
            continue
        pixel = some.display_index
        counts = (some.path == strongest[pixel]) & (some.weight > weight[pixel])
        # of several of one pixel the last is kept
        order = np.flatnonzero(counts)
        order = order[np.argsort(some.weight[order], kind="stable")]
        weight[pixel[order]] = some.weight[order]
        place[pixel[order]] = some.view_xy[order]

    return place


def _each_once(lot: Candidates, view_map: ViewMap) -> Candidates:
    """Candidates, each place but once.

    A map knows its landings to its tolerance. Two places on one path, which has the same way round
    at both, are one where they are no farther apart than that.
    """
    reach = 2 * view_map.tolerance * np.abs(lot.view_by_display).sum(axis=2).max(axis=1)
    order = np.lexsort((lot.view[:, 0], lot.path, lot.point))
    point, path, view, reach = (
        take(values, order) for values in (lot.point, lot.path, lot.view, reach)
    )
    repeated = np.zeros(len(order), bool)
    for k in range(1, len(order)):
        same = np.flatnonzero((point[k:] == point[:-k]) & (path[k:] == path[:-k]))
        away = np.abs(view[same + k] - view[same])
        near = np.minimum(reach[same + k], reach[same])
        if not (away[:, 0] <= near).any():  # and so of none that is further on
            break
        repeated[same[away.max(axis=1) <= near] + k] = True
    return lot.at(order[~repeated])


def _place(
    found: ViewPlaces, plan: Plan, view_map: ViewMap, grid: Grid, lot: Candidates
) -> Steps[None]:
    """Set the places of points: of each the candidate that shows it largest, brought to the point.
    Light ends, or jumps, where the map knows only as well as its tolerance: where a candidate does
    not show its point, the next largest does.
    """
    (a, b), (c, d) = np.moveaxis(lot.view_by_display, 0, 2)
    size = np.abs(a * d - b * c)
    if plan.settings.brightness:
        size *= lot.throughput**2
    lot = lot.at(np.lexsort((size, lot.point)))

    while len(lot.point):
        is_largest = np.append(lot.point[1:] != lot.point[:-1], True)
        some, lot = lot.at(np.flatnonzero(is_largest)), lot.at(np.flatnonzero(~is_largest))
        points = grid.at(some.point)
        places = yield from settle(plan, points, some.view, some.view_by_display, some.branch)
        is_true = (places.off <= view_map.tolerance) & is_in_image(places.view, view_map.view_size)
        true = np.flatnonzero(is_true)
        number = some.point[true]
        found.view[number] = places.view[true]
        found.view_by_display[number] = some.view_by_display[true]
        found.path[number] = some.path[true]
        found.off[number] = places.off[true]
        found.multiplicity[some.point[~is_true]] -= 1
        lot = lot.at(np.flatnonzero(np.isnan(found.view[lot.point, 0])))


def _fill(
    found: ViewPlaces, plan: Plan, view_map: ViewMap, points: Floats, number: Ints, start: Floats
) -> Steps[None]:
    """Set the places of points (n, 2) by their numbers (n,) from shares in their pixels: the very
    points where the way leads there within the viewer's image, else the middles (n, 2) of the
    shares.
    """
    traced = yield from trace_points(plan, start)
    by_view = yield from derivative(tracer(plan), start, traced.xy, traced.branch)
    inverse = inverse_of(by_view)
    places = yield from settle(plan, points, start, inverse, traced.branch)
    is_there = (places.off <= view_map.tolerance) & (traced.branch != 0)
    is_there &= is_in_image(places.view, view_map.view_size)

    found.view[number] = np.where(is_there[:, None], places.view, start)
    found.view_by_display[number] = inverse
    # the way round that it shows the display is the sign of the derivative
    (a, b), (c, d) = np.moveaxis(inverse, 0, 2)
    found.path[number] = np.where(is_there, traced.branch ^ (a * d < b * c), NO_PATH)
    away = np.hypot(*(traced.xy - points).T)
    found.off[number] = np.where(
        is_there, places.off, np.where(traced.branch != 0, away, HALF_PIXEL)
    )
    found.multiplicity[number] = np.maximum(found.multiplicity[number], is_there)
