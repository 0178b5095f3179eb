"""Where branches meet: a pixel whose corners lie on several
branches is cut along the borders between them.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Floats, Ints, mean_at, taken
from ..light.landings import Words
from ..light.plan import Plan
from .bisection import cut_cells
from .points import Points, areas, in_triangles, is_seen, trace_points

# display px: an error that cannot get as small as this is left to the larger viewer that it takes
SMALL = 0.1
QUARTERINGS = 2  # of a pixel, at the most

# of the middles of a square's mixed pixels: where more lie
# on new branches its borders are not looked for
NEW = 0.25
FEW = 1  # pixels of a square that are in doubt: as where edges meet, which is no chaos
GAP = 1 / 16  # of a cell: less that its pieces leave out is not looked into
MANY = 4  # branches at five places of a cell: as good as at each its own
# display px between samples, the median of pixels in doubt: further apart they would leave gaps
APART = 1.25
# samples along a pixel's side for that median: less
# Effort is set to be faster, and never cuts instead
LEAST_ALONG = 4

# For the progress alone, by how often cells have been
# quartered; medians of the glasses of `dev.py glasses`.
RAYS_OF_EDGE = 11.5, 7.0, 4.0, 8.0  # that it takes to look for the border on an edge
NEIGHBOURS = 1.8  # cells that share an edge, on average
# all told, of a quarter or one of the triangles that are cut at the end
RAYS_OF_QUARTER = 5.6, 3.2, 0.6, 0.0
QUARTERS = 1.2, 0.95, 1.3  # of a cell, before anything is known of it
MIXED_AGAIN = 0.35  # of mixed cells, which are quartered, where the glass is not flat


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pixels cut in pieces: all points; indices of corners of whole
    pixels and quarters (q, 4), of other pieces (t, 3).

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

    A ray through the middle tells whether more goes on than the corners know. Where it takes
    another branch than the piece it lies in, or lands further than the tolerance from where it was
    expected, the pixel is quartered, and its quarters once more; of cells that are left then, or
    bent too much, four triangles around the middle are cut.

    Bisection has no end where light is chaotic. Not cut are all mixed pixels of a square (m,), by
    number, in which a good part of the middles lie on other branches than the corners; and, in one
    in which more than a few pixels are in doubt, those with more branches than can be told apart,
    those of which the pieces leave out a part, though all corners are lit, and all mixed quarters.

    `expect` is told about how many rays are still to come.
    """
    quads = []
    last = []
    chaotic = []
    triangles = []
    is_calm = np.ones(len(cells), bool)

    for depth in range(QUARTERINGS + 1):
        n_quarters = 0.0 if plan.is_flat else QUARTERS[depth] * len(cells)
        expect(
            len(cells)
            + _rays_to_come(points, cells, chaotic, depth, n_quarters, plan.settings.effort)
        )
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
        cells, number, branch, is_one, is_calm = (
            of[kept] for of in (cells, number, branch, is_one, is_calm)
        )

        one = np.flatnonzero(is_one)
        mixed = np.flatnonzero(~is_one)
        off = np.zeros(len(cells))
        off[one] = _missed_by_corners(plan, points, cells[one], middle.at(kept[one]))
        n_again = (off[one] > plan.settings.tolerance).sum() + (
            0.0 if plan.is_flat else MIXED_AGAIN
        ) * len(mixed)
        expect(_rays_to_come(points, cells, chaotic, depth, 4 * n_again, plan.settings.effort))

        points, pieces, owner = yield from cut_cells(plan, points, cells[mixed])
        off[mixed] = _missed_by_pieces(plan, points, pieces, owner, middle.at(kept[mixed]))
        again = off > plan.settings.tolerance
        n_met = _n_branches(points, np.column_stack([cells, number]))
        has_gaps = np.zeros(len(cells), bool)
        has_gaps[mixed] = _has_gaps(points, cells[mixed], pieces, owner)

        if depth == 0:
            # not cells that are only bent by more than the tolerance
            in_doubt = has_gaps | np.isinf(off)
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
            simple &= np.isinf(off) | (
                off < 4.0 ** (QUARTERINGS - depth) * max(SMALL, plan.settings.tolerance)
            )
        last.append(_around(cells[again & ~simple], number[again & ~simple]))
        points, cells = yield from _quartered(plan, points, cells[simple], number[simple])
        is_calm = np.tile(is_calm[simple], 4)

    last = np.concatenate(last)
    expect(_rays_to_come(points, last, chaotic, QUARTERINGS + 1, 0, plan.settings.effort))
    points, of_last = yield from _cut_last(plan, points, last)
    return Pieces(
        points,
        np.concatenate(quads),
        np.concatenate([*triangles, of_last]),
        np.concatenate(chaotic),
    )


def _cut_last(
    plan: Plan, points: Points, triangles: Ints
) -> Generator[int, None, tuple[Points, Ints]]:
    """Cut triangles (m, 3) that are not looked into any
    further: all points, and the lit pieces (t, 3).
    """
    branch = points.branch[triangles]
    is_one = (branch == branch[:, :1]).all(axis=1)
    points, pieces, _ = yield from cut_cells(plan, points, triangles[~is_one])
    return points, np.concatenate([triangles[is_one & (branch[:, 0] != 0)], pieces])


def _rays_to_come(
    points: Points, cells: Ints, chaotic: list[Ints], depth: int, n_quarters: float, effort: int
) -> float:
    """About how many rays it takes to find the borders in cells (m,
    k), then to cut so many quarters, and to sample.
    """
    branch = points.branch[cells]
    n_edges = (branch != np.roll(branch, -1, axis=1)).sum() / NEIGHBOURS
    sides = [points.view[corners[:, 1], 0] - points.view[corners[:, 0], 0] for corners in chaotic]
    n_samples = effort * sum((side**2).sum() for side in sides)
    return RAYS_OF_EDGE[depth] * n_edges + RAYS_OF_QUARTER[depth] * n_quarters + n_samples


def _is_dense(plan: Plan, points: Points, pixels: Ints) -> bool:
    """Would samples of pixels like these (m, 4), each on one
    branch, light all of the display, or leave gaps?
    """
    lit = pixels[points.branch[pixels[:, 0]] != 0]
    if not len(lit):
        return True
    across = np.linalg.norm(points.xy[lit[:, 0]] - points.xy[lit[:, 2]], axis=1) / 2**0.5
    return float(np.median(across)) <= APART * max(plan.settings.samples_along, LEAST_ALONG)


def _in_chaos(branch: Words, of_middle: Words, is_mixed: Bools, square: Ints) -> Bools:
    """Which mixed cells (m,) lie in squares (m,), by
    number, whose borders are not worth looking for?

    Their middles are on branches (m,) of which the corners (m,
    4) know nothing, as often as the borders are many.
    """
    is_new = is_mixed & (branch != of_middle[:, None]).all(axis=1)
    n_mixed, n_new = (np.bincount(square, some) for some in (is_mixed, is_new))
    return is_mixed & ((n_new > 1) & (n_new > NEW * n_mixed))[square]


def _has_gaps(points: Points, cells: Ints, pieces: Ints, owner: Ints) -> Bools:
    """Do the pieces (t, 3) of cells (m, 4) that own them (t,)
    leave out a part of one with all corners lit?
    """
    covered = np.bincount(owner, areas(points.view, pieces), len(cells))
    side = points.view[cells[:, 1], 0] - points.view[cells[:, 0], 0]
    return (points.branch[cells] != 0).all(axis=1) & (covered < (1 - GAP) * side**2)


def _missed_by_corners(plan: Plan, points: Points, cells: Ints, middle: Points) -> Floats:
    """By how much (m,), display px, the corners of cells (m, 4) on
    one branch each miss their middles, as `_missed`.
    """
    return _missed(plan, points.branch[cells[:, 0]], mean_at(points.xy, cells), middle)


def _missed_by_pieces(
    plan: Plan, points: Points, pieces: Ints, owner: Ints, middle: Points
) -> Floats:
    """By how much (m,), display px, pieces (t, 3) of cells that
    own them (t,) miss their middles, as `_missed`.

    A middle that no piece holds is expected to be dark.
    """
    branch = np.zeros(len(middle), np.uint64)
    xy = np.full((len(middle), 2), np.nan)
    holds, at = in_triangles(
        *(taken(of, pieces) for of in (points.view, points.xy)), taken(middle.view, owner)
    )
    branch[owner[holds]], xy[owner[holds]] = points.branch[pieces[holds, 0]], at[holds]
    return _missed(plan, branch, xy, middle)


def _missed(plan: Plan, branch: Words, xy: Floats, middle: Points) -> Floats:
    """By how much (m,), display px, middles miss the places xy
    (m, 2) where they are expected, on branches (m,).

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
    return np.concatenate(
        [np.stack([middle, cells[:, k], cells[:, (k + 1) % 4]], axis=1) for k in range(4)]
    )


def _quartered(
    plan: Plan, points: Points, cells: Ints, middle: Ints
) -> Generator[int, None, tuple[Points, Ints]]:
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
    quarters = [
        np.stack([cells[:, k], number[:, k], middle, number[:, k - 1]], axis=1) for k in range(4)
    ]
    # each begins at its corner of the whole: turned back, so that all begin at the upper left
    return points.and_more(found), np.concatenate(
        [np.roll(q, k, axis=1) for k, q in enumerate(quarters)]
    )
