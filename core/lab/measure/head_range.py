"""Eye box: how far a head may move from the place the picture was solved for; surface and curves.

A moving head looks at the picture's centre. It sees a point of the picture where the display shows
it for the solved viewers, at an angle from its true place. To first order this angle is
proportional to the head's motion: a small first step gives its derivative and a guess of the limit.
Tracing from places ever closer to the limit then finds it.
"""

from collections.abc import Generator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...base.arrays import Floats, Ints
from ...base.errors import RigError
from ...base.numbers import number
from ...base.steps import Steps, hold_progress, subprogress
from ...base.vectors import normalise
from ...bench.part_sizes import plane_of
from ...glass.quartics import grid
from ...image.flat_picture import view_of_picture
from ...light.compile_plan import compile_plan_steps
from ...light.mesh_cache import MeshCache
from ...light.plan import Plan
from ...rig.rig import Rig, Viewer
from ...rig.settings import Settings
from ..atlas.heads import Offset, check_viewer, viewer_at
from ..drawing.svg import Curve, linear, points_mm, sheet
from .head_box import angles_of
from .places_seen import Observer, grid_on, places_of_shown, places_shown

LIMIT = 5.0  # arcmin
LEAST = 0.98  # of the points
N_POINTS = 11  # points of the picture, each way
# Inset of the outermost points, relative to a side: glass is worst at the edges, but on the very
# edge half of a display pixel is outside the picture.
EDGE = 0.002

# directions by axis of the viewer and sign, with their limits relative to the picture's distance
WAYS = ((0, -1, 2.0), (0, 1, 2.0), (1, 1, 2.0), (1, -1, 2.0), (2, 1, 0.95), (2, -1, 8.0))
FIRST_STEP = 1e-3  # of the picture's distance
OVER = 1.25  # times the guess, where the limit should be exceeded
N_BETWEEN = 8  # places in between that must not exceed the limit
SETTLED = 2e-3  # of the motion
ABOUT_ROUNDS = 10  # of all directions together


@dataclass(frozen=True)
class EyeBox:
    """Range of a head, m, along the axes of the solved viewer.

    left, right, up, down, nearer, farther : distance at which the error exceeds the limit or too
        little is seen; 0 if this is so at the start
    limit : largest error of a point, arcmin
    least : fraction of the points seen from the start that has to be seen, weighted by their parts
        of the picture
    is_open : in the same order, whether the head was followed no further
    """

    left: float
    right: float
    up: float
    down: float
    nearer: float
    farther: float
    limit: float
    least: float
    is_open: tuple[bool, ...]

    @property
    def ends(self) -> tuple[float, ...]:
        """Range in each direction, m, in the order of `WAYS`."""
        return self.left, self.right, self.up, self.down, self.nearer, self.farther


def eye_box(
    rig: Rig,
    settings: Settings,
    limit: float = LIMIT,
    least: float = LEAST,
    kept: MeshCache | None = None,
) -> Generator[float, None, EyeBox]:
    """Find the range of the first viewer's head before the solved display; yields progress 0..1.

    Raises
    ------
    RigError, MeshError : the viewer has no head, the picture is not a flat rectangle, or the rig
        cannot be traced
    """
    rig.check()
    settings.check()
    plan = yield from hold_progress(0.0, compile_plan_steps(rig, settings, kept))
    return (yield from Walk(plan, limit, least).box())


class Walk:
    """Motions of a head before a solved display.

    plan : of the solved rig, whose first viewer moves
    distance : from it to the picture's centre, m
    weights : (n,) part of the picture that each point represents
    seen : total weight of the points seen from the start, once counted
    begun : largest error at the start, relative to the limit

    Raises
    ------
    RigError : the viewer has no head, or the picture is not a flat rectangle
    """

    def __init__(self, plan: Plan, limit: float = LIMIT, least: float = LEAST) -> None:
        check_viewer(plan.rig, plan.viewer)
        middle = plane_of(plan.rig).middle
        self.distance = float(np.linalg.norm(middle - plan.viewer.position))
        self.uv = grid_on(plan.rig.picture_place, N_POINTS, EDGE)
        self.plan, self.limit, self.least = plan, limit, least
        self.solved = [Observer(plan.seen_by(viewer), viewer.weight) for viewer in plan.rig.viewers]
        # Points on the edge represent half of a step, at corners a quarter.
        along = np.array([1, *[2] * (N_POINTS - 2), 1])
        self.weights = np.outer(along, along).ravel()
        self.seen, self.begun = 0, np.inf
        self._shown: Floats | None = None  # display places of the points, once they are known

    def begin(self) -> Steps[None]:
        """Count the points seen from the viewer's place."""
        off = yield from self.off((0.0, 0.0, 0.0))
        is_seen = np.isfinite(off)
        self.seen = int(self.weights[is_seen].sum())
        self.begun = float(off[is_seen].max(initial=0)) / self.limit if self.seen else np.inf

    def box(self) -> Generator[float, None, EyeBox]:
        """Find the range in each direction; yields progress 0..1."""
        if not self.seen:
            yield from hold_progress(0.05, self.begin())
        ways = [(sign * np.eye(3)[axis], most * self.distance) for axis, sign, most in WAYS]
        found = yield from subprogress(self.farthest(ways), 0.1, 1.0)
        yield 1.0
        ends, are_open = zip(*found, strict=True)
        return EyeBox(*ends, limit=self.limit, least=self.least, is_open=are_open)

    def off(self, offset: Offset) -> Steps[Floats]:
        """Errors of points (n,), arcmin, from a place of the head; NaN if unseen."""
        head = viewer_at(self.plan.viewer, self.plan.rig.picture_place, tuple(offset))
        return (yield from self.off_by([head]))[0]

    def off_by(self, heads: Sequence[Viewer]) -> Steps[Floats]:
        """Errors (k, n) for several heads."""
        seen = yield from self.seen_by(heads)
        return angles_of(self.plan.rig.picture_place, heads, self.uv, seen)

    def seen_by(self, heads: Sequence[Viewer]) -> Steps[Floats]:
        """Places (k, n, 2) of the points in the viewers' images, px; NaN if unseen."""
        if self._shown is None:
            self._shown = yield from places_shown(self.solved, self.uv)
        return (yield from places_of_shown(self.plan, heads, self.uv, self._shown))

    def heads_at(self, offsets: Sequence[Offset]) -> dict[int, Viewer]:
        """Heads at given places, by number; places at the picture itself have none."""
        heads = {}
        for k, offset in enumerate(offsets):
            with suppress(RigError):
                heads[k] = viewer_at(self.plan.viewer, self.plan.rig.picture_place, tuple(offset))
        return heads

    def parts(self, offsets: Sequence[Offset]) -> Steps[list[float]]:
        """Largest error from each place of the head, relative to the limit.

        inf if too few points are seen, or the head is at the picture.
        """
        heads = self.heads_at(offsets)
        parts = [np.inf] * len(offsets)
        for k, off in zip(heads, (yield from self.off_by(list(heads.values()))), strict=True):
            is_seen = np.isfinite(off)
            if self.seen and self.weights[is_seen].sum() >= self.least * self.seen:
                parts[k] = float(off[is_seen].max()) / self.limit
        return parts

    def part(self, offset: Offset) -> Steps[float]:
        """`parts` for one place."""
        return (yield from self.parts([offset]))[0]

    def farthest(
        self, ways: Sequence[tuple[Floats, float]]
    ) -> Generator[float, None, list[tuple[float, bool]]]:
        """Range, m, in each direction up to given limits, and whether it is open; yields progress
        0..1.

        All directions advance together: the heads of a round are traced in one batch.
        """
        searches = [self._walked(way, most) for way, most in ways]
        found: list[tuple[float, bool] | None] = [None] * len(searches)
        answers: list[list[float] | None] = [None] * len(searches)
        n = 0
        while True:
            asks = {}
            for k, search in enumerate(searches):
                if found[k] is None:
                    try:
                        asks[k] = search.send(answers[k])
                    except StopIteration as end:
                        found[k] = end.value
            if not asks:
                return found
            offsets = [one for some in asks.values() for one in some]
            parts = yield from hold_progress(min(1.0, n / ABOUT_ROUNDS), self.parts(offsets))
            for k, some in asks.items():
                answers[k], parts = parts[: len(some)], parts[len(some) :]
            n += 1

    def _walked(
        self, way: Floats, most: float
    ) -> Generator[list[Floats], list[float], tuple[float, bool]]:
        """One direction, as a coroutine that yields places of the head and receives their
        errors.
        """
        first = FIRST_STEP * self.distance
        if self.begun > 1:
            return 0.0, False
        (part,) = yield [first * way]
        slope = (part - self.begun) / first
        guess = OVER * (1 - self.begun) / slope if 0 < slope < np.inf else first

        # Go on from the guess until the limit is exceeded.
        outer = min(guess, most)
        while outer < most and (yield [outer * way])[0] <= 1:
            outer = min(2 * outer, most)

        # It may be exceeded earlier for a while.
        places = np.linspace(0.0, outer, N_BETWEEN + 1)
        passed = np.flatnonzero(np.array((yield [s * way for s in places[1:]])) > 1)
        if not len(passed):
            return float(most), True
        inner, outer = places[passed[0]], places[passed[0] + 1]

        while outer - inner > SETTLED * outer:
            middle = (inner + outer) / 2
            if (yield [middle * way])[0] <= 1:
                inner = middle
            else:
                outer = middle
        return float(inner), False


NAMES = ("left", "right", "up", "down", "nearer", "farther")  # of WAYS
FILE = "eye_box.svg"
BEYOND = 1.2  # times the head's range
AT_NONE = 0.05  # of the picture's distance, if the range is 0
N_STEPS = 6  # points, one of them at the end of the range
NOTHING_SEEN = (None, None, None, None, 0.0)
DISTANCE = "distance of the head from its own place (mm)"


@dataclass(frozen=True)
class WayCurve:
    """The picture along one direction of a head's motion, by distance, m, from its start.

    way : one of NAMES
    distance_m : abscissa of the other lists
    mean_arcmin, largest_arcmin : error of points; None if none is seen
    mean_px, largest_px : the same in viewer px of an image with a constant size of the picture
    coverage : fraction of the points that is seen, 0..1
    """

    way: str
    distance_m: tuple[float, ...]
    mean_arcmin: tuple[float | None, ...]
    largest_arcmin: tuple[float | None, ...]
    mean_px: tuple[float | None, ...]
    largest_px: tuple[float | None, ...]
    coverage: tuple[float, ...]


def curves_of(walk: Walk, box: EyeBox) -> Generator[float, None, tuple[WayCurve, ...]]:
    """A curve for each direction of an eye box; yields progress 0..1.

    An open direction is followed to the picture's distance.
    """
    distances, offsets = [], [np.zeros(3)]  # common start of all directions
    for k, (axis, sign, most) in enumerate(WAYS):
        reach = box.ends[k]
        reach = min(reach, walk.distance) if box.is_open[k] else BEYOND * reach
        reach = min(reach or AT_NONE * walk.distance, most * walk.distance)
        distances.append(np.linspace(0.0, reach, N_STEPS + 1))
        offsets += [distance * sign * np.eye(3)[axis] for distance in distances[-1][1:]]

    own, *others = yield from hold_progress(0.0, _at(walk, offsets))
    yield 1.0
    found = []
    for k, name in enumerate(NAMES):
        columns = [own, *others[k * N_STEPS : (k + 1) * N_STEPS]]
        found.append(WayCurve(name, tuple(distances[k].tolist()), *zip(*columns, strict=True)))
    return tuple(found)


def _at(walk: Walk, offsets: list[Floats]) -> Steps[list[tuple[float | None, ...]]]:
    """Figures of a curve, in their order, at each place of the head."""
    heads = walk.heads_at(offsets)
    seen = yield from walk.seen_by(list(heads.values()))
    of_head = dict(zip(heads, seen, strict=True))
    return [
        _numbers(walk, heads[k], of_head[k]) if k in heads else NOTHING_SEEN
        for k in range(len(offsets))
    ]


def _numbers(walk: Walk, head: Viewer, seen: Floats) -> tuple[float | None, ...]:
    """The same for a head that sees the points at (n, 2) px of its image."""
    straight = view_of_picture(walk.plan.rig.picture_place, head, walk.uv)
    is_seen = np.isfinite(seen).all(axis=1)
    if not is_seen.any():
        return NOTHING_SEEN
    seen, straight = seen[is_seen], straight[is_seen]
    statistics = []
    for off in (head.arcmin_between(seen, straight), np.linalg.norm(seen - straight, axis=1)):
        statistics += [float(off.mean()), float(off.max())]
    return *statistics, float(walk.weights[is_seen].sum() / walk.weights.sum())


def as_data(box: EyeBox, viewer: str, curves: tuple[WayCurve, ...]) -> dict[str, Any]:
    """Record of an eye box and its curves for a report: m, arcmin, px, fractions."""
    return {
        "viewer": viewer,
        "limit_arcmin": box.limit,
        "least_share_of_seen": box.least,
        "ends_m": dict(zip(NAMES, box.ends, strict=True)),
        "is_open": dict(zip(NAMES, box.is_open, strict=True)),
        "curves": [asdict(curve) for curve in curves],
    }


def as_svg(box: EyeBox, viewer: str, curves: tuple[WayCurve, ...]) -> str:
    """Diagrams of all curves: a column for each axis, with rows for angle, px and coverage."""
    columns = []
    for one, other in ((0, 1), (2, 3), (4, 5)):
        pair = [curves[one], curves[other]]
        title = f"The head of '{viewer}': {pair[0].way} and {pair[1].way}"
        note = [
            "; ".join(
                f"{NAMES[k]} {number(1e3 * box.ends[k])} mm{' and more' if box.is_open[k] else ''}"
                for k in (one, other)
            )
            + f" within {number(box.limit)} arcmin"
        ]
        rows = (
            ("off by (arcmin)", ("largest_arcmin", "mean_arcmin")),
            ("off by (px)", ("largest_px", "mean_px")),
            ("fraction of points seen", ("coverage",)),
        )
        column = []
        for label, fields in rows:
            drawn = [
                Curve(_name(curve.way, name), points_mm(curve.distance_m, getattr(curve, name)))
                for curve in pair
                for name in fields
            ]
            column.append(linear(title, DISTANCE, label, drawn, note, is_rising=True))
        columns.append(column)
    return sheet(columns)


def _name(way: str, field: str) -> str:
    word = field.split("_")[0]
    return way if word == "coverage" else f"{way}, {word}"


N_TRACED = 3  # traced divisions of an octant's edge
N_SMOOTH = 4  # drawn divisions
MOST = 2.0  # times the limit: colours saturate here


@dataclass(frozen=True, eq=False)
class HeadSurface:
    """Points on the surface, and its triangles.

    Parameters
    ----------
    positions : (n, 3) m, world
    triangles : (m, 3), anticlockwise from outside
    off : (n,) arcmin, largest error of any point of the picture from there, up to `MOST` limits;
        also `MOST` limits if too few points are seen
    """

    positions: Floats
    triangles: Ints
    off: Floats


def surface_of(walk: Walk, box: EyeBox) -> Generator[float, None, HeadSurface]:
    """Surface of an eye box; yields progress 0..1.

    An open end is drawn no farther away than the picture.
    """
    ends = np.zeros((2, 3))
    for (axis, sign, _), extent, is_open in zip(WAYS, box.ends, box.is_open, strict=True):
        ends[int(sign > 0), axis] = min(extent, walk.distance) if is_open else extent

    coarse, faces = octahedron()
    offsets = _swelled(coarse, ends)
    parts = yield from hold_progress(0.0, walk.parts(list(offsets)))
    off = box.limit * np.minimum(parts, MOST)

    # finer, to look round
    weights, parts = grid(N_SMOOTH)
    steps = np.rint(N_SMOOTH * weights).astype(int) @ coarse[faces]
    points, first, index = np.unique(
        steps.reshape(-1, 3), axis=0, return_index=True, return_inverse=True
    )
    viewer = walk.plan.viewer
    yield 1.0
    return HeadSurface(
        positions=viewer.position + _swelled(points, ends) @ viewer.axes,
        triangles=index.reshape(len(faces), -1)[:, parts].reshape(-1, 3),
        off=(off[faces] @ weights.T).ravel()[first],
    )


def octahedron() -> tuple[Ints, Ints]:
    """Points (n, 3) on an octahedron, and its triangles (m, 3), anticlockwise from outside.

    Its corners lie N_TRACED from the centre, along right, up and forward.
    """
    weights, parts = grid(N_TRACED)
    steps = np.rint(N_TRACED * weights).astype(int)
    points, faces = [], []
    for signs in np.stack(np.meshgrid(*3 * [[-1, 1]]), axis=-1).reshape(-1, 3):
        # right, up, forward are left-handed
        turned = parts if signs.prod() < 0 else parts[:, ::-1]
        faces.append(turned + len(points) * len(steps))
        points.append(signs * steps)
    found, index = np.unique(np.concatenate(points), axis=0, return_inverse=True)
    return found, index.ravel()[np.concatenate(faces)]


def _swelled(points: Ints, ends: Floats) -> Floats:
    """Offsets (n, 3), m, of an octahedron's points (n, 3), moved out to the surface.

    ends : (2, 3) range along each axis, negative and positive
    """
    directions = normalise(points.astype(float))
    return directions * np.where(directions > 0, ends[1], ends[0])
