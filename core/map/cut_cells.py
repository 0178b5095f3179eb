"""Cutting of cells into pieces, along borders found on their edges."""

from collections.abc import Generator
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Ints
from ..light.plan import Plan
from .borders import exceed_budget, find_borders
from .points import Points
from .ray_budget import RayBudget


class Cut(NamedTuple):
    """Pieces of cells (m,), and all points.

    pieces, owner : triangles (t, 3), and their cells (t,)
    is_over_budget : (m,) cells not cut
    """

    points: Points
    pieces: Ints
    owner: Ints
    is_over_budget: Bools


def cut_cells(
    plan: Plan, points: Points, cells: Ints, budget: RayBudget, middle: Ints | None = None
) -> Generator[int, None, Cut]:
    """Cut cells (m, k) with corners on several branches, within the ray budget.

    Cells with four corners have middles (m,), traced points.
    """
    cells = cells.astype(np.int64)
    key, of_cell = _sides(points, cells)
    yield 0
    is_over_budget = np.zeros(len(cells), bool)
    if not len(cells):
        return Cut(points, np.empty((0, 3), np.int64), np.empty(0, np.int64), is_over_budget)

    # each border is searched once from each of its two sides with a landing
    new, number = np.unique(key, return_inverse=True)
    yield 0
    is_over_budget[of_cell[exceed_budget(points, *_points_of(new), budget)[number]]] = True
    yield 0

    is_wanted = np.zeros(len(new), bool)
    is_wanted[number[~is_over_budget[of_cell]]] = True
    new = new[is_wanted]
    yield 0
    border = yield from find_borders(plan, points, *_points_of(new), budget)
    first = len(points)
    yield 0
    points = points.and_more(border)
    yield 0

    some = np.flatnonzero(~is_over_budget)
    pieces, owner = yield from _cut(
        points, cells[some], new, first, None if middle is None else middle[some]
    )
    return Cut(points, pieces, some[owner], is_over_budget)


def around_middles(cells: Ints) -> Ints:
    """Four triangles (4 m, 3) around the middle of each cell (m, 5), which follows its corners."""
    return np.concatenate([cells[:, [4, k, (k + 1) % 4]] for k in range(4)])


def _key_of(near: Ints, far: Ints) -> Ints:
    """Key of an edge between points, from their numbers."""
    return near << 32 | far


def _points_of(key: Ints) -> tuple[Ints, Ints]:
    """Near and far points of edges with such keys."""
    return key >> 32, key & 0xFFFFFFFF


def _sides(points: Points, cells: Ints) -> tuple[Ints, Ints]:
    """Keys (e,) of the edges of cells (m, k) on which a branch ends, from its side, and the cell
    (e,) of each.
    """
    # edge by edge: numpy is slow on rows of four numbers
    corners = np.ascontiguousarray(cells.T)
    branch = points.branch[corners]
    keys = [np.empty(0, np.int64)]
    owners = [np.empty(0, np.int64)]
    for one in range(len(corners)):
        other = (one + 1) % len(corners)
        differs = branch[one] != branch[other]
        for near, far in ((one, other), (other, one)):
            some = np.flatnonzero(differs & (branch[near] != 0))
            keys.append(_key_of(corners[near, some], corners[far, some]))
            owners.append(some)
    return np.concatenate(keys), np.concatenate(owners)


def _cut(
    points: Points, cells: Ints, border: Ints, first: int, middle: Ints | None
) -> Generator[int, None, tuple[Ints, Ints]]:
    """Triangles (t, 3) of cells (m, k), and the cell (t,) of each.

    A cell's outline has 3 k places: each corner, then on the edge after it the last point on the
    corner's own branch and the first on the next corner's. The places on one branch, in order, form
    a convex piece.

    border : (b,) sorted keys of the edges with a border, whose points are those from `first` on
    """
    branch = points.branch[cells]
    following = np.roll(cells, -1, axis=1)
    differs = branch != np.roll(branch, -1, axis=1)

    # places: 0 for none, else 1 + index of the point
    places = np.zeros((*cells.shape, 3), np.int64)
    places[:, :, 0] = np.where(branch != 0, cells + 1, 0)
    for place, near, far in ((1, cells, following), (2, following, cells)):
        has_border = differs & (points.branch[near] != 0)
        key = _key_of(near[has_border], far[has_border])
        places[:, :, place][has_border] = first + 1 + np.searchsorted(border, key)
    yield 0

    group = _groups(points, cells, middle)
    yield 0
    group = np.stack([group, group, np.roll(group, -1, axis=1)], axis=2)
    places, group = (values.reshape(len(cells), 3 * cells.shape[1]) for values in (places, group))
    fans = [_fans(places, (places > 0) & (group == leader)) for leader in range(cells.shape[1])]
    yield 0
    triangles, owner = (np.concatenate(column) for column in zip(*fans, strict=True))
    return triangles - 1, owner


def _fans(places: Ints, is_member: Bools) -> tuple[Ints, Ints]:
    """Triangles (t, 3) of convex polygons, and their rows (t,). Corners are the members of a row,
    in order.
    """
    members = places[is_member]
    n_corners = is_member.sum(axis=1)
    first = np.cumsum(n_corners) - n_corners
    fans = [np.empty((0, 3), np.int64)]
    rows = [np.empty(0, np.int64)]

    for k in range(1, int(n_corners.max(initial=0)) - 1):
        row = np.flatnonzero(n_corners > k + 1)
        fans.append(members[first[row, None] + np.array([0, k, k + 1])])
        rows.append(row)

    return np.concatenate(fans), np.concatenate(rows)


def _groups(points: Points, cells: Ints, middle: Ints | None) -> Ints:
    """First corner (m, k) of the piece each corner belongs to; -1 without a landing.

    Opposite corners on one branch, between two on others, belong together only if the middle (m,)
    is on it, too.
    """
    branch = points.branch[cells]
    same = branch[:, :, None] == branch[:, None, :]
    k = cells.shape[1]
    if middle is not None:
        corner = np.arange(k)
        opposite = np.abs(corner[:, None] - corner) == 2
        is_adjacent = same & ~opposite & ~np.eye(k, dtype=bool)

        # if both corners of the other branch are isolated, the middle decides
        alone = ~is_adjacent.any(axis=2)
        saddle = ((same & opposite).any(axis=2) & alone & (branch != 0)).any(axis=1)
        holds = points.branch[middle[saddle]][:, None] == branch[saddle]
        split = alone[saddle] & ~holds
        same[saddle] &= ~(opposite[None] & split[:, :, None])

    return np.where(branch != 0, same.argmax(axis=2), -1)
