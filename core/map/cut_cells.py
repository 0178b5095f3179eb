"""Cuts cells into pieces along borders. These are found on edges, from each side with a landing."""

from collections.abc import Generator
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Ints, taken
from ..base.steps import Pauses
from ..light.plan import Plan
from .bisection import Edges, last_on_branch, n_digits
from .known_borders import Borders, key_of, points_of
from .points import Points
from .ray_budget import Allowance
from .searches import Search, ask, side_by_side, traced
from .strips import find_strips


def lack(plan: Plan, points: Points, near: Ints, far: Ints, allowance: Allowance) -> Bools:
    """Do borders on edges (n,), as for `find_borders`, take more rays than their pixels have?"""
    n = len(near)
    # by bisection, from the other side after one try, and the ray beyond a border to the dark
    is_second = (points.branch[far] != 0) & (near > far)
    n_rays = n_digits(plan) + (is_second | (points.branch[far] == 0))
    view = np.concatenate([_middle(points, near, far), points.view[near]])
    lacks = allowance.lacks(view, np.append(n_rays, np.ones(n, np.int64)))
    return lacks[:n] | lacks[n:]


def _middle(points: Points, near: Ints, far: Ints) -> Floats:
    """Viewer px (n, 2) of the middles of edges: their rays start in the same pixel."""
    return (points.view[near] + points.view[far]) / 2


def find_borders(
    plan: Plan, points: Points, near: Ints, far: Ints, allowance: Allowance
) -> Search[tuple[Points, Ints, Points, Bools]]:
    """Borders on edges (n,) from points `near` to points `far`, sorted by near, then far.

    Returns the last points (n,) on the branch of the near ones; and the ends (n, 2 MOST_STRIPS) of
    strips beyond, with their points, as of `find_strips`, and where (n,) these were given up for
    want of rays. Where both ends have a landing the other's branch most often begins where the
    one's ends: it is looked for there first.
    """
    # several borders begin at one point
    once, at_near = np.unique(near, return_inverse=True)
    _, course = yield from ask(taken(points.view, once))
    edges = Edges(near, far, course[at_near], np.ones(len(near)))

    # the other side of each border, where it is looked for, too
    n = len(points)
    key, back = near * n + far, far * n + near
    at = np.minimum(np.searchsorted(key, back), len(key) - 1)
    is_second = (key[at] == back) & (near > far)
    first = np.flatnonzero(~is_second)
    second = np.flatnonzero(is_second)
    ends, found, _ = yield from last_on_branch(plan, points, edges.at(first))

    # the second side, where the first has told about where it
    # ends; meanwhile strips, none of which has a second side
    rank = np.empty(len(near), np.int64)
    rank[first] = np.arange(len(first))
    of_second = edges.at(second)._replace(end=np.minimum(1 - ends[rank[at[second]]], 1.0))
    # the most that these may take counts until it is known what they have taken, so that the
    # strips' rays are the same however far they are
    pending = _middle(points, near[second], far[second])
    allowance.take(pending, n_digits(plan) + 1)
    (_, others, n_tried), (strips_of_first, of_strips, is_given_up) = yield from side_by_side([
        last_on_branch(plan, points, of_second, takes=False),
        find_strips(plan, points, near[first], far[first], ends, allowance),
    ])  # fmt: skip
    allowance.take(pending, n_tried - n_digits(plan) - 1)

    strips = np.zeros((len(near), strips_of_first.shape[1]), np.int64)
    strips[first] = strips_of_first
    given_up = np.zeros(len(near), bool)
    given_up[first] = is_given_up
    order = np.argsort(np.concatenate([first, second]))
    return found.and_more(others).at(order), strips, of_strips, given_up


class Sides(NamedTuple):
    """Edges of cells (m, k) on which a branch ends, each from its side, with no known border.

    key, cell : (e,) of the edges by `key_of`, and the cells that they are of
    new : (u,) each key once, sorted
    """

    cells: Ints
    key: Ints
    cell: Ints
    new: Ints


class Cut(NamedTuple):
    """Cells (m,) that were cut: all points, and all borders that are known by now.

    pieces, owner : triangles (t, 3), and the cells (t,) they are pieces of
    lacks (m,) : cells that were not cut, for want of rays
    """

    points: Points
    known: Borders
    pieces: Ints
    owner: Ints
    lacks: Bools


def cut_cells(
    plan: Plan,
    points: Points,
    sides: Sides,
    known: Borders,
    allowance: Allowance,
    middle: Ints | None = None,
) -> Generator[int, None, Cut]:
    """Cut the cells (m, k) of sides, as far as there is an allowance for the rays.

    Cells with four corners have middles (m,), points that were traced.
    """
    cells, key, of_cell, new = sides
    lacks = np.zeros(len(cells), bool)
    if not len(cells):
        return Cut(points, known, np.empty((0, 3), np.int64), np.empty(0, np.int64), lacks)

    # each border is looked for once, from each of its two sides that has a landing
    number = np.searchsorted(new, key)
    yield 0
    lacks[of_cell[lack(plan, points, *points_of(new), allowance)[number]]] = True
    yield 0

    # of cells that lack no ray
    is_wanted = np.zeros(len(new), bool)
    is_wanted[number[~lacks[of_cell]]] = True
    new = new[is_wanted]
    near, far = points_of(new)
    yield 0
    border, strips, of_strips, is_given_up = yield from traced(
        plan, find_borders(plan, points, near, far, allowance), allowance
    )
    lacks[of_cell[np.isin(key, new[is_given_up])]] = True
    number = len(points) + np.arange(len(new))
    strips = np.where(strips > 0, strips + len(points) + len(new), 0)
    known = known.and_more(Borders(new, number, strips))
    yield 0
    points = Points.joined([points, border, of_strips])
    yield 0

    some = np.flatnonzero(~lacks)
    pieces, owner = yield from _cut(
        points, cells[some], known, None if middle is None else middle[some]
    )
    return Cut(points, known, pieces, some[owner], lacks)


def find_sides(points: Points, cells: Ints, known: Borders) -> Pauses[Sides]:
    """The edges of cells (m, k) with a border that is not known yet."""
    cells = cells.astype(np.int64)
    key, of_cell = _sides(points, cells)
    yield 0
    is_new = ~known.find(key)[0]
    key, of_cell = key[is_new], of_cell[is_new]
    yield 0
    return Sides(cells, key, of_cell, np.unique(key))


def around_middles(cells: Ints) -> Ints:
    """Four triangles (4 m, 3) around the middle of each cell (m, 5), given after its corners."""
    return np.concatenate([cells[:, [4, k, (k + 1) % 4]] for k in range(4)])


def _sides(points: Points, cells: Ints) -> tuple[Ints, Ints]:
    """Keys (e,) of the edges of cells (m, k) on which a branch ends, from its side, and the
    cells (e,) that they are of.
    """
    # edge by edge: numpy is slow where rows are four numbers long
    corners = np.ascontiguousarray(cells.T)
    branch = points.branch[corners]
    keys = [np.empty(0, np.int64)]
    owners = [np.empty(0, np.int64)]
    for one in range(len(corners)):
        other = (one + 1) % len(corners)
        differs = branch[one] != branch[other]
        for near, far in ((one, other), (other, one)):
            some = np.flatnonzero(differs & (branch[near] != 0))
            keys.append(key_of(corners[near, some], corners[far, some]))
            owners.append(some)
    return np.concatenate(keys), np.concatenate(owners)


def _cut(
    points: Points, cells: Ints, known: Borders, middle: Ints | None
) -> Generator[int, None, tuple[Ints, Ints]]:
    """Triangles (t, 3) of cells (m, k) whose borders are known, and the cells (t,) they are
    pieces of.

    A cell's outline has 3 k places: each corner, then for the edge that follows it the last point
    on the corner's own branch and the first on the next corner's. Between these two are the ends of
    strips. The places on one branch, in order, are a convex piece.
    """
    m, k = cells.shape
    branch = points.branch[cells]
    following = np.roll(cells, -1, axis=1)
    differs = branch != np.roll(branch, -1, axis=1)

    # places: 0 where there is none, else 1 + index of the point
    places = np.zeros((m, k, 3), np.int64)
    places[:, :, 0] = np.where(branch != 0, cells + 1, 0)
    for place, near, far in ((1, cells, following), (2, following, cells)):
        has_border = differs & (points.branch[near] != 0)
        key = key_of(near[has_border], far[has_border])
        places[:, :, place][has_border] = known.number[known.find(key)[1]] + 1

    yield 0
    group = _groups(points, cells, middle)
    yield 0
    of_place = np.stack([group, group, np.roll(group, -1, axis=1)], axis=2)
    yield 0
    on_edges = known.strips_on(cells, following)
    yield 0

    # cells with strips have more places
    has_strips = (on_edges > 0).any(axis=(1, 2))
    plain = np.flatnonzero(~has_strips)
    others = np.flatnonzero(has_strips)
    on_edges = on_edges[others]
    of_strip = _groups_of_strips(points, branch[others], group[others], on_edges)
    yield 0
    found = [
        (plain, places[plain], of_place[plain]),
        (others, _between(places[others], on_edges), _between(of_place[others], of_strip)),
    ]
    pieces = []
    for some in found:
        pieces.append(_pieces(*some))
        yield 0
    triangles, owner = (np.concatenate(column) for column in zip(*pieces, strict=True))

    return triangles - 1, owner


def _between(of_places: Ints, of_strips: Ints) -> Ints:
    """Values at the places (m, k, 3) of cells' outlines, and at the ends of strips (m, k, s)."""
    return np.concatenate([of_places[:, :, :2], of_strips, of_places[:, :, 2:]], axis=2)


def _pieces(cells: Ints, places: Ints, group: Ints) -> tuple[Ints, Ints]:
    """Triangles (t, 3) of cells (m,) with places (m, k, s) in
    groups, and the cells (t,) they are pieces of.
    """
    _, k, n_places = places.shape
    places, group = (values.reshape(len(cells), k * n_places) for values in (places, group))
    # a leader that leads no corner gives no piece
    pieces = [
        _fans(places, (places > 0) & (group == leader)) for leader in np.unique(group[group >= 0])
    ]
    triangles = [np.empty((0, 3), np.int64), *(fan for fan, _ in pieces)]
    owner = [np.empty(0, np.int64), *(cells[rows] for _, rows in pieces)]
    return np.concatenate(triangles), np.concatenate(owner)


def _groups_of_strips(points: Points, branch: Ints, group: Ints, on_edges: Ints) -> Ints:
    """The groups (m, k, s) of strips' ends: those of a corner (m, k) on their
    branch, or else of their own; -1 where there is none.
    """
    m, k, n_ends = on_edges.shape
    ends = on_edges.reshape(m, k * n_ends)
    of_end = np.where(ends > 0, points.branch[ends - 1], 0)
    known = np.concatenate([branch, of_end], axis=1)

    leader = (of_end[:, :, None] == known[:, None, :]).argmax(axis=2)
    of_corner = np.take_along_axis(group, np.minimum(leader, k - 1), axis=1)
    found = np.where(leader < k, of_corner, leader)

    return np.where(ends > 0, found, -1).reshape(on_edges.shape)


def _fans(places: Ints, is_member: np.ndarray) -> tuple[Ints, Ints]:
    """Triangles (t, 3) of convex polygons, whose corners are the
    members of each row in order, and the rows (t,).
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
    """For each corner (m, k) the first corner whose piece it belongs to; -1 without a landing.

    Opposite corners on one branch between two that are not
    belong together only when the middle (m,) is on it too.
    """
    branch = points.branch[cells]
    same = branch[:, :, None] == branch[:, None, :]
    k = cells.shape[1]
    if middle is not None:
        corner = np.arange(k)
        opposite = np.abs(corner[:, None] - corner) == 2
        beside = same & ~opposite & ~np.eye(k, dtype=bool)

        # where both corners of the other branch stand alone the middle decides
        alone = ~beside.any(axis=2)
        saddle = ((same & opposite).any(axis=2) & alone & (branch != 0)).any(axis=1)
        holds = points.branch[middle[saddle]][:, None] == branch[saddle]
        split = alone[saddle] & ~holds
        same[saddle] &= ~(opposite[None] & split[:, :, None])

    return np.where(branch != 0, same.argmax(axis=2), -1)
