"""Where branches meet: a pixel whose corners lie on several branches is cut along the borders between them."""

from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np

from .. import kernel
from ..arrays import Bools, Floats, Ints, mean_at, taken
from ..light.landings import Words
from ..light.plan import Plan
from ..light.trace import courses
from .points import CHUNK, Points, areas, in_triangles, is_seen, trace_points

LEAST_DIGITS = 9  # binary: a border is known to 2^-9 of a viewer pixel
OF_TOLERANCE = 0.1  # and, where that is less, to this part of the tolerance, in viewer pixels
SMALL = 0.1  # display px: an error that cannot get as small as this is left to the larger viewer that it takes
QUARTERINGS = 2  # of a pixel, at the most
MOST_DIGITS = 4  # that are found in one step
BATCH = 8192  # rays that numpy traces in not much more time than a few
KERNEL_BATCH = 512  # and the kernel

NEW = 0.25  # of the middles of a square's mixed pixels: where more lie on new branches its borders are not looked for
FEW = 1  # pixels of a square that are in doubt: as where edges meet, which is no chaos
GAP = 1 / 16  # of a cell: less that its pieces leave out is not looked into
MANY = 4  # branches at five places of a cell: as good as at each its own
APART = 1.25  # display px between samples, the median of pixels in doubt: further apart they would leave gaps
LEAST_ALONG = 4  # samples along a pixel's side for that median: less Effort is set to be faster, and never cuts instead

# For the progress alone, by how often cells have been quartered; medians of the glasses of `dev.py glasses`.
RAYS_OF_EDGE = 11.5, 7.0, 4.0, 8.0  # that it takes to look for the border on an edge
NEIGHBOURS = 1.8  # cells that share an edge, on average
RAYS_OF_QUARTER = 5.6, 3.2, 0.6, 0.0  # all told, of a quarter or one of the triangles that are cut at the end
QUARTERS = 1.2, 0.95, 1.3  # of a cell, before anything is known of it
MIXED_AGAIN = 0.35  # of mixed cells, which are quartered, where the glass is not flat


def _courses(plan: Plan, view: Floats) -> Generator[int, None, Words]:
    """Courses (n, m) of viewer points (n, 2); yields the number of rays after each chunk of them."""
    parts = []
    for first in range(0, len(view), CHUNK):
        parts.append((yield from courses(plan, *plan.rig.viewer.rays(view[first : first + CHUNK]))))
        yield len(parts[-1])
    width = max((part.shape[1] for part in parts), default=1)
    return np.concatenate(
        [np.pad(part, ((0, 0), (0, width - part.shape[1]))) for part in parts] or [np.empty((0, 1), np.uint64)]
    )


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pixels cut in pieces: all points; indices of corners of whole pixels and quarters (q, 4), of other pieces (t, 3).

    chaotic (c, 4) : cells that are not cut, because light is chaotic there
    """

    points: Points
    quads: Ints
    triangles: Ints
    chaotic: Ints


def cut(
    plan: Plan, points: Points, cells: Ints, square: Ints, expect: Callable[[float], None]
) -> Generator[int, None, Pieces]:
    """Cut pixels (m, 4) whose corners lie on several branches along the borders between them.

    A ray through the middle tells whether more goes on than the corners know. Where it takes another branch than the
    piece it lies in, or lands further than the tolerance from where it was expected, the pixel is quartered, and its
    quarters once more; of cells that are left then, or bent too much, four triangles around the middle are cut.

    Bisection has no end where light is chaotic. Not cut are all mixed pixels of a square (m,), by number, in which a
    good part of the middles lie on other branches than the corners; and, in one in which more than a few pixels are
    in doubt, those with more branches than can be told apart, those of which the pieces leave out a part, though all
    corners are lit, and all mixed quarters.

    `expect` is told about how many rays are still to come.
    """
    quads, last, chaotic, triangles = [], [], [], []
    is_calm = np.ones(len(cells), bool)

    for depth in range(QUARTERINGS + 1):
        n_quarters = 0.0 if plan.is_flat else QUARTERS[depth] * len(cells)
        expect(len(cells) + _rays_to_come(points, cells, chaotic, depth, n_quarters, plan.settings.effort))
        middle = yield from trace_points(plan, mean_at(points.view, cells))
        number = len(points) + np.arange(len(cells))
        points = points.and_more(middle)
        branch = points.branch[cells]
        is_one = (branch == branch[:, :1]).all(axis=1)

        if depth == 0:
            is_dense = _is_dense(plan, points, cells[is_one])
            is_given_up = is_dense & _in_chaos(branch, middle.branch, ~is_one, square)
        else:
            is_given_up = ~is_one & ~is_calm
        chaotic.append(cells[is_given_up])
        kept = np.flatnonzero(~is_given_up)
        cells, number, branch, is_one, is_calm = (of[kept] for of in (cells, number, branch, is_one, is_calm))

        one, mixed = np.flatnonzero(is_one), np.flatnonzero(~is_one)
        off = np.zeros(len(cells))
        off[one] = _missed_by_corners(plan, points, cells[one], middle.at(kept[one]))
        n_again = (off[one] > plan.settings.tolerance).sum() + (0.0 if plan.is_flat else MIXED_AGAIN) * len(mixed)
        expect(_rays_to_come(points, cells, chaotic, depth, 4 * n_again, plan.settings.effort))

        points, pieces, owner = yield from _cut(plan, points, cells[mixed])
        off[mixed] = _missed_by_pieces(plan, points, pieces, owner, middle.at(kept[mixed]))
        again = off > plan.settings.tolerance
        n_met = _n_branches(points, np.column_stack([cells, number]))
        has_gaps = np.zeros(len(cells), bool)
        has_gaps[mixed] = _has_gaps(points, cells[mixed], pieces, owner)

        if depth == 0:
            in_doubt = has_gaps | np.isinf(off)  # not cells that are only bent by more than the tolerance
            n_in_doubt = np.bincount(square[kept], in_doubt)
            is_calm = (n_in_doubt <= FEW)[square[kept]] | (not is_dense)
        is_tangled = np.isinf(off) & ((n_met >= MANY) | (depth == QUARTERINGS)) | has_gaps
        is_tangled &= ~is_calm
        chaotic.append(cells[is_tangled])

        quads.append(cells[is_one & (branch[:, 0] != 0) & ~again])
        triangles.append(pieces[~(again | is_tangled)[mixed[owner]]])

        again &= ~is_tangled
        # quarters of quarters are of no use where the error is too large to get small
        simple = again & (n_met < MANY) & (depth < QUARTERINGS)
        if depth > 0:
            simple &= np.isinf(off) | (off < 4.0 ** (QUARTERINGS - depth) * max(SMALL, plan.settings.tolerance))
        last.append(_around(cells[again & ~simple], number[again & ~simple]))
        points, cells = yield from _quartered(plan, points, cells[simple], number[simple])
        is_calm = np.tile(is_calm[simple], 4)

    last = np.concatenate(last)
    expect(_rays_to_come(points, last, chaotic, QUARTERINGS + 1, 0, plan.settings.effort))
    points, of_last = yield from _cut_last(plan, points, last)
    return Pieces(points, np.concatenate(quads), np.concatenate([*triangles, of_last]), np.concatenate(chaotic))


def _cut_last(plan: Plan, points: Points, triangles: Ints) -> Generator[int, None, tuple[Points, Ints]]:
    """Cut triangles (m, 3) that are not looked into any further: all points, and the lit pieces (t, 3)."""
    branch = points.branch[triangles]
    is_one = (branch == branch[:, :1]).all(axis=1)
    points, pieces, _ = yield from _cut(plan, points, triangles[~is_one])
    return points, np.concatenate([triangles[is_one & (branch[:, 0] != 0)], pieces])


def _rays_to_come(
    points: Points, cells: Ints, chaotic: list[Ints], depth: int, n_quarters: float, effort: int
) -> float:
    """About how many rays it takes to find the borders in cells (m, k), then to cut so many quarters, and to sample."""
    branch = points.branch[cells]
    n_edges = (branch != np.roll(branch, -1, axis=1)).sum() / NEIGHBOURS
    sides = [points.view[corners[:, 1], 0] - points.view[corners[:, 0], 0] for corners in chaotic]
    n_samples = effort * sum((side**2).sum() for side in sides)
    return RAYS_OF_EDGE[depth] * n_edges + RAYS_OF_QUARTER[depth] * n_quarters + n_samples


def _is_dense(plan: Plan, points: Points, pixels: Ints) -> bool:
    """Would samples of pixels like these (m, 4), each on one branch, light all of the display, or leave gaps?"""
    lit = pixels[points.branch[pixels[:, 0]] != 0]
    if not len(lit):
        return True
    across = np.linalg.norm(points.xy[lit[:, 0]] - points.xy[lit[:, 2]], axis=1) / 2**0.5
    return float(np.median(across)) <= APART * max(plan.settings.samples_along, LEAST_ALONG)


def _in_chaos(branch: Words, of_middle: Words, is_mixed: Bools, square: Ints) -> Bools:
    """Which mixed cells (m,) lie in squares (m,), by number, whose borders are not worth looking for?

    Their middles are on branches (m,) of which the corners (m, 4) know nothing, as often as the borders are many.
    """
    is_new = is_mixed & (branch != of_middle[:, None]).all(axis=1)
    n_mixed, n_new = (np.bincount(square, some) for some in (is_mixed, is_new))
    return is_mixed & ((n_new > 1) & (n_new > NEW * n_mixed))[square]


def _has_gaps(points: Points, cells: Ints, pieces: Ints, owner: Ints) -> Bools:
    """Do the pieces (t, 3) of cells (m, 4) that own them (t,) leave out a part of one with all corners lit?"""
    covered = np.bincount(owner, areas(points.view, pieces), len(cells))
    side = points.view[cells[:, 1], 0] - points.view[cells[:, 0], 0]
    return (points.branch[cells] != 0).all(axis=1) & (covered < (1 - GAP) * side**2)


def _missed_by_corners(plan: Plan, points: Points, cells: Ints, middle: Points) -> Floats:
    """By how much (m,), display px, the corners of cells (m, 4) on one branch each miss their middles, as `_missed`."""
    return _missed(plan, points.branch[cells[:, 0]], mean_at(points.xy, cells), middle)


def _missed_by_pieces(plan: Plan, points: Points, pieces: Ints, owner: Ints, middle: Points) -> Floats:
    """By how much (m,), display px, pieces (t, 3) of cells that own them (t,) miss their middles, as `_missed`.

    A middle that no piece holds is expected to be dark.
    """
    branch, xy = np.zeros(len(middle), np.uint64), np.full((len(middle), 2), np.nan)
    holds, at = in_triangles(*(taken(of, pieces) for of in (points.view, points.xy)), taken(middle.view, owner))
    branch[owner[holds]], xy[owner[holds]] = points.branch[pieces[holds, 0]], at[holds]
    return _missed(plan, branch, xy, middle)


def _missed(plan: Plan, branch: Words, xy: Floats, middle: Points) -> Floats:
    """By how much (m,), display px, middles miss the places xy (m, 2) where they are expected, on branches (m,).

    inf on another branch, 0 beside the display.
    """
    seen = is_seen(xy, middle.xy, (plan.rig.display.width, plan.rig.display.height))
    off = np.where(seen, np.nan_to_num(np.linalg.norm(xy - middle.xy, axis=1)), 0.0)
    return np.where(branch == middle.branch, off, np.inf)


def _n_branches(points: Points, cells: Ints) -> Ints:
    """On how many different branches (m,), none being one, do points (m, k) lie?"""
    branch = np.sort(points.branch[cells], axis=1)
    return 1 + (branch[:, 1:] != branch[:, :-1]).sum(axis=1)


def _around(cells: Ints, middle: Ints) -> Ints:
    """Four triangles (4 m, 3) around the middle of each cell (m, 4)."""
    return np.concatenate([np.stack([middle, cells[:, k], cells[:, (k + 1) % 4]], axis=1) for k in range(4)])


def _quartered(plan: Plan, points: Points, cells: Ints, middle: Ints) -> Generator[int, None, tuple[Points, Ints]]:
    """The quarters (4 m, 4) of square cells (m, 4), given their middles; and all points."""
    if not len(cells):
        return points, cells
    view = taken(points.view, cells)
    halfway = (view + np.roll(view, -1, axis=1)) / 2
    # they lie on a grid so fine: whole numbers are told apart faster than places
    column, row = np.moveaxis(2**QUARTERINGS * halfway, 2, 0).astype(np.int64)
    _, first, number = np.unique(row << 32 | column, return_index=True, return_inverse=True)
    found = yield from trace_points(plan, taken(halfway.reshape(-1, 2), first))
    number = len(points) + number.reshape(cells.shape)
    quarters = [np.stack([cells[:, k], number[:, k], middle, number[:, k - 1]], axis=1) for k in range(4)]
    # each begins at its corner of the whole: turned back, so that all begin at the upper left
    return points.and_more(found), np.concatenate([np.roll(q, k, axis=1) for k, q in enumerate(quarters)])


def _cut(plan: Plan, points: Points, cells: Ints) -> Generator[int, None, tuple[Points, Ints, Ints]]:
    """Cut cells (m, k) with k corners; returns all points, triangles (t, 3) and the cells (t,) they are pieces of.

    A cell's outline has 3 k places: each corner, then for the edge that follows it the last point on the
    corner's own branch and the first on the next corner's. The places on one branch, in order, are a convex piece.
    """
    (m, k), n = cells.shape, len(points)
    if not m:
        return points, np.empty((0, 3), np.int64), np.empty(0, np.int64)
    cells = cells.astype(np.int64)
    branch = points.branch[cells]
    following = np.roll(cells, -1, axis=1)
    differs = branch != np.roll(branch, -1, axis=1)
    # each border is looked for once, from each of its two sides that has a landing
    sides = np.concatenate([
        np.stack([cells, following], axis=2)[differs & (branch != 0)],
        np.stack([following, cells], axis=2)[differs & (np.roll(branch, -1, axis=1) != 0)],
    ])  # fmt: skip
    key, inverse = np.unique(sides[:, 0] * n + sides[:, 1], return_inverse=True)
    border = yield from _both_ways(plan, points, key // n, key % n)
    # places: 0 where there is none, else 1 + index of the point
    places = np.zeros((m, k, 3), np.int64)
    places[:, :, 0] = np.where(branch != 0, cells + 1, 0)
    n_from_corner = int((differs & (branch != 0)).sum())
    number = inverse.ravel() + n + 1
    places[:, :, 1][differs & (branch != 0)] = number[:n_from_corner]
    places[:, :, 2][differs & (np.roll(branch, -1, axis=1) != 0)] = number[n_from_corner:]
    group = yield from _groups(plan, points, cells)
    place_group = np.stack([group, group, np.roll(group, -1, axis=1)], axis=2).reshape(m, 3 * k)
    places = places.reshape(m, 3 * k)
    # a leader that leads no corner gives no piece
    pieces = [_fans(places, (places > 0) & (place_group == leader)) for leader in range(k)]
    triangles, owner = (np.concatenate(column) for column in zip(*pieces, strict=True))
    return points.and_more(border), triangles - 1, owner


def _fans(places: Ints, is_member: np.ndarray) -> tuple[Ints, Ints]:
    """Triangles (t, 3) of convex polygons, whose corners are the members of each row in order, and the rows (t,)."""
    members = places[is_member]
    n_corners = is_member.sum(axis=1)
    first = np.cumsum(n_corners) - n_corners
    fans, rows = [], []
    for k in range(1, places.shape[1] - 1):
        row = np.flatnonzero(n_corners > k + 1)
        fans.append(members[first[row, None] + np.array([0, k, k + 1])])
        rows.append(row)
    return np.concatenate(fans), np.concatenate(rows)


def _groups(plan: Plan, points: Points, cells: Ints) -> Generator[int, None, Ints]:
    """For each corner (m, k) the first corner whose piece it belongs to; -1 without a landing.

    Opposite corners on one branch between two that are not belong together only when the middle is on it too.
    """
    branch = points.branch[cells]
    same = branch[:, :, None] == branch[:, None, :]
    k = cells.shape[1]
    if k == 4:
        corner = np.arange(k)
        opposite = np.abs(corner[:, None] - corner) == 2
        beside = same & ~opposite & ~np.eye(k, dtype=bool)
        alone = ~beside.any(axis=2)
        saddle = ((same & opposite).any(axis=2) & alone & (branch != 0)).any(axis=1)
        if saddle.any():
            middle = yield from trace_points(plan, points.view[cells[saddle]].mean(axis=1))
            holds = middle.branch[:, None] == branch[saddle]
            split = alone[saddle] & ~holds
            same[saddle] &= ~(opposite[None] & split[:, :, None])
    return np.where(branch != 0, same.argmax(axis=2), -1)


def _both_ways(plan: Plan, points: Points, near: Ints, far: Ints) -> Generator[int, None, Points]:
    """Last points (n,) on the branch of points `near` (n,) towards points `far`, sorted by near, then far.

    Where both have a landing the other's branch most often begins where the one's ends: it is looked for there first.
    """
    n = len(points)
    key, back = near * n + far, far * n + near
    at = np.minimum(np.searchsorted(key, back), len(key) - 1)
    is_second = (key[at] == back) & (near > far)
    first, second = np.flatnonzero(~is_second), np.flatnonzero(is_second)
    place, found = yield from _last_on_branch(plan, points, near[first], far[first], np.ones(len(first)))
    if not len(second):
        return found
    rank = np.empty(len(key), np.int64)
    rank[first] = np.arange(len(first))
    end = np.minimum(1 - place[rank[at[second]]], 1.0)
    _, others = yield from _last_on_branch(plan, points, near[second], far[second], end)
    order = np.argsort(np.concatenate([first, second]))
    return found.and_more(others).at(order)


def _last_on_branch(
    plan: Plan, points: Points, near: Ints, far: Ints, end: Floats
) -> Generator[int, None, tuple[Floats, Points]]:
    """Last points (n,) on the branch of points `near` towards points `far`, by bisection in several parts.

    They are looked for up to `end` (n,), 0..1 of the way, where the point itself is tried first unless it is `far`.
    Returned before the points is where (n,) the branch has ended.
    """
    xy, throughput = taken(points.xy, near), points.throughput[near]
    a, b = taken(points.view, near), taken(points.view, far)
    low, width = np.zeros(len(near)), end.copy()
    course = yield from _courses(plan, a)
    todo = np.arange(len(near))
    digits = max(LEAST_DIGITS, int(np.ceil(-np.log2(OF_TOLERANCE * plan.settings.tolerance))))
    # where several borders cross one way the kernel and numpy may thus find different ones
    batch = BATCH if kernel.left_out(plan.layers) else KERNEL_BATCH
    parts = 1
    while len(todo):
        # the first time the end alone is tried; then several places at once, the more the fewer borders there are: a
        # batch of rays costs as much as hundreds of its rays
        steps = np.arange(1, parts)[:, None] / parts if parts > 1 else np.ones((1, 1))
        at = low[todo] + width[todo] * steps
        view = (a[todo] + at[..., None] * (b - a)[todo]).reshape(-1, 2)
        if parts > 1 or (end < 1).any():
            found = yield from trace_points(plan, view, np.tile(course[todo], (len(steps), 1)))
            holds = found.branch.reshape(at.shape) == points.branch[near[todo]]
            n_held = np.logical_and.accumulate(holds).sum(axis=0)
            held = np.flatnonzero(n_held)
            last = (n_held[held] - 1) * len(todo) + held
            xy[todo[held]], throughput[todo[held]] = found.xy[last], found.throughput[last]
            width[todo] /= parts
            low[todo] += width[todo] * n_held
            if parts == 1:
                width[todo[held]] = 0.0
        todo = todo[width[todo] > 2.0**-digits]
        left = digits + np.ceil(np.log2(width[todo].max(initial=2.0**-digits)))
        parts = 2 ** int(np.clip(np.log2(batch / max(len(todo), 1)), 1, max(1, min(left, MOST_DIGITS))))
    landed = Points(a + low[:, None] * (b - a), xy, points.branch[near], points.reason[near], throughput)
    return low + width, landed
