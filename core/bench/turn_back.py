"""The smallest turn of the glass that brings a lost part of the picture back.

Turns about axes all around are tried, in angles that grow by steps of a fixed size, until one
brings the lost light to the display, and costs no other part of the picture as much. At each angle
the axes that bring back most are tilted, too, and the best is handed on to the next angle. The
angle is then made smaller by halving, and its axis is tilted as long as that makes it smaller
still. The answer is settled by a finer trace; where that says no, larger angles are tried.
"""

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from ..base.arrays import Bools, Floats
from ..base.errors import RigError
from ..base.steps import at, within
from ..base.vectors import normalise
from ..rig.rig import Rig
from .picture_light import PlanOf, Traced
from .rotated_rig import light_turned


@dataclass(frozen=True)
class TurnSearch:
    """How turns are tried.

    step : between angles, rad; n_halvings : of the first that does it
    n_best : axes that are tilted at each angle, n_tilted : times; by tilt, rad, and half of it each
        time
    tilts_rad : of the axis that does it, one after the other
    n_grid, n_fine : points along each edge of a triangle of the picture, and to settle it
    enough : share of the lost light that has to come back
    n_growths, growth : how often, and how much, an angle grows that the finer trace finds too small
    """

    step: float = np.radians(2)
    n_halvings: int = 6
    n_best: int = 2
    n_tilted: int = 2
    tilt: float = np.radians(20)
    tilts_rad: tuple[float, ...] = (0.35, 0.17, 0.09, 0.04)
    n_grid: int = 24
    n_fine: int = 64
    enough: float = 0.95
    n_growths: int = 5
    growth: float = 1.03


TURN_SEARCH = TurnSearch()
ROUNDING = 1e-9  # of the limit


@dataclass(frozen=True, eq=False)
class TurnBack:
    """A turn of the glass about its middle.

    turn : (3,) rad about its direction, world
    brought : share of the lost light that comes back
    before, after : shares of the picture that arrive
    does_it : does enough come back? Else it is the turn that brings back most
    """

    turn: Floats
    brought: float
    before: float
    after: float
    does_it: bool

    @property
    def angle(self) -> float:
        """Rad."""
        return float(np.linalg.norm(self.turn))


def axes_around() -> Floats:
    """Directions (26, 3) all around: of a cube's faces, edges and corners."""
    ways = np.array([way for way in product((-1, 0, 1), repeat=3) if any(way)], float)
    return normalise(ways)


def turn_back(
    rig: Rig, plan_of: PlanOf, limit: float = np.radians(30)
) -> Generator[float, None, TurnBack]:
    """Find the smallest turn, of up to `limit` rad, that brings the lost
    light of the picture back; yields progress 0..1. A turn that helps within a few degrees of
    axis or angle only may be missed.

    Raises
    ------
    RigError : no light is lost
    """
    search = _Search(rig, plan_of, TURN_SEARCH.n_grid)
    yield from within(search.begin(), 0.0, 0.05)
    low, kept = 0.0, list[Floats]()

    while low < limit * (1 - ROUNDING):
        high = min(low + TURN_SEARCH.step, limit)
        done = 0.05 + 0.7 * low / limit
        found, kept = yield from at(done, _of_angle(search, kept, high))
        if found:
            turn = yield from at(done, _smallest(search, found, (low, high), limit))
            if turn.does_it:
                return turn
        low = high

    return (yield from within(search.told(search.best, False), 0.9, 1.0))


def _of_angle(
    search: "_Search", kept: list[Floats], angle: float
) -> Generator[float, None, tuple[list[Floats], list[Floats]]]:
    """Axes that do it by an angle, the best first; and the best ones, whether they do or not.

    kept : the best ones of the angle before
    """
    tried: list[tuple[float, bool, Floats]] = []
    ways = [*kept, *axes_around()]
    for n in range(1 + TURN_SEARCH.n_tilted):
        for axis in ways:
            does = yield from search.does(axis, angle)
            tried.append((search.gain, does, axis))
        tried.sort(key=lambda one: -one[0])
        best = [axis for _, _, axis in tried[: TURN_SEARCH.n_best]]
        ways = [way for axis in best for way in _tilted(axis, TURN_SEARCH.tilt / 2**n)]

    return [axis for _, does, axis in tried if does], best


def _smallest(
    search: "_Search", axes: list[Floats], between: tuple[float, float], limit: float
) -> Generator[float, None, TurnBack]:
    """The smallest turn about axes that do it by the larger of two angles, rad."""
    low, high = between
    angles = []
    for axis in axes:
        angles.append((yield from at(0.8, search.halved(axis, low, high))))
    angle = min(angles)
    axis = axes[angles.index(angle)]

    for tilt in TURN_SEARCH.tilts_rad:
        for way in _tilted(axis, tilt):
            less = angle * (1 - 0.2 * tilt)
            if (yield from at(0.85, search.does(way, less))):
                angle = yield from at(0.85, search.halved(way, low * 0.8, less))
                axis = way

    # a finer trace may find some light that needs more
    fine = _Search(search.rig, search.plan_of, TURN_SEARCH.n_fine)
    yield from at(0.9, fine.begin())
    for _ in range(TURN_SEARCH.n_growths):
        does = yield from at(0.95, fine.does(axis, angle))
        if does or angle >= limit:
            break
        angle = min(angle * TURN_SEARCH.growth, limit)
    return (yield from within(fine.told(angle * axis, does), 0.97, 1.0))


def _tilted(axis: Floats, tilt: float) -> Iterator[Floats]:
    """An axis tilted to four sides."""
    side = normalise(np.cross(axis, np.eye(3)[np.abs(axis).argmin()]))
    for way in (side, -side, np.cross(axis, side), -np.cross(axis, side)):
        yield normalise(axis + np.tan(tilt) * way)


class _Search:
    """The light of a rig whose glass is turned, and the turn that brought back most so far."""

    def __init__(self, rig: Rig, plan_of: PlanOf, n_grid: int) -> None:
        self.rig = rig
        self.plan_of = plan_of
        self.n_grid = n_grid
        self.best = np.zeros(3)
        self.gain = -1.0
        self._most = -1.0

    def begin(self) -> Generator[float, None, None]:
        """Note the light that is lost."""
        before = yield from self._light(np.zeros(3))
        self.lost: Bools = before.light.is_seen & ~before.light.has_arrived
        self.before = before.share
        if not before.weight[self.lost].sum() > 0:
            raise RigError("All of the picture arrives: there is nothing to bring back.")

    def does(self, axis: Floats, angle: float) -> Generator[float, None, bool]:
        """Does a turn bring the lost light back, and lose no more elsewhere?"""
        light = yield from self._light(angle * axis)
        brought = self.brought(light)
        gain = min(brought, 1.0 + light.share - self.before)
        self.gain = gain if light.share > self.before else gain - 1.0
        if light.share > self.before and gain > self._most:
            self._most, self.best = gain, angle * axis
        return brought >= TURN_SEARCH.enough and light.share > self.before

    def halved(self, axis: Floats, low: float, high: float) -> Generator[float, None, float]:
        """The smallest angle between two that does it, where `high` does."""
        for _ in range(TURN_SEARCH.n_halvings):
            middle = (low + high) / 2
            does = yield from self.does(axis, middle)
            low, high = (low, middle) if does else (middle, high)
        return high

    def brought(self, light: Traced) -> float:
        """The share of the lost light that arrives."""
        weight = light.weight[self.lost]
        return float(weight[light.light.has_arrived[self.lost]].sum() / weight.sum())

    def told(self, turn: Floats, does_it: bool) -> Generator[float, None, TurnBack]:
        light = yield from self._light(turn)
        return TurnBack(turn, self.brought(light), self.before, light.share, does_it)

    def _light(self, turn: Floats) -> Generator[float, None, Traced]:
        return (yield from light_turned(self.rig, turn, self.plan_of, self.n_grid))
