"""The inverse view map: the viewer px that show each point of the display.

A point may be seen at several positions, on several sheets of the map. The path that shows most of
the display pixel counts, and on it the position with the largest image of the point. A source
image that resolves ghosts by the strongest path shows the same.

If a pixel's middle is not seen on this path but another part of the pixel is, the position is the
middle of the part's largest share. No border pixel is lost.

Candidates are the triangles of the map's pieces around a point; a quad is two triangles. A point
on an edge may be found in both triangles.
"""

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Floats, Ints, take
from ...base.errors import RigError
from ...base.steps import Steps, hold_progress
from ...base.vectors import cross_2d
from ...image.ghosts import NO_PATH, paths_of, strongest_paths
from ...light.plan import Plan
from ...map.pieces import Piece
from ...map.points import Tracer, is_in_image, trace_points, tracer
from ...map.rasterise import ragged
from ...map.shares import ShareBatches
from ...map.view_map import ViewMap
from ...rig.rig import Rig
from ...solve.channel import shares_of


@dataclass(frozen=True)
class Grid:
    """Points in rows and columns, numbered row by row from the upper left.

    first : (x, y) display px, of the first point
    step : (x, y) display px, from one point to the next
    """

    first: tuple[float, float]
    step: tuple[float, float]
    columns: int
    rows: int

    def __len__(self) -> int:
        return self.columns * self.rows

    def at(self, number: Ints) -> Floats:
        """Points (n, 2), display px, from their numbers (n,)."""
        place = np.stack([number % self.columns, number // self.columns], axis=1)
        return np.array(self.first) + place * np.array(self.step)

    def bands(self, n_points: int) -> Iterator[range]:
        """Ranges of rows, about `n_points` points each."""
        n_rows = max(1, n_points // self.columns)
        for row in range(0, self.rows, n_rows):
            yield range(row, min(row + n_rows, self.rows))

    def steps_to(self, xy: Floats) -> Floats:
        """Fractional columns and rows (..., 2) of display px (..., 2)."""
        return (xy - np.array(self.first)) / np.array(self.step)

    def pixels(self, display_size: tuple[int, int]) -> Ints:
        """The display pixel (n,) of each point, row * width + column. On an edge it is the next
        pixel.
        """
        width = display_size[0]
        x, y = (
            np.clip(first + step * np.arange(n), 0, size - 1).astype(np.int64)
            for first, step, n, size in zip(
                self.first, self.step, (self.columns, self.rows), display_size, strict=True
            )
        )
        return (y[:, None] * width + x).ravel()


def refuse_views(rig: Rig) -> None:
    """Raise RigError if the display has views: a map has one place for each of its pixels."""
    if rig.display.views is not None:
        raise RigError(
            "A map has one place for each pixel, but '{display}' shows another image in each"
            " direction: export the quilt, or turn its Views off.",
            display=rig.display.name,
        )


def middles(display_size: tuple[int, int], times: int = 1) -> Grid:
    """Middles of a display's pixels, each divided into `times` x `times`."""
    width, height = display_size
    return Grid((0.5 / times,) * 2, (1 / times,) * 2, width * times, height * times)


def nodes(display_size: tuple[int, int], step: float) -> Grid:
    """Corners of a mesh over a whole display, about `step` px apart."""
    columns, rows = (max(1, round(n / step)) for n in display_size)
    width, height = display_size
    return Grid((0.0, 0.0), (width / columns, height / rows), columns + 1, rows + 1)


@dataclass(frozen=True)
class Settling:
    """When a position is accurate enough. Values are from the ball, where the median is two rays.

    settled : distance of the landing from the point, as a fraction of the tolerance. One further
        step without a ray about squares the error.
    most_rays : per position
    nearby : viewer px, step of the finite differences outside pieces
    """

    settled: float = 0.01
    most_rays: int = 10
    nearby: float = 1e-3


SETTLING = Settling()


@dataclass(eq=False)
class Places:
    """Positions in the viewer's image, each for a point of the display.

    view : (n, 2) viewer px, the best so far
    off : (n,) display px from its landing to the point; inf if it is not on the branch
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
    """Move positions until they land on their points (Broyden's method). Yields numbers of rays.

    Parameters
    ----------
    points : (n, 2) display px
    view : (n, 2) viewer px, initial positions
    view_by_display : (n, 2, 2) approximate inverse of the map's derivative
    branch : (n,) required branch
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

        # Broyden's update
        some = left[is_nearer]
        is_second = np.isfinite(found.off[some])
        usable = some[is_second]
        inverse[usable] = _corrected(
            inverse[usable], step[usable], new_miss[is_nearer][is_second] - miss[usable]
        )
        found.view[some] = tried[is_nearer]
        found.off[some] = off[is_nearer]
        miss[some] = new_miss[is_nearer]
        step[some] = -_times(inverse[some], miss[some])

        # a first ray off its branch has no direction to go and is dropped below
        others = left[~is_nearer]
        step[others] *= 0.5
        left = left[np.isfinite(found.off[left]) & (found.off[left] > settled_px)]

    last = np.flatnonzero(found.off <= settled_px)
    found.view[last] += step[last]
    return found


def derivative(
    trace: Tracer, view: Floats, display: Floats, branch: NDArray[np.uint64]
) -> Steps[Floats]:
    """Display px per viewer px (n, 2, 2), columns x and y of the viewer, by finite differences.

    0 if the rays on both sides take other branches.

    trace : traces viewer px, by row numbers of the arrays
    view, display, branch : (n, 2) viewer px, (n, 2) display px and (n,)
    """
    found = np.zeros((len(view), 2, 2))
    for side in (1, -1):
        # both axes in one batch of rays
        unset, axis = np.nonzero(~found.any(axis=1))
        if not len(unset):
            break
        probes = view[unset]
        probes[np.arange(len(unset)), axis] += side * SETTLING.nearby
        traced = yield from trace(unset, probes)
        usable = traced.branch == branch[unset]
        some = unset[usable]
        by_side = (traced.xy[usable] - display[some]) / SETTLING.nearby
        found[some, :, axis[usable]] = side * by_side
    return found


def inverse_of(matrices: Floats) -> Floats:
    """Inverses of matrices (n, 2, 2); 0 for singular ones."""
    (a, b), (c, d) = np.moveaxis(matrices, 0, 2)
    det = a * d - b * c
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found = np.array([[d, -b], [-c, a]]) / det
    return np.where(np.isfinite(found), found, 0.0).transpose(2, 0, 1)


def _corrected(inverse: Floats, step: Floats, change: Floats) -> Floats:
    """Broyden's update of inverse derivatives (n, 2, 2), from a step (n, 2) and the resulting
    change (n, 2).
    """
    predicted = _times(inverse, change)
    back = np.einsum("ni,nij->nj", step, inverse)
    along = np.einsum("ni,ni->n", step, predicted)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        more = (step - predicted)[:, :, None] * back[:, None, :] / along[:, None, None]
    return inverse + np.where(np.isfinite(more), more, 0.0)


def _times(matrices: Floats, vectors: Floats) -> Floats:
    """Products (n, 2) of matrices (n, 2, 2) and vectors (n, 2)."""
    return np.einsum("nij,nj->ni", matrices, vectors)


SLACK = 1e-9  # in barycentric coordinates, so no point falls between two triangles
ROWS_AT_ONCE = 1 << 18  # of triangles, in one batch


class Candidates(NamedTuple):
    """Positions in the viewer's image for points of the display, interpolated from a view map.

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
        """An empty table."""
        paths, two = np.empty(0, np.uint64), np.empty((0, 2))
        return cls(np.empty(0, np.int64), two, np.empty((0, 2, 2)), paths, paths, two[:, 0])

    def at(self, which: NDArray) -> "Candidates":
        """The selected rows."""
        return Candidates(*(take(values, which) for values in self))


def candidates(view_map: ViewMap, grid: Grid, rows: range) -> Iterator[Candidates]:
    """Candidates for the points in some rows of a grid, in batches.

    Samples of chaotic light are excluded: there is no map between them.
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
    """Candidates from triangles, in some rows of a grid. Rows are scanned one by one, because the
    bounding boxes of slivers have a hundred times as many points.
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
    """First and last columns of triangles (t, 3, 2), by triangle numbers (n,), in rows (n,), with
    SLACK around them; infinite for an edge along its row.
    """
    begin = np.full(len(row), -np.inf)
    end = np.full(len(row), np.inf)
    (ax, ay), (bx, by), (cx, cy) = np.moveaxis(corners, 0, 2)
    twice = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    for (px, py), (qx, qy) in (((ax, ay), (bx, by)), ((bx, by), (cx, cy)), ((cx, cy), (ax, ay))):
        # a point is inside of an edge if x * slope + rest + row * fall >= -SLACK
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            slope, fall = (py - qy) / twice, (qx - px) / twice
            rest = -(slope * px + fall * py)
            border = (-SLACK - rest[owner] - fall[owner] * row) / slope[owner]
        rises, falls = (slope > 0)[owner], (slope < 0)[owner]
        begin = np.where(rises, np.fmax(begin, border), begin)
        end = np.where(falls, np.fmin(end, border), end)
    return begin, end


def _within(triangles: Piece, grid: Grid, owner: Ints, number: Ints) -> Candidates:
    """Candidates for pairs of a triangle `owner` (n,) and a grid point `number` (n,), if the
    triangle contains the point.
    """
    # the inverse map of each triangle
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


POINTS_AT_ONCE = 1 << 18  # of the grid: a point in chaotic light has tens of candidates
HALF_PIXEL = 0.5**0.5  # display px, from a pixel's middle to its corner


@dataclass(frozen=True, eq=False)
class ViewPlaces:
    """The position in the viewer's image for each point of a grid.

    view : (n, 2) viewer px, NaN if the point's pixel is not seen
    view_by_display : (n, 2, 2) viewer px per display px
    path : (n,) uint64, NO_PATH if unknown
    multiplicity : (n,) number of positions that show the point itself; 0 if only another part of
        its pixel is seen
    off : (n,) display px, bound on the distance from the landing to the point; inf if the pixel is
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
    """The viewer px that show the points of a grid. Yields progress 0..1.

    Only candidates on the path that counts are traced; the others add to the multiplicity.

    strongest : result of `paths_shown`, computed if None
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
    # the points themselves; a fold may show one a hundred times
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
    unset = np.flatnonzero(np.isnan(found.view[:, 0]) & (wanted != NO_PATH))
    if len(unset):
        shares = _shares(plan, view_map)
        largest = yield from hold_progress(0.85, _largest(shares, strongest, view_map.display_size))
        pixels = grid.pixels(view_map.display_size)[unset]
        yield from hold_progress(
            0.9, _fill(found, plan, view_map, grid.at(unset), unset, largest[pixels])
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
        # for a repeated pixel the last assignment remains
        order = np.flatnonzero(counts)
        order = order[np.argsort(some.weight[order], kind="stable")]
        weight[pixel[order]] = some.weight[order]
        place[pixel[order]] = some.view_xy[order]

    return place


def _each_once(lot: Candidates, view_map: ViewMap) -> Candidates:
    """Candidates without duplicates.

    The map's landings are accurate to its tolerance. Two candidates of a point on one path, which
    includes the orientation, are duplicates if they are no farther apart than the tolerance.
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
        if not (away[:, 0] <= near).any():  # then no pair further apart in this order is closer
            break
        repeated[same[away.max(axis=1) <= near] + k] = True
    return lot.at(order[~repeated])


def _place(
    found: ViewPlaces, plan: Plan, view_map: ViewMap, grid: Grid, lot: Candidates
) -> Steps[None]:
    """Set the position of each point from its candidate with the largest image, after `settle`.

    The map places the end of a light path, or a jump, only within its tolerance. If a candidate
    does not reach its point, the next largest is used.
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
    """Set positions of points (n, 2), by numbers (n,), from the middles `start` (n, 2) of shares in
    their pixels. `settle` may reach the point itself within the viewer's image; otherwise the
    middle is used.
    """
    traced = yield from trace_points(plan, start)
    by_view = yield from derivative(tracer(plan), start, traced.xy, traced.branch)
    inverse = inverse_of(by_view)
    places = yield from settle(plan, points, start, inverse, traced.branch)
    is_there = (places.off <= view_map.tolerance) & (traced.branch != 0)
    is_there &= is_in_image(places.view, view_map.view_size)

    found.view[number] = np.where(is_there[:, None], places.view, start)
    found.view_by_display[number] = inverse
    # the derivative's sign is the orientation of the display's image
    (a, b), (c, d) = np.moveaxis(inverse, 0, 2)
    found.path[number] = np.where(is_there, traced.branch ^ (a * d < b * c), NO_PATH)
    away = np.hypot(*(traced.xy - points).T)
    found.off[number] = np.where(
        is_there, places.off, np.where(traced.branch != 0, away, HALF_PIXEL)
    )
    found.multiplicity[number] = np.maximum(found.multiplicity[number], is_there)
