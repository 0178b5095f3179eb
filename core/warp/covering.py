"""Which pieces of a view map show the points of a grid on the display?

A quad counts as two triangles. A point on an edge may be found in both triangles beside it.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, Ints, taken
from ..base.vectors import cross_2d
from ..image.ghosts import paths_of
from ..map.outlines import ragged
from ..map.pieces import Piece
from ..map.view_map import ViewMap
from .grid import Grid

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
        return Candidates(*(taken(values, which) for values in self))


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
