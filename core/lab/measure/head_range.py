"""How far a head may move from where the picture was solved for; as a surface and as curves.

A head that moves looks at the picture's middle. It sees a point of the picture where the display
shows it for the solved viewers, through the glass, off by an angle from where it would see it
straight. To first order that angle grows with the way of the head: the derivative, by a small
first step, predicts about how far it may go. The limit is then found by tracing at places of the
head, nearer and nearer to where it is passed.
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
from .viewer_errors import arcmin_between

LIMIT = 5.0  # arcmin
LEAST = 0.98  # of the points
N_POINTS = 11  # each way, of the picture
# of a side, how far within the picture the outermost lie: glass is worst at the edges, and right on
# them half of a display pixel is none of the picture's
EDGE = 0.002

# the ways, by the axis of the viewer, its sign, and how far at the most, of the picture's distance
WAYS = ((0, -1, 2.0), (0, 1, 2.0), (1, 1, 2.0), (1, -1, 2.0), (2, 1, 0.95), (2, -1, 8.0))
FIRST_STEP = 1e-3  # of the picture's distance
OVER = 1.25  # times the guess: there the limit should be passed
N_BETWEEN = 8  # places on the way at which nothing may be passed before
SETTLED = 2e-3  # of the way
ABOUT_ROUNDS = 10  # of all ways side by side


@dataclass(frozen=True)
class EyeBox:
    """How far the head may go, m, along the axes of the solved viewer.

    left, right, up, down, nearer, farther : to where the picture is off by the limit, or less of it
        is seen; 0 where it is from the beginning
    limit : arcmin, by which a point may be off
    least : share of the points, by the part of the picture that each stands for, that have to be
        seen, of those that are seen from the viewer's place
    is_open : in the same order, where the head was not followed any further
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
        """How far it may go each way, m, in the order of `WAYS`."""
        return self.left, self.right, self.up, self.down, self.nearer, self.farther


def eye_box(
    rig: Rig,
    settings: Settings,
    limit: float = LIMIT,
    least: float = LEAST,
    kept: MeshCache | None = None,
) -> Generator[float, None, EyeBox]:
    """Find how far the head of a rig's first viewer may go, before a display that is solved for all
    of the rig's viewers; yields progress 0..1.

    Raises
    ------
    RigError, MeshError : the viewer has no head, the picture is no flat rectangle, or the rig
        cannot be traced; one sentence
    """
    rig.check()
    settings.check()
    plan = yield from hold_progress(0.0, compile_plan_steps(rig, settings, kept))
    return (yield from Walk(plan, limit, least).box())


class Walk:
    """Ways of a head before a solved display.

    plan : of the rig whose viewers it is solved for, the first of whom moves
    distance : of the picture's middle from that one, m
    weights : (n,) of the points, as much of the picture as each stands for
    seen : weights of the points that are seen from its own place together, once they are counted
    begun : the largest of the angles by which they are off there, as part of the limit

    Raises
    ------
    RigError : it has no head, or the picture is no flat rectangle; one sentence
    """

    def __init__(self, plan: Plan, limit: float = LIMIT, least: float = LEAST) -> None:
        check_viewer(plan.viewer, plan.rig.picture_place)
        middle = plane_of(plan.rig).middle
        self.distance = float(np.linalg.norm(middle - plan.viewer.position))
        self.uv = grid_on(plan.rig.picture_place, N_POINTS, EDGE)
        self.plan, self.limit, self.least = plan, limit, least
        self.solved = [Observer(plan.seen_by(viewer), viewer.weight) for viewer in plan.rig.viewers]
        # the outermost stand for half of a step, in corners for a quarter
        along = np.array([1, *[2] * (N_POINTS - 2), 1])
        self.weights = np.outer(along, along).ravel()
        self.seen, self.begun = 0, np.inf
        self._shown: Floats | None = None  # where on the display the points are, once it is looked

    def begin(self) -> Steps[None]:
        """Count the points that are seen from the viewer's own place."""
        off = yield from self.off((0.0, 0.0, 0.0))
        is_seen = np.isfinite(off)
        self.seen = int(self.weights[is_seen].sum())
        self.begun = float(off[is_seen].max(initial=0)) / self.limit if self.seen else np.inf

    def box(self) -> Generator[float, None, EyeBox]:
        """Find how far the head may go each way; yields progress 0..1."""
        if not self.seen:
            yield from hold_progress(0.05, self.begin())
        ways = [(sign * np.eye(3)[axis], most * self.distance) for axis, sign, most in WAYS]
        found = yield from subprogress(self.farthest(ways), 0.1, 1.0)
        yield 1.0
        ends, are_open = zip(*found, strict=True)
        return EyeBox(*ends, limit=self.limit, least=self.least, is_open=are_open)

    def off(self, offset: Offset) -> Steps[Floats]:
        """By how much points (n,) are off, arcmin, as seen from a place of the head; NaN where not
        seen.
        """
        head = viewer_at(self.plan.viewer, self.plan.rig.picture_place, tuple(offset))
        return (yield from self.off_by([head]))[0]

    def off_by(self, heads: Sequence[Viewer]) -> Steps[Floats]:
        """The same (k, n) for several heads."""
        seen = yield from self.seen_by(heads)
        return angles_of(self.plan.rig.picture_place, heads, self.uv, seen)

    def seen_by(self, heads: Sequence[Viewer]) -> Steps[Floats]:
        """Where viewers see the points, (k, n, 2) px of their images, NaN where one does not see
        one.
        """
        if self._shown is None:
            self._shown = yield from places_shown(self.solved, self.uv)
        return (yield from places_of_shown(self.plan, heads, self.uv, self._shown))

    def heads_at(self, offsets: Sequence[Offset]) -> dict[int, Viewer]:
        """The heads at some places, by their numbers; none where one would be at the picture."""
        heads = {}
        for k, offset in enumerate(offsets):
            with suppress(RigError):
                heads[k] = viewer_at(self.plan.viewer, self.plan.rig.picture_place, tuple(offset))
        return heads

    def parts(self, offsets: Sequence[Offset]) -> Steps[list[float]]:
        """The largest of the angles by which points are off from each of some places of the head,
        as part of the limit; inf where too few are seen, or the head is at the picture.
        """
        heads = self.heads_at(offsets)
        parts = [np.inf] * len(offsets)
        for k, off in zip(heads, (yield from self.off_by(list(heads.values()))), strict=True):
            is_seen = np.isfinite(off)
            if self.seen and self.weights[is_seen].sum() >= self.least * self.seen:
                parts[k] = float(off[is_seen].max()) / self.limit
        return parts

    def part(self, offset: Offset) -> Steps[float]:
        """The same from one place."""
        return (yield from self.parts([offset]))[0]

    def farthest(
        self, ways: Sequence[tuple[Floats, float]]
    ) -> Generator[float, None, list[tuple[float, bool]]]:
        """How far, m, the head may go along each of some ways, up to so many m, and is that as far
        as it was followed? Yields progress 0..1.

        They are walked side by side: the heads of a round are looked from together.
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
        """The same of one way, which asks for places of the head and is sent their parts."""
        first = FIRST_STEP * self.distance
        if self.begun > 1:
            return 0.0, False
        (part,) = yield [first * way]
        slope = (part - self.begun) / first
        guess = OVER * (1 - self.begun) / slope if 0 < slope < np.inf else first

        # on from the guess until it is passed
        outer = min(guess, most)
        while outer < most and (yield [outer * way])[0] <= 1:
            outer = min(2 * outer, most)

        # it may be passed before, for a while
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
BEYOND = 1.2  # times as far as the head may go
AT_NONE = 0.05  # of the picture's distance: so far where it may go nowhere
N_STEPS = 6  # of which one ends where the head may not go on
NOTHING_SEEN = (None, None, None, None, 0.0)
DISTANCE = "distance of the head from its own place (mm)"


@dataclass(frozen=True)
class WayCurve:
    """The picture as seen along one way of a head, by its distance, m, from its own place.

    way : one of NAMES
    distance_m : to which the other lists belong
    mean_arcmin, largest_arcmin : by which points are off; None where none is seen
    mean_px, largest_px : the same, viewer px of an image in which the picture keeps its size
    coverage : share of the points that is seen, 0..1
    """

    way: str
    distance_m: tuple[float, ...]
    mean_arcmin: tuple[float | None, ...]
    largest_arcmin: tuple[float | None, ...]
    mean_px: tuple[float | None, ...]
    largest_px: tuple[float | None, ...]
    coverage: tuple[float, ...]


def curves_of(walk: Walk, box: EyeBox) -> Generator[float, None, tuple[WayCurve, ...]]:
    """A curve for each way of an eye box that a walk has found; yields progress 0..1.

    An open way is followed as far as the picture is away.
    """
    distances, offsets = [], [np.zeros(3)]  # where all ways begin
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
    """The numbers of a curve, in their order, at each of some places of the head."""
    heads = walk.heads_at(offsets)
    seen = yield from walk.seen_by(list(heads.values()))
    of_head = dict(zip(heads, seen, strict=True))
    return [
        _numbers(walk, heads[k], of_head[k]) if k in heads else NOTHING_SEEN
        for k in range(len(offsets))
    ]


def _numbers(walk: Walk, head: Viewer, seen: Floats) -> tuple[float | None, ...]:
    """The same from a head that sees the points at (n, 2) px of its image."""
    straight = view_of_picture(walk.plan.rig.picture_place, head, walk.uv)
    is_seen = np.isfinite(seen).all(axis=1)
    if not is_seen.any():
        return NOTHING_SEEN
    seen, straight = seen[is_seen], straight[is_seen]
    told = []
    for off in (arcmin_between(head, seen, straight), np.linalg.norm(seen - straight, axis=1)):
        told += [float(off.mean()), float(off.max())]
    return *told, float(walk.weights[is_seen].sum() / walk.weights.sum())


def as_data(box: EyeBox, viewer: str, curves: tuple[WayCurve, ...]) -> dict[str, Any]:
    """An eye box and its curves, as they stand in a report: m, arcmin, px, shares."""
    return {
        "viewer": viewer,
        "limit_arcmin": box.limit,
        "least_share_of_seen": box.least,
        "ends_m": dict(zip(NAMES, box.ends, strict=True)),
        "is_open": dict(zip(NAMES, box.is_open, strict=True)),
        "curves": [asdict(curve) for curve in curves],
    }


def as_svg(box: EyeBox, viewer: str, curves: tuple[WayCurve, ...]) -> str:
    """Diagrams of all curves: a column for each axis, below each other angle, px and coverage."""
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
            ("share of points that is seen", ("coverage",)),
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


N_TRACED = 3  # parts of an octant's edges between places that are traced
N_SMOOTH = 4  # parts of those that are drawn
MOST = 2.0  # times the limit: more is not told apart


@dataclass(frozen=True, eq=False)
class HeadSurface:
    """Places on the surface, and how they hang together.

    Parameters
    ----------
    positions : (n, 3) m, world
    triangles : (m, 3), anticlockwise from outside
    off : (n,) arcmin, the largest angle by which a point of the picture is off from there, up to
        `MOST` limits; as much where fewer points are seen than have to be
    """

    positions: Floats
    triangles: Ints
    off: Floats


def surface_of(walk: Walk, box: EyeBox) -> Generator[float, None, HeadSurface]:
    """The surface of an eye box that a walk has found; yields progress 0..1.

    An end where the head was not followed any further is drawn no farther away than the picture is.
    """
    ends = np.zeros((2, 3))
    for (axis, sign, _), extent, is_open in zip(WAYS, box.ends, box.is_open, strict=True):
        ends[int(sign > 0), axis] = min(extent, walk.distance) if is_open else extent

    coarse, faces = octahedron()
    offsets = _swelled(coarse, ends)
    parts = yield from hold_progress(0.0, walk.parts(list(offsets)))
    off = box.limit * np.minimum(parts, MOST)

    # finer, so that it looks round
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
    """Points (n, 3) on an octahedron with corners N_TRACED from its middle to the right, up and
    forward, and its triangles (m, 3), anticlockwise from outside.
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
    """Offsets (n, 3), m, of points (n, 3) on an octahedron, moved out to the surface whose ends
    (2, 3) are so far along each axis: those below 0 and those above.
    """
    directions = normalise(points.astype(float))
    return directions * np.where(directions > 0, ends[1], ends[0])
