"""Traced points of the viewer's image, and the paths of their rays."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, fields

import numpy as np

from ..base.arrays import Bools, Floats, Ints, take, transpose_rows
from ..base.steps import Steps, run_steps
from ..base.vectors import cross_2d
from ..light.beams import beams
from ..light.plan import Plan
from ..light.rays import Reason, Step, Words, main_landings, main_of
from ..light.trace import TRACED_AT_ONCE, recording, tracing
from ..rig.viewer import Viewer

RAYS_AT_ONCE = 1 << 14  # traced together if their paths or courses are recorded
TRIANGLE_SLACK = 1e-9  # fraction of a triangle: its corners count as inside
BYTES_OF_POINT = 100  # for each point of a map, and for its copy while more are added
MOST_EVENTS = 12  # stored events of a path
PATHS_GROWTH = 1.5  # growth of the room for paths when it is full


@dataclass(frozen=True, eq=False)
class Points:
    """Traced points: viewer px (n, 2), landings on the display, px (n, 2), branch, reason,
    throughput (n,), and beam (n, 2) among the display's views, None if it has none.
    """

    view: Floats
    xy: Floats
    branch: np.ndarray
    reason: np.ndarray
    throughput: Floats
    beam: Floats | None = None

    def __len__(self) -> int:
        return len(self.view)

    @classmethod
    def none(cls) -> "Points":
        two = np.empty((0, 2))
        return cls(two, two, np.empty(0, np.uint64), np.empty(0, np.uint8), np.empty(0))

    def at(self, which: Ints) -> "Points":
        of_each = (getattr(self, f.name) for f in fields(Points))
        return Points(*(None if values is None else take(values, which) for values in of_each))

    def and_more(self, others: "Points") -> "Points":
        """These points, followed by others."""
        return self.joined([self, others])

    @classmethod
    def joined(cls, parts: "Sequence[Points]") -> "Points":
        """Points of several sets, in order."""
        return run_steps(cls.join_steps(parts))

    @classmethod
    def join_steps(cls, parts: "Sequence[Points]") -> "Steps[Points]":
        """`joined`, with pauses: millions of points take a third of a second."""
        arrays = []
        for name in (f.name for f in fields(cls)):
            values = [x for p in parts if (x := getattr(p, name)) is not None]
            arrays.append(np.concatenate(values) if values else None)
            yield 0
        return cls(*arrays)


class Paths:
    """Paths of traced rays, up to the twelfth event, in the order of the points.

    places : (n, k + 1, 3) m, the viewer first, NaN after the last; k events in the longest path
    hits : (n, k) patches, -1 after the last
    reach : m, length of a path's last part if the ray leaves the rig
    """

    def __init__(self, reach: float) -> None:
        self.reach = reach
        self._n = 0
        self._places, self._hits = np.empty((0, 2, 3)), np.empty((0, 1), np.int32)

    @property
    def places(self) -> Floats:
        return self._places[: self._n]

    @property
    def hits(self) -> Ints:
        return self._hits[: self._n]

    def add(self, origins: Floats, steps: list[Step]) -> None:
        """Add the paths of rays from origins (n, 3)."""
        steps = steps[:MOST_EVENTS]
        first = self._n
        self._n += len(origins)
        capacity, width = self._hits.shape
        if self._n > capacity or len(steps) > width:
            larger = max(self._n, int(PATHS_GROWTH * capacity))
            self._grow(larger if self._n > capacity else capacity, max(len(steps), width))

        places = self.places[first:]
        hits = self.hits[first:]
        places[:], hits[:] = np.nan, -1
        places[:, 0] = origins

        for k, step in enumerate(steps):
            places[step.left, k + 1] = step.start + self.reach * step.direction
            places[step.rays, k + 1], hits[step.rays, k] = step.place, step.patch

    def _grow(self, n: int, m: int) -> None:
        """Extend the arrays to n rays and m events."""
        places = np.empty((n, m + 1, 3))
        hits = np.empty((n, m), np.int32)
        for new, old, nothing in ((places, self._places, np.nan), (hits, self._hits, -1)):
            n_old, width = old.shape[:2]
            new[:n_old, :width], new[:n_old, width:] = old, nothing
        self._places, self._hits = places, hits


def trace_points(
    plan: Plan,
    view: Floats,
    course: Words | None = None,
    paths: Paths | None = None,
    courses: list[Words] | None = None,
) -> Generator[int, None, Points]:
    """Trace viewer points (n, 2), on their courses; yields the number of rays traced since.

    A map has one landing at a point: the main one if light splits.

    paths : records the paths
    courses : receives the rays' courses, a chunk at a time
    """
    n = len(view)
    points = Points(
        view, np.empty((n, 2)), np.empty(n, np.uint64), np.empty(n, np.uint8), np.empty(n),
        None if plan.rig.display.views is None else np.empty((n, 2)),
    )  # fmt: skip

    at_once = TRACED_AT_ONCE
    if paths is not None or courses is not None:
        at_once = plan.tracer.rays_at_once(plan, RAYS_AT_ONCE)
    for first in range(0, n, at_once):
        some = slice(first, first + at_once)
        origins, directions = plan.viewer.rays(view[some])
        steps = None if paths is None else []
        if courses is None:
            found = yield from tracing(
                plan, origins, directions, None if course is None else course[some], steps
            )
        else:
            found, taken_by_them = yield from recording(plan, origins, directions)
            if plan.n_copies:
                taken_by_them = taken_by_them[main_of(found, len(origins))]
            courses.append(taken_by_them)
        yield 0
        landings = main_landings(found, len(origins))
        if paths is not None:
            paths.add(origins, steps)

        for name in ("xy", "branch", "reason", "throughput"):
            getattr(points, name)[some] = getattr(landings, name)
        if points.beam is not None:
            points.beam[some] = beam = beams(plan, landings)
            is_outside = landings.has_arrived & ~plan.rig.display.views.are_within(beam)
            points.reason[some][is_outside] = Reason.OUTSIDE_CONE

        yield 0

    return points


# traces places (n, 2) of the viewer's image, for rows (n,) of a table
Tracer = Callable[[Ints, Floats], Steps[Points]]


def tracer(plan: Plan) -> Tracer:
    """Tracer of places on the image of a plan's viewer."""
    return lambda _, view: trace_points(plan, view)


def tracer_of(plan: Plan, viewers: Sequence[Viewer], n: int) -> Tracer:
    """Tracer of places on the images of several viewers together, through the surfaces of a plan.

    Each viewer has n rows, in order. A batch of few rays takes nearly as long as one of many.
    """

    def trace(rows: Ints, view: Floats) -> Steps[Points]:
        whose = rows // n
        origins, directions = np.empty((2, len(view), 3))
        for k in np.unique(whose):
            some = whose == k
            origins[some], directions[some] = viewers[k].rays(view[some])
        found = yield from tracing(plan, origins, directions)
        landings = main_landings(found, len(view))
        return Points(view, landings.xy, landings.branch, landings.reason, landings.throughput)

    return trace


def areas(points: Floats, triangles: Ints) -> Floats:
    """Areas (t,) of triangles (t, 3) between points (n, 2)."""
    (ax, ay), (bx, by), (cx, cy) = (take(points, corner).T for corner in triangles.T)
    return 0.5 * np.abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))


def in_triangles(view: Floats, xy: Floats, at: Floats) -> tuple[Bools, Floats]:
    """Whether points (n, 2) are in triangles (n, 3, 2) of the viewer's image, and their display px
    (n, 2).
    """
    a = view[:, 1] - view[:, 0]
    b = view[:, 2] - view[:, 0]
    p = at - view[:, 0]

    with np.errstate(invalid="ignore", divide="ignore"):
        det = cross_2d(a, b)
        u = cross_2d(p, b) / det
        v = cross_2d(a, p) / det
        inside = (u >= -TRIANGLE_SLACK) & (v >= -TRIANGLE_SLACK) & (u + v <= 1 + TRIANGLE_SLACK)
        return inside, xy[:, 0] + u[:, None] * (xy[:, 1] - xy[:, 0]) + v[:, None] * (
            xy[:, 2] - xy[:, 0]
        )


def is_in_image(xy: Floats, display_size: tuple[int, int]) -> Bools:
    """Whether display pixels (n, 2) are in the image; false without a landing."""
    x, y = xy.T  # numpy is slow where rows are two numbers long
    width, height = display_size
    return (x >= 0) & (x <= width) & (y >= 0) & (y <= height)


def is_seen(a: Floats, b: Floats, display_size: tuple[int, int]) -> Bools:
    """Whether display px a or b (n, 2) is in the image: light outside by both does not matter."""
    return is_in_image(a, display_size) | is_in_image(b, display_size)


def bounds_of(xy: Floats) -> tuple[Floats, Floats]:
    """Least and greatest x and y (n, 2) of display pixels (n, k, 2), NaN without a landing."""
    by_corner = transpose_rows(xy)
    return np.fmin.reduce(by_corner).T, np.fmax.reduce(by_corner).T
