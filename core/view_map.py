"""Which rays to trace: the view map, viewer pixels to display pixels, as cells.

The corners of the viewer's pixels are traced. A pixel whose corners lie on one branch is one cell. Where they do
not, the border is found on the pixel's edges by bisection and the pixel is cut along it, a piece a branch.
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from .plan import Plan
from .rig import Bools, Floats, Ints
from .trace import CHUNK, Words, courses, trace

BISECTIONS = 12  # a border is known to 2^-12 of a viewer pixel
BATCH = 8192  # rays that are traced in not much more time than a few
MOST_PARTS = 4  # binary digits of a border's place that are found in one step


@dataclass(frozen=True, eq=False)
class ViewMap:
    """Cells of the viewer's image and where the display shows them.

    view_size, display_size : width, height in pixels
    view_points, display_points : (p, 2) viewer px and display px of the traced points
    throughput : (p,) of each point
    quads, triangles : (q, 4), (t, 3) indices of points, in order around each cell
    reason : (h + 1, w + 1) of Reason, at the corners of the viewer's pixels
    n_rays : rays traced
    """

    view_size: tuple[int, int]
    display_size: tuple[int, int]
    view_points: Floats
    display_points: Floats
    throughput: Floats
    quads: Ints
    triangles: Ints
    reason: np.ndarray
    n_rays: int


@dataclass(frozen=True, eq=False)
class _Points:
    """What is kept of traced points: viewer px (n, 2), landings on the display (n, 2), branch, reason, throughput."""

    view: Floats
    xy: Floats
    branch: np.ndarray
    reason: np.ndarray
    throughput: Floats


def sample(plan: Plan) -> Generator[float, None, ViewMap]:
    """Trace what the viewer sees of the display and cut it into cells; yields progress 0..1."""
    viewer, display = plan.rig.viewer, plan.rig.display
    w, h = viewer.width, viewer.height
    x, y = np.meshgrid(np.arange(w + 1.0), np.arange(h + 1.0))
    points = yield from _trace_points(plan, np.stack([x.ravel(), y.ravel()], axis=1), 0.0, 0.8)
    whole, mixed = _sort_cells(points, w, h, np.array([display.width, display.height]))
    cut = yield from _cut(plan, points, mixed)
    return ViewMap(
        (w, h),
        (display.width, display.height),
        np.concatenate([points.view, cut.view_points]),
        np.concatenate([points.xy, cut.display_points]),
        np.concatenate([points.throughput, cut.throughput]),
        whole,
        cut.triangles,
        points.reason.reshape(h + 1, w + 1),
        len(points.view) + cut.n_rays,
    )


def _sort_cells(points: _Points, w: int, h: int, display_size: Ints) -> tuple[Ints, Ints]:
    """Cells (m, 4) of the viewer's pixels that lie on one branch whole, and those that lie on it in part."""
    whole, mixed = [], []
    rows = max(1, CHUNK // w)  # a few rows at a time: a large viewer has more cells than fit in memory several times
    for first in range(0, h, rows):
        corner = np.arange(first * w, min(first + rows, h) * w, dtype=np.int32)
        corner += corner // w  # the corners of a row are one more than its pixels
        cells = np.stack([corner, corner + 1, corner + w + 2, corner + w + 1], axis=1)
        branch = points.branch[cells]
        is_one = (branch == branch[:, :1]).all(axis=1)
        is_near = _is_near_display(points.xy[cells], display_size)
        whole.append(cells[is_one & (branch[:, 0] != 0) & is_near])
        mixed.append(cells[~is_one & is_near])
    return np.concatenate(whole), np.concatenate(mixed)


def _is_near_display(xy: Floats, size: Ints) -> Bools:
    """Can cells with corners on display pixels (m, 4, 2), NaN without a landing, reach the display's image?

    The border of a cell with a corner lost may lie further out than its corners: it counts as near.
    """
    lost = np.isnan(xy).any(axis=(1, 2))
    low, high = np.fmin.reduce(xy, axis=1), np.fmax.reduce(xy, axis=1)
    return ((high > 0) & (low < size)).all(axis=1) | lost


def _trace_points(
    plan: Plan, view: Floats, start: float, stop: float, course: Words | None = None
) -> Generator[float, None, _Points]:
    """Trace viewer points (n, 2), on their courses, in chunks; yields progress from start to stop."""
    n = len(view)
    points = _Points(view, np.empty((n, 2)), np.empty(n, np.uint64), np.empty(n, np.uint8), np.empty(n))
    for first in range(0, n, CHUNK):
        some = slice(first, first + CHUNK)
        landings = trace(plan, *plan.rig.viewer.rays(view[some]), None if course is None else course[some])
        for name in ("xy", "branch", "reason", "throughput"):
            getattr(points, name)[some] = getattr(landings, name)
        yield start + (stop - start) * min(1.0, (first + CHUNK) / n)
    return points


@dataclass(frozen=True, eq=False)
class _Cut:
    view_points: Floats
    display_points: Floats
    throughput: Floats
    triangles: Ints
    n_rays: int


def _cut(plan: Plan, points: _Points, cells: Ints) -> Generator[float, None, _Cut]:
    """Cut the cells (m, 4) whose corners lie on several branches along the borders between them.

    A cell's outline has twelve places: each corner, then for the edge that follows it the last point on the
    corner's own branch and the first on the next corner's. The places on one branch, in order, are a convex piece.
    """
    m = len(cells)
    if not m:
        return _Cut(np.empty((0, 2)), np.empty((0, 2)), np.empty(0), np.empty((0, 3), np.int64), 0)
    cells = cells.astype(np.int64)
    branch, n = points.branch[cells], len(points.view)
    following = np.roll(cells, -1, axis=1)
    differs = branch != np.roll(branch, -1, axis=1)
    # each border is looked for once, from each of its two sides that has a landing
    sides = np.concatenate([
        np.stack([cells, following], axis=2)[differs & (branch != 0)],
        np.stack([following, cells], axis=2)[differs & (np.roll(branch, -1, axis=1) != 0)],
    ])  # fmt: skip
    key, inverse = np.unique(sides[:, 0] * n + sides[:, 1], return_inverse=True)
    border = yield from _bisect(plan, points, key // n, key % n)
    # places: 0 where there is none, else 1 + index of the point
    places = np.zeros((m, 4, 3), np.int64)
    places[:, :, 0] = np.where(branch != 0, cells + 1, 0)
    n_from_corner = int((differs & (branch != 0)).sum())
    number = inverse.ravel() + n + 1
    places[:, :, 1][differs & (branch != 0)] = number[:n_from_corner]
    places[:, :, 2][differs & (np.roll(branch, -1, axis=1) != 0)] = number[n_from_corner:]
    group = yield from _groups(plan, points, cells)
    place_group = np.stack([group, group, np.roll(group, -1, axis=1)], axis=2).reshape(m, 12)
    places = places.reshape(m, 12)
    triangles = [
        _fans(places, (places > 0) & (place_group == leader)) for leader in range(4)
    ]  # a leader that leads no corner gives no piece
    xy, landed, throughput, n_rays = border
    return _Cut(xy, landed, throughput, np.concatenate(triangles) - 1, n_rays)


def _fans(places: Ints, is_member: np.ndarray) -> Ints:
    """Triangles (t, 3) of the convex polygons whose corners are the members of each row, in order."""
    order = np.argsort(~is_member, axis=1, kind="stable")
    polygon = np.take_along_axis(places, order, axis=1)
    n_corners = is_member.sum(axis=1)
    fans = [
        np.stack([polygon[:, 0], polygon[:, k], polygon[:, k + 1]], axis=1)[n_corners > k + 1]
        for k in range(1, polygon.shape[1] - 1)
    ]
    return np.concatenate(fans)


def _groups(plan: Plan, points: _Points, cells: Ints) -> Generator[float, None, Ints]:
    """For each corner (m, 4) the first corner whose piece it belongs to; -1 without a landing.

    Opposite corners on one branch between two that are not belong together only when the middle is on it too.
    """
    branch = points.branch[cells]
    same = branch[:, :, None] == branch[:, None, :]
    opposite = np.zeros((4, 4), bool)
    opposite[[0, 1, 2, 3], [2, 3, 0, 1]] = True
    beside = same & ~opposite & ~np.eye(4, dtype=bool)
    alone = ~beside.any(axis=2)
    saddle = ((same & opposite).any(axis=2) & alone & (branch != 0)).any(axis=1)
    if saddle.any():
        middle = yield from _trace_points(plan, points.view[cells[saddle]].mean(axis=1), 0.98, 1.0)
        holds = middle.branch[:, None] == branch[saddle]
        split = alone[saddle] & ~holds
        same[saddle] &= ~(opposite[None] & split[:, :, None])
    return np.where(branch != 0, same.argmax(axis=2), -1)


def _bisect(
    plan: Plan, points: _Points, near: Ints, far: Ints
) -> Generator[float, None, tuple[Floats, Floats, Floats, int]]:
    """Last points on the branch of points `near` towards points `far`: viewer px, display px, throughput, rays."""
    low, high = np.zeros(len(near)), np.ones(len(near))
    xy, throughput = points.xy[near].copy(), points.throughput[near].copy()
    a, b = points.view[near], points.view[far]
    course = courses(plan, *plan.rig.viewer.rays(a))
    n_rays = len(near)
    # many places at once where there are few borders: a batch of rays costs as much as hundreds of its rays
    parts = 2 ** int(np.clip(np.log2(BATCH / len(near)), 1, MOST_PARTS))
    n_steps = int(np.ceil(BISECTIONS / np.log2(parts)))
    for k in range(n_steps):
        at = low + (high - low) * np.arange(1, parts)[:, None] / parts
        view = (a + at[..., None] * (b - a)).reshape(-1, 2)
        share = 0.18 / n_steps
        found = yield from _trace_points(
            plan, view, 0.8 + k * share, 0.8 + (k + 1) * share, np.tile(course, (parts - 1, 1))
        )
        n_rays += len(view)
        n_held = np.logical_and.accumulate(found.branch.reshape(at.shape) == points.branch[near]).sum(axis=0)
        held = np.flatnonzero(n_held)
        last = (n_held[held] - 1) * len(near) + held
        xy[held], throughput[held] = found.xy[last], found.throughput[last]
        low, high = low + (high - low) * n_held / parts, low + (high - low) * (n_held + 1) / parts
    return a + low[:, None] * (b - a), xy, throughput, n_rays
