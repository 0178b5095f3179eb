"""How far may a head move from where the picture was solved for?

A head that moves looks at the picture's middle. It sees a point of the picture where the display
shows it for the solved viewers, through the glass, off by an angle from where it would see it
straight. To first order that angle grows with the way of the head: the derivative, by a small
first step, tells about how far it may go. How far it may is then settled by tracing at places of
the head, nearer and nearer to where the limit is passed.
"""

from collections.abc import Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ...base.arrays import Floats
from ...base.errors import RigError
from ...base.steps import Pauses, at, within
from ...bench.picture_room import plane_of
from ...light.compile_plan import planning
from ...light.mesh_cache import Kept
from ...light.plan import Plan
from ...map.searches import side_by_side
from ...rig.rig import Rig, Viewer
from ...rig.settings import Settings
from ..atlas.heads import Offset, check_viewer, viewer_at
from .head_box import angles_of
from .places_seen import Look, grid_on, places_of_shown, places_shown

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
    kept: Kept | None = None,
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
    plan = yield from at(0.0, planning(rig, settings, kept))
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
        self.solved = [Look(plan.seen_by(viewer), viewer.weight) for viewer in plan.rig.viewers]
        # the outermost stand for half of a step, in corners for a quarter
        along = np.array([1, *[2] * (N_POINTS - 2), 1])
        self.weights = np.outer(along, along).ravel()
        self.seen, self.begun = 0, np.inf
        self._shown: Floats | None = None  # where on the display the points are, once it is looked

    def begin(self) -> Pauses[None]:
        """Count the points that are seen from the viewer's own place."""
        off = yield from self.off((0.0, 0.0, 0.0))
        is_seen = np.isfinite(off)
        self.seen = int(self.weights[is_seen].sum())
        self.begun = float(off[is_seen].max(initial=0)) / self.limit if self.seen else np.inf

    def box(self) -> Generator[float, None, EyeBox]:
        """Find how far the head may go each way; yields progress 0..1."""
        if not self.seen:
            yield from at(0.05, self.begin())
        ways = [(sign * np.eye(3)[axis], most * self.distance) for axis, sign, most in WAYS]
        found = yield from within(self.farthest(ways), 0.1, 1.0)
        yield 1.0
        ends, are_open = zip(*found, strict=True)
        return EyeBox(*ends, limit=self.limit, least=self.least, is_open=are_open)

    def off(self, offset: Offset) -> Pauses[Floats]:
        """By how much points (n,) are off, arcmin, as seen from a place of the head; NaN where not
        seen.
        """
        head = viewer_at(self.plan.viewer, self.plan.rig.picture_place, tuple(offset))
        return (yield from self.off_by([head]))[0]

    def off_by(self, heads: Sequence[Viewer]) -> Pauses[Floats]:
        """The same (k, n) for several heads."""
        seen = yield from self.seen_by(heads)
        return angles_of(self.plan.rig.picture_place, heads, self.uv, seen)

    def seen_by(self, heads: Sequence[Viewer]) -> Pauses[Floats]:
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

    def parts(self, offsets: Sequence[Offset]) -> Pauses[list[float]]:
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

    def part(self, offset: Offset) -> Pauses[float]:
        """The same from one place."""
        return (yield from self.parts([offset]))[0]

    def farthest(
        self, ways: Sequence[tuple[Floats, float]]
    ) -> Generator[float, None, list[tuple[float, bool]]]:
        """How far, m, the head may go along each of some ways, up to so many m, and is that as far
        as it was followed? Yields progress 0..1.

        They are walked side by side: the heads of a round are looked from together.
        """
        walked = side_by_side([self._walked(way, most) for way, most in ways])
        parts, n = None, 0
        while True:
            try:
                offsets = walked.send(parts)
            except StopIteration as end:
                return end.value
            parts = yield from at(min(1.0, n / ABOUT_ROUNDS), self.parts(offsets))
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
