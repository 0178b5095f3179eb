"""Which rays to trace: the view map, viewer pixels to display pixels, as cells.

The corners of the viewer's pixels are traced. A pixel whose corners lie on one branch is one cell. Where they do
not, the border is found on the pixel's edges by bisection and the pixel is cut along it, a piece a branch.
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from .plan import Plan
from .rig import Floats, Ints
from .trace import CHUNK, Landings, join, trace

BISECTIONS = 14  # a border is known to 2^-14 of a viewer pixel


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


def sample(plan: Plan) -> Generator[float, None, ViewMap]:
    """Trace what the viewer sees of the display and cut it into cells; yields progress 0..1."""
    viewer, display = plan.rig.viewer, plan.rig.display
    w, h = viewer.width, viewer.height
    x, y = np.meshgrid(np.arange(w + 1.0), np.arange(h + 1.0))
    corners = np.stack([x.ravel(), y.ravel()], axis=1)
    landings = yield from _trace_points(plan, corners, 0.0, 0.8)
    c = np.arange(w * h) // w * (w + 1) + np.arange(w * h) % w
    cells = np.stack([c, c + 1, c + w + 2, c + w + 1], axis=1)
    branch = landings.branch[cells]
    is_whole = (branch != 0).all(axis=1) & (branch == branch[:, :1]).all(axis=1)
    near = _is_near_display(landings.xy[cells], display.width, display.height)
    is_whole &= near
    is_mixed = (branch != 0).any(axis=1) & ~(branch == branch[:, :1]).all(axis=1) & near
    cut = yield from _cut(plan, corners, landings, cells[is_mixed], branch[is_mixed])
    return ViewMap(
        (w, h),
        (display.width, display.height),
        np.concatenate([corners, cut.view_points]),
        np.concatenate([landings.xy, cut.display_points]),
        np.concatenate([landings.throughput, cut.throughput]),
        cells[is_whole],
        cut.triangles,
        landings.reason.reshape(h + 1, w + 1),
        len(corners) + cut.n_rays,
    )


def _is_near_display(xy: Floats, width: int, height: int) -> np.ndarray:
    """Can cells with corners on display pixels (m, 4, 2), NaN without a landing, reach the display's image?

    The border of a cell with a corner lost may lie further out than its corners: it counts as near.
    """
    size = np.array([width, height])
    lost = np.isnan(xy).any(axis=(1, 2))
    low, high = np.fmin.reduce(xy, axis=1), np.fmax.reduce(xy, axis=1)
    return ((high > 0) & (low < size)).all(axis=1) | lost


def _trace_points(plan: Plan, points: Floats, start: float, stop: float) -> Generator[float, None, Landings]:
    parts = []
    for first in range(0, max(len(points), 1), CHUNK):
        parts.append(trace(plan, *plan.rig.viewer.rays(points[first : first + CHUNK])))
        yield start + (stop - start) * min(1.0, (first + CHUNK) / max(len(points), 1))
    return join(parts)


@dataclass(frozen=True, eq=False)
class _Cut:
    view_points: Floats
    display_points: Floats
    throughput: Floats
    triangles: Ints
    n_rays: int


def _cut(
    plan: Plan, corners: Floats, landings: Landings, cells: Ints, branch: np.ndarray
) -> Generator[float, None, _Cut]:
    """Cut the cells (m, 4) whose corners have branches (m, 4) along the borders between them.

    A cell's outline has twelve places: each corner, then for the edge that follows it the last point on the
    corner's own branch and the first on the next corner's. The places on one branch, in order, are a convex piece.
    """
    m = len(cells)
    if not m:
        return _Cut(np.empty((0, 2)), np.empty((0, 2)), np.empty(0), np.empty((0, 3), np.int64), 0)
    following = np.roll(cells, -1, axis=1)
    differs = branch != np.roll(branch, -1, axis=1)
    # each border is looked for once, from each of its two sides that has a landing
    sides = np.concatenate([
        np.stack([cells, following], axis=2)[differs & (branch != 0)],
        np.stack([following, cells], axis=2)[differs & (np.roll(branch, -1, axis=1) != 0)],
    ])  # fmt: skip
    key, inverse = np.unique(sides[:, 0] * (len(corners) + 1) + sides[:, 1], return_inverse=True)
    near, far = key // (len(corners) + 1), key % (len(corners) + 1)
    border = yield from _bisect(plan, corners, landings, near, far)
    # places: 0 where there is none, else 1 + index of the point
    places = np.zeros((m, 4, 3), np.int64)
    places[:, :, 0] = np.where(branch != 0, cells + 1, 0)
    n_from_corner = int((differs & (branch != 0)).sum())
    number = inverse.ravel() + len(corners) + 1
    places[:, :, 1][differs & (branch != 0)] = number[:n_from_corner]
    places[:, :, 2][differs & (np.roll(branch, -1, axis=1) != 0)] = number[n_from_corner:]
    group = yield from _groups(plan, corners, cells, branch)
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


def _groups(plan: Plan, corners: Floats, cells: Ints, branch: np.ndarray) -> Generator[float, None, Ints]:
    """For each corner (m, 4) the first corner whose piece it belongs to; -1 without a landing.

    Opposite corners on one branch between two that are not belong together only when the middle is on it too.
    """
    same = branch[:, :, None] == branch[:, None, :]
    opposite = np.zeros((4, 4), bool)
    opposite[[0, 1, 2, 3], [2, 3, 0, 1]] = True
    beside = same & ~opposite & ~np.eye(4, dtype=bool)
    alone = ~beside.any(axis=2)
    saddle = ((same & opposite).any(axis=2) & alone & (branch != 0)).any(axis=1)
    if saddle.any():
        middle = corners[cells[saddle]].mean(axis=1)
        landings = yield from _trace_points(plan, middle, 0.98, 1.0)
        holds = landings.branch[:, None] == branch[saddle]
        split = alone[saddle] & ~holds
        same[saddle] &= ~(opposite[None] & split[:, :, None])
    return np.where(branch != 0, same.argmax(axis=2), -1)


def _bisect(
    plan: Plan, corners: Floats, landings: Landings, near: Ints, far: Ints
) -> Generator[float, None, tuple[Floats, Floats, Floats, int]]:
    """Last points on the branch of corners `near` towards corners `far`: viewer px, display px, throughput, rays."""
    wanted = landings.branch[near]
    low, high = np.zeros(len(near)), np.ones(len(near))
    xy, throughput = landings.xy[near].copy(), landings.throughput[near].copy()
    a, b = corners[near], corners[far]
    for k in range(BISECTIONS):
        middle = 0.5 * (low + high)
        share = 0.18 / BISECTIONS
        found = yield from _trace_points(plan, a + middle[:, None] * (b - a), 0.8 + k * share, 0.8 + (k + 1) * share)
        holds = found.branch == wanted
        low, high = np.where(holds, middle, low), np.where(holds, high, middle)
        xy[holds], throughput[holds] = found.xy[holds], found.throughput[holds]
    return a + low[:, None] * (b - a), xy, throughput, BISECTIONS * len(near)
