"""How far may a head move from where the picture was solved for?

A head that moves looks at the picture's middle. It sees a point of the picture where the display
shows it for the solved viewers, through the glass, off by an angle from where it would see it
straight. To first order that angle grows with the way of the head: the derivative, by a small
first step, tells about how far it may go. How far it may is then settled by tracing at places of
the head, nearer and nearer to where the limit is passed.
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from ..arrays import Floats
from ..atlas.heads import Offset, check_viewer, viewer_at
from ..bench.picture_room import plane_of
from ..errors import RigError
from ..image.flat_picture import view_of_picture
from ..light.kept import Kept
from ..light.plan import Plan
from ..light.planning import planning
from ..rig import Rig, Viewer
from ..settings import Settings
from ..steps import Pauses, at
from .places_seen import Look, grid_on, place_of_shown, places_shown
from .viewers import arcmin_between

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
        found = []
        for k, (axis, sign, most) in enumerate(WAYS):
            told = 0.1 + 0.15 * k
            way = np.zeros(3)
            way[axis] = sign
            steps = self.farthest(way, self.distance, most * self.distance)
            found.append((yield from at(told, steps)))
        yield 1.0
        ends, are_open = zip(*found, strict=True)
        return EyeBox(*ends, limit=self.limit, least=self.least, is_open=are_open)

    def off(self, offset: Offset) -> Pauses[Floats]:
        """By how much points (n,) are off, arcmin, as seen from a place of the head; NaN where not
        seen.
        """
        head = viewer_at(self.plan.viewer, self.plan.rig.picture_place, tuple(offset))
        return arcmin_between(head, *(yield from self.seen_by(head)))

    def seen_by(self, head: Viewer) -> Pauses[tuple[Floats, Floats]]:
        """Where a viewer sees the points, and where it would see them straight: (n, 2) px of its
        image each, NaN where it does not see one.
        """
        if self._shown is None:
            self._shown = yield from places_shown(self.solved, self.uv)
        view = yield from place_of_shown(self.plan.seen_by(head), self.uv, self._shown)
        return view, view_of_picture(self.plan.rig.picture_place, head, self.uv)

    def part(self, offset: Offset) -> Pauses[float]:
        """The largest of the angles by which points are off, as part of the limit; inf where too
        few are seen, or the head is at the picture.
        """
        try:
            off = yield from self.off(offset)
        except RigError:
            return np.inf
        is_seen = np.isfinite(off)
        if not self.seen or self.weights[is_seen].sum() < self.least * self.seen:
            return np.inf
        return float(off[is_seen].max()) / self.limit

    def farthest(self, way: Floats, distance: float, most: float) -> Pauses[tuple[float, bool]]:
        """How far, m, the head may go along a way, and is that as far as it was followed?"""
        first = FIRST_STEP * distance
        if self.begun > 1:
            return 0.0, False
        slope = ((yield from self.part(first * way)) - self.begun) / first
        guess = OVER * (1 - self.begun) / slope if 0 < slope < np.inf else first

        # on from the guess until it is passed
        outer = min(guess, most)
        while outer < most and (yield from self.part(outer * way)) <= 1:
            outer = min(2 * outer, most)

        # it may be passed before, for a while
        inner = 0.0
        for s in np.linspace(0.0, outer, N_BETWEEN + 1)[1:]:
            if (yield from self.part(s * way)) > 1:
                outer = s
                break
            inner = s
        if inner == outer:
            return float(most), True

        while outer - inner > SETTLED * outer:
            middle = (inner + outer) / 2
            if (yield from self.part(middle * way)) <= 1:
                inner = middle
            else:
                outer = middle
        return float(inner), False
